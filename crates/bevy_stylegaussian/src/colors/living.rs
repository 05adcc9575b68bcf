//! Paintings whose images change while they are shown: their textures are made anew on the GPU, in the frame
//! in which the image changes, and pixels that are nowhere else are copied to main memory.
//!
//! The texture of a painting has a layer in the store, which all strokes of the painting read. Only this layer
//! is written. Seeds, words and colors stay.

use std::sync::Arc;

use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{Extract, render_asset::RenderAssets, texture::GpuImage},
};
use stylegaussian::{paint::Paint, strokes::StrokeTexture};
use stylegaussian_gpu::strokes::{PaintImage, PaintReadBack, StrokeLayer, StrokeRedrawer};
use wgpu::{TextureDescriptor, TextureDimension, TextureUsages, TextureViewDescriptor, TextureViewDimension};

use crate::{
    commands::GpuCommands,
    reports::Reports,
    work::{Background, SynchronousCompilation},
};

use super::strokes::StrokeTextures;

/// Paintings whose images change. A resource of both worlds.
#[derive(Resource, Clone, Default, PartialEq)]
pub(crate) struct LivingPaintings {
    /// Those whose textures follow.
    pub(crate) shown: Vec<LivingPainting>,
    /// Images to be copied to main memory, each with a number that no other copy has. They stay in the list
    /// until the report is there.
    pub(crate) reads: Vec<(AssetId<Image>, u64)>,
}

/// A painting whose image changes.
#[cfg_attr(not(feature = "images"), allow(dead_code, reason = "styles of images alone change"))]
#[derive(Clone)]
pub(crate) struct LivingPainting {
    pub(crate) image: AssetId<Image>,
    /// The texture that its strokes show.
    pub(crate) texture: Arc<StrokeTexture>,
    /// Width and height at which the painting is read.
    pub(crate) reading: [u32; 2],
    /// Number of changes of the image so far.
    pub(crate) version: u64,
    /// Whether the GPU may change it in each frame.
    pub(crate) changes_on_gpu: bool,
}

impl PartialEq for LivingPainting {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.texture, &other.texture)
            && (self.image, self.reading, self.version, self.changes_on_gpu)
                == (other.image, other.reading, other.version, other.changes_on_gpu)
    }
}

/// Tells of an image that changes.
#[cfg_attr(not(feature = "images"), allow(dead_code, reason = "styles of images alone change"))]
pub(crate) enum LivingReport {
    /// A copy is in main memory.
    Read { image: AssetId<Image>, number: u64, paint: Paint },
    /// The GPU cannot read it.
    Refused { image: AssetId<Image>, reason: String },
}

/// Checks that an image can be read by the GPU.
///
/// # Errors
/// If it cannot. The message says what was found, and what was expected.
pub(crate) fn check_image(
    image: &TextureDescriptor,
    view: Option<&TextureViewDescriptor>,
) -> Result<(), String> {
    let view_dimension = view.and_then(|view| view.dimension);
    let is_flat = image.dimension == TextureDimension::D2
        && image.size.depth_or_array_layers == 1
        && view_dimension.is_none_or(|dimension| dimension == TextureViewDimension::D2);
    if !is_flat {
        return Err("found layers or a third dimension, expected one picture".into());
    }
    if image.sample_count != 1 {
        return Err(format!("found {} samples to a pixel, expected 1", image.sample_count));
    }
    if !image.usage.contains(TextureUsages::TEXTURE_BINDING) {
        return Err("found a texture that shaders cannot read, expected the usage TEXTURE_BINDING".into());
    }
    let format = view.and_then(|view| view.format).unwrap_or(image.format);
    PaintImage::check(format, [image.size.width, image.size.height]).map_err(|error| error.to_string())
}

/// Textures that are made anew, on the present device.
#[derive(Resource, Default)]
pub(crate) struct Redrawing {
    /// The kernels, or `None` if they were not needed yet.
    redrawer: Option<Background<Arc<StrokeRedrawer>>>,
    drawn: HashMap<AssetId<Image>, Drawn>,
    reads: Vec<Read>,
    /// Textures that were made anew.
    #[cfg(test)]
    pub(crate) n_redrawn: u64,
}

/// The state of a painting's texture.
struct Drawn {
    layer: StrokeLayer,
    /// The image's version that it shows.
    version: u64,
    /// Whether it was made in this frame.
    is_of_this_frame: bool,
}

/// A copy to main memory.
struct Read {
    image: AssetId<Image>,
    number: u64,
    /// The copy under way, or `None` if it was reported.
    copy: Option<PaintReadBack>,
}

/// Copies paintings that came, changed or went.
pub(super) fn extract_living(mut living: ResMut<LivingPaintings>, main: Extract<Res<LivingPaintings>>) {
    if main.is_changed() {
        *living = main.clone();
    }
}

