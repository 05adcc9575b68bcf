//! How long commands take by the GPU's own clock, told some frames later.

use std::{
    sync::{Arc, OnceLock},
    time::Duration,
};

/// Timings under way at once: more than frames are in flight, so that hardly any goes without.
const SLOTS: usize = 4;

/// Bytes from one slot's timestamps to the next one's: where a query set may be resolved to.
const STRIDE: u64 = wgpu::QUERY_RESOLVE_BUFFER_ALIGNMENT;

/// Two timestamps.
const BYTES: u64 = 2 * wgpu::QUERY_SIZE as u64;

/// Measures compute passes of a device that has `TIMESTAMP_QUERY`.
#[derive(Debug)]
pub(super) struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    ns_per_tick: f64,
    slots: [Slot; SLOTS],
}

/// A pair of timestamps under way.
#[derive(Debug)]
struct Slot {
    copy: wgpu::Buffer,
    state: State,
}

#[derive(Debug)]
enum State {
    Free,
    /// Encoded: submitted before the next frame begins.
    Encoded {
        operations: u64,
    },
    /// On its way to main memory.
    Mapping {
        operations: u64,
        mapped: Arc<OnceLock<bool>>,
    },
}

/// A slot that was given away.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timing(usize);

impl Timer {
    /// `None` where the device has no timestamps.
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let buffer = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let to_resolve = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let to_read = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        Some(Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("style_timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * SLOTS as u32,
            }),
            resolved: buffer("style_timestamps", STRIDE * SLOTS as u64, to_resolve),
            ns_per_tick: f64::from(queue.get_timestamp_period()),
            slots: std::array::from_fn(|_| Slot {
                copy: buffer("style_timestamps_copy", BYTES, to_read),
                state: State::Free,
            }),
        })
    }

    /// Takes a slot for `operations`, if one is free.
    pub(super) fn start(&mut self, operations: u64) -> Option<Timing> {
        let free = self.slots.iter().position(|slot| matches!(slot.state, State::Free))?;
        self.slots[free].state = State::Encoded { operations };
        Some(Timing(free))
    }

    pub(super) fn timestamps(&self, Timing(slot): Timing) -> wgpu::ComputePassTimestampWrites<'_> {
        let first = 2 * slot as u32;
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder, Timing(slot): Timing) {
        let (first, at) = (2 * slot as u32, STRIDE * slot as u64);
        encoder.resolve_query_set(&self.queries, first..first + 2, &self.resolved, at);
        encoder.copy_buffer_to_buffer(&self.resolved, at, &self.slots[slot].copy, 0, BYTES);
    }

    /// Asks for what was encoded before, and gives what has come: operations and how long they took. Never waits.
    pub(super) fn read(&mut self) -> Vec<(u64, Duration)> {
        let mut measured = Vec::new();
        for Slot { copy, state } in &mut self.slots {
            match state {
                State::Free => {}
                &mut State::Encoded { operations } => {
                    let mapped = Arc::new(OnceLock::new());
                    let told = Arc::clone(&mapped);
                    copy.map_async(wgpu::MapMode::Read, .., move |result| {
                        // Called once.
                        let _ = told.set(result.is_ok());
                    });
                    *state = State::Mapping { operations, mapped };
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

/// What lies between the two timestamps in a buffer that is mapped; 0 where the clock was set back in between.
fn duration(copy: &wgpu::Buffer, ns_per_tick: f64) -> Duration {
    let bytes = copy.get_mapped_range(..);
    let tick = |i: usize| bytes.get(8 * i..8 * i + 8).map_or(0, bytemuck::pod_read_unaligned::<u64>);
    Duration::from_nanos((tick(1).saturating_sub(tick(0)) as f64 * ns_per_tick) as u64)
}
