//! The sort against the standard library's stable one.

use stylegaussian_shaders::splat::{INVISIBLE, SplatCommands, SplatCounts};

use super::*;
use crate::{
    device::HeadlessDevice,
    splat::testing::{gpu, randoms, read},
};

/// Sorts `keys`. Returns record indices in order, and the commands.
fn sorted(gpu: &HeadlessDevice, serial: bool, keys: &[u32], capacity: usize) -> (Vec<u32>, SplatCommands) {
    let sort = Sort::of_kind(&gpu.device, serial);
    let buffers = SortBuffers::new(&gpu.device, &sort, capacity);
    let counts = SplatCounts { n_records: keys.len() as u32, n_visible: 0 };
    gpu.queue.write_buffer(&buffers.counts, 0, bytemuck::bytes_of(&counts));
    gpu.queue.write_buffer(&buffers.keys, 0, bytemuck::cast_slice(keys));
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    sort.encode(&mut pass, &buffers, keys.len() as u32);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);

    let n_visible = read::<SplatCounts>(gpu, &buffers.counts)[0].n_visible as usize;
    let mut indices: Vec<u32> = read(gpu, &buffers.record_indices);
    indices.truncate(n_visible);
    (indices, read(gpu, &buffers.commands)[0])
}

fn expected(keys: &[u32]) -> Vec<u32> {
    let mut indices: Vec<u32> = (0..keys.len() as u32).filter(|&i| keys[i as usize] != INVISIBLE).collect();
    indices.sort_by_key(|&i| keys[i as usize]);
    indices
}

#[track_caller]
fn check(gpu: &HeadlessDevice, keys: &[u32], capacity: usize) {
    let expected = expected(keys);
    for serial in [false, true] {
        let (indices, commands) = sorted(gpu, serial, keys, capacity);
        assert_eq!(indices, expected, "{} keys, serial {serial}", keys.len());
        assert_eq!(commands.n_instances as usize, expected.len());
        assert_eq!([commands.n_vertices, commands.first_vertex, commands.first_instance], [4, 0, 0]);
        assert_eq!(commands.n_groups, commands.n_instances.div_ceil(SORT_BATCH));
    }
}

/// Sizes around a round (256) and a batch (2048); every key many times, a third of them invisible.
#[test]
fn gpu_matches_cpu() {
    let Some(gpu) = gpu() else { return };
    for n in [1, 255, 256, 257, 2048, 2049, 5000] {
        let mut random = randoms(n as u64);
        let keys: Vec<u32> = (0..n)
            .map(|_| match (random() * 3.0) as u32 {
                0 => INVISIBLE,
                1 => (random() * 20.0) as u32 * 0x0123_4567,
                _ => (random() * u32::MAX as f32) as u32 & 0xff00_00ff,
            })
            .collect();
        check(&gpu, &keys, n);
        check(&gpu, &keys, 3 * n + 1000);
    }
}

#[test]
fn nothing_visible_and_all_equal() {
    let Some(gpu) = gpu() else { return };
    check(&gpu, &[INVISIBLE; 300], 300);
    check(&gpu, &[7; 3000], 3000);
    check(&gpu, &(0..3000).rev().collect::<Vec<_>>(), 3000);
}
