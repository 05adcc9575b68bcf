//! Splats in the shadow of what maps of constant depth hold.

use stylegaussian::light::{Cone, ShadowLamp};

use super::*;

/// A square texture of these depths, each all over its layer.
fn layers(gpu: &HeadlessDevice, depths: &[f32]) -> wgpu::Texture {
    let HeadlessDevice { device, queue, .. } = gpu;
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: 8, height: 8, depth_or_array_layers: depths.len() as u32 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Depth32Float,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    for (layer, &depth) in (0..).zip(depths) {
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        });
        drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(depth),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        }));
    }
    queue.submit([encoder.finish()]);
    texture
}

/// Shadows by maps and cubes of these depths.
fn shadows(
    gpu: &HeadlessDevice,
    (maps, cubes): (&[f32], &[f32]),
    cascades: Vec<ShadowCascade>,
    lamps: Vec<ShadowLamp>,
) -> Shadows {
    let view = |depths: &[f32], dimension| {
        let descriptor = wgpu::TextureViewDescriptor { dimension: Some(dimension), ..Default::default() };
        layers(gpu, depths).create_view(&descriptor)
    };
    Shadows {
        maps: view(maps, wgpu::TextureViewDimension::D2Array),
        cubes: view(cubes, wgpu::TextureViewDimension::CubeArray),
        cascades,
        lamps,
    }
}

/// Compares the first cloud, which loses `amount` in shadow, with the share of its light that `shade` says it
/// keeps, `None` where rounding decides. Returns how many splats are darker than lit by half the amount, and
/// how many are not.
#[track_caller]
fn check(
    stage: &Stage,
    camera: &Camera,
    shadows: &Shadows,
    amount: f32,
    shade: impl Fn(Vec3, f32) -> Option<f32>,
) -> [u32; 2] {
    let mut view = SplatView::new();
    let before = stage.shown(&mut view, camera);
    view.set_light(Some(ViewLight {
        shadows: Some(shadows.clone()),
        shadow_amounts: vec![amount],
        ..ViewLight::default()
    }));
    let after = stage.shown(&mut view, camera);
    let mut n = [0; 2];
    for (i, (before, after)) in before.iter().zip(&after).enumerate().take(N) {
        let (Some((color, _)), Some((found, _))) = (before, after) else { continue };
        let ray = stage.ray(camera, i);
        let depth = -camera.world_from_view.inverse().transform_vector3(ray).z;
        let at = ray + Vec3::from(camera.world_from_view.translation);
        let Some(shade) = shade(at, depth) else { continue };
        let display = Display { curve: Curve::Linear, exposure: 0.0 };
        let expected = Lit { tint: Mat3::IDENTITY, shade, air: Air::CLEAR, display }.color(*color);
        let error = (*found - expected).abs().max_element();
        assert!(error < 3e-3, "{i}: {found}, expected {expected}, shade {shade}");
        n[usize::from(shade > 1.0 - 0.5 * amount)] += 1;
    }
    // The other cloud keeps its colors.
    assert!(after[N..] == before[N..]);
    n
}

