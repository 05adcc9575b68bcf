//! The style of an entity.

use std::borrow::Cow;

use bevy::prelude::*;
use stylegaussian::{paint::Hand, strokes::StrokeKnobs};

use crate::style::wish::{
    asset::{GaussianDecoder, StyleLook, StyleStatistics},
    hand::{StylePalette, StylePins},
    motion::StyleMotion,
    relief::StyleRelief,
    strokes::StrokeDirection,
};

/// The style of an entity's [`GaussianSplats`](crate::GaussianSplats): a weighted mix of images, presets and
/// looks, blended with the content itself. Change it at any time. The old colors stay until the new ones are
/// complete.
///
/// Images and presets paint any scene: their strokes are drawn over its colors, pixel by pixel. Or they are
/// mixed as features and decoded together: see [`StyleMethod`](crate::style::StyleMethod). Looks are colors and
/// strokes already, and mix with one another and with painted or decoded colors: that sum is computed on the
/// CPU, whichever [`StyleBackend`](crate::style::decoder::StyleBackend) is set, and so are the images and
/// presets beside a look. In a mix of paintings, each spot shows the strokes of one of them.
///
/// [`strength`](Self::strength), [`paint`](Self::paint), [`protection`](Self::protection),
/// [`stroke_scale`](Self::stroke_scale), [`motion`](Self::motion) and [`relief`](Self::relief) are shown in the
/// next frame and compute nothing, so they can be animated. A [`StyleVolume`](crate::StyleVolume) has a
/// strength and a motion of its own; its strokes are drawn by the others of the splats that it lies on, and by
/// its own [`strokes`](crate::StyleVolume::strokes).
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_stylegaussian::{StyleSource, style::StyleInput};
/// # fn system(mut source: Single<&mut StyleSource>, assets: Res<AssetServer>) {
/// let (starry, wave) = (assets.load("starry.jpg"), assets.load("wave.style.safetensors"));
/// **source = StyleSource::image(starry.clone());
/// **source = StyleSource::mix([(StyleInput::Image(starry), 0.3), (StyleInput::Preset(wave), 0.7)])
///     .with_content(0.2);
/// source.content = 0.5;
/// **source = StyleSource::none();
/// # }
/// ```
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleSource {
    /// The styles and their weights, which are normalized to sum 1. If it is empty, the splats have their
    /// captured colors.
    pub styles: Vec<WeightedStyle>,
    /// Share of the content that stays, 0..1. Painted, and in looks, it is the share of the scene's base
    /// colors. Decoded, it is that of its features, transferred = c f + (1 - c) sum_j w_j AdaIN_j: at 1, the
    /// colors are then the decoder's reconstruction of the content, which differs from the captured colors.
    pub content: f32,
    /// Share of the style's colors and strokes, 0..1: at 0, all is as captured, view-dependent colors included.
    pub strength: f32,
    /// Factor of the strokes, 0 to 3: at 0, the painting's colors are left, and above 1, its strokes stand out
    /// more than in the painting.
    pub paint: f32,
    /// How much of the scene stays clear of strokes, as a factor, 0 to 10. At 1, the default, things that stand
    /// out of the scene and of the strokes stay clear, such as windows and fences; at 2 or 3, more of them
    /// ("clear"), and at 0, none ("strong").
    pub protection: f32,
    /// Size of the strokes, as a factor, 0.1 to 10. At 1, the default, they are as large as in the painting if
    /// the scene is seen at 512 pixels from the usual distance.
    pub stroke_scale: f32,
    /// Whether the paintings act as one style: each spot of the scene shows the painting that has a place like
    /// it. Else they are mixed. See [`StyleSource::collection`].
    pub is_collection: bool,
    /// Colors in the paintings' stead, for their strokes, or `None` for their own.
    pub palette: Option<StylePalette>,
    /// How much the scene's hues are pulled to those of the palette, 0..1: at 0, hues that it does not have
    /// stay, and at 1, there are no others. 0.8 by default.
    pub palette_strength: f32,
    /// Direction of the strokes on the scene. `None`, the default: along the edges of its colors.
    pub stroke_direction: Option<StrokeDirection>,
    /// Spots of the scene that are painted from given spots of the paintings.
    pub pins: StylePins,
    /// The way in which the strokes move: not at all by default. Each volume's strokes move as its own source
    /// says, within its region and its channel of a [`StyleMask`](crate::mask::StyleMask); where more than
    /// eight sources that move lie on one cloud, the lowest stand still.
    pub motion: StyleMotion,
    /// Light on the thickness of the strokes: none by default.
    pub relief: StyleRelief,
    /// Whether strokes keep their size on screen, whatever the distance, for stills, slow cameras and title
    /// screens: they dissolve into one another while the camera moves. False by default. It is of a view as a
    /// whole: of all clouds that a camera sees, one decides, and with it the size of strokes.
    pub screen_stable: bool,
}

