//! The draw into targets of all kinds: depth attachments, multisampling, viewports, orthographic cameras. Each
//! picture has a known result.

mod paintings;
mod pictures;
mod target;

use glam::{Affine3A, Mat4, UVec2, UVec4, Vec2, Vec3};
use paintings::{strokes, texture as brushwork};
use pictures::{camera, draw, psnr, random_scene, rgba, scene};
use stylegaussian::{
    Scene,
    splat::{Colors, render_strokes},
    strokes::{StrokeKnobs, Strokes},
};
use stylegaussian_gpu::{
    colors::GaussianColors,
    device::HeadlessDevice,
    splat::{
        Camera, Cloud, CloudColors, Composite, CompositeMode, GpuScene, Headless, LAYER_FORMAT, Layer,
        SortKey, SplatPass, SplatSettings, SplatView,
    },
};
use target::{composite_edges, edge_layers, gpu, pass, read, resolved, texture};
use wgpu::TextureFormat::{Depth32Float, Rgba16Float};

/// Width and height of most pictures, in pixels: the center of pixel (4, 4) lies on the axis.
const SIZE: u32 = 9;

/// A camera at the origin that looks along -z. Focal length 10 px, reverse z with an infinite far plane: depth
/// is 0.1 / z.
fn pinhole() -> Camera {
    let pinhole = stylegaussian::Camera {
        view_from_world: Affine3A::IDENTITY,
        focal: Vec2::splat(10.0),
        center: Vec2::splat(SIZE as f32 / 2.0),
        size: UVec2::splat(SIZE),
        near: stylegaussian::Camera::NEAR,
    };
    let mut camera = Camera::pinhole(&pinhole);
    camera.clip_from_view.w_axis.z = 0.1;
    camera.world_from_view = Affine3A::IDENTITY;
    camera
}

/// A camera at the origin that looks along -z. 10 px per unit, depths from 0 to 100 units.
fn orthographic() -> Camera {
    let half = SIZE as f32 / 20.0;
    Camera {
        world_from_view: Affine3A::IDENTITY,
        // Near and far change places: reverse z.
        clip_from_view: Mat4::orthographic_rh(-half, half, -half, half, 100.0, 0.0),
        viewport: UVec4::new(0, 0, SIZE, SIZE),
    }
}

/// A round Gaussian `z` ahead of opacity 0.8. Its footprint has a variance of (10 * 0.2 / z)^2 + 0.3 px^2.
fn ahead(z: f32) -> (Vec3, Vec3, f32) {
    (Vec3::new(0.0, 0.0, -z), Vec3::splat(0.2), 0.8)
}

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
const WHITE: [f32; 3] = [1.0; 3];
const CENTER: usize = (SIZE * SIZE / 2) as usize;

#[track_caller]
fn near(found: [f32; 4], expected: [f32; 4]) {
    let close = found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 2e-3);
    assert!(close, "found {found:?}, expected {expected:?}");
}

/// A layer and a depth attachment.
struct Target {
    color: wgpu::Texture,
    depth: wgpu::Texture,
    samples: u32,
}

impl Target {
    /// An empty layer in front of a wall at `depth`.
    fn new(gpu: &HeadlessDevice, size: [u32; 2], samples: u32, depth: f32) -> Self {
        let layer = Self {
            color: texture(&gpu.device, size, LAYER_FORMAT, samples),
            depth: texture(&gpu.device, size, Depth32Float, samples),
            samples,
        };
        layer.pass(gpu, Some(depth), |_| ());
        layer
    }

