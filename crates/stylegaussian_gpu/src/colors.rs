//! Colors of N Gaussians on the GPU: the meeting place of the style pass and the splat pass.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

use half::{f16, slice::HalfFloatSliceExt};

use crate::buffers::{self, ReadBackError, TooLarge};

/// View-independent colors `[N]`, display-referred and not clamped, as f16: red, green and blue, multiplied by
/// the fourth number, which is 1 unless a part of the captured colors shows through (see
/// [`stylegaussian::layers`]). WGSL declares them as `vec2<u32>` and reads them with `unpack2x16float`.
#[derive(Clone, Debug)]
pub struct GaussianColors {
    buffer: wgpu::Buffer,
    n_gaussians: u32,
    version: Arc<AtomicU64>,
}

impl GaussianColors {
    /// Bytes of one color.
    pub const STRIDE: u64 = 8;

    /// Bytes of the colors of `n_gaussians`. At least one color, because buffers cannot be empty.
    pub fn bytes(n_gaussians: usize) -> u64 {
        Self::STRIDE * (n_gaussians as u64).max(1)
    }

    /// Colors of `n_gaussians`, all zero: nothing but the captured colors.
    ///
    /// # Errors
    /// If they exceed the device's limit on a buffer or a storage binding.
    pub fn new(device: &wgpu::Device, n_gaussians: usize) -> Result<Self, TooLarge> {
        let size = Self::bytes(n_gaussians);
        // Shaders index Gaussians with 32 bits.
        let limit = buffers::largest_binding(device).min(Self::bytes(u32::MAX as usize));
        TooLarge::check("colors", size, limit)?;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let buffer = buffers::create(device, "gaussian_colors", size, usage);
        Ok(Self { buffer, n_gaussians: n_gaussians as u32, version: Arc::default() })
    }

    /// Colors that hold `rgb` `[N]`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_rgb(device: &wgpu::Device, queue: &wgpu::Queue, rgb: &[[f32; 3]]) -> Result<Self, TooLarge> {
        let colors = Self::new(device, rgb.len())?;
        colors.write(queue, rgb);
        Ok(colors)
    }

    /// Colors that hold `colors` `[N]`, premultiplied by their fourth number.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_premultiplied(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        colors: &[[f32; 4]],
    ) -> Result<Self, TooLarge> {
        let gaussian_colors = Self::new(device, colors.len())?;
        gaussian_colors.write_packed(queue, &pack(colors.as_flattened()));
        Ok(gaussian_colors)
    }

    /// Replaces all colors.
    ///
    /// # Panics
    /// If `rgb` does not hold N colors.
    pub fn write(&self, queue: &wgpu::Queue, rgb: &[[f32; 3]]) {
        assert_eq!(rgb.len(), self.n_gaussians(), "one color per Gaussian");
        self.write_packed(queue, &pack_rgb(rgb));
    }

    fn write_packed(&self, queue: &wgpu::Queue, packed: &[f16]) {
        queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(packed));
        self.mark_changed();
    }

    /// Makes views draw the colors anew. Call it after every write to [`buffer`](Self::buffer).
    pub fn mark_changed(&self) {
        // Only compared for equality, and submissions order the writes themselves.
        self.version.fetch_add(1, Ordering::Relaxed);
    }

    /// A number that differs after each change.
    pub(crate) fn version(&self) -> u64 {
        self.version.load(Ordering::Relaxed)
    }

    /// N.
    pub fn n_gaussians(&self) -> usize {
        self.n_gaussians as usize
    }

    /// `[N]` of `vec2<u32>`; usable as storage, and as source and destination of copies. Call
    /// [`mark_changed`](Self::mark_changed) after writing to it.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// Waits for all work submitted so far and reads the resulting colors `[N]`.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn read(&self, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Vec<[f32; 3]>, ReadBackError> {
        let mut colors = buffers::read(device, queue, &self.buffer, Self::unpack)?;
        // The buffer holds one color even if there are no Gaussians.
        colors.truncate(self.n_gaussians());
        Ok(colors)
    }

    /// Waits for all work submitted so far and reads all four numbers of the colors `[N]`.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn read_premultiplied(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
    ) -> Result<Vec<[f32; 4]>, ReadBackError> {
        let unpack = |bytes: &[u8]| {
            let halves: Vec<f16> = bytemuck::pod_collect_to_vec(bytes);
            halves.as_chunks::<4>().0.iter().map(|color| color.map(f16::to_f32)).collect::<Vec<_>>()
        };
        let mut colors = buffers::read(device, queue, &self.buffer, unpack)?;
        colors.truncate(self.n_gaussians());
        Ok(colors)
    }

    /// The colors `[N]` from the bytes of [`buffer`](Self::buffer), as read back.
    pub fn unpack(bytes: &[u8]) -> Vec<[f32; 3]> {
        let channel = |b: &[u8], i: usize| f16::from_le_bytes([b[2 * i], b[2 * i + 1]]).to_f32();
        bytes.chunks_exact(8).map(|b| [0, 1, 2].map(|i| channel(b, i))).collect()
    }
}

/// The colors as they are in the buffer `[N * 4]`, without any of the captured ones.
fn pack_rgb(rgb: &[[f32; 3]]) -> Vec<f16> {
    pack(&rgb.iter().flat_map(|&[r, g, b]| [r, g, b, 1.0]).collect::<Vec<_>>())
}

/// Numbers as f16.
fn pack(numbers: &[f32]) -> Vec<f16> {
    let mut packed = vec![f16::ZERO; numbers.len()];
    // All at once, by the processor's vector instructions if it has them: this runs on the render thread.
    packed.convert_from_f32_slice(numbers);
    packed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_round_trip_through_their_bytes() {
        let colors = [[0.5, -0.25, 1.5], [0.0, 1.0, 0.125]];
        assert_eq!(GaussianColors::unpack(bytemuck::cast_slice(&pack_rgb(&colors))), colors);
    }
}
