//! Clouds that fade in a view.

use stylegaussian_shaders::splat::{FADED_SHIFT, MAX_FADED};

use crate::splat::cloud::Cloud;

/// The shares of opacities that are faded out.
#[derive(Debug, Default)]
pub(super) struct Fades {
    /// Of all clouds, 0..1.
    pub(super) wanted: Vec<f32>,
    /// Of this frame's clouds without those that are not drawable, as [`faded_flags`].
    drawn: Vec<u32>,
}

impl Fades {
    /// Notes which of the clouds are drawn in this frame.
    pub(super) fn note_drawn(&mut self, clouds: &[Cloud]) {
        let Self { wanted, drawn } = self;
        let drawable = clouds.iter().enumerate().filter(|(_, cloud)| cloud.is_drawable());
        drawn.clear();
        drawn.extend(drawable.map(|(i, _)| wanted.get(i).map_or(0, |share| faded_flags(*share))));
    }

    /// The flags of a chunk of the i-th cloud that is drawn, with its fade.
    pub(super) fn on(&self, i: usize, flags: u32) -> u32 {
        flags | self.drawn.get(i).copied().unwrap_or(0)
    }
}

/// The flags of a chunk of which a share of all opacities is faded out, 0..1.
pub(in crate::splat) fn faded_flags(share: f32) -> u32 {
    ((share.clamp(0.0, 1.0) * MAX_FADED as f32).round() as u32) << FADED_SHIFT
}

/// The share that is faded out, of `MAX_FADED`.
pub(super) fn of_flags(flags: u32) -> u32 {
    flags >> FADED_SHIFT
}
