//! Meshes that are painted as scenes are.
//!
//! 1. A mesh's triangles are split until they are smaller than a stroke ([`Split`]).
//! 2. Its vertices become flat Gaussians, one for each spot of the surface ([`Spots`]). Vertices that the mesh
//!    has twice, for a seam of its texture coordinates, are one spot, so paint has no such seams.
//! 3. These are painted as any scene is ([`paint`](crate::paint)), beside the scene in which the mesh stands.
//! 4. Each vertex takes color and word of its spot ([`Corners`]). A triangle between spots of several seeds
//!    shows the strokes of all of them, by the fragment's shares of its corners: see [`detail_at`].
//!
//! A place in the painting is an affine function of the position, so a triangle's corners have all of it, and
//! fragments interpolate. Positions are those of the mesh at rest, so strokes stay on it however it is bent.
//! The kernel is `mesh_strokes`; [`draw`](draw()) makes such pictures on the CPU.

mod corners;
mod draw;
mod paint;
mod sky;
mod split;
mod spots;
#[cfg(test)]
mod tests;

pub use corners::{Corner, Corners, blend_weights, detail_at};
pub use draw::draw;
pub use paint::MeshPaint;
pub use sky::{Sky, direction_of, face_of};
pub use split::{MAX_TRIANGLES, Split};
pub use spots::{MAX_SPOTS, SPACING, Spots, spacing_alone};
