//! What this module's tests share: a device, and buffers read back.

use crate::device::{DeviceError, HeadlessDevice};

/// A device, or `None` (said aloud) where there is none.
pub fn gpu() -> Option<HeadlessDevice> {
    match pollster::block_on(HeadlessDevice::request()) {
        Ok(gpu) => Some(gpu),
        Err(DeviceError::NoAdapter(_)) => {
            eprintln!("SKIPPED: no GPU adapter");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// The contents of a buffer that can be copied from.
pub fn read<T: bytemuck::Pod>(gpu: &HeadlessDevice, buffer: &wgpu::Buffer) -> Vec<T> {
    let copy = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: buffer.size(),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, buffer.size());
    gpu.queue.submit([encoder.finish()]);
    copy.map_async(wgpu::MapMode::Read, .., Result::unwrap);
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    bytemuck::pod_collect_to_vec(&copy.get_mapped_range(..))
}

/// Pseudo-random numbers in 0..1 (a linear congruential generator).
pub fn randoms(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}
