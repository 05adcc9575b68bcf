//! The splat pass: draws any number of clouds as cameras see them, every frame.
//!
//! 1. *project* (`project`): culls and projects the Gaussians of each cloud and evaluates their colors, into
//!    one array of records and keys per view. Behind it, *strokes* (`strokes`) writes how the splats of clouds
//!    with strokes lie in their paintings. Views without such clouds do none of this, and their draws bind
//!    nothing of it. Last, *light* (`light`) tints colors, darkens them in shadow and puts them behind fog and
//!    air, in views that have any: see [`SplatView::set_light`]. In an atmosphere, it is a stage of its own
//!    after the next: [`SplatPass::light_in_atmosphere`];
//! 2. *sort* (`sort`): one radix sort over the visible splats of all clouds, so that clouds interleave where
//!    they overlap;
//! 3. *draw* (`draw`): one indirect draw of quads, back to front, premultiplied over, into a *layer* of the
//!    target's size. Splats blend there among themselves, display-referred. On software adapters a tiled
//!    compute rasterizer (`tiles`) draws layers, four times as fast. Layers have one sample per pixel. For
//!    targets with several, splats are drawn once more where meshes end (`edges`). For weak GPUs, they are
//!    drawn at half the width and height, and made whole by the depth of meshes (`half`);
//! 4. *composite* (`composite`): puts the layer over the picture, in the picture's own space.
//!
//! Two eyes of one head share stages 1 and 2 (`eyes`): one kernel projects for both, from one order and one
//! color.
//!
//! Record indices are fixed, so the order of equal depths never changes between frames. Clouds behind a mask
//! have a variant of *project* that is compiled at its first use. The sort is skipped while nothing moves.
//! Quads end where alpha falls under 1/255. Only the composite knows the target's space
//! ([`CompositeMode`]): tone mapping that comes later is undone, by formula if it has an inverse and by a
//! least-squares table otherwise.
//!
//! Stages 1 and 2 are [`SplatPass::project_and_sort`], stage 3 is [`SplatPass::draw_layer`], stage 4 is
//! [`Composite::draw`]. A stage of its own, *depth* (`depth`), writes what the splats know of depth into the
//! camera's depth attachment, if it is asked for: [`SplatPass::find_depth`], [`SplatPass::write_depth`].
//! Another, *cast* (`cast`), draws the cores of splats into the shadow maps of lights:
//! [`SplatPass::project_casters`], [`SplatPass::cast`]. The rules are those of the CPU twin,
//! `stylegaussian::splat`, with two differences: quads finish no pixel early (less than 1e-4 of its light is
//! left then), and records store colors and opacities as f16.

mod camera;
mod cast;
mod cloud;
mod composite;
mod depth;
mod dispatch;
mod draw;
mod edges;
mod error;
mod eyes;
mod half;
mod headless;
mod layer;
mod lift;
mod light;
mod memory;
mod pass;
mod project;
mod scene;
mod settings;
mod sort;
mod strokes;
#[cfg(test)]
pub(crate) mod testing;
mod tiles;
mod tonemapping;
mod view;

pub use self::half::HalfLayer;
pub use camera::Camera;
pub use cast::{CastView, Caster, SHADOW_FORMAT};
pub use cloud::{Cloud, CloudColors, CloudVisibility};
pub use composite::{Composite, CompositeInput, CompositeMode, CompositePipeline};
pub use depth::{DepthPipeline, IsoDepth};
pub use draw::SplatPipeline;
pub use edges::EdgeLayers;
pub use error::SplatError;
pub use headless::{Headless, HeadlessError, Picture};
pub use layer::{LAYER_FORMAT, Layer};
pub use lift::LiftPipeline;
pub use light::{AerialPerspective, Shadows, ViewLight};
pub use pass::SplatPass;
pub(crate) use scene::Ball;
pub use scene::GpuScene;
pub use settings::{SortKey, SplatCuts, SplatSettings};
pub use strokes::PaintedColors;
pub use tonemapping::{InverseTable, ToneCurve, Tonemapping};
pub use view::SplatView;
