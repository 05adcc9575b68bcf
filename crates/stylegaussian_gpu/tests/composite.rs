//! The composite: a known layer over a known picture gives a known target.

mod target;

use glam::{Mat3, UVec4, Vec3};
use half::f16;
use stylegaussian_gpu::{
    device::HeadlessDevice,
    splat::{Composite, CompositeMode, InverseTable, ToneCurve, Tonemapping},
};
use target::{gpu, layer_of, read, texture};
use wgpu::TextureFormat::{Rgba8Unorm, Rgba8UnormSrgb, Rgba16Float};

/// Width of every picture, in pixels.
const WIDTH: u32 = 8;

/// A target of `background` with `layer` over it.
fn composited(
    gpu: &HeadlessDevice,
    layer: &[[f32; 4]],
    format: wgpu::TextureFormat,
    background: wgpu::Color,
    mode: CompositeMode,
    table: Option<&InverseTable>,
    stops: f32,
) -> Vec<[f32; 4]> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let composite = Composite::new(device);
    let pipeline = composite.pipeline(device, format, 1, mode);
    let input = composite.bind(device, &layer_of(gpu, layer, WIDTH), table);
    input.set_exposure(queue, stops);
    let height = layer.len() as u32 / WIDTH;
    let target = texture(device, [WIDTH, height], format, 1);
    target::pass(gpu, &target, None, background, |pass| {
        composite.draw(pass, &pipeline, &input, UVec4::new(0, 0, WIDTH, height));
    });
    read(gpu, &target)
}

/// A row that starts with `texels`.
fn row(texels: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let mut row = vec![[0.0; 4]; WIDTH as usize];
    row[..texels.len()].copy_from_slice(texels);
    row
}

fn linear_from_srgb(c: f32) -> f32 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

#[track_caller]
fn near(found: [f32; 4], expected: [f32; 4], tolerance: f32) {
    let close = found.iter().zip(&expected).all(|(a, b)| (a - b).abs() <= tolerance);
    assert!(close, "found {found:?}, expected {expected:?}");
}

const BLUE: wgpu::Color = wgpu::Color { r: 0.0, g: 0.0, b: 1.0, a: 1.0 };

#[test]
fn encoded_goes_over_as_it_is() {
    let Some(gpu) = gpu() else { return };
    let layer = row(&[[0.25, 0.5, 0.0, 0.5], [0.0; 4], [1.5, -0.5, 0.2, 1.0]]);
    let bytes = composited(&gpu, &layer, Rgba8Unorm, BLUE, CompositeMode::Encoded, None, 0.0);
    near(bytes[0], [0.25, 0.5, 0.5, 1.0], 2.0 / 255.0);
    near(bytes[1], [0.0, 0.0, 1.0, 1.0], 0.0);
    let floats = composited(&gpu, &layer, Rgba16Float, BLUE, CompositeMode::Encoded, None, 0.0);
    near(floats[2], [1.5, -0.5, 0.2, 1.0], 1e-3);
}

/// Straight (0.5, 1, 0) at half coverage over linear blue. An opaque texel comes back as the same byte.
#[test]
fn linear_targets_get_decoded_colors() {
    let Some(gpu) = gpu() else { return };
    let layer = row(&[[0.25, 0.5, 0.0, 0.5], [0.5, 0.25, 0.75, 1.0], [2.0, -1.0, 0.0, 1.0]]);
    let floats = composited(&gpu, &layer, Rgba16Float, BLUE, CompositeMode::LinearFromSrgb, None, 3.0);
    near(floats[0], [0.5 * linear_from_srgb(0.5), 0.5, 0.5, 1.0], 1e-3);
    near(floats[2], [1.0, 0.0, 0.0, 1.0], 1e-3);
    // Reading an sRGB texture gives back its bytes, undecoded.
    let bytes = composited(&gpu, &layer, Rgba8UnormSrgb, BLUE, CompositeMode::LinearFromSrgb, None, 0.0);
    near(bytes[1], [0.5, 0.25, 0.75, 1.0], 1.0 / 255.0);
}

