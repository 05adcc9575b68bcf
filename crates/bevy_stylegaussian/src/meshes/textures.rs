//! Paintings and seeds as images.

use std::sync::{Arc, Weak};

use bevy::{
    asset::RenderAssetUsages,
    image::{ImageAddressMode, ImageSampler, ImageSamplerDescriptor},
    prelude::*,
    render::render_resource::{
        Extent3d, TextureDimension, TextureFormat, TextureViewDescriptor, TextureViewDimension,
    },
};
use stylegaussian::strokes::{FINE_SIDE, StrokeSeed, StrokeTexture, WIDE_SIDE};
use stylegaussian_shaders::mesh::{SEEDS_TO_A_ROW, TEXELS, seed_texels};

/// Images of the paintings that meshes show.
#[derive(Default)]
pub(super) struct PaintingImages(Vec<PaintingImage>);

struct PaintingImage {
    textures: Vec<Weak<StrokeTexture>>,
    images: [Handle<Image>; 2],
}

impl PaintingImages {
    /// Images of fine and of wide detail, with a layer for each of `textures`. There is one at least.
    pub(super) fn get(
        &mut self,
        textures: &[Arc<StrokeTexture>],
        images: &mut Assets<Image>,
    ) -> [Handle<Image>; 2] {
        // A weak reference keeps the address from being used again.
        self.0.retain(|known| known.textures.iter().all(|texture| texture.strong_count() > 0));
        let is_of = |known: &&PaintingImage| {
            known.textures.len() == textures.len()
                && known.textures.iter().zip(textures).all(|(a, b)| a.as_ptr() == Arc::as_ptr(b))
        };
        if let Some(known) = self.0.iter().find(is_of) {
            return known.images.clone();
        }
        let fine = array(FINE_SIDE, textures.iter().map(|texture| &texture.fine));
        let wide = array(WIDE_SIDE, textures.iter().map(|texture| &texture.wide));
        let made = [images.add(fine), images.add(wide)];
        let textures = textures.iter().map(Arc::downgrade).collect();
        self.0.push(PaintingImage { textures, images: made.clone() });
        made
    }
}

/// Squares with their mipmaps, a layer for each.
fn array<'a>(side: usize, layers: impl ExactSizeIterator<Item = &'a Vec<Vec<[i8; 4]>>>) -> Image {
    let size =
        Extent3d { width: side as u32, height: side as u32, depth_or_array_layers: layers.len() as u32 };
    let mut image = Image::new_uninit(
        size,
        TextureDimension::D2,
        TextureFormat::Rgba8Snorm,
        RenderAssetUsages::RENDER_WORLD,
    );
    let bytes = layers.flat_map(|levels| levels.iter().flatten().flatten().map(|byte| byte.cast_unsigned()));
    image.data = Some(bytes.collect());
    image.texture_descriptor.mip_level_count = side.ilog2() + 1;
    // An array of one layer is one all the same.
    image.texture_view_descriptor = Some(TextureViewDescriptor {
        dimension: Some(TextureViewDimension::D2Array),
        ..TextureViewDescriptor::default()
    });
    let mirrored = ImageAddressMode::MirrorRepeat;
    image.sampler = ImageSampler::Descriptor(ImageSamplerDescriptor {
        address_mode_u: mirrored,
        address_mode_v: mirrored,
        ..ImageSamplerDescriptor::linear()
    });
    image
}

/// Seeds as the shader reads them.
pub(super) fn seeds_image(seeds: &[StrokeSeed]) -> Image {
    let texels = seed_texels(seeds);
    let row = TEXELS * SEEDS_TO_A_ROW;
    let size = Extent3d { width: row as u32, height: (texels.len() / row) as u32, depth_or_array_layers: 1 };
    let data = texels.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    Image::new(size, TextureDimension::D2, data, TextureFormat::Rgba32Float, RenderAssetUsages::RENDER_WORLD)
}