    /// A pass over both. If `clear` is given, it clears both, the depth to that value. Otherwise the depth is
    /// only read.
    fn pass(&self, gpu: &HeadlessDevice, clear: Option<f32>, draw: impl FnOnce(&mut wgpu::RenderPass)) {
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let (color, depth) = (view(&self.color), view(&self.depth));
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let load = clear.map_or(wgpu::LoadOp::Load, |_| wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth,
                depth_ops: clear.map(|depth| wgpu::Operations {
                    load: wgpu::LoadOp::Clear(depth),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        draw(&mut pass);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Draws a scene of one RGB per Gaussian by quads, over the earlier content.
    fn splat(&self, gpu: &HeadlessDevice, scene: &Scene, rgb: &[[f32; 3]], camera: &Camera) {
        self.by_quads(gpu, sorted(gpu, scene, rgb, None, camera));
    }

    fn by_quads(&self, gpu: &HeadlessDevice, (splats, view): (SplatPass, SplatView)) {
        let pipeline = splats.pipeline(&gpu.device, self.samples, Some(Depth32Float));
        self.pass(gpu, None, |pass| splats.draw(pass, &view, &pipeline));
    }

    /// Draws the same by the adapter's fastest way, into the cleared layer.
    fn splat_layer(&self, gpu: &HeadlessDevice, scene: &Scene, rgb: &[[f32; 3]], camera: &Camera) {
        self.layer(gpu, sorted(gpu, scene, rgb, None, camera), camera);
    }

    fn layer(&self, gpu: &HeadlessDevice, (splats, mut view): (SplatPass, SplatView), camera: &Camera) {
        if self.samples > 1 {
            let layers = edge_layers(gpu, &splats, &mut view, camera, &self.depth);
            return composite_edges(gpu, &layers, self.samples, &self.color);
        }
        let HeadlessDevice { device, queue, .. } = gpu;
        let pipeline = splats.pipeline(device, 1, Some(Depth32Float));
        let [color, depth] =
            [&self.color, &self.depth].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
        let layer = Layer { color: &color, depth: Some(&depth) };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        splats.draw_layer(&mut gpu.encoding(&mut encoder), &mut view, &layer, &pipeline);
        queue.submit([encoder.finish()]);
    }

    /// The layer over `background`, its samples averaged.
    fn composited(&self, gpu: &HeadlessDevice, background: wgpu::Color) -> Vec<[f32; 4]> {
        let device = &gpu.device;
        let size = [self.color.width(), self.color.height()];
        let single = resolved(gpu, &self.color);
        let composite = Composite::new(device);
        let pipeline = composite.pipeline(device, Rgba16Float, 1, CompositeMode::Encoded);
        let layer = single.create_view(&wgpu::TextureViewDescriptor::default());
        let input = composite.bind(device, &layer, None);
        let target = texture(device, size, Rgba16Float, 1);
        pass(gpu, &target, None, background, |pass| {
            composite.draw(pass, &pipeline, &input, UVec4::new(0, 0, size[0], size[1]));
        });
        read(gpu, &target)
    }
}

/// A scene of one RGB per Gaussian, with strokes or without, projected and sorted for a camera.
fn sorted(
    gpu: &HeadlessDevice,
    scene: &Scene,
    rgb: &[[f32; 3]],
    painting: Option<&Strokes>,
    camera: &Camera,
) -> (SplatPass, SplatView) {
    let HeadlessDevice { device, queue, .. } = gpu;
    let splats = SplatPass::new(device);
    let colors = GaussianColors::from_rgb(device, queue, rgb).unwrap();
    let scene = GpuScene::new(device, scene).unwrap();
    let painted = painting.map(|painting| splats.store().upload(device, queue, painting).unwrap());
    let colors = CloudColors::Rgb(&colors);
    let cloud = Cloud {
        scene: &scene,
        colors: match &painted {
            Some(painted) => colors.with_strokes(painted, StrokeKnobs::default()),
            None => colors,
        },
        world_from_scene: Affine3A::IDENTITY,
        visibility: None,
    };
    let mut view = SplatView::new();
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let settings = SplatSettings::default();
    splats.project_and_sort(&mut gpu.encoding(&mut encoder), &mut view, camera, &[cloud], &settings).unwrap();
    queue.submit([encoder.finish()]);
    (splats, view)
}

/// A wall 2 units ahead hides the green splat 3 units ahead, but not the red one 1 unit ahead. A wall 4 units
/// ahead hides neither, a wall half a unit ahead hides both.
#[test]
fn walls_hide_splats_behind_them() {
    let Some(gpu) = gpu() else { return };
    let both = scene(&[ahead(3.0), ahead(1.0)]);
    let check = |wall: f32, expected: [f32; 4]| {
        for samples in [1, 4] {
            let layer = Target::new(&gpu, [SIZE; 2], samples, 0.1 / wall);
            layer.splat(&gpu, &both, &[GREEN, RED], &pinhole());
            near(layer.composited(&gpu, wgpu::Color::TRANSPARENT)[CENTER], expected);
            layer.splat_layer(&gpu, &both, &[GREEN, RED], &pinhole());
            near(layer.composited(&gpu, wgpu::Color::TRANSPARENT)[CENTER], expected);
        }
    };
    check(4.0, [0.8, 0.16, 0.0, 0.96]);
    check(2.0, [0.8, 0.0, 0.0, 0.8]);
    check(0.5, [0.0; 4]);
}

/// The edge of a wall runs through the middle of the pixels of column 4. The wall hides a white splat behind it
/// in two of four samples there, in all samples to the left, and in none to the right.
#[test]
fn walls_hide_sample_by_sample() {
    let Some(gpu) = gpu() else { return };
    let layer = Target::new(&gpu, [SIZE; 2], 4, 0.0);
    draw_wall(&gpu, &layer);
    // So large that it is the same everywhere.
    let behind = scene(&[(Vec3::new(0.0, 0.0, -2.0), Vec3::splat(100.0), 0.8)]);
    let check = || {
        let picture = layer.composited(&gpu, wgpu::Color::BLACK);
        let row = &picture[CENTER - 4..CENTER + 5];
        let expected = [0.0, 0.0, 0.0, 0.0, 0.4, 0.8, 0.8, 0.8, 0.8];
        for (pixel, expected) in row.iter().zip(expected) {
            near(*pixel, [expected, expected, expected, 1.0]);
        }
    };
    layer.splat(&gpu, &behind, &[WHITE], &pinhole());
    check();
    layer.splat_layer(&gpu, &behind, &[WHITE], &pinhole());
    check();
}

/// The same wall with one sample per pixel: a pixel is hidden if its middle lies on the wall.
#[test]
fn walls_hide_pixel_by_pixel() {
    let Some(gpu) = gpu() else { return };
    let layer = Target::new(&gpu, [SIZE; 2], 1, 0.0);
    draw_wall(&gpu, &layer);
    let behind = scene(&[(Vec3::new(0.0, 0.0, -2.0), Vec3::splat(100.0), 0.8)]);
    layer.splat_layer(&gpu, &behind, &[WHITE], &pinhole());
    let picture = read(&gpu, &layer.color);
    for row in picture.chunks_exact(SIZE as usize) {
        for (x, pixel) in row.iter().enumerate().filter(|&(x, _)| x != SIZE as usize / 2) {
            near(*pixel, if x < SIZE as usize / 2 { [0.0; 4] } else { [0.8; 4] });
        }
    }
}

/// Strokes before a wall are drawn, and those behind it are not, with one sample to a pixel and with four,
/// which share a pixel's strokes.
#[test]
fn walls_hide_strokes_behind_them() {
    let Some(gpu) = gpu() else { return };
    let on_cpu = camera(UVec2::new(80, 60));
    let whole = random_scene(600, 0, 41);
    let painting = strokes(&whole, &[brushwork(42)], 40.0, 43);
    let wall = 3.0;
    let is_before = |mean: &Vec3| on_cpu.view_from_world.transform_point3(*mean).z < wall;
    let before: Vec<u32> = (0..600).filter(|&i| is_before(&whole.means[i as usize])).collect();
    assert!((100..500).contains(&before.len()), "{} before the wall", before.len());
    let nearer = whole.subset(&before);
    let words = before.iter().map(|&i| painting.words[i as usize]).collect();
    let of_nearer = Strokes { words, ..painting.clone() };
    let grays = |n: usize| vec![[0.5; 3]; n];
    let colors = grays(nearer.len());
    let drawn =
        render_strokes(&nearer, Colors::Rgb(&colors), (&of_nearer, &StrokeKnobs::default()), &on_cpu, None);
    let expected = rgba(&drawn);
    let mut camera = Camera::pinhole(&on_cpu);
    camera.clip_from_view.w_axis.z = 0.1;
    for samples in [1, 4] {
        let layer = Target::new(&gpu, on_cpu.size.to_array(), samples, 0.1 / wall);
        let splats = || sorted(&gpu, &whole, &grays(whole.len()), Some(&painting), &camera);
        layer.by_quads(&gpu, splats());
        let by_quads = psnr(&layer.composited(&gpu, wgpu::Color::TRANSPARENT), &expected);
        layer.layer(&gpu, splats(), &camera);
        let fastest = psnr(&layer.composited(&gpu, wgpu::Color::TRANSPARENT), &expected);
        assert!(by_quads > 54.0 && fastest > 54.0, "{samples} samples: {by_quads:.1} dB, {fastest:.1} dB");
    }
}

/// A layer drawn by the adapter's fastest way is cleared everywhere, and drawn to within the viewport.
#[test]
fn a_layer_is_cleared_around_its_viewport() {
    let Some(gpu) = gpu() else { return };
    let size = [2 * SIZE + 1, SIZE + 2];
    let layer = Target::new(&gpu, size, 1, 0.0);
    let large = scene(&[(Vec3::new(0.0, 0.0, -2.0), Vec3::splat(100.0), 0.8)]);
    let mut camera = pinhole();
    for viewport in [UVec4::new(0, 2, SIZE, SIZE), UVec4::new(SIZE + 1, 0, SIZE, SIZE)] {
        camera.viewport = viewport;
        layer.splat_layer(&gpu, &large, &[RED], &camera);
        for (i, pixel) in read(&gpu, &layer.color).into_iter().enumerate() {
            let at = UVec2::new(i as u32 % size[0], i as u32 / size[0]);
            let corner = UVec2::new(viewport.x, viewport.y);
            let inside = at.cmpge(corner).all() && at.cmplt(corner + SIZE).all();
            near(pixel, if inside { [0.8, 0.0, 0.0, 0.8] } else { [0.0; 4] });
        }
    }
}

/// Splats are drawn even if the lists of tiles are too small: 2,500 splats that each cover all 1,600 tiles of a
/// picture.
#[test]
fn splats_without_room_in_lists_are_drawn() {
    let Some(gpu) = gpu() else { return };
    let faint: Vec<_> =
        (0..2500).map(|i| (Vec3::new(0.0, 0.0, -2.0 - 0.001 * i as f32), Vec3::splat(100.0), 0.01)).collect();
    let camera = Camera { viewport: UVec4::new(0, 0, 320, 320), ..pinhole() };
    let rgb: Vec<_> = (0..2500).map(|i| if i < 100 { RED } else { GREEN }).collect();
    let clouds = [(&scene(&faint), Colors::Rgb(&rgb), Affine3A::IDENTITY)];
    let picture = draw(&gpu, &camera, &clouds, &SplatSettings::default()).rgba;
    // A hundred layers of 1% red before everything else, which is green.
    let red = 1.0 - 0.99f32.powi(100);
    for pixel in picture {
        let close = [pixel[0] - red, pixel[1] - (1.0 - red)].iter().all(|error| error.abs() < 0.04);
        assert!(close, "{pixel:?}, expected {red} red");
    }
}

/// Depth 0.9 over the left half of the picture.
fn draw_wall(gpu: &HeadlessDevice, layer: &Target) {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(
            "@vertex fn wall(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
                return vec4(f32(i & 1u) - 1.0, f32(i >> 1u) * 2.0 - 1.0, 0.9, 1.0);
            }"
            .into(),
        ),
    });
    let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: layer.samples, ..Default::default() },
        fragment: None,
        multiview_mask: None,
        cache: None,
    });
    let view = layer.depth.create_view(&wgpu::TextureViewDescriptor::default());
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &view,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        }),
        ..Default::default()
    });
    pass.set_pipeline(&pipeline);
    pass.draw(0..4, 0..1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
}

