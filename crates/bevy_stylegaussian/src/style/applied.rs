//! The style that an entity shows.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian::{
    Decoder, Scene,
    fold::{self, ChannelMap, StylizeError},
};

/// The style that an entity shows. It is inserted when [`StyleApplied`](crate::StyleApplied), the event, is sent, and
/// removed with [`StyleSource::none`](crate::StyleSource::none) or with the scene.
#[derive(Component, Clone, Reflect)]
#[reflect(opaque)]
#[reflect(Component, Clone)]
pub struct AppliedStyle {
    pub(super) scene: Arc<Scene>,
    pub(super) colors: AppliedColors,
}

/// The colors of a style, or what gives them.
#[derive(Clone)]
pub(super) enum AppliedColors {
    /// One color per Gaussian `[N]`.
    Known(Arc<[[f32; 3]]>),
    /// The GPU decoded them.
    // They are not read back: they are half floats, and reading them would wait for the GPU.
    Decoded { decoder: Arc<Decoder>, map: Arc<ChannelMap> },
}

impl AppliedStyle {
    /// One color per Gaussian of the scene `[N]`, display-referred RGB, not clamped.
    ///
    /// If the GPU styled the entity, the colors are computed again on the CPU. This can take seconds, so call it in a task.
    ///
    /// # Errors
    /// None for a style that is shown: scene, decoder and style have been checked.
    pub fn colors(&self) -> Result<Arc<[[f32; 3]]>, StylizeError> {
        match &self.colors {
            AppliedColors::Known(colors) => Ok(Arc::clone(colors)),
            AppliedColors::Decoded { decoder, map } => Ok(fold::stylize(&self.scene, decoder, map)?.into()),
        }
    }

    /// The scene in the colors that it is shown in. Write it to a file with `stylegaussian::file::write_scene`.
    ///
    /// # Errors
    /// As [`Self::colors`].
    pub fn styled_scene(&self) -> Result<Scene, StylizeError> {
        let colors = self.colors()?;
        let mut scene = Scene::clone(&self.scene);
        scene.set_colors(&colors);
        Ok(scene)
    }
}
