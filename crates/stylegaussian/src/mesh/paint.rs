//! Colors and strokes of a mesh.

use super::{corners::Corners, split::Split, spots::Spots};
use crate::{
    paint::Painted,
    strokes::{PlainSeed, StrokeSeed, Strokes},
};

/// A painted mesh.
#[derive(Clone, Debug, Default)]
pub struct MeshPaint {
    /// Its vertices and triangles.
    pub corners: Corners,
    /// The color of each spot `[S]`: display-referred, and up to 0.3 outside of 0..1.
    pub colors: Vec<[f32; 3]>,
    /// The strokes over them.
    pub strokes: Strokes,
}

impl MeshPaint {
    /// The paint of a mesh whose spots were `painted`. Overlapping Gaussians blur fine detail, which is laid on
    /// stronger therefore. On a mesh nothing is blurred: its gain is 1, that of the painting.
    ///
    /// # Panics
    /// If other spots were painted.
    pub fn new(split: &Split, spots: &Spots, painted: Painted) -> Self {
        let Painted { colors, mut strokes, .. } = painted;
        assert_eq!(colors.len(), spots.scene.len(), "one color for each spot");
        for seed in &mut strokes.seeds {
            let direction = seed.direction();
            *seed = PlainSeed { fine: 1.0, ..StrokeSeed::plain(seed) }.packed().with_direction(direction);
        }
        Self { corners: Corners::new(split, spots, &strokes.words), colors, strokes }
    }
}
