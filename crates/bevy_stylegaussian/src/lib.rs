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
//!             // Splats have soft edges, so multisampling would only take time.
//!             commands.spawn((Camera3d::default(), Msaa::Off));
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
//!   format). [`StyleSource`] paints it in the strokes of images, by
//!   [`StyleStatistics`](style::StyleStatistics) (`.style.safetensors`), by a baked
//!   [`StyleLook`](style::StyleLook) (`.look.safetensors`), or by a mix; change it at any time.
//!   [`StyleLiving`](style::StyleLiving) lets strokes follow an image that changes. [`StyleTransition`] fades
//!   from one style to the next. `StyleRefine` bakes a shown style further in the background,
//!   [`StylePrepare`](style::StylePrepare) prepares a loaded scene for the first.
//!   [`StyleMask`](mask::StyleMask) holds weights that are painted at run time, and
//!   [`MaskVisibility`](mask::MaskVisibility) hides painted splats or crops to them. [`SplatTint`] changes the
//!   colors of all of it at once, [`SplatShadows`](splats::SplatShadows) lets shadows fall on it, and
//!   [`SplatCaster`](splats::SplatCaster) lets it cast them.
//! - Worlds: [`GaussianWorld`] shows a capture that is larger than a GPU, at levels of detail that follow the
//!   cameras.
//! - Components of meshes and of skies, with the feature `meshes`: `StyledMesh` and `StyledSky` paint them as a
//!   capture beside them is.
//! - Components of cameras: those of [`splats`]; Bevy's `DistanceFog` and `Atmosphere` reach splats, too.
//! - Parameters of systems: [`SplatRayCast`]. `SplatPickingPlugin` adds Bevy's pointer events to splats.
//! - Resources: [`StyleMethod`](style::StyleMethod), [`StyleThreads`],
//!   [`GaussianBudget`](world::GaussianBudget), and those of the [decoder](style::decoder).
//! - Events, as messages and for observers: [`GaussianSceneReady`], [`GaussianSceneFailed`],
//!   [`GaussianWorldFailed`](world::GaussianWorldFailed), [`StyleRecolored`](style::StyleRecolored),
//!   [`StyleApplied`], `StyleRefined`, [`StyleFailed`], [`StyleMaskFailed`](mask::StyleMaskFailed). The
//!   component [`AppliedStyle`] holds the style that an entity shows, and can save the styled scene.
//!
//! The root has what most games name. The rest is in modules: [`scene`], [`style`] with its
//! [`decoder`](style::decoder), [`splats`], [`mask`], [`picking`] and [`world`].
//!
//! Scene files and saved games: Bevy's serializers save and load all of these components but [`AppliedStyle`],
//! which the plugin computes again. Assets are saved by their path, so one that a program made is not; masks
//! are saved as they are painted. Bevy's own `VisibilityClass`, which meshes have too, cannot be saved: deny it
//! if Bevy's feature `reflect_auto_register` is on.
//!
//! Most apps need no more than [`prelude`].
//!
//! With Bevy's `RenderDiagnosticsPlugin`, the times of `splat_project_and_sort`, `splat_draw`, `splat_depth`,
//! `splat_prepass_depth`, `splat_composite`, `splat_cast`, `style_pass`, `redraw_strokes` and, in an
//! atmosphere, `splat_light` are among the render diagnostics. If several cameras see splats, the names of the
//! second and further ones end with a number, as in `splat_draw_2`: in the order in which the cameras came, and
//! a camera keeps its number. The sum is the time of the frame. Shadow maps of spot lights and point lights
//! belong to no camera: there the name of Bevy's pass follows, as in `splat_cast_shadow_spot_light_0`.
//!
//! The features of cargo, of which all but those of the last two points are defaults:
//!
//! - `images`: styles of images, `StyleEncoder` and its asset `ImageEncoder`. Without it, a game shows looks
//!   and presets, and compiles no encoder. A style of an image is an error then, which names the feature.
//! - `image_files`: reads `.png` and `.jpg`, with Bevy's features of these names.
//! - `refine`: the baker in the game, `StyleRefine` and its event `StyleRefined`. It implies `images`.
//! - `bundled_models`: compiles the default decoder in, and with `images` the default encoder, so that a game
//!   works offline.
//! - `picking`: pointer events, with Bevy's feature `bevy_picking`.
//! - `meshes`: meshes and skies in the same paint, `StyledMesh` and `StyledSky`. It implies `pbr`.
//! - `pbr`: for games that draw meshes with `bevy_pbr`. Without it, transmissive materials may not see splats,
//!   and there are no fog, no air of an atmosphere and no shadows.
//! - `webp`, `bmp`, `gif` (the first picture) and `tiff`: read images of these formats, with Bevy's features of
//!   these names. They imply `images`.
//! - `onnx`: encoders as `.onnx` files. It implies `images`.

