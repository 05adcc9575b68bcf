//! Progress and interruption of long computations, for embedding, training, distillation and evaluation alike.

use std::sync::atomic::{AtomicBool, Ordering};

/// Progress of a computation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The part of the computation that is running.
    pub stage: Stage,
    /// Views, steps or pictures done.
    pub done: u32,
    /// Views, steps or pictures in all.
    pub total: u32,
    /// Running means of the losses by name. Empty for stages without losses.
    pub losses: [Option<(&'static str, f32)>; 2],
}

/// A part of a computation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Embedding: encoding views and computing their blend weights.
    Views,
    /// Embedding: descent.
    Refine,
    /// Decoder training: regression on the recolored scene.
    WarmStart,
    /// Decoder training: steps with the paper's loss.
    Training,
    /// Encoder distillation: steps.
    Distillation,
    /// Evaluation: stylized pictures.
    Evaluation,
}

/// Follows a computation from outside, from any thread.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// Called before or after each view, step or picture.
    pub progress: &'a (dyn Fn(Progress) + Sync),
    /// If set, the computation stops after the view, step or picture at which it is.
    pub interrupted: &'a AtomicBool,
}

impl Watch<'_> {
    /// Whether the caller asked to stop.
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Reports progress of a stage without losses.
    pub(crate) fn report(&self, stage: Stage, done: u32, total: u32) {
        (self.progress)(Progress { stage, done, total, losses: [None; 2] });
    }
}

/// Ignores progress and never interrupts.
impl Default for Watch<'_> {
    fn default() -> Self {
        static NEVER: AtomicBool = AtomicBool::new(false);
        Self { progress: &|_| (), interrupted: &NEVER }
    }
}

/// Running means of two losses, for progress reports.
#[cfg(feature = "training")]
pub(crate) struct RunningMeans {
    names: [&'static str; 2],
    /// Weight of the newest value.
    rate: f32,
    means: [Option<f32>; 2],
}

#[cfg(feature = "training")]
impl RunningMeans {
    /// Means of losses with these names, in which a new value has weight `rate`.
    pub fn new(names: [&'static str; 2], rate: f32) -> Self {
        Self { names, rate, means: [None; 2] }
    }

    /// Adds the losses of a step.
    pub fn add(&mut self, losses: [f32; 2]) {
        for (mean, loss) in self.means.iter_mut().zip(losses) {
            // Begins at the first loss: from 0, the display would show a rise that is none.
            *mean = Some(mean.map_or(loss, |mean| (1.0 - self.rate) * mean + self.rate * loss));
        }
    }

    /// Names and means.
    pub fn losses(&self) -> [Option<(&'static str, f32)>; 2] {
        [0, 1].map(|i| self.means[i].map(|mean| (self.names[i], mean)))
    }
}

#[cfg(all(test, feature = "training"))]
mod tests {
    use super::*;

    #[test]
    fn means_begin_at_the_first_value() {
        let mut means = RunningMeans::new(["a", "b"], 0.25);
        assert_eq!(means.losses(), [None, None]);
        means.add([4.0, 0.0]);
        means.add([8.0, 1.0]);
        assert_eq!(means.losses(), [Some(("a", 5.0)), Some(("b", 0.25))]);
    }
}
