//! Dispatches of kernels.

use stylegaussian_shaders::splat::WORKGROUP;

/// Workgroups in one dimension of a dispatch, by WebGPU's default limits.
const MAX_WORKGROUPS: u32 = 65_535;

/// Dispatches one invocation for each of `n_gaussians`.
pub(super) fn dispatch(pass: &mut wgpu::ComputePass, n_gaussians: u32) {
    let n = n_gaussians.div_ceil(WORKGROUP);
    // Workgroups beyond the limit go into a second dimension.
    let x = n.min(MAX_WORKGROUPS);
    pass.dispatch_workgroups(x, n.div_ceil(x.max(1)), 1);
}
