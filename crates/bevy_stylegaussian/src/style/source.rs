//! What an entity's splats should look like.

use std::time::Duration;

use bevy::prelude::*;

use crate::asset::{GaussianDecoder, StyleStatistics};

use super::job::StyleJob;

/// The style of an entity's [`GaussianSplats`](crate::GaussianSplats): a weighted mix of images and presets, blended
/// with the content itself. Change it at any time; the old look stays until the new one is complete.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{StyleInput, StyleSource};
/// # fn system(mut source: Single<&mut StyleSource>, assets: Res<AssetServer>) {
/// let (starry, wave) = (assets.load("starry.jpg"), assets.load("wave.style.safetensors"));
/// **source = StyleSource::image(starry.clone());
/// **source = StyleSource::mix([(StyleInput::Image(starry), 0.3), (StyleInput::Preset(wave), 0.7)]).with_content(0.2);
/// source.content = 0.5;
/// **source = StyleSource::none();
/// # }
/// ```
#[derive(Component, Clone, Debug, Default, PartialEq, Reflect)]
#[require(StyleJob)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleSource {
    /// The styles and how much of each; weights are normalized to sum 1. Without any, the splats keep their own colors.
    pub styles: Vec<WeightedStyle>,
    /// How much of the content's own features stays, 0..1: transferred = c f + (1 - c) sum_j w_j AdaIN_j. At 1 the
    /// decoder shows what it makes of the content, which is not the original color.
    pub content: f32,
}

/// One style of a mix.
#[derive(Clone, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, PartialEq)]
pub struct WeightedStyle {
    /// The style.
    pub input: StyleInput,
    /// Its weight, at least 0.
    pub weight: f32,
}

/// Where a style comes from.
#[derive(Clone, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, PartialEq)]
pub enum StyleInput {
    /// An image, encoded off the main thread the first time it is used, and again when it changes. Needs an encoder: see
    /// [`StyleEncoder`](crate::StyleEncoder).
    Image(Handle<Image>),
    /// Statistics computed beforehand.
    Preset(Handle<StyleStatistics>),
}

impl From<Handle<Image>> for StyleInput {
    fn from(image: Handle<Image>) -> Self {
        Self::Image(image)
    }
}

impl From<Handle<StyleStatistics>> for StyleInput {
    fn from(statistics: Handle<StyleStatistics>) -> Self {
        Self::Preset(statistics)
    }
}

impl StyleSource {
    /// The style of an image.
    pub fn image(image: Handle<Image>) -> Self {
        Self::mix([(image, 1.0)])
    }

    /// A style whose statistics are known.
    pub fn preset(statistics: Handle<StyleStatistics>) -> Self {
        Self::mix([(statistics, 1.0)])
    }

    /// A mix of styles and their weights, which are at least 0 and are normalized to sum 1.
    pub fn mix<I: Into<StyleInput>>(styles: impl IntoIterator<Item = (I, f32)>) -> Self {
        let weighted = |(input, weight): (I, f32)| WeightedStyle { input: input.into(), weight };
        Self { styles: styles.into_iter().map(weighted).collect(), content: 0.0 }
    }

    /// No style: the splats keep their own colors.
    pub fn none() -> Self {
        Self::default()
    }

    /// The same with `content` of the content's own features, 0..1.
    pub fn with_content(self, content: f32) -> Self {
        Self { content, ..self }
    }

    /// Whether there is no style.
    pub fn is_none(&self) -> bool {
        self.styles.is_empty()
    }
}

/// How long an entity's splats take to fade from one look to the next once that is complete; without this component they
/// change at once. A look that is ready during a fade waits for its end.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleTransition {
    /// From the first frame that shows anything of the new look to the first that shows it alone.
    pub duration: Duration,
}

impl Default for StyleTransition {
    /// Half a second.
    fn default() -> Self {
        Self { duration: Duration::from_millis(500) }
    }
}

/// The decoder of an entity's style, where it is to be another than the one that the scene carries or, for scenes without
/// any, the default one.
#[derive(Component, Clone, Debug, Default, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleDecoder(pub Handle<GaussianDecoder>);