mod colors;
mod commands;
mod loader;
pub mod mask;
#[cfg(feature = "meshes")]
mod meshes;
pub mod picking;
mod plugin;
mod reports;
pub mod scene;
pub mod splats;
pub mod style;
mod systems;
#[cfg(test)]
mod tests;
mod work;
pub mod world;

pub use colors::{GaussianSceneReady, SplatTint};
#[cfg(feature = "meshes")]
pub use meshes::{StyledMesh, StyledSky};
#[doc(inline)]
pub use picking::SplatRayCast;
pub use plugin::StyleGaussianPlugin;
#[doc(inline)]
pub use scene::{FitScene, GaussianScene, GaussianSceneFailed, GaussianSplats};
#[doc(inline)]
pub use style::{
    AppliedStyle, HiddenUntilStyled, StyleApplied, StyleFailed, StyleSource, StyleTransition, StyleVolume,
};
pub use systems::StyleGaussianSystems;
pub use work::StyleThreads;
#[doc(inline)]
pub use world::GaussianWorld;

/// The model crate: the types inside of assets, such as [`stylegaussian::Scene`].
pub use stylegaussian;
/// The encoder crate: the type inside of an [`ImageEncoder`](style::decoder::ImageEncoder),
/// [`stylegaussian_encoder::Encoder`].
#[cfg(feature = "images")]
pub use stylegaussian_encoder;
/// The crate of files: readers and writers of scenes and of everything else that loads, such as
/// [`stylegaussian_files::write_scene`].
pub use stylegaussian_files;

/// The plugin and the components, resources and events that most apps use.
///
/// ```
/// use bevy_stylegaussian::prelude::*;
/// ```
pub mod prelude {
    #[cfg(feature = "picking")]
    pub use crate::picking::{SplatPickingCamera, SplatPickingPlugin, SplatPickingSettings};
    #[cfg(feature = "refine")]
    pub use crate::style::{StyleRefine, StyleRefined};
    pub use crate::{
        AppliedStyle, FitScene, GaussianScene, GaussianSceneFailed, GaussianSceneReady, GaussianSplats,
        HiddenUntilStyled, SplatRayCast, SplatTint, StyleApplied, StyleFailed, StyleGaussianPlugin,
        StyleSource, StyleTransition, StyleVolume,
        mask::{MaskVisibility, SavedMask, StyleMask, StyleMaskFailed},
        picking::SplatHit,
        splats::{
            SplatCaster, SplatCuts, SplatDepth, SplatEyes, SplatShadows, SplatSortKey, SplatTonemapping,
        },
        style::{
            StyleInput, StyleLiving, StyleMethod, StylePrepare, StyleRecolored, TransitionClock,
            TransitionShape,
        },
        world::{GaussianBudget, GaussianWorld, GaussianWorldFailed, WorldManifest, WorldPart, WorldState},
    };
    #[cfg(feature = "meshes")]
    pub use crate::{StyledMesh, StyledSky};
}