impl Default for StyleSource {
    /// No style.
    fn default() -> Self {
        Self {
            styles: Vec::new(),
            content: 0.0,
            strength: 1.0,
            paint: 1.0,
            protection: 1.0,
            stroke_scale: 1.0,
            is_collection: false,
            palette: None,
            palette_strength: Hand::PALETTE,
            stroke_direction: None,
            pins: StylePins::default(),
            motion: StyleMotion::Still,
            relief: StyleRelief::default(),
            screen_stable: false,
        }
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
    /// The part of an image or a preset's paint that is used, or `None` for all of it: as shares of the sides,
    /// from the left and top edges, 0..1. Looks, and presets that are decoded, are always whole.
    pub crop: Option<Rect>,
}

/// The source of a style.
#[derive(Clone, Debug, PartialEq, Reflect)]
#[reflect(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum StyleInput {
    /// An image. It is prepared in the background at its first use and again if it changes. To be decoded, it
    /// is encoded by the `StyleEncoder` too. Without the feature `images` it fails, and the error names the
    /// feature.
    Image(Handle<Image>),
    /// An image that was prepared before.
    Preset(Handle<StyleStatistics>),
    /// Baked colors and strokes of the entity's scene. A look of another scene fails.
    Look(Handle<StyleLook>),
    /// Looks of the chunks of a [`GaussianWorld`](crate::world::GaussianWorld): a folder of assets with one for
    /// each, as `stylegaussian bake --chunk` and the workflow `world` write them. `0_0.look.safetensors` is of
    /// the chunk `0_0/meta.json`. A source has one such folder; it fails on anything but a world. A chunk
    /// whose look cannot be had stays as captured, and
    /// [`GaussianWorldFailed`](crate::world::GaussianWorldFailed) tells it. Surroundings have no look and
    /// stay as captured.
    ChunkLooks(String),
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
    /// The style of an image. It needs the feature `images`.
    pub fn image(image: Handle<Image>) -> Self {
        Self::mix([(image, 1.0)])
    }

    /// The style of an image that was prepared before.
    pub fn preset(statistics: Handle<StyleStatistics>) -> Self {
        Self::mix([(statistics, 1.0)])
    }

    /// A baked look. It is shown without features, decoder or encoder.
    pub fn look(look: Handle<StyleLook>) -> Self {
        Self::mix([(look, 1.0)])
    }

    /// Baked looks of all chunks of a [`GaussianWorld`](crate::world::GaussianWorld), in a folder of assets:
    /// see [`StyleInput::ChunkLooks`].
    pub fn chunk_looks(folder: impl Into<String>) -> Self {
        Self::mix([(StyleInput::ChunkLooks(folder.into()), 1.0)])
    }

    /// A mix of styles and their weights. Weights are at least 0 and are normalized to sum 1.
    pub fn mix<I: Into<StyleInput>>(styles: impl IntoIterator<Item = (I, f32)>) -> Self {
        let weighted = |(input, weight): (I, f32)| WeightedStyle { input: input.into(), weight, crop: None };
        Self { styles: styles.into_iter().map(weighted).collect(), ..Self::default() }
    }

