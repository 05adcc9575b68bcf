//! The adapter, and the times of its commands.

use std::time::Instant;

use anyhow::{Context, Result};
use stylegaussian_gpu::device::{DeviceError, DeviceOptions, GpuEncoder, HeadlessDevice};

/// A device and its clock.
#[derive(Debug)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// The device's queue.
    pub queue: wgpu::Queue,
    headless: HeadlessDevice,
    timestamps: Option<Timestamps>,
}

/// Two timestamps, and the buffer for reading them.
#[derive(Debug)]
struct Timestamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read_back: wgpu::Buffer,
    ns_per_tick: f64,
}

/// Bytes of two timestamps.
const TWO: u64 = 16;

impl Gpu {
    /// The fastest adapter, or `None` if there is none.
    pub fn open() -> Result<Option<Self>> {
        let features = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS;
        let options = DeviceOptions { features, ..Default::default() };
        let headless = match pollster::block_on(HeadlessDevice::request(options)) {
            Err(DeviceError::NoAdapter(_)) => return Ok(None),
            result => result?,
        };
        let HeadlessDevice { device, queue, .. } = headless.clone();
        // Software adapters report the time at which they accept work, not at which they do it.
        let has_clock = !headless.is_software() && device.features().contains(features);
        let timestamps = has_clock.then(|| Timestamps::new(&device, &queue));
        Ok(Some(Self { device, queue, headless, timestamps }))
    }

    /// The device and its queue with the commands of `encoder`.
    pub fn encoding<'a>(&'a self, encoder: &'a mut wgpu::CommandEncoder) -> GpuEncoder<'a> {
        self.headless.encoding(encoder)
    }

    /// Whether the adapter is software.
    pub fn is_software(&self) -> bool {
        self.headless.is_software()
    }

    /// The adapter and its driver.
    pub fn name(&self) -> String {
        let info = &self.headless.info;
        let clock = if self.timestamps.is_some() { "GPU timestamps" } else { "the wall's clock" };
        format!("{} ({} {}), {clock}", info.name, info.driver, info.driver_info)
    }

    /// Milliseconds that the commands of `encode` take: by the GPU's clock if it has one, otherwise from
    /// submission to end.
    pub fn time(&self, encode: impl FnOnce(&mut wgpu::CommandEncoder) -> Result<()>) -> Result<f64> {
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        if let Some(timestamps) = &self.timestamps {
            encoder.write_timestamp(&timestamps.queries, 0);
        }
        encode(&mut encoder)?;
        if let Some(timestamps) = &self.timestamps {
            timestamps.end(&mut encoder);
        }
        // Recording is timed by neither clock.
        let commands = encoder.finish();
        let start = Instant::now();
        self.queue.submit([commands]);
        self.wait()?;
        let waited = start.elapsed().as_secs_f64() * 1e3;
        self.timestamps.as_ref().map_or(Ok(waited), |timestamps| timestamps.read(&self.device))
    }

    /// Waits until all submitted work is done.
    pub fn wait(&self) -> Result<()> {
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        Ok(())
    }
}

impl Timestamps {
    fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size: TWO,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            read_back: buffer(wgpu::BufferUsages::MAP_READ),
            ns_per_tick: f64::from(queue.get_timestamp_period()),
        }
    }

    fn end(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.write_timestamp(&self.queries, 1);
        encoder.resolve_query_set(&self.queries, 0..2, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read_back, 0, TWO);
    }

    fn read(&self, device: &wgpu::Device) -> Result<f64> {
        let (sender, receiver) = std::sync::mpsc::channel();
        self.read_back.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver waits below.
            let _ = sender.send(result);
        });
        device.poll(wgpu::PollType::wait_indefinitely())?;
        receiver.recv().context("the device was lost")??;
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&self.read_back.get_mapped_range(..));
        self.read_back.unmap();
        // Ticks that go backward must not wrap to centuries.
        Ok(ticks[1].saturating_sub(ticks[0]) as f64 * self.ns_per_tick * 1e-6)
    }
}
