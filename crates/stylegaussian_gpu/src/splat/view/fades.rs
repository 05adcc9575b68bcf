//! Clouds that fade in a view.

use stylegaussian_shaders::splat::{FADED_SHIFT, MAX_FADED};

use super::SplatView;
use crate::splat::cloud::Cloud;

/// The shares of opacities that are faded out.
#[derive(Debug, Default)]
pub(super) struct Fades {
    /// Of all clouds, 0..1.
    wanted: Vec<f32>,
    /// Of this frame's clouds without those that are not drawable, of `MAX_FADED`.
    drawn: Vec<u32>,
}

impl SplatView {
    /// Fades clouds, for all frames until the next call: the shares of their opacities that are left out, 0..1,
    /// in the order in which clouds are given. Those beyond the last one, and by default all, are drawn whole.
    pub fn set_faded(&mut self, shares: Vec<f32>) {
        self.fades.wanted = shares;
    }

    /// Notes which of the clouds are drawn in this frame.
    pub(in crate::splat) fn note_drawn(&mut self, clouds: &[Cloud]) {
        let Fades { wanted, drawn } = &mut self.fades;
        let code = |share: f32| (share.clamp(0.0, 1.0) * MAX_FADED as f32).round() as u32;
        let drawable = clouds.iter().enumerate().filter(|(_, cloud)| cloud.is_drawable());
        drawn.clear();
        drawn.extend(drawable.map(|(i, _)| wanted.get(i).map_or(0, |share| code(*share))));
    }

    /// The flags of a chunk of the i-th cloud that is drawn, with its fade.
    pub(in crate::splat) fn with_fade(&self, i: usize, flags: u32) -> u32 {
        flags | self.fades.drawn.get(i).copied().unwrap_or(0) << FADED_SHIFT
    }
}

/// The share that is faded out, of `MAX_FADED`.
pub(super) fn of_flags(flags: u32) -> u32 {
    flags >> FADED_SHIFT
}
