//! Helpers of this module's tests: a device, buffers read back, random numbers.

use crate::{
    buffers,
    device::{DeviceError, DeviceOptions, HeadlessDevice},
};

/// A device, or `None` with a message if there is none.
pub fn gpu() -> Option<HeadlessDevice> {
    match pollster::block_on(HeadlessDevice::request(DeviceOptions::default())) {
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
    buffers::read(&gpu.device, &gpu.queue, buffer, |bytes| bytemuck::pod_collect_to_vec(bytes)).unwrap()
}

/// Pseudo-random numbers in 0..1 (a linear congruential generator).
pub fn randoms(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}