/// Begins a frame, in which each texture is made anew at most once.
pub(super) fn begin_redrawing(mut redrawing: ResMut<Redrawing>, living: Res<LivingPaintings>) {
    if living.shown.is_empty() && redrawing.drawn.is_empty() {
        return;
    }
    let redrawing = &mut *redrawing;
    redrawing.drawn.retain(|image, _| living.shown.iter().any(|shown| shown.image == *image));
    redrawing.drawn.values_mut().for_each(|drawn| drawn.is_of_this_frame = false);
    if redrawing.drawn.is_empty()
        && living.shown.is_empty()
        && let Some(redrawer) = redrawing.redrawer.as_ref().and_then(Background::get)
    {
        redrawer.release_scratch();
    }
}

/// Where textures are made.
pub(crate) struct RedrawingGpu<'a> {
    pub(crate) images: &'a RenderAssets<GpuImage>,
    pub(crate) textures: &'a StrokeTextures,
    pub(crate) synchronous: SynchronousCompilation,
    pub(crate) reports: &'a Reports<LivingReport>,
}

impl Redrawing {
    /// Makes the textures anew whose images changed. Does nothing if none did.
    pub(crate) fn redraw(&mut self, living: &LivingPaintings, from: &RedrawingGpu, gpu: &mut GpuCommands) {
        for painting in &living.shown {
            let Some(layer) = from.textures.0.layer_of(&painting.texture) else { continue };
            let drawn = self.drawn.get(&painting.image).filter(|drawn| drawn.layer == layer);
            let is_current = drawn.is_some_and(|drawn| {
                drawn.version == painting.version && (drawn.is_of_this_frame || !painting.changes_on_gpu)
            });
            let Some(image) = from.images.get(painting.image).filter(|_| !is_current) else { continue };
            let Some(redrawer) = self.redrawer(from.synchronous, gpu.device()) else { continue };
            let found = readable(image).and_then(|image| {
                let encoded = gpu.timed("redraw_strokes", |gpu| {
                    redrawer.encode(gpu, &image, painting.reading, &from.textures.0, &layer)
                });
                encoded.map_err(|error| error.to_string())
            });
            // Noted after a failure too: the next frame would fail again.
            let (version, image) = (painting.version, painting.image);
            self.drawn.insert(image, Drawn { layer, version, is_of_this_frame: true });
            match found {
                Ok(()) => self.count(),
                Err(reason) => from.reports.push(LivingReport::Refused { image, reason }),
            }
        }
    }

    /// The kernels, or `None` while they are compiled. The first call starts that.
    fn redrawer(
        &mut self,
        synchronous: SynchronousCompilation,
        device: &wgpu::Device,
    ) -> Option<Arc<StrokeRedrawer>> {
        let device = device.clone();
        let compile = move || Arc::new(StrokeRedrawer::new(&device));
        self.redrawer.get_or_insert_with(|| Background::start(synchronous, compile)).get().cloned()
    }

    fn count(&mut self) {
        #[cfg(test)]
        {
            self.n_redrawn += 1;
        }
    }
}

/// A GPU image as the kernels take it.
fn readable(image: &GpuImage) -> Result<PaintImage<'_>, String> {
    check_image(&image.texture_descriptor, image.texture_view_descriptor.as_ref())?;
    let size = image.size_2d().to_array();
    Ok(PaintImage { view: &image.texture_view, format: image.view_format(), size })
}

/// Copies images to main memory, after all cameras have drawn. It takes a few frames, and none waits for it.
pub(super) fn read_living(
    mut redrawing: ResMut<Redrawing>,
    living: Res<LivingPaintings>,
    images: Res<RenderAssets<GpuImage>>,
    synchronous: Res<SynchronousCompilation>,
    reports: Res<Reports<LivingReport>>,
    mut gpu: GpuCommands,
) {
    if living.reads.is_empty() && redrawing.reads.is_empty() {
        return;
    }
    let redrawing = &mut *redrawing;
    redrawing.reads.retain_mut(|read| {
        if !living.reads.contains(&(read.image, read.number)) {
            return false;
        }
        match read.copy.as_mut().and_then(PaintReadBack::poll) {
            None => true,
            Some(Ok(paint)) => {
                let (image, number) = (read.image, read.number);
                reports.push(LivingReport::Read { image, number, paint });
                // It stays in the list until the main world has heard of it.
                read.copy = None;
                true
            }
            // It is copied once more.
            Some(Err(_)) => false,
        }
    });
    for &(id, number) in &living.reads {
        let is_begun = redrawing.reads.iter().any(|read| (read.image, read.number) == (id, number));
        let Some(image) = images.get(id).filter(|_| !is_begun) else { continue };
        let Some(redrawer) = redrawing.redrawer(*synchronous, gpu.device()) else { continue };
        let copy = readable(image).and_then(|image| {
            gpu.encode(|gpu| redrawer.encode_read(gpu, &image)).map_err(|error| error.to_string())
        });
        match copy {
            Ok(copy) => redrawing.reads.push(Read { image: id, number, copy: Some(copy) }),
            Err(reason) => reports.push(LivingReport::Refused { image: id, reason }),
        }
    }
}
