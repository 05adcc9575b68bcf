//! Splats in an atmosphere. Its tables are linear, so what is between their texels is known.

use glam::Vec2;
use stylegaussian::light::Atmosphere;

use super::*;

const LIGHT_SIZE: Vec3 = Vec3::new(6.0, 5.0, 4.0);
const TRANSMITTANCE_SIZE: Vec2 = Vec2::new(8.0, 6.0);

/// L at a place in the texture. Beyond the centers of the outer texels, it is as in them.
fn log_light(uvw: Vec3) -> Vec3 {
    let at = (uvw * LIGHT_SIZE - 0.5).clamp(Vec3::ZERO, LIGHT_SIZE - 1.0);
    Vec3::new(-2.2, -1.9, -1.5)
        + at.x * Vec3::new(0.1, 0.0, -0.05)
        + at.y * Vec3::new(0.0, 0.08, 0.04)
        + at.z * Vec3::splat(0.2)
}

/// T likewise.
fn transmittance(uv: Vec2) -> Vec3 {
    let at = (uv * TRANSMITTANCE_SIZE - 0.5).clamp(Vec2::ZERO, TRANSMITTANCE_SIZE - 1.0);
    Vec3::new(0.75, 0.65, 0.6) - at.x * Vec3::new(0.02, 0.04, 0.05) + at.y * Vec3::new(0.03, 0.04, 0.05)
}

/// A texture of the values at the centers of its texels.
fn table(
    gpu: &HeadlessDevice,
    [width, height, depth]: [u32; 3],
    dimension: wgpu::TextureDimension,
    value: impl Fn(Vec3) -> Vec3,
) -> wgpu::TextureView {
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: depth };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let mut texels = Vec::new();
    for z in 0..depth {
        for y in 0..height {
            for x in 0..width {
                let center = Vec3::new(x as f32, y as f32, z as f32) + 0.5;
                let value = value(center / Vec3::new(width as f32, height as f32, depth as f32));
                texels.push(value.extend(0.0).to_array().map(|channel| f16::from_f32(channel).to_bits()));
            }
        }
    }
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(8 * width),
        rows_per_image: Some(height),
    };
    gpu.queue.write_texture(texture.as_image_copy(), bytemuck::cast_slice(&texels), layout, size);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

fn aerial(gpu: &HeadlessDevice, atmosphere: Atmosphere) -> AerialPerspective {
    let light = LIGHT_SIZE.to_array().map(|side| side as u32);
    let [width, height] = TRANSMITTANCE_SIZE.to_array().map(|side| side as u32);
    let by_place = |place: Vec3| transmittance(place.truncate());
    AerialPerspective {
        atmosphere,
        light: table(gpu, light, wgpu::TextureDimension::D3, log_light),
        transmittance: table(gpu, [width, height, 1], wgpu::TextureDimension::D2, by_place),
    }
}

/// A small planet, whose horizon is in the middle of the scene.
fn atmosphere(camera: &Camera) -> Atmosphere {
    Atmosphere {
        inner_radius: 60.0,
        thickness: 30.0,
        altitude: 2.0,
        up: Vec3::new(0.1, 0.9, 0.2).normalize(),
        meters_from_view: 1.5 * Mat3::from_rotation_x(0.3),
        clip_from_view: camera.clip_from_view,
        max_distance: 20.0,
        n_slices: LIGHT_SIZE.z as u32,
        exposure: 0.8,
        is_gray: false,
    }
}

/// How far a ray goes down: 1 if it touches the ground, more if it meets it.
fn descent(atmosphere: &Atmosphere, ray: Vec3) -> f32 {
    let &Atmosphere { inner_radius, altitude, up, .. } = atmosphere;
    let along = ((inner_radius + altitude) * ray.normalize().dot(up)).min(0.0);
    along * along / (altitude * (altitude + 2.0 * inner_radius))
}

#[test]
fn records_in_an_atmosphere_match() {
    let Some(stage) = Stage::new(76) else { return };
    let turned = Camera {
        world_from_view: Affine3A::from_rotation_y(0.2) * before_scene().world_from_view,
        ..before_scene()
    };
    // A picture that takes a part of the camera's, as those of half the size do.
    let part = Mat4::from_scale(Vec3::new(0.5, 0.7, 1.0)) * turned.clip_from_view;
    let cases = [
        (before_scene(), atmosphere(&before_scene()), None, Tonemapping::None, Curve::Linear),
        (
            turned.clone(),
            Atmosphere { is_gray: true, clip_from_view: part, ..atmosphere(&turned) },
            Some(fogs()[1].clone()),
            Tonemapping::Reinhard,
            Curve::Reinhard,
        ),
    ];
    for (camera, atmosphere, fog, tonemapping, curve) in cases {
        let mut view = SplatView::new();
        let light = ViewLight { fog: fog.clone(), tonemapping, ..ViewLight::default() };
        let before = stage.shown(&mut view, &camera);
        view.set_light(Some(ViewLight {
            aerial: Some(aerial(&stage.gpu, atmosphere.clone())),
            ..light.clone()
        }));
        let after = stage.shown(&mut view, &camera);
        let (mut n_above, mut n_below, mut most) = (0, 0, 0.0_f32);
        for (i, (before, after)) in before.iter().zip(&after).enumerate() {
            let (Some((color, _)), Some((found, _))) = (before, after) else { continue };
            let ray = stage.ray(&camera, i);
            let air = fog.as_ref().map_or(Air::CLEAR, |fog| fog.along(ray));
            let seen = camera.world_from_view.inverse().transform_vector3(ray);
            let descent = descent(&atmosphere, seen);
            // Rounding decides at the horizon.
            if (descent - 1.0).abs() < 0.01 {
                continue;
            }
            let behind = atmosphere.behind_atmosphere(air, seen, log_light, transmittance);
            let lit = |air| Lit {
                tint: Mat3::IDENTITY,
                shade: 1.0,
                air,
                display: Display { curve, exposure: 0.0 },
            };
            let expected = lit(behind).color(*color);
            // Tables and records are f16, and GPUs find places between texels to 1/256.
            let error = (*found - expected).abs().max_element();
            assert!(error < 6e-3, "{curve:?}: {i} is {found}, expected {expected}");
            most = most.max((expected - lit(air).color(*color)).abs().max_element());
            *(if descent > 1.0 { &mut n_below } else { &mut n_above }) += 1;
        }
        assert!(n_above > 50 && n_below > 50, "{n_above} above the horizon and {n_below} below");
        assert!(most > 0.1, "the atmosphere is hardly seen: {most}");

        // Lit once, and again in each frame.
        let HeadlessDevice { device, queue, .. } = &stage.gpu;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        stage.pass.light_in_atmosphere(device, &mut encoder, &mut view);
        queue.submit([encoder.finish()]);
        assert!(stage.records(&view) == after);
        assert!(stage.shown(&mut view, &camera) == after);
        // One without a size is none, and leaves the light of others.
        let unusable = Atmosphere { thickness: 0.0, ..atmosphere };
        view.set_light(Some(ViewLight { aerial: Some(aerial(&stage.gpu, unusable)), ..light.clone() }));
        let without = stage.shown(&mut view, &camera);
        view.set_light(Some(light));
        assert!(stage.shown(&mut view, &camera) == without && without != after);
        view.set_light(None);
        assert!(stage.shown(&mut view, &camera) == before);
    }
}