/// Two maps of a directional light.
#[test]
fn shadowed_records_match() {
    let Some(stage) = Stage::new(74) else { return };
    let depths = [0.5, 0.52];
    // Above the first cloud, looking down on all of it but its rim.
    let light = Mat4::look_at_rh(Vec3::new(2.0, 8.0, 1.0), Vec3::ZERO, Vec3::Z);
    let clip_from_point = Mat4::orthographic_rh(-1.5, 1.5, -1.5, 1.5, 16.0, 0.0) * light;
    let offset = Vec3::new(0.02, 0.08, 0.01);
    let cascade = |far| ShadowCascade { clip_from_point, offset, far };
    let shadows = shadows(&stage.gpu, (&depths, &[0.0; 6]), vec![cascade(4.0), cascade(5.0)], Vec::new());
    let camera = Camera {
        world_from_view: Affine3A::from_rotation_y(0.3) * before_scene().world_from_view,
        ..before_scene()
    };
    let amount = 0.7;
    let [n_dark, n_lit] = check(&stage, &camera, &shadows, amount, |at, depth| {
        let cascade = ShadowCascade::at(&shadows.cascades, depth);
        let place = cascade.and_then(|i| Some((shadows.cascades[i].place(at)?, depths[i])));
        let is_lit = place.is_none_or(|(place, depth)| place.z >= depth);
        // Rounding decides at the edges.
        let rim = |x: f32| x.min(1.0 - x) < 1e-3;
        let is_close = place.is_some_and(|(at, depth)| (at.z - depth).abs() < 1e-4 || rim(at.x) || rim(at.y));
        let is_between = shadows.cascades.iter().any(|cascade| (cascade.far - depth).abs() < 1e-3);
        (!is_close && !is_between).then(|| in_shadow(amount, f32::from(u8::from(is_lit))))
    });
    assert!(n_dark > 50 && n_lit > 50, "{n_dark} dark and {n_lit} lit");
}

/// A spot light and a point light among the splats, each with the second of two maps, and one after the eighth,
/// which does not count.
#[test]
fn records_in_the_shadow_of_lamps_match() {
    let Some(stage) = Stage::new(75) else { return };
    let light_from_point = Affine3A::look_at_rh(Vec3::new(1.0, 4.0, 1.0), Vec3::ZERO, Vec3::Z);
    let (near, depth_bias, normal_bias) = (0.1, 0.05, 0.01);
    let cone = Some(Cone { inner: 0.2, outer: 0.5 });
    let spot = ShadowLamp { light_from_point, range: 9.0, near, depth_bias, normal_bias, cone, map: 1 };
    let light_from_point = Affine3A::from_translation(Vec3::new(1.0, -0.5, -0.3));
    let point = ShadowLamp { light_from_point, range: 4.0, cone: None, ..spot };
    let maps = [1.0, near / 4.0];
    // The sides of the second cube hold things at 0.6 to 1.1.
    let sides: Vec<f32> = (0..12).map(|i| if i < 6 { 1.0 } else { near / (0.1 * i as f32) }).collect();
    let lamps = vec![spot, point];
    let shadows = shadows(&stage.gpu, (&maps, &sides), Vec::new(), lamps.clone());
    let camera = before_scene();
    let amount = 0.8;
    let [n_dark, n_lit] = check(&stage, &camera, &shadows, amount, |at, _| {
        let mut shade = 1.0;
        for lamp in &lamps {
            let Some((share, depth)) = lamp.reach(at) else { continue };
            let mut in_map = maps[1];
            if lamp.cone.is_none() {
                // The axes of cubes are left-handed: +x, -x, +y, -y, +z, -z.
                let toward = lamp.light_from_point.transform_point3(at) * Vec3::new(1.0, 1.0, -1.0);
                let axis = toward.abs().max_position();
                in_map = sides[6 + 2 * axis + usize::from(toward[axis] < 0.0)];
                // Sides blend into one another at their edges.
                let across = (0..3).filter(|&i| i != axis).map(|i| toward[i].abs()).fold(0.0, f32::max);
                if across > 0.85 * toward[axis].abs() {
                    return None;
                }
            }
            if (depth / in_map - 1.0).abs() < 1e-3 {
                return None;
            }
            shade *= 1.0 - amount * if depth >= in_map { 0.0 } else { share };
        }
        Some(shade)
    });
    assert!(n_dark > 30 && n_lit > 50, "{n_dark} dark and {n_lit} lit");

    let mut many = shadows.clone();
    many.lamps = vec![ShadowLamp { range: 0.0, ..spot }; 8];
    many.lamps.push(spot);
    let [n_dark, _] = check(&stage, &camera, &many, amount, |_, _| Some(1.0));
    assert_eq!(n_dark, 0);
}
