//! Costs of light: frames of the splat pass with one of its features, and with several, in turns with plain
//! ones.

use anyhow::Result;
use glam::{Affine3A, Mat4, UVec2, UVec4, Vec3};
use stylegaussian::light::{Falloff, Fog, ShadowCascade, Tint};
use stylegaussian_gpu::splat::{
    Camera, CastView, Caster, Cloud, CloudColors, Composite, CompositeInput, CompositeMode,
    CompositePipeline, GpuScene, IsoDepth, Layer, SHADOW_FORMAT, Shadows, SplatPass, SplatPipeline,
    SplatSettings, SplatView, ViewLight,
};
use wgpu::TextureFormat::Depth32Float;

use crate::{
    frame::{FIRST_ANGLE, FOV, around_structured},
    gpu::Gpu,
    measure::Samples,
    plan::Plan,
    report::{Report, Row, names},
    scenes,
};

/// Gaussians of the structured scene.
const N: usize = 100_000;
/// Width and height of a picture.
const SIZE: u32 = 512;
/// Width and height of the shadow map, Bevy's default.
const MAP_SIZE: u32 = 2048;
/// Half the width of the structured scene, with all of its corners.
const HALF_WIDTH: f32 = 6.0;
/// Samples per pixel of MSAA.
const SAMPLES: u32 = 4;
/// Frames before those that count: the first ones allocate.
const WARM_UP: usize = 4;
/// Near plane of the cameras.
const NEAR: f32 = 0.1;
const TARGET: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// Two triangles before and behind some of the splats, whose edges cross the picture. Depth is 0.1 / z.
const MESH: &str = "
    @vertex fn mesh(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
        var corners = array(
            vec3(-0.9, -0.8, 0.026), vec3(0.4, -0.6, 0.022), vec3(-0.2, 0.9, 0.016),
            vec3(0.1, -0.9, 0.018), vec3(0.95, 0.1, 0.024), vec3(0.2, 0.7, 0.015),
        );
        return vec4<f32>(corners[i], 1.0);
    }";

/// Measures all of them.
pub fn run(gpu: &Gpu, plan: &Plan, report: &mut Report) -> Result<()> {
    let stage = Stage::new(gpu)?;
    let frames: [(&str, &mut dyn FnMut() -> Result<f64>); 7] = [
        (names::PLAIN, &mut plain(&stage)),
        (names::MSAA, &mut msaa(&stage)),
        (names::TWO_EYES, &mut two_eyes(&stage)),
        (names::HALF_SIZE, &mut half_size(&stage)),
        (names::CASTING, &mut casting(&stage, 0.0)),
        (names::CASTING_ANEW, &mut casting(&stage, 0.02)),
        (names::ALL_LIGHT, &mut all(&stage)?),
    ];
    let (names, mut runs): (Vec<_>, Vec<_>) = frames.into_iter().unzip();
    let samples = Samples::in_turns(WARM_UP, if plan.quick { 12 } else { 20 }, &mut runs)?;
    for (name, samples) in names.into_iter().zip(&samples) {
        report.add(Row::new(name, N, samples));
    }
    Ok(())
}

/// The scene among meshes, and what draws it.
struct Stage<'a> {
    gpu: &'a Gpu,
    scene: GpuScene,
    pass: SplatPass,
    draw: SplatPipeline,
    composite: Composite,
    over: CompositePipeline,
    layer: wgpu::TextureView,
    input: CompositeInput,
    /// Depth of the meshes, with one sample.
    depth: wgpu::TextureView,
    target: wgpu::TextureView,
}

impl<'a> Stage<'a> {
    fn new(gpu: &'a Gpu) -> Result<Self> {
        let device = &gpu.device;
        let (pass, composite) = (SplatPass::new(device), Composite::new(device));
        let layer = pass.layer(device, UVec2::splat(SIZE));
        Ok(Self {
            gpu,
            scene: GpuScene::new(device, &scenes::structured(N))?,
            draw: pass.pipeline(device, 1, Some(Depth32Float)),
            over: composite.pipeline(device, TARGET, 1, CompositeMode::LinearFromSrgb),
            input: composite.bind(device, &layer, None),
            depth: depth_of_meshes(gpu, 1),
            target: picture(device, TARGET, 1),
            pass,
            composite,
            layer,
        })
    }

