//! Inputs of a style: the assets that a source names, and the app's settings.

use std::sync::Arc;

use bevy::{asset::LoadState, ecs::system::SystemParam, prelude::*, render::renderer::RenderAdapterInfo};
use stylegaussian::{
    Look,
    fold::{self, StylizeError},
    paint::Pin,
    recolor::ColorMoments,
    restyle,
};
use stylegaussian_gpu::device::is_software;

#[cfg(feature = "meshes")]
use crate::style::make::brushwork::Brushwork;
use crate::{
    scene::{GaussianScene, LoadedScene},
    style::{
        make::{
            beside::Beside,
            first::{FirstRequest, Palette},
            images::ImageInputs,
            later::{Crop, Encoded, Input, Later, Stretched, loaded, name},
            packed::PackedInputs,
            presets::{Presets, preset_name},
            request::{Decided, GivenTints, Same, StyleRequest, Styles, WeightedLook},
            surfaces::Surfaces,
        },
        wish::{
            asset::{GaussianDecoder, StyleLook, StyleStatistics},
            decoder::choose_decoder,
            error::StyleError,
            hand::{StylePalette, StylePins, StylePinsFile},
            settings::{StyleBackend, StyleMethod},
            source::{StyleDecoder, StyleInput, StyleSource, WeightedStyle},
        },
    },
    work::Workers,
};

/// One style of a mix, loaded.
enum Given {
    Canvas(Later<Stretched>),
    Statistics(Later<Encoded>),
    Look { name: String, look: Arc<Look> },
}

/// Everything that a style is computed from, except the entity's components.
#[derive(SystemParam)]
pub(crate) struct Inputs<'w> {
    images: ImageInputs<'w>,
    statistics: Res<'w, Assets<StyleStatistics>>,
    looks: Res<'w, Assets<StyleLook>>,
    decoders: Res<'w, Assets<GaussianDecoder>>,
    pins: Res<'w, Assets<StylePinsFile>>,
    server: Res<'w, AssetServer>,
    presets: ResMut<'w, Presets>,
    pub(crate) surfaces: ResMut<'w, Surfaces>,
    pub(crate) workers: Res<'w, Workers>,
    packed: ResMut<'w, PackedInputs>,
    method: Res<'w, StyleMethod>,
    backend: Res<'w, StyleBackend>,
    // Bevy puts a copy into the main world. It is absent if the app does not render.
    adapter: Option<Res<'w, RenderAdapterInfo>>,
}