/// Bevy 0.19's curves: linear scene color in, linear display color out.
mod forward {
    use glam::{Mat3, Vec3};

    pub fn reinhard(c: Vec3) -> Vec3 {
        c / (Vec3::ONE + c)
    }

    pub fn luminance(c: Vec3) -> f32 {
        c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
    }

    pub fn reinhard_luminance(c: Vec3) -> Vec3 {
        let l = luminance(c);
        if l > 0.0 { c * ((l / (1.0 + l)) / l) } else { c }
    }

    pub fn aces_fitted(c: Vec3) -> Vec3 {
        // WGSL's `v * m` takes the dot product with each column.
        let rgb_to_rrt = Mat3::from_cols_array(&[
            0.59719, 0.35458, 0.04823, 0.07600, 0.90834, 0.01566, 0.02840, 0.13383, 0.83777,
        ]);
        let odt_to_rgb = Mat3::from_cols_array(&[
            1.60475, -0.53108, -0.07367, -0.10208, 1.10813, -0.00605, -0.00327, -0.07276, 1.07602,
        ]);
        let v = rgb_to_rrt.transpose() * c;
        let a = v * (v + 0.0245786) - 0.000_090_537;
        let b = v * (0.983729 * v + 0.432_951) + 0.238081;
        (odt_to_rgb.transpose() * (a / b)).clamp(Vec3::ZERO, Vec3::ONE)
    }

    pub fn somewhat_boring(c: Vec3) -> Vec3 {
        let y = luminance(c);
        let cb = c.dot(Vec3::new(-0.1146, -0.3854, 0.5));
        let cr = c.dot(Vec3::new(0.5, -0.4542, -0.0458));
        let curve = |v: f32| 1.0 - (-v).exp();
        let bt = curve(cb.hypot(cr) * 2.4);
        let grayness = ((bt - 0.7) * 0.8).max(0.0).powi(2);
        let by_channel = c.lerp(Vec3::splat(y), grayness).map(curve);
        let by_luminance = c * (curve(y) / y.max(1e-5));
        by_luminance.lerp(by_channel, bt * bt) * 0.97
    }

    pub fn pbr_neutral(c: Vec3) -> Vec3 {
        let start = 0.8 - 0.04;
        let x = c.min_element();
        let offset = if x < 0.08 { x - 6.25 * x * x } else { 0.04 };
        let c = c - offset;
        let peak = c.max_element();
        if peak < start {
            return c;
        }
        let d = 1.0 - start;
        let new_peak = 1.0 - d * d / (peak + d - start);
        let g = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
        (c * (new_peak / peak)).lerp(Vec3::splat(new_peak), g)
    }
}

/// Opaque display-referred colors on a grid from 0 to 1, black and white included.
fn any_color() -> Vec<Vec3> {
    let steps = [0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0];
    (0..512).map(|i| Vec3::new(steps[i % 8], steps[i / 8 % 8], steps[i / 64])).collect()
}

/// Display colors of scene colors from 6 stops under to 2 stops over 1, encoded.
fn shown_colors(forward: impl Fn(Vec3) -> Vec3) -> Vec<Vec3> {
    let stops = |i: usize| 8.0 / 7.0 * i as f32 - 6.0;
    let scene = (0..512).map(|i| Vec3::new(stops(i % 8), stops(i / 8 % 8), stops(i / 64)).exp2());
    scene.map(|c| forward(c).map(srgb_from_linear)).collect()
}

