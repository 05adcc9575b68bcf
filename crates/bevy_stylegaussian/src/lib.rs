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
//!                 GaussianSplats(assets.load("garden.sgs")),
//!                 StyleSource::preset(assets.load("starry.style.safetensors")),
//!             ));
//!         })
//!         .run();
//! }
//! ```
//!
//! - What to spawn: [`GaussianSplats`] shows a [`GaussianScene`] (`.sgs`, or a plain 3DGS `.ply`); [`StyleSource`]
//!   styles it by images, by [`StyleStatistics`] (`.style.safetensors`), or by a mix; change it at any time.
//!   [`StyleTransition`] fades from look to look, [`StyleDecoder`] takes another [`GaussianDecoder`].
//! - What to set on cameras: [`SplatTonemapping`], [`SortKey`]. For the app: [`StyleBackend`], [`StyleBudget`],
//!   [`StyleEncoder`].
//! - What comes back, as messages and to observers: [`StyleApplied`], [`StyleFailed`], [`SceneFailed`]; on the entity
//!   [`AppliedStyle`], which can save what is shown.

#[cfg(test)]
extern crate self as bevy_stylegaussian;

mod asset;
mod loader;
mod pipeline;
mod plugin;
mod splats;
mod style;
#[cfg(test)]
#[path = "../tests/world/mod.rs"]
mod world;

pub use asset::{GaussianDecoder, GaussianScene, StyleStatistics};
pub use plugin::{StyleGaussianPlugin, StyleGaussianSystems};
pub use splats::{GaussianSplats, SceneError, SceneFailed, SortKey, SplatTonemapping};
pub use style::{
    AppliedStyle, StyleApplied, StyleBackend, StyleBudget, StyleDecoder, StyleEncoder, StyleError,
    StyleFailed, StyleInput, StylePassCount, StyleSource, StyleTransition, WeightedStyle,
};

/// The examples of the repository's README, as tests.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
mod readme {}