    fn cloud(&self) -> Cloud<'_> {
        let world_from_scene = Affine3A::IDENTITY;
        Cloud { scene: &self.scene, colors: CloudColors::Captured, world_from_scene, visibility: None }
    }

    fn sort(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        view: &mut SplatView,
        camera: &Camera,
        settings: &SplatSettings,
    ) -> Result<()> {
        let clouds = [self.cloud()];
        self.pass.project_and_sort(&mut self.gpu.encoding(encoder), view, camera, &clouds, settings)?;
        Ok(())
    }

    /// Draws a view and composites it.
    fn draw(&self, encoder: &mut wgpu::CommandEncoder, view: &mut SplatView) {
        let layer = Layer { color: &self.layer, depth: Some(&self.depth) };
        self.pass.draw_layer(&mut self.gpu.encoding(encoder), view, &layer, &self.draw);
        self.composite(encoder, (&self.over, &self.input), &self.target, None);
    }

    fn composite(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (over, input): (&CompositePipeline, &CompositeInput),
        target: &wgpu::TextureView,
        resolve: Option<&wgpu::TextureView>,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: resolve,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        self.composite.draw(&mut pass, over, input, UVec4::new(0, 0, SIZE, SIZE));
    }
}

/// The camera of a frame, moved to its right by `aside`. It turns by about a degree per frame, because one that
/// stands still would skip the sort.
fn camera(frame: u32, aside: f32) -> Camera {
    let pose = around_structured(FIRST_ANGLE + 0.02 * frame as f32);
    Camera {
        world_from_view: pose * Affine3A::from_translation(aside * Vec3::X),
        clip_from_view: Mat4::perspective_infinite_reverse_rh(FOV, 1.0, NEAR),
        viewport: UVec4::new(0, 0, SIZE, SIZE),
    }
}

/// Frames without any of light's features.
fn plain<'a>(stage: &'a Stage<'a>) -> impl FnMut() -> Result<f64> + 'a {
    let (mut view, mut frame) = (SplatView::new(), 0);
    move || {
        frame += 1;
        stage.gpu.time(|encoder| {
            stage.sort(encoder, &mut view, &camera(frame, 0.0), &SplatSettings::default())?;
            stage.draw(encoder, &mut view);
            Ok(())
        })
    }
}

/// Frames over a target with four samples per pixel.
fn msaa<'a>(stage: &'a Stage<'a>) -> impl FnMut() -> Result<f64> + 'a {
    let device = &stage.gpu.device;
    let layers = stage.pass.edge_layers(device, UVec2::splat(SIZE));
    let depth = depth_of_meshes(stage.gpu, SAMPLES);
    let target = picture(device, TARGET, SAMPLES);
    let mode = CompositeMode::LinearFromSrgb;
    let over = stage.composite.edge_pipeline(device, TARGET, [SAMPLES; 2], mode);
    let input = stage.composite.bind_edges(device, &layers, None);
    let (mut view, mut frame) = (SplatView::new(), 0);
    move || {
        frame += 1;
        let camera = camera(frame, 0.0);
        stage.gpu.time(|encoder| {
            stage.sort(encoder, &mut view, &camera, &SplatSettings::default())?;
            let to = (&layers, &depth);
            stage.pass.draw_edge_layers(
                &mut stage.gpu.encoding(encoder),
                &mut view,
                &camera,
                to,
                &stage.draw,
            );
            stage.composite(encoder, (&over, &input), &target, Some(&stage.target));
            Ok(())
        })
    }
}

