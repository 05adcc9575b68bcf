//! Apps that render without a window, and images read back from them.

use std::path::Path;

use bevy::{
    app::TaskPoolPlugin,
    asset::{AssetPlugin, RenderAssetUsages},
    camera::{CameraPlugin, RenderTarget},
    core_pipeline::CorePipelinePlugin,
    diagnostic::{DiagnosticsPlugin, FrameCountPlugin},
    input::InputPlugin,
    light::LightPlugin,
    mesh::MeshPlugin,
    pbr::PbrPlugin,
    prelude::*,
    render::{
        RenderApp, RenderPlugin,
        error_handler::RenderErrorHandler,
        render_asset::RenderAssets,
        render_resource::{
            BufferDescriptor, BufferUsages, CommandEncoderDescriptor, Extent3d, MapMode, PollType,
            TexelCopyBufferInfo, TexelCopyBufferLayout, TextureDimension, TextureFormat, TextureUsages,
        },
        renderer::{RenderDevice, RenderQueue},
        settings::WgpuSettings,
        texture::GpuImage,
    },
    time::TimePlugin,
    window::{ExitCondition, WindowPlugin},
};

use stylegaussian::splat::RenderedImage;

use crate::{StyleGaussianPlugin, style::decoder::StyleBackend};

/// An app that renders without a window, in which any render error fails the test. If there is no adapter, it
/// prints `SKIPPED` and returns `None`.
pub fn app_with_rendering(backend: StyleBackend) -> Option<App> {
    app_with_settings(backend, WgpuSettings::default())
}

/// As [`app_with_rendering`], on a device of these settings.
pub fn app_with_settings(backend: StyleBackend, settings: WgpuSettings) -> Option<App> {
    let mut app = app_without_splats(settings)?;
    app.insert_resource(backend).insert_resource(super::QUICK_THREADS);
    app.add_plugins(StyleGaussianPlugin { synchronous_pipeline_compilation: true });
    Some(finish(app))
}

/// An app that renders, before any plugin of ours is added and before it is [finished](finish). `None` if there
/// is no adapter.
pub fn app_without_splats(settings: WgpuSettings) -> Option<App> {
    // Asked before the app is made: Bevy's `RenderPlugin` panics if it finds no adapter.
    if !has_adapter() {
        return None;
    }
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let file_path = assets.to_string_lossy().into_owned();
    Some(app_of_settings(settings, AssetPlugin { file_path, ..default() }))
}

/// Whether there is an adapter. If there is none, it prints `SKIPPED`.
pub fn has_adapter() -> bool {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let options = wgpu::RequestAdapterOptions::default();
    let is_there = bevy::tasks::block_on(instance.request_adapter(&options)).is_ok();
    if !is_there {
        eprintln!("SKIPPED: no GPU adapter");
    }
    is_there
}

/// The same, whether or not there is an adapter, and with assets from another source.
pub fn app_of_settings(settings: WgpuSettings, assets: AssetPlugin) -> App {
    let mut app = App::new();
    // Named one by one and not `DefaultPlugins`: no window, and no pipelined rendering, so that an update draws
    // its own frame.
    app.add_plugins((
        TaskPoolPlugin::default(),
        FrameCountPlugin,
        TimePlugin,
        TransformPlugin,
        DiagnosticsPlugin,
        InputPlugin,
        WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() },
        assets,
        RenderPlugin {
            render_creation: settings.into(),
            synchronous_pipeline_compilation: true,
            ..default()
        },
        ImagePlugin::default(),
        MeshPlugin,
        CameraPlugin,
        LightPlugin,
        CorePipelinePlugin,
        PbrPlugin::default(),
    ));
    // By default Bevy logs a render error and stops rendering. Tests would then pass on old pictures.
    app.insert_resource(RenderErrorHandler(|error, _, _| panic!("{error:?}")));
    app
}

/// Finishes the plugins of an app, as a runner does.
pub fn finish(mut app: App) -> App {
    app.finish();
    app.cleanup();
    app
}

/// An image to render into.
pub fn render_target(app: &mut App, size: UVec2) -> Handle<Image> {
    let extent = Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 };
    let (format, usages) = (TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::default());
    let mut image = Image::new_fill(extent, TextureDimension::D2, &[0; 4], format, usages);
    image.texture_descriptor.usage |= TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
    super::add(app, image)
}

