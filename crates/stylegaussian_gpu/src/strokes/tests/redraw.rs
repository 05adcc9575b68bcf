//! Textures of images that change: the kernels beside their twin.

use stylegaussian::{
    paint::{Canvas, Paint, redraw},
    random::Random,
};

use super::{
    plan::{Plan, PlanKey},
    *,
};

fn gpu() -> Option<HeadlessDevice> {
    let gpu = pollster::block_on(HeadlessDevice::request(DeviceOptions::default()));
    if gpu.is_err() {
        eprintln!("SKIPPED: no GPU adapter");
    }
    gpu.ok()
}

/// A texture of `size` that holds `bytes`.
fn image(
    gpu: &HeadlessDevice,
    format: wgpu::TextureFormat,
    size: [u32; 2],
    bytes: &[u8],
) -> wgpu::TextureView {
    let size = wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("image"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let row = bytes.len() as u32 / size.height;
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
    gpu.queue.write_texture(texture.as_image_copy(), bytes, layout, size);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Random shapes of several sizes, with alpha `[H * W]`.
fn shapes([width, height]: [u32; 2], seed: u64) -> Vec<[u8; 4]> {
    let mut random = Random::new(seed);
    let mut pixels = vec![[90, 120, 150, 255]; (width * height) as usize];
    for _ in 0..200 {
        let side = 1 + random.below(20) as u32;
        let [left, top] = [width, height].map(|n| random.below(u64::from(n) as usize) as u32);
        let color: [u8; 4] = std::array::from_fn(|i| random.below(256) as u8 | if i == 3 { 0x80 } else { 0 });
        for y in top..(top + side).min(height) {
            for x in left..(left + side).min(width) {
                pixels[(y * width + x) as usize] = color;
            }
        }
    }
    pixels
}

/// The paint of an image, by the twin.
fn paint([width, height]: [u32; 2], pixels: &[[u8; 4]]) -> Paint {
    let rgba: Vec<_> = pixels.iter().map(|pixel| pixel.map(|byte| f32::from(byte) / 255.0)).collect();
    redraw::read(width, height, &rgba)
}

/// All levels of a layer: fine detail, then wide detail.
fn levels(gpu: &HeadlessDevice, store: &StrokeStore, layer: u32) -> Vec<Vec<[i8; 4]>> {
    let arrays = store.arrays(&gpu.device);
    let mut found = Vec::new();
    for array in [arrays.fine, arrays.wide] {
        for level in 0..array.mip_level_count() {
            let side = array.width() >> level;
            let row = (4 * side).next_multiple_of(256);
            let usage = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
            let buffer = buffers::create(&gpu.device, "level", u64::from(row * side), usage);
            let layout =
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
            let from = wgpu::TexelCopyTextureInfo {
                mip_level: level,
                origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
                ..array.as_image_copy()
            };
            let size = wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 };
            let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
            encoder.copy_texture_to_buffer(from, to, size);
            gpu.queue.submit([encoder.finish()]);
            let texels = |bytes: &[u8]| -> Vec<[i8; 4]> {
                let rows = bytes.chunks(row as usize).map(|row| &row[..4 * side as usize]);
                rows.flat_map(|row| row.as_chunks().0.iter().map(|texel: &[u8; 4]| texel.map(|b| b as i8)))
                    .collect()
            };
            found.push(buffers::read(&gpu.device, &gpu.queue, &buffer, texels).unwrap());
        }
    }
    found
}

/// Memory and dispatches of a painting that is as large as it is read.
#[test]
fn plans_have_the_pictures_of_all_steps() {
    let (original, reading) = ([512, 512], Some([512, 512]));
    let plan = Plan::new(PlanKey { original, reading, n_channels: 4, is_linear: false });
    let n = 512 * 512;
    // The painting, and rows of a blur; fine and wide detail; copies of the same size, of a half, a quarter and
    // an eighth; energies in a quarter; two sums, and sums of 1024 pixels each of the painting and of energies.
    let detail = (4_u32.pow(10) - 1) / 3 + (4_u32.pow(8) - 1) / 3;
    let copies = 3 * n + n / 4 + n / 16 + n / 64;
    assert_eq!(plan.n_pixels, 2 * n + detail + copies + n / 16 + 2 + n / 1024 + n / 16 / 1024);
    // One to read, one to resize, two for each of six blurs, three to halve copies and two for energies, one
    // for squares, two for each of two sums, two for detail, and one for each of 10 and 8 levels.
    assert_eq!(plan.steps.len(), 1 + 1 + 12 + 5 + 1 + 4 + 2 + 18);
    // A row takes 64 texels at least, of which levels of less than 64 columns leave some unused.
    let packed =
        |side: u32| (0..=side.ilog2()).map(move |level| side >> level).map(|side| side * side.max(64));
    assert_eq!(plan.n_packed, packed(512).chain(packed(128)).sum::<u32>());
    let read = Plan::new(PlanKey { original: [300, 200], reading: None, n_channels: 4, is_linear: false });
    assert_eq!((read.steps.len(), read.n_pixels), (1, 60_000));
    // What is read from half as many pixels as it has is blurred before.
    let softened =
        Plan::new(PlanKey { original, reading: Some([256, 256]), n_channels: 4, is_linear: false });
    assert_eq!(softened.steps.len(), plan.steps.len() + 2);
}

/// Draws an image into the texture of `canvas`, which is the second of a store.
fn redrawn(gpu: &HeadlessDevice, canvas: &Canvas, image: &PaintImage) -> Vec<Vec<[i8; 4]>> {
    let store = StrokeStore::new();
    let strokes = strokes(&[&texture(0.5), canvas.texture()]);
    let uploaded = store.upload(&gpu.device, &gpu.queue, &strokes).unwrap();
    let layer = store.layer_of(canvas.texture()).unwrap();
    let redrawer = StrokeRedrawer::new(&gpu.device);
    let before = levels(gpu, &store, 0);
    // Twice, on the same memory.
    for _ in 0..2 {
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let reading = canvas.reading_size();
        redrawer.encode(&mut gpu.encoding(&mut encoder), image, reading, &store, &layer).unwrap();
        gpu.queue.submit([encoder.finish()]);
    }
    assert!(levels(gpu, &store, 0) == before, "another layer changed");
    let found = levels(gpu, &store, 1);
    drop(uploaded);
    assert_eq!(store.layer_of(canvas.texture()), None);
    // Strokes that are gone have no layer to draw into.
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let reading = canvas.reading_size();
    redrawer.encode(&mut gpu.encoding(&mut encoder), image, reading, &store, &layer).unwrap();
    found
}

/// Every level of every texel is that of the twin, to a step of a byte, for images that are enlarged, shrunk,
/// of odd sizes, and of other proportions than the first picture.
#[test]
fn a_changed_image_gives_the_texture_of_its_twin() {
    let Some(gpu) = gpu() else { return };
    let first = paint([160, 120], &shapes([160, 120], 1));
    let canvas = Canvas::new(&first);
    let sizes = [[160, 120], [97, 203], [700, 500]];
    for (seed, size) in (2..).zip(sizes) {
        let pixels = shapes(size, seed);
        let format = wgpu::TextureFormat::Rgba8UnormSrgb;
        let view = image(&gpu, format, size, pixels.as_flattened());
        let found = redrawn(&gpu, &canvas, &PaintImage { view: &view, format, size });
        let expected = redraw::redrawn(&paint(size, &pixels), canvas.reading_size());
        assert_eq!(found.len(), expected.fine.len() + expected.wide.len());
        let mut largest = 0;
        for (level, expected) in found.iter().zip(expected.fine.iter().chain(&expected.wide)) {
            assert_eq!(level.len(), expected.len());
            let steps = level.as_flattened().iter().zip(expected.as_flattened());
            largest = steps.map(|(a, b)| (i16::from(*a) - i16::from(*b)).abs()).fold(largest, i16::max);
        }
        let contrast = expected.fine[0].as_flattened().iter().map(|byte| i16::from(*byte).abs()).max();
        eprintln!("{size:?}: at most {largest} steps of 127, of {contrast:?}");
        assert!(largest <= 1, "{size:?}: {largest} steps of 127");
        assert!(contrast > Some(40), "{size:?} has no detail to compare");
    }
}

/// Formats are read as their colors look, and their pixels are copied to main memory as the twin reads them.
#[test]
fn pixels_are_read_back_in_every_format() {
    use wgpu::TextureFormat as Format;
    let Some(gpu) = gpu() else { return };
    let size = [40, 24];
    let pixels = shapes(size, 7);
    let linear = |byte: u8| {
        let value = f32::from(byte) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    let swapped: Vec<_> = pixels.iter().flat_map(|[r, g, b, a]| [*b, *g, *r, *a]).collect();
    let floats = |pixel: &[u8; 4]| {
        let [r, g, b, a] = *pixel;
        [linear(r), linear(g), linear(b), f32::from(a) / 255.0].map(half::f16::from_f32)
    };
    let floats: Vec<_> = pixels.iter().flat_map(floats).collect();
    let gray: Vec<u8> = pixels.iter().map(|pixel| pixel[0]).collect();
    let grays: Vec<_> = pixels.iter().map(|[r, ..]| [*r, *r, *r, 255]).collect();
    let redrawer = StrokeRedrawer::new(&gpu.device);
    let bytes = pixels.as_flattened();
    for (format, bytes, expected) in [
        (Format::Rgba8UnormSrgb, bytes, &pixels),
        (Format::Rgba8Unorm, bytes, &pixels),
        (Format::Bgra8UnormSrgb, &swapped, &pixels),
        (Format::Rgba16Float, bytemuck::cast_slice(&floats), &pixels),
        (Format::R8Unorm, &gray, &grays),
    ] {
        let view = image(&gpu, format, size, bytes);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let source = PaintImage { view: &view, format, size };
        let mut copy = redrawer.encode_read(&mut gpu.encoding(&mut encoder), &source).unwrap();
        gpu.queue.submit([encoder.finish()]);
        assert!(copy.poll().is_none(), "the first call begins");
        gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let found = copy.poll().expect("mapped").unwrap();
        let expected = paint(size, expected);
        assert_eq!((found.width, found.height), (expected.width, expected.height));
        // A half float has 11 bits, and curves of colors are rounded.
        let differs = |(a, b): (&u8, &u8)| a.abs_diff(*b) > 1;
        let n = found.pixels.iter().zip(&expected.pixels).filter(|&pair| differs(pair)).count();
        assert_eq!(n, 0, "{format:?}: {n} bytes differ");
    }
}

#[test]
fn images_that_cannot_be_read_are_refused() {
    use wgpu::TextureFormat as Format;
    let error = |format, size| PaintImage::check(format, size).unwrap_err().to_string();
    assert!(PaintImage::check(Format::Rgba8UnormSrgb, [8, 8]).is_ok());
    let small = error(Format::Rgba8UnormSrgb, [1, 1]);
    assert!(small.contains("1x1") && small.contains("8x8"), "{small}");
    let integers = error(Format::Rgba8Uint, [64, 64]);
    assert!(integers.contains("Rgba8Uint") && integers.contains("Rgba8UnormSrgb"), "{integers}");
    assert!(PaintImage::check(Format::Depth32Float, [64, 64]).is_err());
}
