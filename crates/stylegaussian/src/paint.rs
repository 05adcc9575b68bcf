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
//!    split into color and detail; the detail is laid over the scene's own large shapes, recolored.
//!
//! A painting is read at 1 pixel of it to 1 pixel of a picture of 512 pixels, seen from the usual distance.
//!
//! The stages, one module each: `sight` (how large and how visible Gaussians are), `frames` (normals and directions),
//! `seeds`, `surface` (all that depends on the scene alone), `painting` (what a style carries), `canvas` (the painting
//! prepared for reading), `places` (choice and coherence), `reading` (colors).

mod canvas;
mod frames;
mod painting;
mod places;
mod reading;
mod seeds;
mod sight;
mod surface;
#[cfg(test)]
mod tests;

pub use painting::{MAX_PIXELS, Paint, PaintFeatures};
pub use reading::{Brush, repaint};
pub use surface::Surface;
