//! A painting's own paint on a scene, without training: places of the painting are looked up for the scene's surfaces.
//!
//! A decoder carries a painting's palette, but a stroke is not a function of features: they say what is there, and not
//! where in a stroke a Gaussian lies. Here the painting supplies the strokes itself:
//!
//! 1. *Seeds* cover the scene at the spacing of a brush stroke ([`Surface`], once per scene). Each has a tangent plane and
//!    a direction in it: along the edges of the scene's own colors.
//! 2. Each seed takes the place in the painting ([`Paint`]) that resembles its features and its recolored color. Over a
//!    few rounds, seeds continue the places of their neighbors where that costs little, so that strokes run on.
//! 3. Each Gaussian reads the painting at its offset from the nearest seeds, in their tangent planes. What it reads is
//!    split into color and bands of detail, and so are the scene's own colors, recolored.
//! 4. The bands are added up with factors by which small pictures of the scene (*proofs*) have as much detail of each
//!    size as the painting: a smooth painting takes the scene's grain away, a rough one adds its own. At last the
//!    proofs' palette and their shares of dark and bright are corrected, and hues that the painting does not have move
//!    to those that it has.
//! 5. Pictures of the painted scene from eight sides (*sheets*) are painted over with the painting's own patches that
//!    resemble them. Each Gaussian reads the detail of its sheet in place of the painting's, and step 4 is done once more,
//!    and once again for the detail that its correction takes away.
//!
//! A painting is read at 1 pixel of it to 1 pixel of a picture of 512 pixels that shows the whole scene, or of 394 pixels from
//! the middle ones of its capture's cameras.
//!
//! The stages, one module each: `sight` (how large and how visible Gaussians are), `frames` (normals and directions),
//! `seeds`, `smooth` (the scene without its detail), `surface` (all that depends on the scene alone), `painting` (what a
//! style carries), `canvas` (the painting prepared for reading), `places` (choice and coherence), `reading` (colors),
//! `proofs` and `bands` (how much detail pictures show), `gains` (the factors), `tone` (dark and bright), `sheets` (what is
//! painted over, and then read), `patches` (with what).

mod bands;
mod canvas;
mod frames;
mod gains;
mod painting;
mod patches;
mod places;
mod proofs;
mod reading;
mod seeds;
mod sheets;
mod sight;
mod smooth;
mod surface;
#[cfg(test)]
mod tests;
mod tone;

pub use painting::{MAX_PIXELS, Paint, PaintFeatures};
pub use reading::{Brush, repaint};
pub use surface::Surface;
