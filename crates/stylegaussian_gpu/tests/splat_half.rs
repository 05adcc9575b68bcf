//! Layers of half the width and height, among meshes.

mod pictures;
mod target;

use std::path::Path;

use glam::{Affine3A, UVec2, UVec4, Vec3};
use pictures::{camera, psnr, random_scene};
use stylegaussian::{
    Scene,
    splat::{Colors, RenderedImage, render_half},
};
use stylegaussian_files::read_scene;
use stylegaussian_gpu::{
    device::HeadlessDevice,
    splat::{
        Camera, Cloud, CloudColors, GpuScene, Headless, LAYER_FORMAT, Layer, SplatPass, SplatSettings,
        SplatView,
    },
};
use target::{composite_edges, depth_of, gpu, read, resolved, texture, view_of, with_near_plane};
use wgpu::TextureFormat::Depth32Float;

/// Width and height of pictures, in pixels.
const SIZE: UVec2 = UVec2::new(96, 63);

/// A mesh before half of the splats, in normalized device coordinates, reverse z: depth is 0.1 / z.
const MESH: [[f32; 3]; 3] = [[-0.9, -0.8, 0.05], [0.7, -0.5, 0.04], [-0.2, 0.9, 0.03]];

/// Depth of the mesh in a target of `size`, or of none.
fn depth_of_mesh(gpu: &HeadlessDevice, size: UVec2, samples: u32, is_there: bool) -> wgpu::Texture {
    depth_of(gpu, size, samples, if is_there { &MESH[..] } else { &[] })
}

/// A camera with depth 0.1 / z.
fn eye() -> Camera {
    with_near_plane(&camera(SIZE))
}

/// The layer of a scene before `depth`, whole or made from half of its width and height.
fn layer(
    gpu: &HeadlessDevice,
    splats: &SplatPass,
    (scene, camera): (&Scene, &Camera),
    depth: &wgpu::Texture,
    half_size: bool,
) -> Vec<[f32; 4]> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let scene = GpuScene::new(device, scene).unwrap();
    let (colors, world_from_scene) = (CloudColors::Captured, Affine3A::IDENTITY);
    let clouds = [Cloud { scene: &scene, colors, world_from_scene, visibility: None }];
    let settings = SplatSettings { half_size, ..SplatSettings::default() };
    let size = UVec2::new(depth.width(), depth.height());
    let samples = depth.sample_count();
    let color = texture(device, size.to_array(), LAYER_FORMAT, 1);
    let pipeline = splats.pipeline(device, 1, Some(Depth32Float));
    let (to, of_depth) = (view_of(&color), view_of(depth));
    let mut view = SplatView::new();
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let to_gpu = &mut encoder;
    splats.project_and_sort(&mut gpu.encoding(to_gpu), &mut view, camera, &clouds, &settings).unwrap();
    let half = splats.half_layer(device, size);
    if samples == 1 {
        if half_size {
            let layers = (&half, &to, &of_depth);
            splats.draw_half_layer(&mut gpu.encoding(to_gpu), &mut view, camera, layers, &pipeline);
        } else {
            let layer = Layer { color: &to, depth: Some(&of_depth) };
            splats.draw_layer(&mut gpu.encoding(to_gpu), &mut view, &layer, &pipeline);
        }
        queue.submit([encoder.finish()]);
        return read(gpu, &color);
    }
    let layers = splats.edge_layers(device, size);
    if half_size {
        let layers = (&half, &layers, &of_depth);
        splats.draw_half_edge_layers(&mut gpu.encoding(to_gpu), &mut view, camera, layers, &pipeline);
    } else {
        let layers = (&layers, &of_depth);
        splats.draw_edge_layers(&mut gpu.encoding(to_gpu), &mut view, camera, layers, &pipeline);
    }
    queue.submit([encoder.finish()]);
    let target = texture(device, size.to_array(), LAYER_FORMAT, samples);
    composite_edges(gpu, &layers, samples, &target);
    read(gpu, &resolved(gpu, &target))
}

fn texels(picture: &RenderedImage) -> Vec<[f32; 4]> {
    let texels = picture.color.iter().zip(&picture.alpha);
    texels.map(|(&[r, g, b], &alpha)| [r, g, b, alpha]).collect()
}