    /// Several paintings that act as one style, such as a painter's work: each spot of the scene takes its
    /// place among all of them, and neighbors prefer the same painting. The sky comes from one, foliage from
    /// another, all in their own colors and strokes. With a single painting, it is that painting. With
    /// more than [`MAX_TEXTURES`](stylegaussian::strokes::MAX_TEXTURES) paintings it fails.
    ///
    /// A collection serves where paintings are alike in manner, or each has what a part of the scene needs. A
    /// [`mix`](Self::mix) serves to go from one style to another, and to give one look to all of a scene: its
    /// colors are means.
    pub fn collection<I: Into<StyleInput>>(paintings: impl IntoIterator<Item = I>) -> Self {
        let mix = Self::mix(paintings.into_iter().map(|painting| (painting, 1.0)));
        Self { is_collection: true, ..mix }
    }

    /// No style: the splats have their captured colors.
    pub fn none() -> Self {
        Self::default()
    }

    /// The same styles with this share of the content, 0..1.
    pub fn with_content(self, content: f32) -> Self {
        Self { content, ..self }
    }

    /// The same styles with this share of their colors and strokes, 0..1.
    pub fn with_strength(self, strength: f32) -> Self {
        Self { strength, ..self }
    }

    /// The same styles with this factor of their strokes, 0 to 3.
    pub fn with_paint(self, paint: f32) -> Self {
        Self { paint, ..self }
    }

    /// The same styles with this factor of [`protection`](Self::protection), 0 to 10.
    pub fn with_protection(self, protection: f32) -> Self {
        Self { protection, ..self }
    }

    /// The same styles in strokes of this size, as a factor, 0.1 to 10.
    pub fn with_stroke_scale(self, stroke_scale: f32) -> Self {
        Self { stroke_scale, ..self }
    }

    /// The same styles, of whose images only this part is used: shares of the sides, from the left and top
    /// edges, 0..1. Fields of [`WeightedStyle`] give each its own.
    pub fn cropped(mut self, part: Rect) -> Self {
        self.styles.iter_mut().for_each(|style| style.crop = Some(part));
        self
    }

    /// The same strokes in other colors: of an image, of a preset, or given ones.
    pub fn with_palette(self, palette: impl Into<StylePalette>) -> Self {
        Self { palette: Some(palette.into()), ..self }
    }

    /// The same styles with this [`palette_strength`](Self::palette_strength), 0..1.
    pub fn with_palette_strength(self, palette_strength: f32) -> Self {
        Self { palette_strength, ..self }
    }

    /// The same styles in strokes that run along a direction or a curve, in the entity's local space.
    pub fn with_stroke_direction(self, direction: impl Into<StrokeDirection>) -> Self {
        Self { stroke_direction: Some(direction.into()), ..self }
    }

    /// The same styles with these pinned places.
    pub fn with_pins(self, pins: impl Into<StylePins>) -> Self {
        Self { pins: pins.into(), ..self }
    }

    /// The same styles in strokes that move.
    pub fn with_motion(self, motion: StyleMotion) -> Self {
        Self { motion, ..self }
    }

    /// The same styles in strokes that have a thickness.
    pub fn with_relief(self, relief: StyleRelief) -> Self {
        Self { relief, ..self }
    }

    /// The same styles in strokes that keep their size on screen, if `screen_stable` is true.
    pub fn with_screen_stable(self, screen_stable: bool) -> Self {
        Self { screen_stable, ..self }
    }

    /// The strength within 0..1; 0 if it is no number.
    pub(crate) fn usual_strength(&self) -> f32 {
        if self.strength.is_nan() { 0.0 } else { self.strength.clamp(0.0, 1.0) }
    }

