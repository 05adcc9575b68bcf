//! Buffers of both passes: how they are made, how large they may be, and how they are read back.

use std::sync::{Arc, OnceLock, mpsc};

/// A buffer is larger than the device can bind.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{contents} take a buffer of {found} bytes, the device binds at most {limit}")]
pub struct TooLarge {
    /// Contents of the buffer, in the plural.
    pub contents: &'static str,
    /// Bytes of the buffer, or of the smallest piece that it could be split into.
    pub found: u64,
    /// Bytes of the largest storage binding and buffer.
    pub limit: u64,
}

impl TooLarge {
    /// # Errors
    /// If `found` is above `limit`.
    pub(crate) fn check(contents: &'static str, found: u64, limit: u64) -> Result<(), Self> {
        if found > limit { Err(Self { contents, found, limit }) } else { Ok(()) }
    }
}

/// A buffer could not be read back.
#[derive(Debug, thiserror::Error)]
pub enum ReadBackError {
    /// The device did not finish its work.
    #[error("the GPU did not finish: {0}")]
    Poll(#[from] wgpu::PollError),
    /// The copy could not be mapped.
    #[error("a buffer could not be read back from the GPU: {0}")]
    Map(#[from] wgpu::BufferAsyncError),
    /// The device is gone.
    #[error("the GPU was lost before a buffer was read back")]
    Lost,
    /// The program runs in a browser.
    #[error("a browser cannot wait for the GPU, found a call that reads a buffer back at once")]
    CannotWait,
}

/// Bytes of the largest buffer that a device can bind as storage.
pub(crate) fn largest_binding(device: &wgpu::Device) -> u64 {
    let limits = device.limits();
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
}

/// A buffer of zeros.
pub(crate) fn create(
    device: &wgpu::Device,
    label: &str,
    size: u64,
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    let label = Some(label);
    device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
}

/// Uniforms that are uploaded if they change.
#[derive(Debug)]
pub(crate) struct Uniforms<T> {
    pub buffer: wgpu::Buffer,
    /// The numbers that the buffer holds.
    written: Option<T>,
}

impl<T: bytemuck::Pod + PartialEq> Uniforms<T> {
    /// Uniforms that hold nothing yet.
    pub fn new(device: &wgpu::Device, label: &str) -> Self {
        Self { buffer: uniforms(device, label, size_of::<T>() as u64), written: None }
    }

    /// Uploads `now`, if it is not there.
    pub fn write(&mut self, queue: &wgpu::Queue, now: T) {
        if self.written != Some(now) {
            queue.write_buffer(&self.buffer, 0, bytemuck::bytes_of(&now));
            self.written = Some(now);
        }
    }
}

/// A storage buffer that the CPU can write to.
pub(crate) fn storage(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    create(device, label, size, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST)
}

/// A uniform buffer of `size` bytes that the CPU can write to.
pub(crate) fn uniforms(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    create(device, label, size, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST)
}

/// A buffer that the GPU copies to and the CPU reads.
pub(crate) fn read_back(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    create(device, label, size, wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ)
}

/// Waits for all work submitted so far and passes the bytes of `buffer`, which must allow copies, to `read`.
pub(crate) fn read<T>(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    buffer: &wgpu::Buffer,
    read: impl FnOnce(&[u8]) -> T,
) -> Result<T, ReadBackError> {
    let copy = read_back(device, "read_back", buffer.size());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, buffer.size());
    queue.submit([encoder.finish()]);
    read_mapped(device, &copy, read)
}

/// Waits for all work submitted so far and passes the bytes of a [`read_back`] buffer to `read`.
pub(crate) fn read_mapped<T>(
    device: &wgpu::Device,
    buffer: &wgpu::Buffer,
    read: impl FnOnce(&[u8]) -> T,
) -> Result<T, ReadBackError> {
    // There the callback runs once this function has returned, so `recv` below would never return.
    if cfg!(target_family = "wasm") {
        return Err(ReadBackError::CannotWait);
    }
    let (sender, receiver) = mpsc::channel();
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        // It fails only if the receiver below is gone, which then needs no result.
        let _ = sender.send(result);
    });
    // The callback has run when this returns.
    device.poll(wgpu::PollType::wait_indefinitely())?;
    receiver.recv().map_err(|_| ReadBackError::Lost)??;
    let value = read(&buffer.get_mapped_range(..));
    buffer.unmap();
    Ok(value)
}

/// Starts to map a [`read_back`] buffer, without waiting. The result holds whether that succeeded, once it is
/// known.
pub(crate) fn start_mapping(buffer: &wgpu::Buffer) -> Arc<OnceLock<bool>> {
    let mapped = Arc::new(OnceLock::new());
    let result_of = Arc::clone(&mapped);
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        // It fails only on a second call, and wgpu calls once.
        let _ = result_of.set(result.is_ok());
    });
    mapped
}