/// Two cameras share a target, side by side: each draws its picture and nothing outside of it.
#[test]
fn viewports_keep_to_themselves() {
    let Some(gpu) = gpu() else { return };
    let layer = Target::new(&gpu, [2 * SIZE + 1, SIZE + 2], 1, 0.0);
    // Large enough to cover the whole target.
    let large = scene(&[(Vec3::new(0.0, 0.0, -2.0), Vec3::splat(100.0), 0.8)]);
    let mut left = pinhole();
    left.viewport = UVec4::new(0, 2, SIZE, SIZE);
    layer.splat(&gpu, &large, &[RED], &left);
    let mut right = pinhole();
    right.viewport = UVec4::new(SIZE + 1, 0, SIZE, SIZE);
    layer.splat(&gpu, &scene(&[ahead(2.0)]), &[GREEN], &right);

    let picture = read(&gpu, &layer.color);
    let pixel = |x: u32, y: u32| picture[(y * (2 * SIZE + 1) + x) as usize];
    near(pixel(4, 6), [0.8, 0.0, 0.0, 0.8]);
    near(pixel(0, 2), [0.8, 0.0, 0.0, 0.8]);
    near(pixel(8, 10), [0.8, 0.0, 0.0, 0.8]);
    near(pixel(4, 1), [0.0; 4]);
    near(pixel(9, 5), [0.0; 4]);
    // Variance (10 * 0.2 / 2)^2 + 0.3 = 1.3 px^2 about the middle of the second viewport.
    near(pixel(SIZE + 5, 4), [0.0, 0.8, 0.0, 0.8]);
    let beside = 0.8 * (-0.5f32 / 1.3).exp();
    near(pixel(SIZE + 6, 4), [0.0, beside, 0.0, beside]);
    near(pixel(SIZE + 1, 10), [0.0; 4]);
}

