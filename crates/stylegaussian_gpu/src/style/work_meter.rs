//! A change of style spread over frames.

use std::time::Duration;

use stylegaussian_shaders::style::TILE_ROWS;

use super::{
    plan::Step,
    timer::{Timer, Timing},
};

/// How far a change of style has come: see [`StylePass::encode_some`](super::StylePass::encode_some).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StyleProgress {
    /// The dispatch at hand, and how many of its rows are done.
    step: usize,
    row: u32,
    is_done: bool,
}

impl StyleProgress {
    /// Whether all colors are encoded.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// The next dispatches: `operations` of them at most, but at least a tile of rows.
    pub(super) fn take(&mut self, steps: &[Step], operations: u64) -> Vec<Step> {
        let (mut taken, mut left) = (Vec::new(), operations);
        while let Some(step) = steps.get(self.step) {
            let of_row = step.operations_of_row().max(1);
            let rest = step.parameters.n_rows - self.row;
            let affordable = u32::try_from(left / of_row).unwrap_or(u32::MAX);
            // Sums over planes are kept by row of the dispatch: those steps are not cut.
            let whole = affordable >= rest || step.is_partial();
            let tiles = (affordable / TILE_ROWS).max(u32::from(taken.is_empty())) * TILE_ROWS;
            let n = if whole { rest } else { tiles.min(rest) };
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

/// How much of a frame changes of style may take, and how fast the GPU is: what tells
/// [`StylePass::encode_some`](super::StylePass::encode_some) how much to encode.
///
/// It learns the speed by timestamps around what it granted ([`timed`](Self::timed)) or from what
/// [`observe`](Self::observe) is told; until then it assumes the slowest GPU that it is meant for. What a frame takes passes
/// the budget by a tile of 128 rows at most, or where sums over planes are kept by a chunk.
#[derive(Debug)]
pub struct WorkMeter {
    /// Milliseconds of GPU time in each frame; infinite for all at once.
    pub ms_per_frame: f32,
    /// Multiplications and additions in a millisecond.
    operations_per_ms: f64,
    /// What this frame has been granted so far.
    granted: u64,
    timer: Option<Timer>,
}

/// An integrated GPU of ten years ago reaches 0.1 TFLOP/s in products of matrices.
const SLOWEST: f64 = 1e8;

/// Share of the newest observation: a GPU's clock settles within some frames.
const NEWEST: f64 = 0.25;

impl WorkMeter {
    /// At most `ms_per_frame` milliseconds of each frame.
    pub fn new(ms_per_frame: f32) -> Self {
        Self { ms_per_frame, operations_per_ms: SLOWEST, granted: 0, timer: None }
    }

    /// So many multiplications and additions in each frame, however long they take.
    pub fn of_operations(operations: u64) -> Self {
        Self { operations_per_ms: operations as f64, ..Self::new(1.0) }
    }

    /// Everything at once.
    pub fn unlimited() -> Self {
        Self::new(f32::INFINITY)
    }

    /// Measures what it grants by the GPU's own clock, where the device has `TIMESTAMP_QUERY`. Not for software that acts as a
    /// GPU: it tells the time at which it took work up, not at which it did it.
    pub fn timed(mut self, device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        self.timer = Timer::new(device, queue);
        self
    }

    /// Whether a change may take more than one frame.
    pub fn is_limited(&self) -> bool {
        self.ms_per_frame != f32::INFINITY
    }

    /// Whether it measures.
    pub fn is_timed(&self) -> bool {
        self.timer.is_some()
    }

    /// Grants anew, and takes over what was measured of earlier frames, whose commands have been submitted.
    pub fn begin_frame(&mut self) {
        self.granted = 0;
        let measured = self.timer.as_mut().map(Timer::read).unwrap_or_default();
        for (operations, time) in measured {
            self.observe(operations, time);
        }
    }

    /// How much a frame is granted.
    pub fn operations(&self) -> u64 {
        // Casts of what is not positive give 0: a tile of rows is encoded all the same.
        (f64::from(self.ms_per_frame) * self.operations_per_ms) as u64
    }

    /// What is left of this frame's; `None` once it is used up. What has not been begun is granted at least nothing: a tile.
    pub(super) fn left(&self) -> Option<u64> {
        let left = self.operations().saturating_sub(self.granted);
        (left > 0 || self.granted == 0).then_some(left)
    }

    /// Notes what was taken of it. Gives the timestamps to write around it, to be resolved by [`Self::resolve`].
    pub(super) fn grant(&mut self, operations: u64) -> Option<Timing> {
        self.granted = self.granted.saturating_add(operations);
        let is_limited = self.is_limited();
        self.timer.as_mut().filter(|_| is_limited).and_then(|timer| timer.start(operations))
    }

    /// The queries of a timing's two timestamps.
    pub(super) fn timestamps(&self, timing: Timing) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.timer.as_ref().map(|timer| timer.timestamps(timing))
    }

    /// Encodes the way back of a timing's timestamps, behind the pass that wrote them.
    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder, timing: Timing) {
        if let Some(timer) = &self.timer {
            timer.resolve(encoder, timing);
        }
    }

    /// Tells that `operations` took `time` on the GPU. A slower GPU than thought is believed at once, a faster one bit by
    /// bit.
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
        content::StyleShape,
        plan::{CHUNK_ROWS, Split, steps},
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

    /// A row of the first layer takes 2 * 8 * 32 * 64 = 32,768 operations, of the last one 2 * 8 * 64 * 4 = 4,096.
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

    /// Each row of each layer once, and a tile where the budget is too small for one.
    #[test]
    fn the_smallest_part_is_a_tile() {
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
