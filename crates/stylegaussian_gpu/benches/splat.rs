//! How long a frame takes: `cargo bench -p stylegaussian_gpu --bench splat [-- N]`, N = 100,000 Gaussians unless told, in
//! 512 x 512 pixels. Stages are submitted and waited for one by one, so their sum is a little more than a frame takes.

use std::time::{Duration, Instant};

use glam::{Affine3A, Mat4, Quat, UVec4, Vec3};
use stylegaussian::{Scene, scene::Sh};
use stylegaussian_gpu::{
    device::{DeviceError, HeadlessDevice},
    scene::GpuScene,
    splat::{
        Camera, Cloud, CloudColors, Composite, CompositeMode, LAYER_FORMAT, SplatPass, SplatSettings,
        SplatView,
    },
};

const SIZE: u32 = 512;
const FRAMES: u32 = 20;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result<()> {
    let n = std::env::args().find_map(|argument| argument.parse().ok()).unwrap_or(100_000);
    let gpu = match pollster::block_on(HeadlessDevice::request()) {
        Err(DeviceError::NoAdapter(_)) => {
            eprintln!("SKIPPED: no GPU adapter");
            return Ok(());
        }
        result => result?,
    };
    println!("{n} Gaussians, {SIZE} x {SIZE} pixels, {}", gpu.info.name);
    run(&gpu, &structured(n))
}

/// A unit sphere (40%), a torus (20%) and a checkered floor (40%) of flat Gaussians that lie in their surfaces.
fn structured(n: usize) -> Scene {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let (mut scene, mut coefficients) = (Scene::default(), Vec::new());
    for _ in 0..n {
        let kind = random();
        let (u, v) = (random(), random());
        let [a, b] = [u, v].map(|x| std::f32::consts::TAU * x);
        let (mean, normal, area, rgb) = if kind < 0.4 {
            let z = 2.0 * v - 1.0;
            let r = (1.0 - z * z).sqrt();
            let normal = Vec3::new(r * a.cos(), z, r * a.sin());
            let rgb = Vec3::new(0.5 + 0.5 * (4.0 * a).sin(), 0.35, 0.5 + 0.5 * z);
            (normal + Vec3::Y, normal, 12.57 / 0.4, rgb)
        } else if kind < 0.6 {
            let ring = Vec3::new(a.cos(), 0.0, a.sin());
            let normal = ring * b.cos() + Vec3::Y * b.sin();
            let rgb = Vec3::new(0.9, 0.6 + 0.3 * b.sin(), 0.1);
            (1.8 * ring + 0.25 * normal + 0.6 * Vec3::Y, normal, 17.8 / 0.2, rgb)
        } else {
            let (x, z) = (8.0 * u - 4.0, 8.0 * v - 4.0);
            let is_light = (x.floor() as i32 + z.floor() as i32) % 2 == 0;
            (Vec3::new(x, 0.0, z), Vec3::Y, 64.0 / 0.4, Vec3::splat(if is_light { 0.85 } else { 0.2 }))
        };
        let size = 0.8 * (area / n as f32).sqrt();
        scene.means.push(mean);
        scene.rotations.push(Quat::from_rotation_arc(Vec3::Z, normal));
        scene.scales.push(Vec3::new(size, size, 0.1 * size));
        scene.opacities.push(0.9);
        coefficients.extend(stylegaussian::sh::dc_from_color(rgb.to_array()));
    }
    scene.sh = Some(Sh { degree: 0, coefficients });
    scene
}

/// The camera of a frame, on its way around the scene.
fn camera(frame: u32) -> Camera {
    let angle = 0.5 + 0.02 * frame as f32;
    let eye = Vec3::new(5.0 * angle.sin(), 2.6, 5.0 * angle.cos());
    Camera {
        world_from_view: Affine3A::look_at_rh(eye, Vec3::new(0.0, 0.6, 0.0), Vec3::Y).inverse(),
        clip_from_view: Mat4::perspective_infinite_reverse_rh(std::f32::consts::FRAC_PI_4, 1.0, 0.1),
        viewport: UVec4::new(0, 0, SIZE, SIZE),
    }
}

fn run(gpu: &HeadlessDevice, scene: &Scene) -> Result<()> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let start = Instant::now();
    let pass = SplatPass::new(device);
    let pipeline = pass.pipeline(device, 1, None);
    let composite = Composite::new(device);
    let over =
        composite.pipeline(device, wgpu::TextureFormat::Rgba8UnormSrgb, 1, CompositeMode::LinearFromSrgb);
    println!("{:8.2} ms to compile", start.elapsed().as_secs_f64() * 1e3);
    let start = Instant::now();
    let scene = GpuScene::new(device, scene)?;
    println!("{:8.2} ms to pack and upload", start.elapsed().as_secs_f64() * 1e3);

    let [layer, target] =
        [LAYER_FORMAT, wgpu::TextureFormat::Rgba8UnormSrgb].map(|format| target(device, format));
    let input = composite.bind(device, &layer, 1, None);
    let mut view = SplatView::new();
    let mut stages = [Duration::ZERO; 3];
    let cloud = Cloud { scene: &scene, colors: CloudColors::Sh, world_from_scene: Affine3A::IDENTITY };
    for frame in 0..FRAMES + 2 {
        let camera = camera(frame);
        let mut stage = |i: usize, encode: &mut dyn FnMut(&mut wgpu::CommandEncoder) -> Result<()>| {
            let start = Instant::now();
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encode(&mut encoder)?;
            queue.submit([encoder.finish()]);
            device.poll(wgpu::PollType::wait_indefinitely())?;
            // The first frames allocate.
            if frame >= 2 {
                stages[i] += start.elapsed();
            }
            Result::Ok(())
        };
        stage(0, &mut |encoder| {
            let settings = SplatSettings::default();
            Ok(pass.prepare(device, queue, encoder, &mut view, &camera, &[cloud], &settings)?)
        })?;
        stage(1, &mut |encoder| {
            pass.draw(&mut clear(encoder, &layer), &view, &pipeline);
            Ok(())
        })?;
        stage(2, &mut |encoder| {
            composite.draw(&mut clear(encoder, &target), &over, &input, camera.viewport);
            Ok(())
        })?;
    }
    for (name, time) in ["project and sort", "draw", "composite"].iter().zip(stages) {
        println!("{:8.2} ms to {name}", time.as_secs_f64() * 1e3 / f64::from(FRAMES));
    }
    Ok(())
}

fn target(device: &wgpu::Device, format: wgpu::TextureFormat) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: SIZE, height: SIZE, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// A pass over a cleared target.
fn clear<'a>(encoder: &'a mut wgpu::CommandEncoder, target: &wgpu::TextureView) -> wgpu::RenderPass<'a> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Store,
            },
        })],
        ..Default::default()
    })
}
