//! Captured 3D Gaussian Splatting scenes in Bevy, restyled by any image at run time.
//!
//! ```no_run
//! use bevy::prelude::*;
//! use bevy_stylegaussian::{GaussianSplats, StyleGaussianPlugin, StyleSource};
//!
//! fn main() {
//!     App::new()
//!         .add_plugins((DefaultPlugins, StyleGaussianPlugin::default()))
//!         .add_systems(Startup, |mut commands: Commands, assets: Res<AssetServer>| {
//!             commands.spawn(Camera3d::default());
//!             commands.spawn((
//!                 GaussianSplats(assets.load("garden.ply")),
//!                 StyleSource::image(assets.load("starry.jpg")),
//!             ));
//!         })
//!         .run();
//! }
//! ```
//!
//! - Components of scenes: [`GaussianSplats`] shows a [`GaussianScene`] (`.sgs`, or a capture in another
//!   format; [`SceneSettings`] are those of loading it). [`StyleSource`] paints it in the strokes of images, by
//!   [`StyleStatistics`] (`.style.safetensors`), by a baked [`StyleLook`] (`.look.safetensors`), or by a mix;
//!   change it at any time. [`StyleTransition`] fades from one style to the next. [`StyleRefine`] bakes a shown
//!   style further in the background, [`StylePrepare`] prepares a loaded scene for the first. [`StyleDecoder`]
//!   selects another [`GaussianDecoder`]. [`StyleMask`] holds weights that are painted at run time, from a
//!   [`SavedMask`] (`.mask.safetensors`) if there is one, and [`MaskVisibility`] hides painted splats or crops
//!   to them.
//! - Components of cameras: [`SplatTonemapping`], [`SplatSortKey`].
//! - Parameters of systems: [`SplatRayCast`]. `SplatPickingPlugin` adds Bevy's pointer events to splats.
//! - Resources: [`StyleMethod`], [`StyleBackend`], [`StyleBudget`], [`StyleEncoder`].
//! - Events, as messages and for observers: [`GaussianSceneReady`], [`GaussianSceneFailed`],
//!   [`StyleRecolored`], [`StyleApplied`], [`StyleRefined`], [`StyleFailed`], [`StyleMaskFailed`]. The
//!   component [`AppliedStyle`] holds the style that an entity shows, and can save the styled scene.
//!
//! Scene files and saved games: Bevy's serializers save and load all of these components but [`AppliedStyle`],
//! which the plugin computes again. Assets are saved by their path, so one that a program made is not; masks
//! are saved as they are painted. Bevy's own `VisibilityClass`, which meshes have too, cannot be saved: deny it
//! if Bevy's feature `reflect_auto_register` is on.
//!
//! Most apps need no more than [`prelude`].
//!
//! With Bevy's `RenderDiagnosticsPlugin`, the times of `splat_project_and_sort`, `splat_draw`,
//! `splat_composite` and `style_pass` are among the render diagnostics. If several cameras see splats, the
//! names of the second and further ones end with a number, as in `splat_draw_2`: in the order in which the
//! cameras came, and a camera keeps its number. The sum is the time of the frame.
//!
//! The features of cargo: `bundled_models` (default) compiles the default encoder and decoder in, so that a
//! game works offline. `picking` (default) is for pointer events, with Bevy's feature `bevy_picking`.
//! `image_files` (default) are style images as `.png` and `.jpg`, with Bevy's features of these names. `webp`,
//! `bmp`, `gif` and `tiff` are style images of these formats, likewise. `pbr` (default) is for games that draw
//! meshes with `bevy_pbr`: without it, transmissive materials may not see splats.

mod colors;
mod loader;
mod mask;
mod picking;
mod plugin;
mod reports;
mod scene;
mod splats;
mod style;
mod systems;
#[cfg(test)]
mod tests;
mod work;

pub use colors::GaussianSceneReady;
pub use mask::{MaskVisibility, SavedMask, StyleMask, StyleMaskError, StyleMaskFailed, lasso_in_view};
pub use picking::{SplatHit, SplatRayCast};
#[cfg(feature = "picking")]
pub use picking::{SplatPickingCamera, SplatPickingPlugin, SplatPickingSettings};
pub use plugin::StyleGaussianPlugin;
pub use scene::{GaussianScene, GaussianSceneError, GaussianSceneFailed, GaussianSplats, SceneSettings};
pub use splats::{SplatSortKey, SplatTonemapping};
pub use style::{
    AppliedStyle, GaussianDecoder, HiddenUntilStyled, ImageEncoder, StyleApplied, StyleBackend, StyleBudget,
    StyleDecoder, StyleEncoder, StyleError, StyleFailed, StyleInput, StyleLook, StyleMethod, StylePrepare,
    StyleProgress, StyleRecolored, StyleRefine, StyleRefined, StyleSource, StyleStatistics, StyleTransition,
    StyleVolume, TransitionCenter, TransitionClock, TransitionShape, VolumeShape, WeightedStyle,
};
pub use systems::StyleGaussianSystems;
pub use work::StyleThreads;

/// The model crate: the types inside of assets, such as [`stylegaussian::Scene`].
pub use stylegaussian;
/// The encoder crate: the type inside of [`ImageEncoder`], [`stylegaussian_encoder::Encoder`].
pub use stylegaussian_encoder;
/// The crate of files: readers and writers of scenes and of everything else that loads, such as
/// [`stylegaussian_files::write_scene`].
pub use stylegaussian_files;
/// The limits that a GPU must have: [`NEEDS`](gpu_needs::NEEDS). On a GPU without them, the app goes on and no
/// splats are drawn: each of their entities gets a [`GaussianSceneFailed`], and the log has one error.
pub use stylegaussian_gpu::needs as gpu_needs;

/// The plugin and the components, resources and events that most apps use.
///
/// ```
/// use bevy_stylegaussian::prelude::*;
/// ```
pub mod prelude {
    pub use crate::{
        AppliedStyle, GaussianScene, GaussianSceneFailed, GaussianSceneReady, GaussianSplats,
        HiddenUntilStyled, MaskVisibility, SavedMask, SplatHit, SplatRayCast, SplatSortKey, SplatTonemapping,
        StyleApplied, StyleBackend, StyleBudget, StyleDecoder, StyleEncoder, StyleFailed,
        StyleGaussianPlugin, StyleInput, StyleMask, StyleMaskFailed, StyleMethod, StylePrepare,
        StyleRecolored, StyleRefine, StyleRefined, StyleSource, StyleTransition, StyleVolume,
        TransitionClock, TransitionShape,
    };
    #[cfg(feature = "picking")]
    pub use crate::{SplatPickingCamera, SplatPickingPlugin, SplatPickingSettings};
}

/// The examples of the repository's README, as doc tests.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
mod readme {}
