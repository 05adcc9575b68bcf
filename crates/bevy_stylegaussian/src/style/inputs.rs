//! Everything that a look is computed from: the assets that a source names, waited for, and the app's settings.

use std::sync::Arc;

use bevy::{asset::LoadState, ecs::system::SystemParam, prelude::*, render::renderer::RenderAdapterInfo};
use stylegaussian::{ChannelStatistics, fold::StylizeError};

use crate::{
    asset::{GaussianDecoder, StyleStatistics},
    splats::CloudScene,
};

use super::{
    event::StyleError,
    images::ImageStatistics,
    packed::PackedInputs,
    settings::{StyleBackend, StyleEncoder},
    source::{StyleDecoder, StyleInput, StyleSource},
    transfer::Order,
};

/// Everything that a look is computed from, besides the entity's own components.
#[derive(SystemParam)]
pub(super) struct Inputs<'w> {
    images: Res<'w, Assets<Image>>,
    statistics: Res<'w, Assets<StyleStatistics>>,
    decoders: Res<'w, Assets<GaussianDecoder>>,
    server: Res<'w, AssetServer>,
    encoder: Res<'w, StyleEncoder>,
    encoded: ResMut<'w, ImageStatistics>,
    packed: Res<'w, PackedInputs>,
    backend: Res<'w, StyleBackend>,
    adapter: Option<Res<'w, RenderAdapterInfo>>,
}

impl Inputs<'_> {
    /// What to compute, or `None` while an asset is awaited.
    pub(super) fn order(
        &mut self,
        source: &StyleSource,
        scene: &CloudScene,
        decoder: Option<&StyleDecoder>,
        gpu_refused: bool,
    ) -> Option<Result<Order, Arc<StyleError>>> {
        if scene.0.scene().features.is_none() {
            return Some(Err(Arc::new(StylizeError::NoFeatures.into())));
        }
        let backend = match self.backend(gpu_refused) {
            Ok(backend) => backend,
            Err(error) => return Some(Err(Arc::new(error))),
        };
        // Every image is asked for before any is awaited, so that they are encoded side by side.
        let found: Vec<_> = source.styles.iter().map(|style| self.statistics(&style.input)).collect();
        let decoder = decoder.map(|decoder| match self.decoders.get(&decoder.0) {
            Some(decoder) => Some(Ok(Arc::clone(&decoder.0))),
            None => self.awaited(decoder.0.id()).map(Err),
        });
        let mut styles = Vec::with_capacity(found.len());
        for (statistics, style) in found.into_iter().zip(&source.styles) {
            match statistics? {
                Ok(statistics) => styles.push((statistics, f64::from(style.weight))),
                Err(error) => return Some(Err(error)),
            }
        }
        let decoder = match decoder {
            None => None,
            Some(None) => return None,
            Some(Some(Ok(decoder))) => Some(decoder),
            Some(Some(Err(error))) => return Some(Err(error)),
        };
        let (scene, content) = (scene.0.clone(), f64::from(source.content));
        Some(Ok(Order { scene, decoder, styles, content, backend, packed: self.packed.clone() }))
    }

    /// The statistics of one style, or `None` while they are awaited.
    fn statistics(&mut self, input: &StyleInput) -> Option<Result<Arc<ChannelStatistics>, Arc<StyleError>>> {
        match input {
            StyleInput::Preset(preset) => match self.statistics.get(preset) {
                Some(statistics) => Some(Ok(Arc::clone(&statistics.0))),
                None => self.awaited(preset.id()).map(Err),
            },
            StyleInput::Image(handle) => match self.images.get(handle) {
                Some(image) => {
                    let name = || handle.path().map_or_else(|| "a style image".into(), ToString::to_string);
                    self.encoded.get(handle.id(), name, image, &self.encoder)
                }
                None => self.awaited(handle.id()).map(Err),
            },
        }
    }

    /// `None` while an asset may still come, otherwise why it will not.
    fn awaited<A: Asset>(&self, id: AssetId<A>) -> Option<Arc<StyleError>> {
        match self.server.get_load_state(id) {
            Some(LoadState::Failed(error)) => Some(Arc::new(StyleError::Load(error.to_string()))),
            _ => None,
        }
    }

    /// Where to decode: never [`StyleBackend::Auto`].
    fn backend(&self, gpu_refused: bool) -> Result<StyleBackend, StyleError> {
        let adapter = self.adapter.as_ref();
        match *self.backend {
            StyleBackend::Gpu if adapter.is_none() => Err(StyleError::Gpu("there is no GPU".into())),
            StyleBackend::Auto => {
                let is_hardware =
                    adapter.is_some_and(|adapter| !stylegaussian_gpu::device::is_software(adapter));
                Ok(if is_hardware && !gpu_refused { StyleBackend::Gpu } else { StyleBackend::Cpu })
            }
            backend => Ok(backend),
        }
    }
}
