//! The style that an entity shows.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian::{
    Decoder, Scene,
    fold::{self, ChannelMap, StylizeError},
    paint::Painted,
    strokes::Strokes,
};

/// The style that an entity shows. It is inserted when [`StyleApplied`](crate::StyleApplied), the event, is
/// sent, and removed with [`StyleSource::none`](crate::StyleSource::none) or with the scene.
///
/// It is not reflected: it holds what the plugin has computed, and a world that is saved and loaded computes it
/// again.
#[derive(Component, Clone)]
pub struct AppliedStyle {
    pub(crate) scene: Arc<Scene>,
    pub(crate) colors: AppliedColors,
}

/// The colors of a style, or folded weights that give them.
#[derive(Clone)]
pub(crate) enum AppliedColors {
    /// One color per Gaussian `[N]`, and the strokes over them if there are any.
    Known { colors: Arc<[[f32; 3]]>, strokes: Option<Arc<Strokes>> },
    /// The GPU decoded them.
    // They are not read back: they are half floats, and reading them would wait for the GPU.
    Decoded { decoder: Arc<Decoder>, map: Arc<ChannelMap> },
}

impl AppliedStyle {
    /// One color per Gaussian of the scene `[N]`, display-referred RGB, not clamped. Over them lie the
    /// [`strokes`](Self::strokes).
    ///
    /// If the GPU styled the entity, the colors are computed again on the CPU. This can take seconds, so call
    /// it in a task.
    ///
    /// # Errors
    /// None for a style that is shown: scene, decoder and style have been checked.
    pub fn colors(&self) -> Result<Arc<[[f32; 3]]>, StylizeError> {
        match &self.colors {
            AppliedColors::Known { colors, .. } => Ok(Arc::clone(colors)),
            AppliedColors::Decoded { decoder, map } => Ok(fold::stylize(&self.scene, decoder, map)?.into()),
        }
    }

    /// The strokes over the colors, or `None` if the style has none.
    /// [`Look::with_strokes`](stylegaussian::Look::with_strokes) keeps both in a file.
    pub fn strokes(&self) -> Option<&Arc<Strokes>> {
        match &self.colors {
            AppliedColors::Known { strokes, .. } => strokes.as_ref(),
            AppliedColors::Decoded { .. } => None,
        }
    }

    /// Colors and strokes together. As [bytes](Painted::to_bytes) they can go elsewhere, such as to a worker of
    /// a browser.
    ///
    /// # Errors
    /// As [`Self::colors`].
    pub fn painted(&self) -> Result<Painted, StylizeError> {
        let strokes = self.strokes().map(|strokes| (**strokes).clone()).unwrap_or_default();
        Ok(Painted { colors: self.colors()?.to_vec(), strokes, ..Painted::default() })
    }

    /// The decoder and the map of features from which the GPU makes the colors, or `None` if they are known
    /// without it. [`fold::stylize`] computes them elsewhere, such as in a worker of a browser.
    pub fn decoded(&self) -> Option<(&Arc<Decoder>, &Arc<ChannelMap>)> {
        match &self.colors {
            AppliedColors::Known { .. } => None,
            AppliedColors::Decoded { decoder, map } => Some((decoder, map)),
        }
    }

    /// The scene in the colors that it is shown in, each with the mean of the strokes over it: other formats
    /// hold no strokes. Write it to a file with `stylegaussian_files::write_scene`. With strokes, this takes a
    /// moment too.
    ///
    /// # Errors
    /// As [`Self::colors`].
    pub fn styled_scene(&self) -> Result<Scene, StylizeError> {
        let mut scene = Scene::clone(&self.scene);
        scene.set_colors(&self.painted()?.flattened(&self.scene));
        Ok(scene)
    }
}
