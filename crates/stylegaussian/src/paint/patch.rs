//! Patches: the surroundings of a seed or of a place, at a few points.

/// Side of a place, in pixels.
pub(super) const PLACE: usize = 8;

/// Points along a side of a patch.
const SIDE: usize = 5;

/// Points of a patch, which shows the surroundings of a seed or a place.
pub(super) const PATCH: usize = SIDE * SIDE;

/// Distance of a patch's points, in pixels: a patch is a little wider than a stroke's spot.
pub(super) const STEP: f32 = 8.0;

/// The largest offset of a patch's points, in steps along and beside.
pub(super) fn reach_of_patch() -> f32 {
    (SIDE / 2) as f32
}

/// The place of a patch's point, in steps along and beside.
pub(super) fn offset_in_patch(k: usize) -> (f32, f32) {
    let middle = (SIDE / 2) as f32;
    ((k / SIDE) as f32 - middle, (k % SIDE) as f32 - middle)
}
