//! The style of an entity.

use bevy::prelude::*;

use super::{
    asset::{GaussianDecoder, StyleLook, StyleStatistics},
    job::StyleJobs,
};

/// The style of an entity's [`GaussianSplats`](crate::GaussianSplats): a weighted mix of images, presets and looks, blended
/// with the content itself. Change it at any time. The old colors stay until the new ones are complete.
///
/// Images and presets are painted and mixed as colors, or mixed as features and decoded together: see
/// [`StyleMethod`](crate::StyleMethod). Looks are colors already, and mix with one another and
/// with what was decoded as colors: that sum is computed on the CPU, whichever [`StyleBackend`](crate::StyleBackend) is set,
/// and so are the images and presets beside a look.
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
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
// On the source and not on the splats: entities that are never styled carry none.
#[require(StyleJobs)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleSource {
    /// The styles and their weights, which are normalized to sum 1. If it is empty, the splats have their captured colors.
    pub styles: Vec<WeightedStyle>,
    /// Share of the content's features that stays, 0..1: transferred = c f + (1 - c) sum_j w_j AdaIN_j. At 1, the colors
    /// are the decoder's reconstruction of the content, which differs from the captured colors. In looks, it is the share of
    /// the scene's base colors.
    pub content: f32,
    /// Size of the strokes, as a factor above 0. At 1, the default, they have the size that they have in the painting if the
    /// scene is seen at 512 pixels from the usual distance. Only for [`StyleMethod::Paint`](crate::StyleMethod::Paint).
    pub stroke_scale: f32,
    /// Share of the style's colors, 0..1: at 0, all is as captured, view-dependent colors included. A change of it alone is
    /// shown at once and computes no style.
    pub strength: f32,
}

impl Default for StyleSource {
    /// No style.
    fn default() -> Self {
        Self { styles: Vec::new(), content: 0.0, stroke_scale: 1.0, strength: 1.0 }
    }
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

/// The source of a style.
#[derive(Clone, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, PartialEq)]
pub enum StyleInput {
    /// An image. It is encoded in the background at its first use and again if it changes, by the
    /// [`StyleEncoder`](crate::StyleEncoder).
    Image(Handle<Image>),
    /// Precomputed statistics.
    Preset(Handle<StyleStatistics>),
    /// Baked colors of the entity's scene. A look of another scene fails.
    Look(Handle<StyleLook>),
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

impl From<Handle<StyleLook>> for StyleInput {
    fn from(look: Handle<StyleLook>) -> Self {
        Self::Look(look)
    }
}

impl StyleSource {
    /// The style of an image.
    pub fn image(image: Handle<Image>) -> Self {
        Self::mix([(image, 1.0)])
    }

    /// The style of precomputed statistics.
    pub fn preset(statistics: Handle<StyleStatistics>) -> Self {
        Self::mix([(statistics, 1.0)])
    }

    /// A baked look. It is shown without features, decoder or encoder.
    pub fn look(look: Handle<StyleLook>) -> Self {
        Self::mix([(look, 1.0)])
    }

    /// A mix of styles and their weights. Weights are at least 0 and are normalized to sum 1.
    pub fn mix<I: Into<StyleInput>>(styles: impl IntoIterator<Item = (I, f32)>) -> Self {
        let weighted = |(input, weight): (I, f32)| WeightedStyle { input: input.into(), weight };
        Self { styles: styles.into_iter().map(weighted).collect(), ..Self::default() }
    }

    /// No style: the splats have their captured colors.
    pub fn none() -> Self {
        Self::default()
    }

    /// The same styles with this share of the content's features, 0..1.
    pub fn with_content(self, content: f32) -> Self {
        Self { content, ..self }
    }

    /// The same styles in strokes of this size, as a factor above 0.
    pub fn with_stroke_scale(self, stroke_scale: f32) -> Self {
        Self { stroke_scale, ..self }
    }

    /// The same styles with this share of their colors, 0..1.
    pub fn with_strength(self, strength: f32) -> Self {
        Self { strength, ..self }
    }

    /// The strength within 0..1; 0 if it is no number.
    pub(super) fn usual_strength(&self) -> f32 {
        if self.strength.is_nan() { 0.0 } else { self.strength.clamp(0.0, 1.0) }
    }

    /// Whether there is no style.
    pub fn is_none(&self) -> bool {
        self.styles.is_empty()
    }
}

/// The decoder of an entity's style. Without this component, the scene's own decoder is used if it has one, otherwise the
/// bundled decoder.
#[derive(Component, Clone, Debug, Default, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleDecoder(pub Handle<GaussianDecoder>);
