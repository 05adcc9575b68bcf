//! Frames of the splat pass, and their parts: no MSAA, no HDR, a picture in sRGB.

use anyhow::Result;
use glam::{Affine3A, Mat4, UVec4, Vec3};
use stylegaussian::Scene;
use stylegaussian_gpu::{
    colors::GaussianColors,
    splat::{
        Camera, Cloud, CloudColors, Composite, CompositeInput, CompositeMode, CompositePipeline, GpuScene,
        Layer, SplatPass, SplatPipeline, SplatSettings, SplatView,
    },
};

use crate::{
    fidelity,
    gpu::Gpu,
    measure::Samples,
    plan::Plan,
    report::{Report, Row},
    scenes,
};

/// Frames before those that count: the first ones allocate.
const WARM_UP: usize = 4;

/// Measures every size of every scene.
pub fn run(gpu: &Gpu, plan: &Plan, report: &mut Report) -> Result<()> {
    run_kind(gpu, plan, "structured", scenes::structured, around_structured, report)?;
    run_kind(gpu, plan, "random", scenes::random, around_random, report)
}

fn run_kind(
    gpu: &Gpu,
    plan: &Plan,
    kind: &str,
    scene: fn(usize) -> Scene,
    pose: fn(f32) -> Affine3A,
    report: &mut Report,
) -> Result<()> {
    for &n in plan.frame_sizes() {
        let source = scene(n);
        let scene = GpuScene::new(&gpu.device, &source)?;
        for &picture in plan.pictures() {
            let mut stage = Stage::new(gpu, &scene, picture, pose, plan);
            let name = format!("{kind}, {}x{}", picture[0], picture[1]);
            stage.frames(&format!("frame, {name}"), 1, report)?;
            stage.frames(&format!("frame, {name}, two cameras"), 2, report)?;
            stage.parts(&name, report)?;
            let found = stage.picture()?;
            let expected = fidelity::reference(&source, pose(FIRST_ANGLE), FOV, picture);
            let psnr = fidelity::psnr(&found, &expected);
            report.add(Row::of_picture(format!("picture, {name}"), n, psnr));
        }
    }
    Ok(())
}

/// Start of the cameras' way, in radians. Pictures are compared there.
pub const FIRST_ANGLE: f32 = 0.5;

/// Vertical field of view of the cameras, in radians.
pub const FOV: f32 = std::f32::consts::FRAC_PI_4;

/// A camera on its way around the structured scene.
pub fn around_structured(angle: f32) -> Affine3A {
    let eye = Vec3::new(5.0 * angle.sin(), 2.6, 5.0 * angle.cos());
    Affine3A::look_at_rh(eye, Vec3::new(0.0, 0.6, 0.0), Vec3::Y).inverse()
}

/// A camera on its way around the random scene.
fn around_random(angle: f32) -> Affine3A {
    let eye = Vec3::new(45.0 * angle.sin(), 12.0, 45.0 * angle.cos());
    Affine3A::look_at_rh(eye, Vec3::ZERO, Vec3::Y).inverse()
}

/// A scene, a picture, and the passes that draw one into the other.
struct Stage<'a> {
    gpu: &'a Gpu,
    scene: &'a GpuScene,
    picture: [u32; 2],
    pose: fn(f32) -> Affine3A,
    n_frames: usize,
    /// Frames drawn so far. The camera moves with each.
    frame: u32,
    pass: SplatPass,
    draw: SplatPipeline,
    composite: Composite,
    over: CompositePipeline,
    input: CompositeInput,
    layer: wgpu::TextureView,
    target: wgpu::TextureView,
    views: [SplatView; 2],
}

impl<'a> Stage<'a> {
    fn new(
        gpu: &'a Gpu,
        scene: &'a GpuScene,
        picture: [u32; 2],
        pose: fn(f32) -> Affine3A,
        plan: &Plan,
    ) -> Self {
        const TARGET: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
        let device = &gpu.device;
        let (pass, composite) = (SplatPass::new(device), Composite::new(device));
        let layer = pass.layer(device, picture.into());
        let target = texture(device, picture, TARGET, wgpu::TextureUsages::COPY_SRC);
        Self {
            gpu,
            scene,
            picture,
            pose,
            n_frames: if plan.quick { 12 } else { 20 },
            frame: 0,
            draw: pass.pipeline(device, 1, None),
            over: composite.pipeline(device, TARGET, 1, CompositeMode::LinearFromSrgb),
            input: composite.bind(device, &layer, None),
            pass,
            composite,
            layer,
            target,
            views: [SplatView::new(), SplatView::new()],
        }
    }

    /// The camera of a frame for part `i` of `n`, side by side.
    fn camera(&self, i: u32, n: u32) -> Camera {
        let [width, height] = [self.picture[0] / n, self.picture[1]];
        let aspect = width as f32 / height as f32;
        Camera {
            // About a degree per frame. A camera that stands still would skip the sort.
            world_from_view: (self.pose)(FIRST_ANGLE + 0.02 * self.frame as f32),
            clip_from_view: Mat4::perspective_infinite_reverse_rh(FOV, aspect, 0.1),
            viewport: UVec4::new(i * width, 0, width, height),
        }
    }

