//! Canvases: paintings that are prepared for painting any scene. They are made by the first style that needs
//! them, and kept as long as the image or the preset that they are of. No encoder takes part.

use std::sync::{Arc, LazyLock, OnceLock};

use bevy::{
    platform::collections::{HashMap, HashSet},
    prelude::*,
    render::render_resource::TextureFormat,
};
use stylegaussian::{
    paint::{Canvas, Paint},
    recolor::ColorMoments,
};
use stylegaussian_encoder::paint_of;

use crate::style::{
    make::{
        first::palette_of,
        images::{decoded, name, pixels},
    },
    wish::{asset::StyleStatistics, error::StyleError},
};

/// A value that the first computation makes that needs it.
pub(crate) type Later<T> = Arc<LazyLock<T, Box<dyn FnOnce() -> T + Send>>>;

/// The canvas of an image. All entities that use the image share an error.
pub(crate) type Stretched = Result<Arc<Canvas>, Arc<StyleError>>;

/// A value that is made later.
pub(crate) fn later<T>(make: impl FnOnce() -> T + Send + 'static) -> Later<T> {
    Arc::new(LazyLock::new(Box::new(make)))
}

/// The canvas of each image and preset that was used as a style.
#[derive(Resource, Default)]
pub(crate) struct Canvases {
    of_image: HashMap<AssetId<Image>, ImageCanvas>,
    of_preset: HashMap<AssetId<StyleStatistics>, Later<Stretched>>,
    /// Presets of which it was said that they carry no paint.
    bare: HashSet<AssetId<StyleStatistics>>,
}

/// The canvas of an image.
struct ImageCanvas {
    /// Its palette, which is there at once or with the canvas.
    palette: Arc<OnceLock<ColorMoments>>,
    canvas: Later<Stretched>,
}

impl Canvases {
    /// The canvas of a loaded image.
    pub(crate) fn of_image(&mut self, handle: &Handle<Image>, image: &Image) -> Later<Stretched> {
        let stretch = || {
            let name = name(handle);
            let palette = Arc::new(palette_at_once(image).map_or_else(OnceLock::new, OnceLock::from));
            let of_canvas = Arc::clone(&palette);
            let pixels = pixels(image);
            let canvas = later(move || match pixels {
                Ok(image) => stretched(name, image, &of_canvas),
                Err(found) => Err(Arc::new(StyleError::Image { image: name, found })),
            });
            ImageCanvas { palette, canvas }
        };
        Arc::clone(&self.of_image.entry(handle.id()).or_insert_with(stretch).canvas)
    }

    /// The canvas of a preset's paint.
    pub(crate) fn of_preset(
        &mut self,
        handle: &Handle<StyleStatistics>,
        paint: &Arc<Paint>,
    ) -> Later<Stretched> {
        let stretch = || {
            let paint = Arc::clone(paint);
            later(move || Ok(Arc::new(Canvas::new(&paint))))
        };
        Arc::clone(self.of_preset.entry(handle.id()).or_insert_with(stretch))
    }

    /// The palette of an image that was asked for by [`Self::of_image`], or `None` if it is not known yet.
    pub(crate) fn palette(&self, handle: &Handle<Image>) -> Option<ColorMoments> {
        self.of_image.get(&handle.id())?.palette.get().copied()
    }

    /// Says once of a preset that it carries no paint.
    pub(crate) fn warn_of_bare(&mut self, handle: &Handle<StyleStatistics>) {
        if self.bare.insert(handle.id()) {
            warn!("{}: {BARE}; it is decoded instead", preset_name(handle));
        }
    }
}

/// The error of a preset without paint.
pub(crate) const BARE: &str = "the preset carries no paint (`stylegaussian style IMAGE` makes one that does)";

/// The name of a preset for messages.
pub(crate) fn preset_name(handle: &Handle<StyleStatistics>) -> String {
    handle.path().map_or_else(|| "a style preset".into(), ToString::to_string)
}

/// Forgets the canvases of images and presets that changed or went.
pub(crate) fn forget_changed_canvases(
    mut images: MessageReader<AssetEvent<Image>>,
    mut presets: MessageReader<AssetEvent<StyleStatistics>>,
    mut canvases: ResMut<Canvases>,
) {
    // `Added` is left out: there is no canvas before the asset exists.
    for event in images.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = event {
            canvases.of_image.remove(id);
        }
    }
    for event in presets.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = event {
            canvases.of_preset.remove(id);
            canvases.bare.remove(id);
        }
    }
}

/// Prepares an image. Takes a while: not for the main thread. Its palette is set first.
fn stretched(name: String, image: Image, palette: &OnceLock<ColorMoments>) -> Stretched {
    let image = decoded(name, image)?;
    palette.get_or_init(|| palette_of(image.rgb.as_chunks().0, |pixel| *pixel));
    Ok(Arc::new(Canvas::new(&paint_of(&image))))
}

/// The palette of an image whose pixels can be read as they are, which takes less than a millisecond.
fn palette_at_once(image: &Image) -> Option<ColorMoments> {
    let format = image.texture_descriptor.format;
    let data = image.data.as_ref()?;
    // Over white, as images are decoded.
    let over_white = |pixel: &[u8; 4]| {
        let [r, g, b, alpha] = pixel.map(|byte| f32::from(byte) / 255.0);
        [r, g, b].map(|color| color * alpha + 1.0 - alpha)
    };
    matches!(format, TextureFormat::Rgba8Unorm | TextureFormat::Rgba8UnormSrgb)
        .then(|| palette_of(data.as_chunks().0, over_white))
}

#[cfg(test)]
mod tests {
    use bevy::{
        asset::RenderAssetUsages,
        render::render_resource::{Extent3d, TextureDimension},
    };
    use stylegaussian::recolor::Recoloring;

    use super::*;

    #[test]
    fn the_palette_at_once_is_that_of_the_decoded_image() {
        let size = Extent3d { width: 40, height: 30, depth_or_array_layers: 1 };
        let data: Vec<u8> = (0..40 * 30 * 4).map(|i: u32| (i * i % 251) as u8).collect();
        let image =
            |format, data| Image::new(size, TextureDimension::D2, data, format, RenderAssetUsages::default());
        let rgba = image(TextureFormat::Rgba8UnormSrgb, data.clone());
        let at_once = palette_at_once(&rgba).unwrap();
        let decoded = decoded("a".into(), rgba).unwrap();
        let later = palette_of(decoded.rgb.as_chunks().0, |pixel| *pixel);
        // The map from one to the other changes nothing.
        let same = Recoloring::new(&at_once, &later).color([0.2, 0.5, 0.7]);
        assert!(same.iter().zip([0.2, 0.5, 0.7]).all(|(a, b)| (a - b).abs() < 1e-4), "{same:?}");
        let floats = image(TextureFormat::R32Float, data);
        assert!(palette_at_once(&floats).is_none());
    }
}
