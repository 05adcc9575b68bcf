//! Colors of N Gaussians on the GPU: where the style pass and the splat pass meet.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
    mpsc,
};

use half::f16;

/// View-independent colors `[N]`, display-referred and not clamped: red, green, blue and an unused fourth number as f16,
/// `vec2<u32>` in WGSL, to be read with `unpack2x16float`.
#[derive(Clone, Debug)]
pub struct GaussianColors {
    buffer: wgpu::Buffer,
    n_gaussians: u32,
    version: Arc<AtomicU64>,
}

/// The colors do not fit the device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("colors of {n_gaussians} Gaussians take {found} bytes, the device binds at most {limit}")]
pub struct GaussianColorsError {
    /// N.
    pub n_gaussians: usize,
    /// Bytes of the buffer.
    pub found: u64,
    /// Bytes of the largest storage binding and buffer.
    pub limit: u64,
}

/// The colors did not come back from the device.
#[derive(Debug, thiserror::Error)]
pub enum ReadColorsError {
    /// The device did not finish its work.
    #[error("the GPU did not finish: {0}")]
    Poll(#[from] wgpu::PollError),
    /// The copy could not be read.
    #[error("colors could not be read back from the GPU: {0}")]
    Map(#[from] wgpu::BufferAsyncError),
    /// The device is gone.
    #[error("the GPU was lost before colors were read back")]
    Lost,
}

impl GaussianColors {
    /// Bytes of one color.
    pub const STRIDE: u64 = 8;

    /// Bytes that the colors of `n_gaussians` take; a buffer is never empty.
    pub fn bytes(n_gaussians: usize) -> u64 {
        Self::STRIDE * (n_gaussians as u64).max(1)
    }

    /// Colors of `n_gaussians`, all zero.
    ///
    /// # Errors
    /// When they pass the device's limit on a buffer or a storage binding.
    pub fn new(device: &wgpu::Device, n_gaussians: usize) -> Result<Self, GaussianColorsError> {
        let limits = device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let found = Self::bytes(n_gaussians);
        if found > limit || u32::try_from(n_gaussians).is_err() {
            return Err(GaussianColorsError { n_gaussians, found, limit });
        }
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("gaussian_colors"),
            size: found,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Ok(Self { buffer, n_gaussians: n_gaussians as u32, version: Arc::default() })
    }

    /// Colors that hold `rgb` `[N]`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_rgb(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        rgb: &[[f32; 3]],
    ) -> Result<Self, GaussianColorsError> {
        let colors = Self::new(device, rgb.len())?;
        colors.write(queue, rgb);
        Ok(colors)
    }

    /// Replaces all colors.
    ///
    /// # Panics
    /// When `rgb` does not hold N colors.
    pub fn write(&self, queue: &wgpu::Queue, rgb: &[[f32; 3]]) {
        assert_eq!(rgb.len(), self.n_gaussians(), "one color per Gaussian");
        let packed: Vec<[f16; 4]> = rgb.iter().map(|&color| pack(color)).collect();
        queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(&packed));
        self.mark_changed();
    }

    /// Tells views that the colors changed: whoever writes to [`buffer`](Self::buffer) must say so.
    pub fn mark_changed(&self) {
        self.version.fetch_add(1, Ordering::Relaxed);
    }

    /// Another number after each change.
    pub(crate) fn version(&self) -> u64 {
        self.version.load(Ordering::Relaxed)
    }

    /// N.
    pub fn n_gaussians(&self) -> usize {
        self.n_gaussians as usize
    }

    /// `[N]` of `vec2<u32>`; usable as storage, and as source and target of copies. See
    /// [`mark_changed`](Self::mark_changed).
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// Waits for all work submitted so far and gives the colors `[N]` as they then are.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read(&self, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Vec<[f32; 3]>, ReadColorsError> {
        let size = Self::bytes(self.n_gaussians());
        let copy = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("gaussian_colors_copy"),
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&self.buffer, 0, &copy, 0, size);
        queue.submit([encoder.finish()]);
        let (sender, receiver) = mpsc::channel();
        copy.map_async(wgpu::MapMode::Read, .., move |result| {
            // A receiver that is gone no longer wants to know.
            let _ = sender.send(result);
        });
        device.poll(wgpu::PollType::wait_indefinitely())?;
        receiver.recv().map_err(|_| ReadColorsError::Lost)??;
        let mut colors = Self::unpack(&copy.get_mapped_range(..));
        colors.truncate(self.n_gaussians());
        Ok(colors)
    }

    /// The colors `[N]` in the bytes of [`buffer`](Self::buffer), once they are mapped or copied back.
    pub fn unpack(bytes: &[u8]) -> Vec<[f32; 3]> {
        let channel = |b: &[u8], i: usize| f16::from_le_bytes([b[2 * i], b[2 * i + 1]]).to_f32();
        bytes.chunks_exact(8).map(|b| [0, 1, 2].map(|i| channel(b, i))).collect()
    }
}

fn pack(color: [f32; 3]) -> [f16; 4] {
    let [r, g, b] = color.map(f16::from_f32);
    [r, g, b, f16::ONE]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_round_trip_through_their_bytes() {
        let colors = [[0.5, -0.25, 1.5], [0.0, 1.0, 0.125]];
        let packed: Vec<[f16; 4]> = colors.iter().map(|&color| pack(color)).collect();
        assert_eq!(GaussianColors::unpack(bytemuck::cast_slice(&packed)), colors);
    }
}
