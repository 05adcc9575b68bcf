//! The time that commands take by the GPU's own clock, available some frames later.

use std::{
    sync::{Arc, OnceLock},
    time::Duration,
};

use crate::buffers;

/// Measurements under way at once. More than the frames in flight, so that hardly any work goes unmeasured.
const N_MEASUREMENTS: usize = 4;

/// Bytes from the timestamps of one measurement to the next: the alignment of a resolved query set.
const STRIDE: u64 = wgpu::QUERY_RESOLVE_BUFFER_ALIGNMENT;

/// Bytes of two timestamps.
const BYTES: u64 = 2 * wgpu::QUERY_SIZE as u64;

/// Measures compute passes of a device that has `TIMESTAMP_QUERY`.
#[derive(Debug)]
pub(super) struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    ns_per_tick: f64,
    measurements: [Measurement; N_MEASUREMENTS],
}

/// A pair of timestamps, from the pass to main memory.
#[derive(Debug)]
struct Measurement {
    copy: wgpu::Buffer,
    state: State,
}

#[derive(Debug)]
enum State {
    Free,
    /// Encoded, and submitted before the next frame begins.
    Encoded {
        operations: u64,
    },
    /// On its way to main memory.
    Mapping {
        operations: u64,
        mapped: Arc<OnceLock<bool>>,
    },
}

/// Index of a measurement that is in use.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timing(usize);

impl Timer {
    /// A timer, or `None` if the device has no timestamps.
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let to_resolve = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let size = STRIDE * N_MEASUREMENTS as u64;
        Some(Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("style_timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * N_MEASUREMENTS as u32,
            }),
            resolved: buffers::create(device, "style_timestamps", size, to_resolve),
            ns_per_tick: f64::from(queue.get_timestamp_period()),
            measurements: std::array::from_fn(|_| Measurement {
                copy: buffers::read_back(device, "style_timestamps_copy", BYTES),
                state: State::Free,
            }),
        })
    }

    /// Reserves a measurement of `operations`, if one is free.
    pub(super) fn reserve(&mut self, operations: u64) -> Option<Timing> {
        let is_free = |measurement: &Measurement| matches!(measurement.state, State::Free);
        let free = self.measurements.iter().position(is_free)?;
        self.measurements[free].state = State::Encoded { operations };
        Some(Timing(free))
    }

    /// The queries around a pass.
    pub(super) fn timestamps(&self, Timing(index): Timing) -> wgpu::ComputePassTimestampWrites<'_> {
        let first = 2 * index as u32;
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Encodes the copy of the timestamps to the buffer that the CPU reads.
    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder, Timing(index): Timing) {
        let (first, at) = (2 * index as u32, STRIDE * index as u64);
        encoder.resolve_query_set(&self.queries, first..first + 2, &self.resolved, at);
        encoder.copy_buffer_to_buffer(&self.resolved, at, &self.measurements[index].copy, 0, BYTES);
    }

    /// Requests the timestamps of work that was submitted, and returns those that have arrived: operations and
    /// their time. It never waits.
    pub(super) fn read(&mut self) -> Vec<(u64, Duration)> {
        let mut measured = Vec::new();
        for Measurement { copy, state } in &mut self.measurements {
            match state {
                State::Free => {}
                // A buffer that a later submission writes to must not be mapped, so mapping waits for the next
                // frame.
                &mut State::Encoded { operations } => {
                    *state = State::Mapping { operations, mapped: buffers::start_mapping(copy) };
                }
                State::Mapping { operations, mapped } => {
                    let Some(&is_mapped) = mapped.get() else { continue };
                    if is_mapped {
                        measured.push((*operations, duration(copy, self.ns_per_tick)));
                        copy.unmap();
                    }
                    *state = State::Free;
                }
            }
        }
        measured
    }
}

/// The time between the two timestamps in a mapped buffer; 0 if the clock was reset in between.
fn duration(copy: &wgpu::Buffer, ns_per_tick: f64) -> Duration {
    let bytes = copy.get_mapped_range(..);
    let tick = |i: usize| bytes.get(8 * i..8 * i + 8).map_or(0, bytemuck::pod_read_unaligned::<u64>);
    Duration::from_nanos((tick(1).saturating_sub(tick(0)) as f64 * ns_per_tick) as u64)
}