    fn prepare(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        i: usize,
        n: u32,
        colors: CloudColors,
    ) -> Result<()> {
        let camera = self.camera(i as u32, n);
        let cloud =
            Cloud { scene: self.scene, colors, world_from_scene: Affine3A::IDENTITY, visibility: None };
        let settings = SplatSettings::default();
        self.pass.project_and_sort(
            &mut self.gpu.encoding(encoder),
            &mut self.views[i],
            &camera,
            &[cloud],
            &settings,
        )?;
        Ok(())
    }

    fn draw(&mut self, encoder: &mut wgpu::CommandEncoder, i: usize) {
        let layer = Layer { color: &self.layer, depth: None };
        self.pass.draw_layer(&mut self.gpu.encoding(encoder), &mut self.views[i], &layer, &self.draw);
    }

    /// Composites the layer over part `i` of `n` of the picture.
    fn composite(&self, encoder: &mut wgpu::CommandEncoder, i: u32, n: u32) {
        let load = match i {
            0 => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
            _ => wgpu::LoadOp::Load,
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        let viewport = self.camera(i, n).viewport;
        self.composite.draw(&mut pass, &self.over, &self.input, viewport);
    }

    /// Whole frames of moving cameras.
    fn frames(&mut self, name: &str, n_cameras: u32, report: &mut Report) -> Result<()> {
        let gpu = self.gpu;
        let samples = Samples::of(WARM_UP, self.n_frames, || {
            self.frame += 1;
            gpu.time(|encoder| {
                for i in 0..n_cameras {
                    self.prepare(encoder, i as usize, n_cameras, CloudColors::Captured)?;
                    self.draw(encoder, i as usize);
                    self.composite(encoder, i, n_cameras);
                }
                Ok(())
            })
        })?;
        let n = self.scene.n_gaussians();
        let bytes = u64::from(n_cameras) * SplatView::bytes(n);
        report.add(Row { bytes: Some(bytes), ..Row::new(name, n, &samples) });
        Ok(())
    }

    /// The first camera's picture `[H, W]`.
    fn picture(&mut self) -> Result<Vec<[u8; 3]>> {
        let Gpu { device, queue, .. } = self.gpu;
        // At the first angle, where the reference stands.
        self.frame = 0;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.prepare(&mut encoder, 0, 1, CloudColors::Captured)?;
        self.draw(&mut encoder, 0);
        self.composite(&mut encoder, 0, 1);
        let [width, height] = self.picture;
        // WebGPU copies textures in rows of a multiple of 256 bytes. The padding is cut off below.
        let row_bytes = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let copy = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture"),
            size: u64::from(row_bytes * height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_texture_to_buffer(
            self.target.texture().as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &copy,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row_bytes),
                    rows_per_image: None,
                },
            },
            self.target.texture().size(),
        );
        queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        copy.map_async(wgpu::MapMode::Read, .., move |result| {
            // A receiver that is gone no longer wants to know.
            let _ = sender.send(result);
        });
        self.gpu.wait()?;
        receiver.recv()??;
        let bytes = copy.get_mapped_range(..);
        let rows = bytes.chunks_exact(row_bytes as usize).map(|row| &row[..4 * width as usize]);
        Ok(rows.flat_map(|row| row.chunks_exact(4).map(|p| [p[0], p[1], p[2]])).collect())
    }

    /// Measures the parts of a frame, each submitted alone.
    fn parts(&mut self, name: &str, report: &mut Report) -> Result<()> {
        let (gpu, n, n_frames) = (self.gpu, self.scene.n_gaussians(), self.n_frames);
        let mut add = |part: &str, run: &mut dyn FnMut() -> Result<f64>| {
            let samples = Samples::of(WARM_UP, n_frames, run)?;
            report.add(Row::new(format!("{part}, {name}"), n, &samples));
            anyhow::Ok(())
        };
        add("project and sort", &mut || {
            self.frame += 1;
            gpu.time(|encoder| self.prepare(encoder, 0, 1, CloudColors::Captured))
        })?;
        // If nothing moves and colors change, nothing is sorted. These colors are nothing but a share of the
        // captured ones.
        let changing = GaussianColors::new(&gpu.device, n)?;
        add("project", &mut || {
            changing.mark_changed();
            gpu.time(|encoder| self.prepare(encoder, 0, 1, CloudColors::Rgb(&changing)))
        })?;
        add("draw", &mut || {
            gpu.time(|encoder| {
                self.draw(encoder, 0);
                Ok(())
            })
        })?;
        add("composite", &mut || {
            gpu.time(|encoder| {
                self.composite(encoder, 0, 1);
                Ok(())
            })
        })
    }
}

fn texture(
    device: &wgpu::Device,
    [width, height]: [u32; 2],
    format: wgpu::TextureFormat,
    more: wgpu::TextureUsages,
) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING | more,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