/// 10 px per unit at any distance: variance (10 * 0.2)^2 + 0.3 = 4.3 px^2, 1 unit or 50 units or 0.1 units
/// ahead. Gaussians behind the camera or beyond its far plane are not drawn.
#[test]
fn orthographic_footprints_do_not_shrink() {
    let Some(gpu) = gpu() else { return };
    let picture = |z: f32| {
        let one = scene(&[ahead(z)]);
        let clouds = [(&one, Colors::Rgb(&[RED]), Affine3A::IDENTITY)];
        draw(&gpu, &orthographic(), &clouds, &SplatSettings::default()).rgba
    };
    let beside = 0.8 * (-0.5f32 / 4.3).exp();
    for z in [0.1, 1.0, 50.0] {
        let picture = picture(z);
        near(picture[CENTER], [0.8, 0.0, 0.0, 0.8]);
        near(picture[CENTER + 1], [beside, 0.0, 0.0, beside]);
        near(picture[CENTER - SIZE as usize], [beside, 0.0, 0.0, beside]);
    }
    for z in [-1.0, 101.0] {
        assert!(picture(z).iter().all(|pixel| pixel[3] == 0.0), "{z} ahead");
    }
}

/// Every ray of an orthographic camera looks along -z: with f_z of degree 1 alone, red is 0.5 - 0.4886 * 0.5
/// everywhere.
#[test]
fn orthographic_rays_are_parallel() {
    let Some(gpu) = gpu() else { return };
    let mut one = scene(&[(Vec3::new(0.3, 0.2, -2.0), Vec3::splat(0.2), 0.8)]);
    let mut coefficients = vec![0.0; 12];
    coefficients[6] = 0.5;
    one.sh = Some(stylegaussian::scene::Sh { degree: 1, coefficients });
    let clouds = [(&one, Colors::Captured, Affine3A::IDENTITY)];
    let picture = draw(&gpu, &orthographic(), &clouds, &SplatSettings::default());
    // 3 px right of the center, 2 px up.
    let pixel = picture.rgba[CENTER + 3 - 2 * SIZE as usize];
    near(pixel, [0.8 * (0.5 - 0.488_602_5 * 0.5), 0.4, 0.4, 0.8]);
}

