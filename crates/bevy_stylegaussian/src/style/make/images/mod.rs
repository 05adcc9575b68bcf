//! Images as styles: prepared as [`canvases`], or encoded to [`statistics`] for the decoder. Some change
//! while they are shown ([`living`]).

use bevy::{
    asset::{AssetEventSystems, LoadState},
    ecs::system::SystemParam,
    prelude::*,
};
use stylegaussian::recolor::ColorMoments;

use crate::{
    loader::FileLoader,
    style::{
        make::later::{Crop, Encoded, Input, Later, Stretched, loaded},
        wish::{
            encoder::{ImageEncoder, StyleEncoder},
            error::StyleError,
        },
    },
    systems::StyleGaussianSystems,
};

pub(crate) mod canvases;
pub(crate) mod living;
pub(crate) mod pixels;
mod statistics;

use canvases::ImageCanvases;
use living::LivingImages;
use statistics::ImageStatistics;

/// Reads images as styles, by the encoder if they are decoded.
pub(crate) struct ImagesPlugin;

impl Plugin for ImagesPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<ImageEncoder>()
            .init_asset_loader::<FileLoader<ImageEncoder>>()
            .init_resource::<StyleEncoder>()
            .init_resource::<ImageCanvases>()
            .init_resource::<ImageStatistics>()
            .init_resource::<LivingImages>()
            .register_type::<ImageEncoder>()
            .register_type::<StyleEncoder>()
            .add_systems(
                PostUpdate,
                // Old canvases and statistics are gone before a style is wanted.
                ((living::find_living, living::take_reports).chain(), statistics::forget_changed_statistics)
                    .after(AssetEventSystems)
                    .before(StyleGaussianSystems::Styles),
            );
        #[cfg(feature = "bundled_models")]
        // After `init_asset`, whose collection it is added to.
        crate::style::wish::encoder::add_bundled_encoder(app.world_mut());
    }
}

/// The images of the app, and what is known of those that are styles.
#[derive(SystemParam)]
pub(crate) struct ImageInputs<'w> {
    images: Res<'w, Assets<Image>>,
    encoders: Res<'w, Assets<ImageEncoder>>,
    server: Res<'w, AssetServer>,
    encoder: Res<'w, StyleEncoder>,
    canvases: ResMut<'w, ImageCanvases>,
    statistics: ResMut<'w, ImageStatistics>,
    living: ResMut<'w, LivingImages>,
}

impl ImageInputs<'_> {
    /// The canvas of an image, or of a part of it.
    pub(crate) fn canvas(&mut self, handle: &Handle<Image>, crop: Option<Crop>) -> Input<Later<Stretched>> {
        let id = handle.id();
        // An image that changes may have a canvas and be gone.
        if let (None, Some(known)) = (crop, self.canvases.known(id)) {
            return Ok(Some(known));
        }
        let Some(image) = loaded(&self.server, &self.images, handle)? else { return Ok(None) };
        let is_living = crop.is_none() && self.living.images.contains_key(&id);
        if is_living && self.living.first(id)? {
            return Ok(None);
        }
        Ok(Some(self.canvases.get(handle, crop, image, is_living)))
    }

    /// Whether the encoder is still being loaded.
    pub(crate) fn is_encoder_loading(&self) -> bool {
        matches!(self.server.get_load_state(&self.encoder.0), Some(LoadState::Loading))
    }

    /// Whether an image that changes is followed, where all of it is used, and is no new painting.
    pub(crate) fn follows(&self, id: AssetId<Image>) -> bool {
        self.living.follows(&self.canvases, id)
    }

    /// The palette of an image whose canvas was asked for, or `None` if it is not known yet.
    pub(crate) fn palette(&self, handle: &Handle<Image>, crop: Option<Crop>) -> Option<ColorMoments> {
        self.canvases.palette(handle, crop)
    }

    /// The statistics of an image, or of a part of it.
    pub(crate) fn statistics(&mut self, handle: &Handle<Image>, crop: Option<Crop>) -> Input<Later<Encoded>> {
        let Some(image) = loaded(&self.server, &self.images, handle)? else { return Ok(None) };
        let Some(encoder) = loaded(&self.server, &self.encoders, &self.encoder.0)? else {
            // The default handle is never loaded; it exists only if the encoder is bundled.
            let is_default = self.encoder.0 == Handle::default();
            return if is_default { Err(StyleError::NoEncoder.into()) } else { Ok(None) };
        };
        Ok(Some(self.statistics.get(handle, crop, image, encoder)))
    }
}

/// Changes of the encoder that reads images.
#[derive(SystemParam)]
pub(crate) struct EncoderChanges<'w, 's> {
    encoders: MessageReader<'w, 's, AssetEvent<ImageEncoder>>,
    encoder: Res<'w, StyleEncoder>,
}

impl EncoderChanges<'_, '_> {
    /// Whether it is another one since the last call. The first call counts as a change.
    pub(crate) fn read(&mut self) -> bool {
        let id = self.encoder.0.id();
        // Every event is read, so that none is left for the next frame.
        let is_of = |event: &&AssetEvent<ImageEncoder>| event.is_added(id) || event.is_modified(id);
        self.encoders.read().filter(is_of).count() > 0 || self.encoder.is_changed()
    }
}
