//! Painted weights on the GPU. Layers read them when they are mixed, and the splat pass to hide and to crop.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

use crate::buffers::{self, ReadBackError, TooLarge};

/// Painted weights of N Gaussians: four channels of 8 bits.
#[derive(Clone, Debug)]
pub struct GaussianMask {
    pub(crate) buffer: wgpu::Buffer,
    pub(crate) n_gaussians: usize,
    version: Arc<AtomicU64>,
}

impl GaussianMask {
    /// A mask that holds `weights` `[N]`.
    ///
    /// # Errors
    /// If they exceed the device's limit on a buffer or a storage binding.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, weights: &[[u8; 4]]) -> Result<Self, TooLarge> {
        let size = 4 * (weights.len() as u64).max(1);
        TooLarge::check("painted weights", size, buffers::largest_binding(device))?;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let buffer = buffers::create(device, "gaussian_mask", size, usage);
        let mask = Self { buffer, n_gaussians: weights.len(), version: Arc::default() };
        mask.write(queue, weights);
        Ok(mask)
    }

    /// Replaces all weights.
    ///
    /// # Panics
    /// If there is not one entry per Gaussian.
    pub fn write(&self, queue: &wgpu::Queue, weights: &[[u8; 4]]) {
        assert_eq!(weights.len(), self.n_gaussians, "one entry per Gaussian");
        self.write_range(queue, 0, weights);
    }

    /// Replaces the weights of the Gaussians from `first` on.
    ///
    /// # Panics
    /// If they go beyond the last Gaussian.
    pub fn write_range(&self, queue: &wgpu::Queue, first: usize, weights: &[[u8; 4]]) {
        assert!(
            first <= self.n_gaussians && weights.len() <= self.n_gaussians - first,
            "at most one entry per Gaussian"
        );
        queue.write_buffer(&self.buffer, 4 * first as u64, bytemuck::cast_slice(weights));
        // Only compared for equality, and submissions order the writes themselves.
        self.version.fetch_add(1, Ordering::Relaxed);
    }

    /// Waits for all work submitted so far and reads the weights `[N]`.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn read(&self, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Vec<[u8; 4]>, ReadBackError> {
        let mut weights = buffers::read(device, queue, &self.buffer, |bytes| {
            bytes.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]).collect::<Vec<_>>()
        })?;
        // A buffer holds at least one.
        weights.truncate(self.n_gaussians);
        Ok(weights)
    }

    /// N.
    pub fn n_gaussians(&self) -> usize {
        self.n_gaussians
    }

    /// A number that differs after each change.
    pub fn version(&self) -> u64 {
        self.version.load(Ordering::Relaxed)
    }
}