/// The low picture is the CPU twin's.
#[test]
fn low_pictures_equal_the_twin() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = (random_scene(800, 1, 7), camera(SIZE));
    let settings = SplatSettings { half_size: true, near: camera.near, ..SplatSettings::default() };
    let of_pass = Camera::pinhole(&camera);
    let twin = render_half(&scene, Colors::Captured, &camera);
    let mut splats = Headless::new(&gpu.device);
    let uploaded = GpuScene::new(&gpu.device, &scene).unwrap();
    let (colors, world_from_scene) = (CloudColors::Captured, Affine3A::IDENTITY);
    let clouds = [Cloud { scene: &uploaded, colors, world_from_scene, visibility: None }];
    let picture = splats.render(&gpu.device, &gpu.queue, &of_pass, &clouds, &settings).unwrap();
    // The low picture is in the corner of the whole one's layer.
    let rows = picture.rgba.chunks_exact(SIZE.x as usize).take(twin.size.y as usize);
    let found: Vec<[f32; 4]> = rows.flat_map(|row| row[..twin.size.x as usize].to_vec()).collect();
    let likeness = psnr(&found, &texels(&twin));
    assert!(likeness > 45.0, "{likeness:.1} dB");
}

/// Among meshes, the picture of half the width and height is near the whole one, by quads and by the adapter's
/// fastest way, with one sample and with four.
#[test]
fn the_picture_is_near_the_whole_one() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(800, 1, 7);
    let seen = (&scene, &eye());
    for samples in [1, 4] {
        let depth = depth_of_mesh(&gpu, SIZE, samples, true);
        let mut both = Vec::new();
        for splats in [SplatPass::by_quads(&gpu.device), SplatPass::new(&gpu.device)] {
            let whole = layer(&gpu, &splats, seen, &depth, false);
            let half = layer(&gpu, &splats, seen, &depth, true);
            let likeness = psnr(&half, &whole);
            println!("{samples} samples: {likeness:.1} dB");
            assert!(likeness > 20.0, "{samples} samples: {likeness:.1} dB");
            both.push(half);
        }
        let likeness = psnr(&both[0], &both[1]);
        assert!(likeness > 45.0, "{samples} samples: quads and tiles differ, {likeness:.1} dB");
    }
}

/// No fringe: within a mesh before all splats, nothing of them is seen, and beside it all of them.
#[test]
fn meshes_have_no_fringe() {
    let Some(gpu) = gpu() else { return };
    // One opaque wall far behind the mesh.
    let wall = pictures::scene(&[(Vec3::new(0.0, 0.0, 6.0), Vec3::new(9.0, 9.0, 0.01), 1.0); 3]);
    let seen = (&wall, &eye());
    let depth = depth_of_mesh(&gpu, SIZE, 1, true);
    let splats = SplatPass::new(&gpu.device);
    let whole = layer(&gpu, &splats, seen, &depth, false);
    let half = layer(&gpu, &splats, seen, &depth, true);
    let hidden = whole.iter().filter(|texel| texel[3] == 0.0).count();
    assert!((1000..4000).contains(&hidden), "{hidden} pixels are hidden");
    let is_off = |(found, expected): &(&[f32; 4], &[f32; 4])| (found[3] - expected[3]).abs() > 0.02;
    let n_off = half.iter().zip(&whole).filter(is_off).count();
    // The tips of the triangle are thinner than a low pixel. A fringe would be as long as its edges, 170
    // pixels.
    assert!(n_off <= 12, "{n_off} pixels are off");
}

/// A viewport beside the corner of its target has its picture there.
#[test]
fn viewports_stay_in_their_place() {
    let Some(gpu) = gpu() else { return };
    let scene = random_scene(300, 0, 9);
    let target = SIZE + UVec2::new(8, 6);
    let mut eye = eye();
    eye.viewport = UVec4::new(5, 3, SIZE.x, SIZE.y);
    let depth = depth_of_mesh(&gpu, target, 1, false);
    let splats = SplatPass::new(&gpu.device);
    let [whole, half] = [false, true].map(|half| layer(&gpu, &splats, (&scene, &eye), &depth, half));
    let likeness = psnr(&half, &whole);
    assert!(likeness > 20.0, "{likeness:.1} dB");
}

/// On the demo scene, whose splats are small, at 320x240 pixels.
#[test]
fn half_the_size_is_near_on_a_real_scene() {
    let Some(gpu) = gpu() else { return };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo.sgs");
    let scene = read_scene(&path).unwrap().scene;
    let (low, high) = scene.bounds().unwrap();
    let center = (low + high) / 2.0;
    let up = scene.up.unwrap_or(Vec3::Y);
    let eye = center + (high - low).length() * (0.3 * up.any_orthonormal_vector() + 0.1 * up);
    let size = UVec2::new(320, 240);
    let camera = Camera::pinhole(&stylegaussian::Camera::look_at(eye, center, up, 1.0, size));
    let splats = SplatPass::new(&gpu.device);
    let depth = depth_of_mesh(&gpu, size, 1, false);
    let [whole, half] = [false, true].map(|half| layer(&gpu, &splats, (&scene, &camera), &depth, half));
    let likeness = psnr(&half, &whole);
    println!("{likeness:.1} dB");
    assert!(likeness > 18.0 && likeness < 50.0, "{likeness:.1} dB");
}