impl Inputs<'_> {
    /// The request for an entity's style, or `Ok(None)` while an input is missing. If it is painted, it is a
    /// part of the painted scene `beside` it.
    pub(crate) fn request(
        &mut self,
        source: &StyleSource,
        scene: &LoadedScene,
        decoder: Option<&StyleDecoder>,
        gpu_refused: bool,
        beside: Option<&Arc<Beside>>,
    ) -> Input<StyleRequest> {
        let has_looks = source.styles.iter().any(|style| matches!(style.input, StyleInput::Look(_)));
        let has_styles = source.styles.iter().any(|style| !matches!(style.input, StyleInput::Look(_)));
        let is_painted = has_styles && self.is_painted(source, scene, decoder)?;
        // Checked first: a plain scene must not wait for images before its user hears of the reason.
        if has_styles && !is_painted && scene.scene().features.is_none() {
            return Err(Arc::new(StylizeError::NoFeatures.into()));
        }
        // Begun before images are there, if they are still being loaded.
        let of_scene = beside.map(|beside| &**beside);
        let surface = if is_painted { self.surfaces.get(scene, of_scene, &self.workers)? } else { None };
        let inputs: Vec<_> = source.styles.iter().map(|style| self.input(style, is_painted)).collect();
        let decided = if is_painted { self.decided(source, scene) } else { Ok(None) };
        let (mut canvases, mut statistics, mut looks) = (Vec::new(), Vec::new(), Vec::new());
        for (input, style) in inputs.into_iter().zip(&source.styles) {
            let weight = f64::from(style.weight);
            match input? {
                None => return Ok(None),
                Some(Given::Canvas(canvas)) => canvases.push((Same(canvas), weight)),
                Some(Given::Statistics(of_image)) => statistics.push((Same(of_image), weight)),
                Some(Given::Look { name, look }) => {
                    looks.push(WeightedLook { name, look: Same(look), weight });
                }
            }
        }
        let styles = if is_painted {
            let (Some(decided), Some(surface)) = (decided?, surface) else { return Ok(None) };
            Styles::Painted { canvases, surface: Same(surface), decided }
        } else if has_styles {
            let of_entity = match decoder {
                Some(decoder) => match loaded(&self.server, &self.decoders, &decoder.0)? {
                    Some(decoder) => Some(&decoder.0),
                    None => return Ok(None),
                },
                None => None,
            };
            let decoder = choose_decoder(of_entity, scene.asset.decoder())?;
            Styles::Decoded { styles: statistics, inputs: self.packed.get(scene, decoder) }
        } else {
            Styles::None
        };
        Ok(Some(StyleRequest {
            scene: Same(Arc::clone(scene.scene())),
            styles,
            looks,
            content: f64::from(source.content),
            // Paint is laid on and looks are mixed on the CPU. Decided anew for each request, so that a change
            // of `StyleBackend` affects the next change of style.
            backend: if is_painted || has_looks { StyleBackend::Cpu } else { self.backend(gpu_refused)? },
            under: None,
            beside: beside.filter(|_| is_painted).cloned().map(Same),
        }))
    }

    /// Whether a scene is still on its way.
    pub(crate) fn is_loading(&self, scene: &Handle<GaussianScene>) -> bool {
        matches!(self.server.get_load_state(scene), Some(LoadState::NotLoaded | LoadState::Loading))
    }

    /// Inputs of a style's first colors, or `None` while a palette is missing, if the style is not painted, or
    /// if it cannot be.
    pub(crate) fn first_request(
        &self,
        source: &StyleSource,
        scene: &LoadedScene,
        decoder: Option<&StyleDecoder>,
    ) -> Option<FirstRequest> {
        if !self.may_paint(scene, decoder) {
            return None;
        }
        let weights: Vec<f64> = source.styles.iter().map(|style| f64::from(style.weight)).collect();
        let weights = fold::normalized(&weights).ok()?;
        let of_preset = |preset: &Handle<StyleStatistics>, crop: Option<Crop>| {
            let paint = self.statistics.get(preset)?.paint.clone()?;
            let part = crop.map(|crop| paint.cropped(crop.area()).map(Arc::new));
            Some(Palette::Paint(part.transpose().ok()?.unwrap_or(paint)))
        };
        let given = source.palette.as_ref().map(|palette| match palette {
            StylePalette::Image(image) => self.images.palette(image, None).map(Palette::Moments),
            StylePalette::Preset(preset) => of_preset(preset, None),
            StylePalette::Colors(colors) => {
                Some(Palette::Moments(ColorMoments::of_rgb(displayed(colors).as_flattened())))
            }
        });
        let palette = |style: &WeightedStyle| {
            let crop = style.crop.map(Crop::new);
            match &style.input {
                StyleInput::Image(image) => self.images.palette(image, crop).map(Palette::Moments),
                StyleInput::Preset(preset) => of_preset(preset, crop),
                // It is there nearly as soon as the first colors would be.
                StyleInput::Look(_) | StyleInput::ChunkLooks(_) => None,
            }
        };
        if let Some(given) = given {
            let has_look = source.styles.iter().any(|style| matches!(style.input, StyleInput::Look(_)));
            let content = f64::from(source.content);
            let shows = !has_look && (0.0..=1.0).contains(&content);
            return given.filter(|_| shows).map(|palette| FirstRequest {
                scene: Arc::clone(scene.scene()),
                palettes: vec![(palette, 1.0)],
                content,
            });
        }
        let palettes = source.styles.iter().zip(weights);
        let palettes = palettes.map(|(style, weight)| Some((palette(style)?, weight)));
        let content = f64::from(source.content);
        let palettes = palettes.collect::<Option<Vec<_>>>()?;
        (0.0..=1.0).contains(&content).then(|| FirstRequest {
            scene: Arc::clone(scene.scene()),
            palettes,
            content,
        })
    }

    /// Whether styles that have paint are painted on this scene, and not decoded.
    fn may_paint(&self, scene: &LoadedScene, decoder: Option<&StyleDecoder>) -> bool {
        let asks_for_decoder = *self.method != StyleMethod::Paint || decoder.is_some();
        restyle::is_painted(scene.scene(), asks_for_decoder, true)
    }

    /// Whether a source is painted on this scene, as far as its presets are loaded.
    ///
    /// # Errors
    /// If it can neither be painted nor decoded.
    fn is_painted(
        &mut self,
        source: &StyleSource,
        scene: &LoadedScene,
        decoder: Option<&StyleDecoder>,
    ) -> Result<bool, Arc<StyleError>> {
        if !self.may_paint(scene, decoder) {
            return Ok(false);
        }
        let bare = source.styles.iter().find_map(|style| match &style.input {
            StyleInput::Preset(preset) if self.statistics.get(preset)?.paint.is_none() => Some(preset),
            _ => None,
        });
        let Some(bare) = bare else { return Ok(true) };
        if scene.scene().features.is_none() {
            return Err(Arc::new(StyleError::NoPaint { preset: preset_name(bare) }));
        }
        self.presets.warn_of_bare(bare);
        Ok(false)
    }

    /// One style of a mix, as it is painted or decoded.
    fn input(&mut self, style: &WeightedStyle, is_painted: bool) -> Input<Given> {
        let crop = style.crop.map(Crop::new);
        match &style.input {
            StyleInput::Preset(handle) => {
                let Some(preset) = loaded(&self.server, &self.statistics, handle)? else { return Ok(None) };
                let Some(paint) = preset.paint.as_ref().filter(|_| is_painted) else {
                    let statistics = Arc::clone(&preset.statistics);
                    return Ok(Some(Given::Statistics(self.presets.statistics(handle, statistics))));
                };
                Ok(Some(Given::Canvas(self.presets.canvas(handle, crop, paint))))
            }
            StyleInput::Image(handle) if is_painted => {
                Ok(self.images.canvas(handle, crop)?.map(Given::Canvas))
            }
            StyleInput::Image(handle) => Ok(self.images.statistics(handle, crop)?.map(Given::Statistics)),
            StyleInput::Look(handle) => {
                let name = name(handle, "a look");
                let look = loaded(&self.server, &self.looks, handle)?;
                Ok(look.map(|look| Given::Look { name, look: Arc::clone(&look.0) }))
            }
            StyleInput::ChunkLooks(folder) => {
                let found = format!("found looks of the chunks of a world (`{folder}`)");
                let error = format!("{found}, expected one such folder, and a `GaussianWorld`");
                Err(Arc::new(StyleError::Source(error)))
            }
        }
    }

    /// The paint of a source, for a mesh that stands alone.
    #[cfg(feature = "meshes")]
    pub(crate) fn brushwork(&mut self, source: &StyleSource) -> Input<Brushwork> {
        let mut canvases = Vec::new();
        for style in &source.styles {
            match (self.input(style, true)?, &style.input) {
                (None, _) => return Ok(None),
                (Some(Given::Canvas(canvas)), _) => canvases.push((Same(canvas), f64::from(style.weight))),
                (Some(_), StyleInput::Preset(preset)) => {
                    return Err(Arc::new(StyleError::NoPaint { preset: preset_name(preset) }));
                }
                (Some(_), _) => {
                    let found =
                        "a mesh is painted by images and presets, and found a look, which is a scene's";
                    return Err(Arc::new(StyleError::Source(found.into())));
                }
            }
        }
        let Some(tints) = self.tints(source)? else { return Ok(None) };
        let (is_collection, palette) = (source.is_collection, source.palette_strength);
        let direction = source.stroke_direction.clone();
        let decided = Decided { is_collection, tints, palette, direction, pins: Vec::new() };
        Ok(Some(Brushwork::new(canvases, decided, f64::from(source.content), None)))
    }

    /// Colors in the paintings' stead, `Some(None)` if there are none.
    fn tints(&mut self, source: &StyleSource) -> Input<Option<GivenTints>> {
        Ok(Some(match &source.palette {
            None => None,
            Some(StylePalette::Colors(colors)) => Some(GivenTints::Colors(displayed(colors))),
            Some(StylePalette::Image(handle)) => {
                let Some(canvas) = self.images.canvas(handle, None)? else { return Ok(None) };
                Some(GivenTints::Canvas(Same(canvas)))
            }
            Some(StylePalette::Preset(handle)) => {
                let Some(preset) = loaded(&self.server, &self.statistics, handle)? else { return Ok(None) };
                let Some(paint) = &preset.paint else {
                    return Err(Arc::new(StyleError::NoPaint { preset: preset_name(handle) }));
                };
                Some(GivenTints::Canvas(Same(self.presets.canvas(handle, None, paint))))
            }
        }))
    }

    /// The choices of a source beside its paintings.
    fn decided(&mut self, source: &StyleSource, scene: &LoadedScene) -> Input<Decided> {
        let Some(tints) = self.tints(source)? else { return Ok(None) };
        let pins = match &source.pins {
            StylePins::List(pins) => pins.iter().map(|pin| Pin::from(*pin)).collect(),
            StylePins::File(handle) => {
                let Some(file) = loaded(&self.server, &self.pins, handle)? else { return Ok(None) };
                let failed = |source| StyleError::OtherScene { pins: name(handle, "pinned places"), source };
                file.0.pins_for(scene.scene()).map_err(failed)?.to_vec()
            }
        };
        let (is_collection, palette) = (source.is_collection, source.palette_strength);
        let direction = source.stroke_direction.clone();
        Ok(Some(Decided { is_collection, tints, palette, direction, pins }))
    }

    /// The backend to decode on: never [`StyleBackend::Auto`].
    fn backend(&self, gpu_refused: bool) -> Result<StyleBackend, Arc<StyleError>> {
        let adapter = self.adapter.as_ref();
        match *self.backend {
            StyleBackend::Gpu if adapter.is_none() => Err(Arc::new(StyleError::NoGpu)),
            StyleBackend::Auto => {
                let is_hardware = adapter.is_some_and(|adapter| !is_software(adapter));
                Ok(if is_hardware && !gpu_refused { StyleBackend::Gpu } else { StyleBackend::Cpu })
            }
            backend => Ok(backend),
        }
    }
}

/// Display-referred RGB of colors.
fn displayed(colors: &[Color]) -> Vec<[f32; 3]> {
    let rgb = |color: &Color| {
        let Srgba { red, green, blue, .. } = color.to_srgba();
        [red, green, blue]
    };
    colors.iter().map(rgb).collect()
}