    /// How strokes are drawn, within sane ranges. NaN becomes the default. The light is for the caller to find.
    pub(crate) fn knobs(&self) -> StrokeKnobs {
        let within =
            |value: f32, min: f32, max: f32| if value.is_nan() { 1.0 } else { value.clamp(min, max) };
        StrokeKnobs {
            amount: within(self.paint, 0.0, 3.0),
            protection: within(self.protection, 0.0, 10.0),
            stroke_scale: within(self.stroke_scale, 0.1, 10.0),
            relief: self.relief.usual_amount(),
            screen_stable: self.screen_stable,
            ..StrokeKnobs::DEFAULT
        }
    }

    /// Whether another source gives the same style, apart from the factors that are shown at once.
    pub(crate) fn is_computed_like(&self, other: &Self) -> bool {
        self.styles == other.styles && self.is_decided_like(other)
    }

    /// Whether it is computed like [`for_part`](Self::for_part) of `world`, the source of a world. It makes no
    /// copy, since all runs are asked in each frame.
    pub(crate) fn is_part_of(&self, world: &Self, look: Option<&Handle<StyleLook>>) -> bool {
        let (Some(folder), Some(look)) = (world.folder_of_looks(), look) else {
            return self.is_computed_like(world);
        };
        let is_same = |(own, given): (&WeightedStyle, &WeightedStyle)| match (&own.input, &given.input) {
            (StyleInput::Look(own_look), StyleInput::ChunkLooks(of)) if of == folder => {
                own_look == look && own.weight == given.weight
            }
            _ => own == given,
        };
        self.styles.len() == world.styles.len()
            && self.styles.iter().zip(&world.styles).all(is_same)
            && self.is_decided_like(world)
    }

    /// The source of a run of a world that has this one: `look` takes the place of the looks of chunks.
    pub(crate) fn for_part(&self, look: Option<&Handle<StyleLook>>) -> Cow<'_, Self> {
        let (Some(folder), Some(look)) = (self.folder_of_looks(), look) else { return Cow::Borrowed(self) };
        let mut part = self.clone();
        for style in &mut part.styles {
            if matches!(&style.input, StyleInput::ChunkLooks(of) if of == folder) {
                style.input = StyleInput::Look(look.clone());
            }
        }
        Cow::Owned(part)
    }

    /// The folder of looks of chunks, if there is one: the first.
    pub(crate) fn folder_of_looks(&self) -> Option<&str> {
        self.styles.iter().find_map(|style| match &style.input {
            StyleInput::ChunkLooks(folder) => Some(&**folder),
            _ => None,
        })
    }

    /// Whether two sources differ in their styles alone, apart from the factors that are shown at once.
    fn is_decided_like(&self, other: &Self) -> bool {
        self.content == other.content
            && self.is_collection == other.is_collection
            && self.palette == other.palette
            && self.palette_strength == other.palette_strength
            && self.stroke_direction == other.stroke_direction
            && self.pins == other.pins
    }

    /// Whether something is decided that a bake does not know of.
    #[cfg(feature = "refine")]
    pub(crate) fn has_hand(&self) -> bool {
        let plain = Self::default();
        self.is_collection
            || self.palette.is_some()
            || self.palette_strength != plain.palette_strength
            || self.stroke_direction.is_some()
            || self.pins != plain.pins
            || self.styles.iter().any(|style| style.crop.is_some())
    }

    /// Whether there is no style.
    pub fn is_none(&self) -> bool {
        self.styles.is_empty()
    }
}

/// The decoder of an entity's style. Without this component, the scene's own decoder is used if it has one,
/// otherwise the bundled decoder.
#[derive(Component, Clone, Debug, Default, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleDecoder(pub Handle<GaussianDecoder>);

/// Keeps an entity with a [`StyleSource`] from being drawn until its first style is there, instead of showing
/// its captured colors for a while. If the style fails, the entity is drawn as captured.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct HiddenUntilStyled;
