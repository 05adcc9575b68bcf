//! Activations: planes of 8 channels of all rows, in as many buffers as the device's limits require.

use stylegaussian_shaders::style::{self as shaders, NumberFormat};

use crate::buffers::{self, TooLarge};

/// Channels in a plane.
pub(super) const PLANE_CHANNELS: usize = shaders::PLANE_CHANNELS as usize;

/// Planes `[planes, rows]`.
#[derive(Clone, Debug)]
pub(super) struct Planes {
    buffers: Vec<wgpu::Buffer>,
    planes_per_buffer: usize,
    plane_bytes: u64,
}

/// Successive planes of one buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PlaneGroup {
    pub buffer: usize,
    pub first: usize,
    pub n: usize,
}

/// The number of planes for `width` channels.
pub(super) fn n_planes(width: usize) -> usize {
    width.div_ceil(PLANE_CHANNELS)
}

/// Planes 0..`n_planes` grouped by buffer, `planes_per_buffer` in each.
pub(super) fn groups(n_planes: usize, planes_per_buffer: usize) -> impl Iterator<Item = PlaneGroup> + Clone {
    (0..n_planes.div_ceil(planes_per_buffer)).map(move |buffer| {
        let first = buffer * planes_per_buffer;
        PlaneGroup { buffer, first, n: planes_per_buffer.min(n_planes - first) }
    })
}

/// The number of planes of `n_rows` that a buffer for `width` channels holds, at least 1.
///
/// # Errors
/// If a single plane is larger than `limit`.
pub(super) fn planes_per_buffer(
    width: usize,
    n_rows: usize,
    format: NumberFormat,
    limit: u64,
) -> Result<usize, TooLarge> {
    let found = plane_bytes(n_rows, format);
    TooLarge::check("eight channels of all rows", found, limit)?;
    Ok(usize::try_from(limit / found).unwrap_or(usize::MAX).min(n_planes(width)).max(1))
}

impl Planes {
    /// Bytes of planes for `width` channels of `n_rows`. A plane has one row at least, because buffers cannot
    /// be empty.
    pub fn bytes(width: usize, n_rows: usize, format: NumberFormat) -> u64 {
        n_planes(width) as u64 * plane_bytes(n_rows, format)
    }

    /// Planes for `width` channels of `n_rows`, `planes_per_buffer` in a buffer. There are none if the width is
    /// 0.
    pub fn new(
        device: &wgpu::Device,
        label: &'static str,
        width: usize,
        n_rows: usize,
        format: NumberFormat,
        planes_per_buffer: usize,
    ) -> Self {
        let plane_bytes = plane_bytes(n_rows, format);
        let buffer = |group: PlaneGroup| buffers::storage(device, label, group.n as u64 * plane_bytes);
        let buffers = groups(n_planes(width), planes_per_buffer).map(buffer).collect();
        Self { buffers, planes_per_buffer, plane_bytes }
    }

    /// Fills all planes with numbers `[planes, rows, 8]`.
    pub fn write(&self, queue: &wgpu::Queue, bytes: &[u8]) {
        // Planes are the outermost dimension, so the numbers of a buffer are one piece of the whole.
        let chunk = self.planes_per_buffer * self.plane_bytes as usize;
        for (buffer, bytes) in self.buffers.iter().zip(bytes.chunks(chunk)) {
            queue.write_buffer(buffer, 0, bytes);
        }
    }

    pub fn buffer(&self, index: usize) -> &wgpu::Buffer {
        &self.buffers[index]
    }
}

fn plane_bytes(n_rows: usize, format: NumberFormat) -> u64 {
    (PLANE_CHANNELS * format.bytes() * n_rows.max(1)) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_split_by_buffer() {
        let split: Vec<_> = groups(5, 2).map(|group| (group.buffer, group.first, group.n)).collect();
        assert_eq!(split, [(0, 0, 2), (1, 2, 2), (2, 4, 1)]);
        assert_eq!(groups(0, 2).count(), 0);
        // 8.4 million Gaussians fit WebGPU's 128 MiB by the plane.
        assert!(plane_bytes(8_388_608, NumberFormat::F16) <= 128 << 20);
        assert_eq!(Planes::bytes(39, 10, NumberFormat::F16), 5 * 160);
    }
}
