//! The store: which layers textures get, how it grows, and when it lets them go.

use glam::Vec3;
use stylegaussian::strokes::{FINE_SIDE, StrokeTexture, StrokeWord, WIDE_SIDE};

mod redraw;

use super::*;
use crate::device::{DeviceOptions, HeadlessDevice};

/// A device with textures of at most three layers.
fn gpu() -> Option<HeadlessDevice> {
    let limits = |limits| wgpu::Limits { max_texture_array_layers: 3, ..limits };
    let options = DeviceOptions { limits, ..DeviceOptions::default() };
    let gpu = pollster::block_on(HeadlessDevice::request(options));
    if gpu.is_err() {
        eprintln!("SKIPPED: no GPU adapter");
    }
    gpu.ok()
}

/// A texture whose wide detail is `value` everywhere.
fn texture(value: f32) -> Arc<StrokeTexture> {
    let fine = vec![Vec3::ZERO; FINE_SIDE * FINE_SIDE];
    Arc::new(StrokeTexture::new(fine, vec![Vec3::splat(value); WIDE_SIDE * WIDE_SIDE]))
}

/// Strokes of one Gaussian with a seed of each texture.
fn strokes(textures: &[&Arc<StrokeTexture>]) -> Strokes {
    let seed = |i: usize| StrokeSeed::default().with_texture(i as u8);
    Strokes {
        seeds: (0..textures.len()).map(seed).collect(),
        words: vec![StrokeWord { seed: 0, protection: 0.0, share: 1.0 }.packed()],
        textures: textures.iter().map(|&texture| Arc::clone(texture)).collect(),
    }
}

/// The layers of a stroke's seeds.
fn layers(gpu: &HeadlessDevice, strokes: &GaussianStrokes) -> Vec<usize> {
    strokes.read_seeds(&gpu.device, &gpu.queue).unwrap().iter().map(texture_of).collect()
}

/// The first byte of each layer of wide detail.
fn bytes(gpu: &HeadlessDevice, store: &StrokeStore) -> Vec<u8> {
    let array = store.arrays(&gpu.device).wide;
    let size = wgpu::Extent3d { width: 64, height: 1, depth_or_array_layers: array.depth_or_array_layers() };
    let usage = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
    let bytes = 256 * u64::from(size.depth_or_array_layers);
    let buffer = buffers::create(&gpu.device, "layers", bytes, usage);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(256), rows_per_image: Some(1) };
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(array.as_image_copy(), to, size);
    gpu.queue.submit([encoder.finish()]);
    let first = |bytes: &[u8]| bytes.chunks(256).map(|layer| layer[0]).collect();
    buffers::read(&gpu.device, &gpu.queue, &buffer, first).unwrap()
}

#[test]
fn layers_grow_are_shared_and_are_let_go() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let [a, b, c, d] = [0.1, 0.2, 0.3, 0.4].map(texture);
    let [of_a, of_b, of_c, of_d] = [13, 25, 38, 51];
    let store = StrokeStore::new();
    let upload = |strokes: &Strokes| store.upload(device, queue, strokes);
    assert_eq!((store.n_used(), store.n_layers(), store.bytes()), (0, 0, 0));

    let first = upload(&strokes(&[&a])).unwrap();
    assert_eq!((layers(&gpu, &first), store.n_layers()), (vec![0], 1));
    let before = store.arrays(device);
    // The same texture twice, and one that is there already.
    let second = upload(&strokes(&[&b, &a, &b])).unwrap();
    assert_eq!((layers(&gpu, &second), store.n_used(), store.n_layers()), (vec![1, 0, 1], 2, 2));
    assert_ne!(before, store.arrays(device));
    // 4 bytes of (4^10 - 1) / 3 + (4^8 - 1) / 3 texels, twice.
    assert_eq!(store.bytes(), 2 * 4 * (349_525 + 21_845));
    // Twice two layers would be more than the device has.
    let third = upload(&strokes(&[&c])).unwrap();
    assert_eq!((layers(&gpu, &third), store.n_layers()), (vec![2], 3));
    assert_eq!(bytes(&gpu, &store), [of_a, of_b, of_c]);

    let full = StrokesError::TooManyTextures { found: 1, free: 0, limit: 3 };
    assert_eq!(upload(&strokes(&[&d, &a])).unwrap_err(), full);
    // Another user keeps a, and the last user of b lets it go.
    let copy = second.clone();
    drop(second);
    assert_eq!(store.n_used(), 3);
    drop(copy);
    assert_eq!(store.n_used(), 2);
    let fourth = upload(&strokes(&[&d, &a])).unwrap();
    assert_eq!((layers(&gpu, &fourth), store.n_layers()), (vec![1, 0], 3));
    assert_eq!(bytes(&gpu, &store), [of_a, of_d, of_c]);
    // An equal texture is another one.
    assert!(upload(&strokes(&[&texture(0.1)])).is_err());
    drop((first, third, fourth));
    assert_eq!(store.n_used(), 0);
}

#[test]
fn strokes_of_nothing_and_bad_strokes() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let store = StrokeStore::new();
    let none = store.upload(device, queue, &Strokes::default()).unwrap();
    assert_eq!((none.n_gaussians(), none.n_seeds(), store.n_layers()), (0, 0, 0));
    assert!(none.read_words(device, queue).unwrap().is_empty());
    assert!(none.read_seeds(device, queue).unwrap().is_empty());
    let nameless = Strokes { textures: Vec::new(), ..strokes(&[&texture(0.5)]) };
    let error = StrokesError::NoTexture { found: 0, expected: 0 };
    assert_eq!(store.upload(device, queue, &nameless).unwrap_err(), error);
    let many = Strokes { seeds: vec![StrokeSeed::default(); MAX_SEEDS + 1], ..Strokes::default() };
    let error = StrokesError::TooManySeeds { found: MAX_SEEDS + 1, limit: MAX_SEEDS };
    assert_eq!(store.upload(device, queue, &many).unwrap_err(), error);
}

#[test]
fn words_are_replaced() {
    let Some(gpu) = gpu() else { return };
    let HeadlessDevice { device, queue, .. } = &gpu;
    let uploaded = StrokeStore::new().upload(device, queue, &strokes(&[])).unwrap();
    let version = uploaded.version();
    uploaded.write_words(queue, &[7]);
    assert_eq!(uploaded.read_words(device, queue).unwrap(), [7]);
    assert_ne!(uploaded.version(), version);
}