/// A camera's target component.
pub fn target(image: &Handle<Image>) -> RenderTarget {
    RenderTarget::Image(image.clone().into())
}

/// The pixels of a render target, row-major, in sRGB values of 0..1.
pub fn read_back(app: &App, image: &Handle<Image>) -> Vec<[f32; 4]> {
    let world = app.sub_app(RenderApp).world();
    let (device, queue) = (world.resource::<RenderDevice>(), world.resource::<RenderQueue>());
    let gpu = world.resource::<RenderAssets<GpuImage>>().get(image).expect("the target is on the GPU");
    let size = gpu.texture_descriptor.size;
    // wgpu copies textures to rows of a multiple of 256 bytes (`COPY_BYTES_PER_ROW_ALIGNMENT`).
    let row = (size.width * 4).next_multiple_of(256);
    let buffer = device.create_buffer(&BufferDescriptor {
        label: Some("read_back"),
        size: u64::from(row * size.height),
        usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
    let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
    let destination = TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(gpu.texture.as_image_copy(), destination, size);
    queue.submit([encoder.finish()]);
    buffer.slice(..).map_async(MapMode::Read, |result| result.expect("mapped"));
    device.poll(PollType::wait_indefinitely()).expect("the device answers");
    let bytes = buffer.slice(..).get_mapped_range();
    let pixels = bytes.chunks_exact(row as usize).flat_map(|row| {
        let texels = row[..size.width as usize * 4].chunks_exact(4);
        texels.map(|texel| [0, 1, 2, 3].map(|i| f32::from(texel[i]) / 255.0))
    });
    pixels.collect()
}

/// Allocations on the device.
#[derive(Clone, Debug, PartialEq)]
pub struct Allocations {
    /// Number of allocations in the allocator's report. The report's bytes include the padding before a
    /// resource, so they depend on its place; the bytes below do not.
    pub n: usize,
    pub n_buffers: isize,
    pub buffer_bytes: isize,
    pub texture_bytes: isize,
}

/// Allocations once all work of the device is done, or `None` if it does not report them.
pub fn allocations(app: &App) -> Option<Allocations> {
    let device = app.sub_app(RenderApp).world().resource::<RenderDevice>();
    device.poll(PollType::wait_indefinitely()).expect("the device answers");
    let n = device.wgpu_device().generate_allocator_report()?.allocations.len();
    let counters = device.wgpu_device().get_internal_counters().hal;
    let found = Allocations {
        n,
        n_buffers: counters.buffers.read(),
        buffer_bytes: counters.buffer_memory.read(),
        texture_bytes: counters.texture_memory.read(),
    };
    // The counters are 0 unless wgpu's feature `counters` is on. Equal zeros would prove nothing.
    assert!(found.buffer_bytes > 0 && found.texture_bytes > 0, "wgpu counts nothing: {found:?}");
    Some(found)
}

/// A picture of the CPU rasterizer over black, as a camera blends it: the colors are display-referred, and the
/// blend is linear.
pub fn over_black(view: &RenderedImage) -> Vec<[f32; 3]> {
    let blend = |(color, &alpha): (&[f32; 3], &f32)| {
        let linear = |channel: f32| alpha * Srgba::gamma_function(channel / alpha.max(1e-6));
        color.map(|channel| Srgba::gamma_function_inverse(linear(channel)).clamp(0.0, 1.0))
    };
    view.color.iter().zip(&view.alpha).map(blend).collect()
}

/// Peak signal-to-noise ratio of the chosen pixels' colors, in dB, for values of 0..1.
pub fn psnr(a: &[[f32; 3]], b: &[[f32; 3]], chosen: impl Fn(usize) -> bool) -> f32 {
    let (mut sum, mut n) = (0.0_f64, 0);
    for i in (0..a.len()).filter(|&i| chosen(i)) {
        for channel in 0..3 {
            sum += f64::from(a[i][channel] - b[i][channel]).powi(2);
            n += 1;
        }
    }
    (-10.0 * (sum / f64::from(n)).log10()) as f32
}