/// Red splats 1 and 3 units ahead, a green one of another cloud between them: 0.8 red, then 0.2 * 0.8 green,
/// then 0.2 * 0.2 * 0.8 red. The other cloud got there by its transform.
#[test]
fn clouds_interleave() {
    let Some(gpu) = gpu() else { return };
    let (red, green) = (scene(&[ahead(3.0), ahead(1.0)]), scene(&[ahead(7.0)]));
    let moved = Affine3A::from_translation(Vec3::new(0.0, 0.0, 5.0));
    let clouds =
        [(&red, Colors::Rgb(&[RED, RED]), Affine3A::IDENTITY), (&green, Colors::Rgb(&[GREEN]), moved)];
    let picture = draw(&gpu, &pinhole(), &clouds, &SplatSettings::default());
    near(picture.rgba[CENTER], [0.832, 0.16, 0.0, 0.992]);
    let swapped = draw(&gpu, &pinhole(), &[clouds[1], clouds[0]], &SplatSettings::default());
    assert_eq!(picture, swapped);
}

/// Red over half of the mid-gray of a scene without colors, and all of either.
#[test]
fn own_colors_leave_a_share_of_the_captured_ones() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let scene = GpuScene::new(device, &scene(&[ahead(1.0)])).unwrap();
    let check = |colors: [f32; 4], expected: [f32; 3]| {
        let own = GaussianColors::from_premultiplied(device, queue, &[colors]).unwrap();
        let colors = CloudColors::Rgb(&own);
        let cloud = Cloud { scene: &scene, colors, world_from_scene: Affine3A::IDENTITY, visibility: None };
        let settings = SplatSettings::default();
        let picture = Headless::new(device).render(device, queue, &pinhole(), &[cloud], &settings).unwrap();
        let [r, g, b] = expected.map(|c| 0.8 * c);
        near(picture.rgba[CENTER], [r, g, b, 0.8]);
    };
    check([1.0, 0.0, 0.0, 1.0], RED);
    check([0.5, 0.0, 0.0, 0.5], [0.75, 0.25, 0.25]);
    check([0.0; 4], [0.5; 3]);
}

/// Two splats on the picture's middle line: one is nearer along the axis, the other nearer to the eye.
#[test]
fn splats_sort_by_depth_or_by_distance() {
    let Some(gpu) = gpu() else { return };
    // Depths 2 and 2.2; distances from the eye 2.83 and 2.2. Large, so that both cover the center.
    let green = (Vec3::new(2.0, 0.0, -2.0), Vec3::new(20.0, 20.0, 1e-3), 0.8);
    let red = (Vec3::new(0.0, 0.0, -2.2), Vec3::new(20.0, 20.0, 1e-3), 0.8);
    let both = scene(&[green, red]);
    let center = |sort_key| {
        let clouds = [(&both, Colors::Rgb(&[GREEN, RED]), Affine3A::IDENTITY)];
        let settings = SplatSettings { sort_key, ..SplatSettings::default() };
        draw(&gpu, &pinhole(), &clouds, &settings).rgba[CENTER]
    };
    let by_depth = center(SortKey::ViewZ);
    let by_distance = center(SortKey::Distance);
    assert!(by_depth[1] > 0.7 && by_depth[0] < 0.2, "{by_depth:?}");
    assert!(by_distance[0] > 0.7 && by_distance[1] < 0.2, "{by_distance:?}");
}
