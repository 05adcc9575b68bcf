//! The artist's choices.

use super::{direction::Direction, pins::Pin, tints::Tints};

/// Share of the way toward the painting's nearest colors, for hues that it does not have. Grass then turns to a
/// painting's gold and not to its mean.
pub(super) const TO_PALETTE: f32 = 0.8;

/// Choices of an artist beside the paintings.
#[derive(Clone, Copy)]
pub struct Hand<'a> {
    /// Whether the paintings act as one style: each spot takes its place among all of them, and neighbors
    /// prefer the same painting. Else colors are mixed by weights.
    pub is_collection: bool,
    /// Colors in the paintings' stead. Strokes keep their light and dark.
    pub tints: Option<&'a Tints>,
    /// Share of the way that base colors go toward the hues of the palette, 0..1. At 0, hues that it does not
    /// have stay; at 1, there are no others.
    pub palette: f32,
    /// Direction of strokes on the scene. `None`: along its edges.
    pub direction: Option<Direction<'a>>,
    /// Places that are given.
    pub pins: &'a [Pin],
}

impl Default for Hand<'_> {
    /// The paintings decide all.
    fn default() -> Self {
        Self { is_collection: false, tints: None, palette: Hand::PALETTE, direction: None, pins: &[] }
    }
}

impl Hand<'_> {
    /// The usual strength of the palette.
    pub const PALETTE: f32 = TO_PALETTE;
}
