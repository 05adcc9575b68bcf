//! A change of style spread over frames.

use std::time::Duration;

use stylegaussian_shaders::style::ROWS_PER_WORKGROUP;

use super::{
    plan::Step,
    timer::{Timer, Timing},
};

/// The progress of a change of style: see [`StylePass::encode_some`](super::StylePass::encode_some).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StyleProgress {
    /// Index of the current dispatch.
    step: usize,
    /// Rows of it that are encoded.
    row: u32,
    is_done: bool,
}

impl StyleProgress {
    /// Whether all colors are encoded.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// The next dispatches, with `operations` at most, but at least one workgroup of rows.
    pub(super) fn take(&mut self, steps: &[Step], operations: u64) -> Vec<Step> {
        let (mut taken, mut left) = (Vec::new(), operations);
        while let Some(step) = steps.get(self.step) {
            let of_row = step.operations_of_row().max(1);
            let rest = step.parameters.n_rows - self.row;
            let affordable = u32::try_from(left / of_row).unwrap_or(u32::MAX);
            // Sums over planes are stored by row of the dispatch, so a step that shares them is not cut.
            let whole = affordable >= rest || step.is_partial();
            let workgroups =
                (affordable / ROWS_PER_WORKGROUP).max(u32::from(taken.is_empty())) * ROWS_PER_WORKGROUP;
            let n = if whole { rest } else { workgroups.min(rest) };
            // A step that is not cut waits for the next frame, unless it would be the first one of this frame.
            if n == 0 || (affordable < rest && whole && !taken.is_empty()) {
                return taken;
            }
            taken.push(step.part(self.row, n));
            left = left.saturating_sub(u64::from(n) * of_row);
            self.row += n;
            if self.row == step.parameters.n_rows {
                (self.step, self.row) = (self.step + 1, 0);
            }
        }
        self.is_done = true;
        taken
    }
}

/// GPU time per frame for all style changes together, and an estimate of the GPU's speed. It limits how much
/// [`StylePass::encode_some`](super::StylePass::encode_some) encodes.
///
/// The speed comes from timestamps around the granted work ([`timed`](Self::timed)) or from
/// [`observe`](Self::observe). Until then, the meter assumes the slowest GPU that this crate is meant for. A
/// frame exceeds its budget by at most one workgroup of 128 rows, or by one chunk if sums over planes are kept.
#[derive(Debug)]
pub struct WorkMeter {
    /// Milliseconds of GPU time in each frame. Infinity puts the whole change into one frame.
    pub ms_per_frame: f32,
    /// Estimated multiplications and additions in a millisecond.
    operations_per_ms: f64,
    /// Operations granted in this frame so far.
    granted: u64,
    timer: Option<Timer>,
}

/// Operations per millisecond assumed at first: an integrated GPU of ten years ago reaches 0.1 TFLOP/s in
/// products of matrices.
const SLOWEST: f64 = 1e8;

/// Share of the newest observation in the estimate. A GPU's clock settles within some frames.
const NEWEST: f64 = 0.25;

impl WorkMeter {
    /// A budget of `ms_per_frame` milliseconds in each frame.
    pub fn new(ms_per_frame: f32) -> Self {
        Self { ms_per_frame, operations_per_ms: SLOWEST, granted: 0, timer: None }
    }

    /// A budget of multiplications and additions in each frame, whatever time they take.
    pub fn of_operations(operations: u64) -> Self {
        Self { operations_per_ms: operations as f64, ..Self::new(1.0) }
    }

    /// No limit: a change is encoded at once.
    pub fn unlimited() -> Self {
        Self::new(f32::INFINITY)
    }

    /// Measures granted work by the GPU's own clock, if the device has `TIMESTAMP_QUERY`. Do not use it on
    /// software adapters: they report when they accepted the work, not when they did it.
    pub fn timed(mut self, device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        self.timer = Timer::new(device, queue);
        self
    }

    /// Whether a change may take more than one frame.
    pub fn is_limited(&self) -> bool {
        self.ms_per_frame != f32::INFINITY
    }

    /// Whether granted work is measured.
    pub fn is_timed(&self) -> bool {
        self.timer.is_some()
    }

    /// Starts a frame with a full budget, and learns from measurements of earlier frames. Their commands must
    /// have been submitted.
    pub fn begin_frame(&mut self) {
        self.granted = 0;
        let measured = self.timer.as_mut().map(Timer::read).unwrap_or_default();
        for (operations, time) in measured {
            self.observe(operations, time);
        }
    }

    /// The budget of a frame, in operations.
    pub fn operations(&self) -> u64 {
        // A cast of a negative number gives 0. A workgroup of rows is encoded all the same.
        (f64::from(self.ms_per_frame) * self.operations_per_ms) as u64
    }

    /// Operations left in this frame's budget, or `None` if it is spent. The first call of a frame always
    /// returns `Some`, so at least one workgroup of rows is encoded and every change completes.
    pub(super) fn left(&self) -> Option<u64> {
        let left = self.operations().saturating_sub(self.granted);
        (left > 0 || self.granted == 0).then_some(left)
    }