fn srgb_from_linear(c: f32) -> f32 {
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

/// Composites display-referred `colors` under a camera's tone mapping. Returns the mean and the largest error
/// of a channel in the camera's picture, encoded.
fn errors(
    gpu: &HeadlessDevice,
    mode: CompositeMode,
    table: Option<&InverseTable>,
    stops: f32,
    colors: &[Vec3],
    forward: impl Fn(Vec3) -> Vec3,
) -> [f32; 2] {
    let layer: Vec<_> = colors.iter().map(|c| [c.x, c.y, c.z, 1.0]).collect();
    let target = composited(gpu, &layer, Rgba16Float, wgpu::Color::BLACK, mode, table, stops);
    let error = |(color, scene): (&Vec3, [f32; 4])| {
        let shown = forward(Vec3::from_slice(&scene[..3]) * stops.exp2());
        (shown.map(srgb_from_linear) - *color).abs().max_element()
    };
    let errors: Vec<f32> = colors.iter().zip(target).map(error).collect();
    [errors.iter().sum::<f32>() / errors.len() as f32, errors.into_iter().fold(0.0, f32::max)]
}

#[test]
fn curves_with_an_inverse_are_undone_exactly() {
    let Some(gpu) = gpu() else { return };
    // Linear 0.8 is where curves that never reach 1 are no longer undone exactly.
    let below_the_knee = any_color().into_iter().filter(|c| c.max_element() < 0.9).collect::<Vec<_>>();
    let check = |tonemapping, stops, colors: &[Vec3], forward: fn(Vec3) -> Vec3| {
        let mode = CompositeMode::InvertTonemapping(tonemapping);
        let [mean, worst] = errors(&gpu, mode, None, stops, colors, forward);
        println!("{tonemapping:?}: mean {mean:.5}, worst {worst:.5}");
        assert!(worst < 0.5 / 255.0, "{tonemapping:?}: {worst}");
    };
    check(Tonemapping::None, 0.0, &any_color(), |c| c);
    check(Tonemapping::None, 1.5, &any_color(), |c| c);
    check(Tonemapping::Reinhard, -1.0, &below_the_knee, forward::reinhard);
    check(Tonemapping::ReinhardLuminance, 0.5, &below_the_knee, forward::reinhard_luminance);
}

/// White gives bloom as much light as a sunlit wall and not as a lamp: 8 times the scene's 1, where the curve
/// itself asks for hundreds. Grays keep their order, and white loses 13 of 255 steps.
#[test]
fn whites_are_no_lamps() {
    let Some(gpu) = gpu() else { return };
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let table = identity_table(&gpu, 32);
    let tony = InverseTable::new(&gpu.device, &mut encoder, &ToneCurve::TonyMcMapface(table));
    gpu.queue.submit([encoder.finish()]);
    let grays: Vec<[f32; 4]> =
        (0..64).map(|i| [i as f32 / 63.0; 3]).map(|[r, g, b]| [r, g, b, 1.0]).collect();
    let curves = [
        (Tonemapping::Reinhard, None),
        (Tonemapping::ReinhardLuminance, None),
        (Tonemapping::TonyMcMapface, Some(&tony)),
    ];
    for (tonemapping, table) in curves {
        let mode = CompositeMode::InvertTonemapping(tonemapping);
        let scene = composited(&gpu, &grays, Rgba16Float, wgpu::Color::BLACK, mode, table, 0.0);
        let light: Vec<f32> = scene.iter().map(|texel| texel[1]).collect();
        assert!(light.windows(2).all(|pair| pair[0] < pair[1]), "{tonemapping:?}: {light:?}");
        assert!((7.5..8.1).contains(&light[63]), "{tonemapping:?}: {}", light[63]);
        let shown = srgb_from_linear(light[63] / (1.0 + light[63]));
        assert!(1.0 - shown < 13.5 / 255.0, "{tonemapping:?}: white is shown as {shown}");
    }
}

/// Colors that a curve shows are undone to about three steps of 8 bits, and on average to less than one. Any
/// other color becomes something near it. `least_mean` bounds the mean error of any color; it depends on how
/// much of the cube the curve cannot show.
fn check_table(
    gpu: &HeadlessDevice,
    curve: ToneCurve,
    tonemapping: Tonemapping,
    least_mean: f32,
    forward: impl Fn(Vec3) -> Vec3,
) {
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let table = InverseTable::new(&gpu.device, &mut encoder, &curve);
    gpu.queue.submit([encoder.finish()]);
    let mode = CompositeMode::InvertTonemapping(tonemapping);
    let [mean, worst] = errors(gpu, mode, Some(&table), 0.0, &shown_colors(&forward), &forward);
    println!("{tonemapping:?}, shown colors: mean {mean:.5}, worst {worst:.5}");
    let [any_mean, any_worst] = errors(gpu, mode, Some(&table), 0.0, &any_color(), &forward);
    println!("{tonemapping:?}, any color: mean {any_mean:.5}, worst {any_worst:.5}");
    assert!(mean < 3.0 / 255.0 && worst < 0.08, "{tonemapping:?}: mean {mean}, worst {worst}");
    assert!(any_mean < least_mean, "{tonemapping:?}: mean {any_mean}");
}

#[test]
fn curves_without_an_inverse_are_undone_as_far_as_possible() {
    let Some(gpu) = gpu() else { return };
    let check = |curve, tonemapping, least_mean, forward: fn(Vec3) -> Vec3| {
        check_table(&gpu, curve, tonemapping, least_mean, forward);
    };
    check(ToneCurve::AcesFitted, Tonemapping::AcesFitted, 0.08, forward::aces_fitted);
    check(ToneCurve::KhronosPbrNeutral, Tonemapping::KhronosPbrNeutral, 0.03, forward::pbr_neutral);
    let boring = (ToneCurve::SomewhatBoringDisplayTransform, Tonemapping::SomewhatBoringDisplayTransform);
    check(boring.0, boring.1, 0.03, forward::somewhat_boring);
}

/// A table that maps each coordinate to itself, so that only the axes of the curves are tested.
fn identity_table(gpu: &HeadlessDevice, size: u32) -> wgpu::TextureView {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: size },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let at = |i: u32| f16::from_f32(i as f32 / (size - 1) as f32);
    let texels: Vec<[f16; 4]> = (0..size.pow(3))
        .map(|i| [at(i % size), at(i / size % size), at(i / size / size), f16::ONE])
        .collect();
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * size), rows_per_image: Some(size) };
    let bytes = bytemuck::cast_slice(&texels);
    gpu.queue.write_texture(texture.as_image_copy(), bytes, layout, texture.size());
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Stops from middle gray. `lowest` becomes 0, `highest` becomes 1.
fn stops_between(c: Vec3, lowest: f32, highest: f32) -> Vec3 {
    c.map(|c| ((c.max(1.5e-5) / 0.18).log2().clamp(lowest, highest) - lowest) / (highest - lowest))
}

#[test]
fn curves_that_are_tables_are_undone() {
    let Some(gpu) = gpu() else { return };
    let table = identity_table(&gpu, 32);
    // More than half of the colors have a channel above the knee, which is dimmed by up to 13 of 255 steps.
    check_table(
        &gpu,
        ToneCurve::TonyMcMapface(table.clone()),
        Tonemapping::TonyMcMapface,
        0.025,
        forward::reinhard,
    );
    let filmic = |c| stops_between(c, -11.0, 12.0);
    check_table(&gpu, ToneCurve::BlenderFilmic(table.clone()), Tonemapping::BlenderFilmic, 0.12, filmic);
    let agx = |c: Vec3| {
        let inset = Mat3::from_cols_array(&[
            0.842_479_06,
            0.0784336,
            0.079_223_75,
            0.042_328_24,
            0.878_468_64,
            0.079_166_13,
            0.042_375_65,
            0.0784336,
            0.879_143,
        ]);
        stops_between(inset.transpose() * c, -10.0, 6.5)
    };
    check_table(&gpu, ToneCurve::AgX(table), Tonemapping::AgX, 0.3, agx);
}
