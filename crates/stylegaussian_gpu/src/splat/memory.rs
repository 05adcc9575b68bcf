//! The memory that the records of a view take.

use stylegaussian_shaders::splat::SORT_BATCH;

use super::sort::SortBuffers;
use crate::buffers;

/// Bytes of one half of a record.
pub(super) const HALF_RECORD: u64 = 16;

/// The most batches that the sort can dispatch: WebGPU's default limit on workgroups in one dimension.
const MAX_BATCHES: u64 = 65_535;

/// Bytes of the largest buffer that a view of `n_gaussians` needs.
pub(super) fn record_bytes(n_gaussians: usize) -> u64 {
    (HALF_RECORD * n_gaussians as u64).max(SortBuffers::largest(n_gaussians))
}

/// Bytes of the largest buffer that the records of a view may take.
pub(super) fn record_limit(device: &wgpu::Device) -> u64 {
    // The sort would need a second dimension of workgroups beyond that many batches.
    let sortable = MAX_BATCHES * u64::from(SORT_BATCH) * HALF_RECORD;
    buffers::largest_binding(device).min(sortable)
}