/// Frames of two eyes, each as large as the plain picture.
fn two_eyes<'a>(stage: &'a Stage<'a>) -> impl FnMut() -> Result<f64> + 'a {
    let (mut views, mut frame) = ([SplatView::new(), SplatView::new()], 0);
    move || {
        frame += 1;
        let (left, right) = (camera(frame, -0.03), camera(frame, 0.03));
        stage.gpu.time(|encoder| {
            let [first, second] = &mut views;
            let (both, cameras, settings) = ([first, second], [&left, &right], SplatSettings::default());
            let clouds = [stage.cloud()];
            stage.pass.project_and_sort_eyes(
                &mut stage.gpu.encoding(encoder),
                both,
                cameras,
                &clouds,
                &settings,
            )?;
            for view in &mut views {
                stage.draw(encoder, view);
            }
            Ok(())
        })
    }
}

/// Frames whose splats are drawn at half the width and height.
fn half_size<'a>(stage: &'a Stage<'a>) -> impl FnMut() -> Result<f64> + 'a {
    let half = stage.pass.half_layer(&stage.gpu.device, UVec2::splat(SIZE));
    let settings = SplatSettings { half_size: true, ..SplatSettings::default() };
    let (mut view, mut frame) = (SplatView::new(), 0);
    move || {
        frame += 1;
        let camera = camera(frame, 0.0);
        stage.gpu.time(|encoder| {
            stage.sort(encoder, &mut view, &camera, &settings)?;
            let to = (&half, &stage.layer, &stage.depth);
            stage.pass.draw_half_layer(&mut stage.gpu.encoding(encoder), &mut view, &camera, to, &stage.draw);
            stage.composite(encoder, (&stage.over, &stage.input), &stage.target, None);
            Ok(())
        })
    }
}

/// A shadow map of a directional light that sees the whole scene, from nearly above.
struct Map {
    texture: wgpu::Texture,
    layer: wgpu::TextureView,
    camera: Camera,
    casters: CastView,
}

impl Map {
    fn new(gpu: &Gpu) -> Self {
        let texture = texture(&gpu.device, [MAP_SIZE, 1], SHADOW_FORMAT, 1);
        let view_from_world = Affine3A::look_at_rh(Vec3::new(2.0, 9.0, 3.0), Vec3::ZERO, Vec3::Y);
        let camera = Camera {
            world_from_view: view_from_world.inverse(),
            // Reverse z: the far plane is named first.
            clip_from_view: Mat4::orthographic_rh(
                -HALF_WIDTH,
                HALF_WIDTH,
                -HALF_WIDTH,
                HALF_WIDTH,
                20.0,
                0.0,
            ),
            viewport: UVec4::new(0, 0, MAP_SIZE, MAP_SIZE),
        };
        let layer = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { texture, layer, camera, casters: CastView::new() }
    }

    /// Clears the map, and draws the scene into it.
    fn draw(&mut self, stage: &Stage, encoder: &mut wgpu::CommandEncoder) -> Result<()> {
        let threshold = stylegaussian::splat::CAST_THRESHOLD;
        let casters = [Caster { cloud: stage.cloud(), threshold, faded: 0.0 }];
        let light = (&self.camera, NEAR);
        stage.pass.project_casters(&mut stage.gpu.encoding(encoder), &mut self.casters, light, &casters)?;
        stage.pass.cast(&mut depth_pass(encoder, &self.layer), &self.casters);
        Ok(())
    }

    /// The map as splats are compared with it.
    fn shadows(&self, device: &wgpu::Device) -> Shadows {
        let view = |texture: &wgpu::Texture, dimension| {
            let descriptor = wgpu::TextureViewDescriptor { dimension: Some(dimension), ..Default::default() };
            texture.create_view(&descriptor)
        };
        let no_cubes = texture(device, [1, 6], SHADOW_FORMAT, 1);
        let clip_from_point = self.camera.clip_from_view * Mat4::from(self.camera.world_from_view.inverse());
        Shadows {
            maps: view(&self.texture, wgpu::TextureViewDimension::D2Array),
            cubes: view(&no_cubes, wgpu::TextureViewDimension::CubeArray),
            cascades: vec![ShadowCascade {
                clip_from_point,
                offset: Vec3::new(0.01, 0.04, 0.01),
                far: 100.0,
            }],
            lamps: Vec::new(),
        }
    }
}