    /// Takes `operations` from the budget. Returns a measurement to write around them, to be resolved by
    /// [`Self::resolve`].
    pub(super) fn grant(&mut self, operations: u64) -> Option<Timing> {
        self.granted = self.granted.saturating_add(operations);
        let is_limited = self.is_limited();
        // Nobody asks for the speed if everything runs at once.
        self.timer.as_mut().filter(|_| is_limited).and_then(|timer| timer.reserve(operations))
    }

    /// The queries of a measurement's two timestamps.
    pub(super) fn timestamps(&self, timing: Timing) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.timer.as_ref().map(|timer| timer.timestamps(timing))
    }

    /// Encodes the copy of a measurement's timestamps, behind the pass that wrote them.
    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder, timing: Timing) {
        if let Some(timer) = &self.timer {
            timer.resolve(encoder, timing);
        }
    }

    /// Learns that `operations` took `time` on the GPU. The estimate drops at once if the GPU is slower than
    /// assumed, and rises gradually if it is faster: a frame that comes too late is worse than a change that
    /// takes longer.
    pub fn observe(&mut self, operations: u64, time: Duration) {
        let ms = time.as_secs_f64() * 1e3;
        if operations == 0 || ms <= 0.0 {
            return;
        }
        let found = operations as f64 / ms;
        let mixed = self.operations_per_ms * (1.0 - NEWEST) + found * NEWEST;
        self.operations_per_ms = mixed.min(found);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::style::{
        blocks::BlockShape,
        plan::{CHUNK_ROWS, Split, steps},
        shape::StyleShape,
    };

    fn plan(inputs: usize) -> Vec<Step> {
        let shape = StyleShape {
            n_gaussians: 1000,
            k: 8,
            widths: vec![32, 64, 3],
            residual: false,
            smoothing_passes: 0,
        };
        let split = Split { capacity: 1000, inputs, scratch: [8, 1], chunk_rows: CHUNK_ROWS };
        steps(&shape, &split, 0, &BlockShape::whole(&shape))
    }

    /// Rows of each layer, part by part.
    fn parts(plan: &[Step], operations: u64) -> Vec<Vec<(usize, u32, u32)>> {
        let (mut progress, mut parts) = (StyleProgress::default(), Vec::new());
        while !progress.is_done() {
            let taken = progress.take(plan, operations);
            let rows = |s: &Step| (s.layer, s.parameters.first_row, s.parameters.n_rows);
            parts.push(taken.iter().map(rows).collect());
        }
        parts
    }

    #[test]
    fn all_at_once_is_the_plan() {
        assert_eq!(parts(&plan(4), u64::MAX), [[(0, 0, 1000), (1, 0, 1000)]]);
    }

    /// A row of the first layer takes 2 * 8 * 32 * 64 = 32,768 operations, of the last one 2 * 8 * 64 * 4 =
    /// 4,096.
    #[test]
    fn parts_keep_to_their_budget() {
        let plan = plan(4);
        let parts = parts(&plan, 32_768 * 400);
        assert_eq!(
            parts,
            [
                vec![(0, 0, 384)],
                vec![(0, 384, 384)],
                // 232 rows leave 168 * 8 = 1,344 of the last layer.
                vec![(0, 768, 232), (1, 0, 1000)],
            ]
        );
    }

    /// Every row of every layer once, and a workgroup of rows if the budget is too small for one.
    #[test]
    fn the_smallest_part_is_a_workgroup() {
        let parts = parts(&plan(4), 0);
        assert!(parts[..parts.len() - 1].iter().all(|part| part.len() == 1));
        let rows = parts.concat();
        assert_eq!(rows[..2], [(0, 0, 128), (0, 128, 128)]);
        assert_eq!(rows.iter().map(|part| part.2).sum::<u32>(), 2000);
    }

    #[test]
    fn sums_over_planes_are_not_cut() {
        let parts = parts(&plan(2), 0).concat();
        assert_eq!(parts[..3], [(0, 0, 1000), (0, 0, 1000), (1, 0, 128)]);
    }

    #[test]
    fn slowness_is_believed_at_once() {
        let mut budget = WorkMeter::new(2.0);
        assert_eq!(budget.operations(), 200_000_000);
        budget.observe(400_000_000, Duration::from_millis(1));
        assert_eq!(budget.operations(), 350_000_000);
        budget.observe(1_000_000, Duration::from_millis(1));
        assert_eq!(budget.operations(), 2_000_000);
        budget.observe(0, Duration::ZERO);
        assert_eq!(budget.operations(), 2_000_000);
        assert_eq!(WorkMeter::new(-1.0).operations(), 0);
        assert_eq!(WorkMeter::unlimited().operations(), u64::MAX);
        assert_eq!(WorkMeter::of_operations(123_456_789).operations(), 123_456_789);
    }

    /// Several scenes share a frame; the last one to be granted anything may exceed it.
    #[test]
    fn a_frame_is_granted_once() {
        let mut budget = WorkMeter::new(1.0);
        assert_eq!(budget.left(), Some(100_000_000));
        budget.grant(60_000_000);
        assert_eq!(budget.left(), Some(40_000_000));
        budget.grant(50_000_000);
        assert_eq!(budget.left(), None);
        budget.begin_frame();
        assert_eq!(budget.left(), Some(100_000_000));
        // Nothing is granted at all, but changes complete.
        let mut none = WorkMeter::new(0.0);
        assert_eq!(none.left(), Some(0));
        none.grant(1);
        assert_eq!(none.left(), None);
    }
}