/// Frames before which the scene is drawn into a shadow map. The light turns around its axis by `turn` per
/// frame, in radians.
fn casting<'a>(stage: &'a Stage<'a>, turn: f32) -> impl FnMut() -> Result<f64> + 'a {
    let mut map = Map::new(stage.gpu);
    let (mut view, mut frame) = (SplatView::new(), 0);
    move || {
        frame += 1;
        map.camera.world_from_view *= Affine3A::from_rotation_z(turn);
        stage.gpu.time(|encoder| {
            map.draw(stage, encoder)?;
            stage.sort(encoder, &mut view, &camera(frame, 0.0), &SplatSettings::default())?;
            stage.draw(encoder, &mut view);
            Ok(())
        })
    }
}

/// Frames with a tint, fog and shadows on splats, whose depth is written.
fn all<'a>(stage: &'a Stage<'a>) -> Result<impl FnMut() -> Result<f64> + 'a> {
    let Gpu { device, queue, .. } = stage.gpu;
    let mut map = Map::new(stage.gpu);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    map.draw(stage, &mut encoder)?;
    queue.submit([encoder.finish()]);
    let fog = Fog {
        color: Vec3::new(0.5, 0.6, 0.7),
        strength: 1.0,
        falloff: Falloff::Exponential { density: 0.05 },
        suns: Vec::new(),
        exponent: 1.0,
    };
    let mut view = SplatView::new();
    view.set_light(Some(ViewLight {
        fog: Some(fog),
        tints: vec![Tint { exposure: -0.5, saturation: 0.8, ..Tint::IDENTITY }],
        shadows: Some(map.shadows(device)),
        shadow_amounts: vec![0.5],
        ..ViewLight::default()
    }));
    let written = picture(device, Depth32Float, 1);
    let write = stage.pass.depth_pipeline(device, 1, Depth32Float);
    let (mut iso, mut frame) = (IsoDepth::default(), 0);
    Ok(move || {
        frame += 1;
        stage.gpu.time(|encoder| {
            stage.sort(encoder, &mut view, &camera(frame, 0.0), &SplatSettings::default())?;
            stage.draw(encoder, &mut view);
            let threshold = stylegaussian::splat::ISO_THRESHOLD;
            stage.pass.find_depth(&mut stage.gpu.encoding(encoder), &mut view, threshold, &mut iso);
            stage.pass.write_depth(&mut depth_pass(encoder, &written), &iso, &write);
            Ok(())
        })
    })
}

/// A pass over a depth that it clears.
fn depth_pass<'a>(encoder: &'a mut wgpu::CommandEncoder, depth: &wgpu::TextureView) -> wgpu::RenderPass<'a> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depth,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}

/// The depth that the meshes leave, with so many samples per pixel.
fn depth_of_meshes(gpu: &Gpu, samples: u32) -> wgpu::TextureView {
    let device = &gpu.device;
    let depth = picture(device, Depth32Float, samples);
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(MESH.into()),
    });
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
        fragment: None,
        multiview_mask: None,
        cache: None,
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = depth_pass(&mut encoder, &depth);
    pass.set_pipeline(&pipeline);
    pass.draw(0..6, 0..1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    depth
}

/// A texture of the picture's size.
fn picture(device: &wgpu::Device, format: wgpu::TextureFormat, samples: u32) -> wgpu::TextureView {
    texture(device, [SIZE, 1], format, samples).create_view(&wgpu::TextureViewDescriptor::default())
}

/// A square texture with layers that can be drawn to and bound.
fn texture(
    device: &wgpu::Device,
    [side, n_layers]: [u32; 2],
    format: wgpu::TextureFormat,
    samples: u32,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: n_layers },
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    })
}
