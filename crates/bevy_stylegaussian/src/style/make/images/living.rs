//! Images that change while they are shown: which they are, what is known of their pixels, and what is wrong
//! with them.

use std::{sync::Arc, time::Duration};

use bevy::{
    asset::RenderAssetUsages,
    platform::collections::HashMap,
    prelude::*,
    render::{render_resource::TextureUsages, renderer::RenderAdapterInfo},
};
use stylegaussian::{paint::Paint, work::Work};

use super::{
    canvases::ImageCanvases,
    pixels::{decoded, over_white, pixels},
};
use crate::{
    colors::{LivingReport, check_image},
    reports::Reports,
    style::{
        make::{
            later::{Later, Stretched, image_name, later},
            worker::Painting,
        },
        wish::{
            error::StyleError,
            living::StyleLiving,
            source::{StyleInput, StyleSource},
        },
    },
};

/// The images that change.
#[derive(Resource, Default)]
pub(crate) struct LivingImages {
    pub(crate) images: HashMap<AssetId<Image>, LivingImage>,
    /// Number of copies from the GPU that were asked for.
    n_reads: u64,
}

/// An image that changes.
#[derive(Default)]
pub(crate) struct LivingImage {
    /// Time between two changes of base colors.
    every: Duration,
    /// Number of changes so far.
    pub(crate) version: u64,
    /// The version that its first canvas is of.
    of_canvas: u64,
    /// Whether the GPU may change it in each frame.
    pub(crate) changes_on_gpu: bool,
    /// Whether its pixels in main memory are not those that it shows.
    is_on_gpu: bool,
    /// Whether it was there.
    is_known: bool,
    /// The reason, if it cannot be followed.
    pub(crate) error: Option<Arc<StyleError>>,
    /// Whether that was told.
    pub(crate) is_told: bool,
    /// Why the GPU does not read it as it is now.
    refused: Option<String>,
    /// The copy from the GPU that is under way.
    read: Option<u64>,
    /// The last copy.
    paint: Option<Arc<Paint>>,
    /// The version that base colors were last asked for, and when.
    asked: Option<(u64, Duration)>,
    /// The canvas of its present colors, or `None` while they are those of the first one.
    pub(crate) colors: Option<Later<Stretched>>,
}

impl LivingImages {
    /// Whether an image that changes is followed where all of it is used: it has a canvas, or one on its way.
    pub(super) fn follows(&self, canvases: &ImageCanvases, id: AssetId<Image>) -> bool {
        self.images.contains_key(&id) && canvases.may_be_followed(id)
    }

    /// The wait of an image's first canvas: an error, or `Ok(true)` if its pixels are copied from the
    /// GPU first.
    pub(super) fn first(&mut self, id: AssetId<Image>) -> Result<bool, Arc<StyleError>> {
        let Some(living) = self.images.get_mut(&id) else { return Ok(false) };
        if let Some(error) = &living.error {
            return Err(Arc::clone(error));
        }
        if !(living.is_on_gpu && living.read.is_some()) {
            living.of_canvas = living.version;
            living.asked = Some((living.version, Duration::ZERO));
        }
        if living.is_on_gpu && living.read.is_none() {
            self.n_reads += 1;
            living.read = Some(self.n_reads);
        }
        Ok(living.is_on_gpu)
    }

    /// The images to be copied from the GPU.
    pub(crate) fn reads(&self) -> Vec<(AssetId<Image>, u64)> {
        let mut reads: Vec<_> =
            self.images.iter().filter_map(|(id, living)| Some((*id, living.read?))).collect();
        // In the order in which they were asked for, so that the list changes only if they do.
        reads.sort_by_key(|(_, number)| *number);
        reads
    }

    /// Asks for the present colors of an image, if they are another's and it is time. `canvas` is its first
    /// one.
    pub(crate) fn ask_for_colors(
        &mut self,
        handle: &Handle<Image>,
        image: &Image,
        canvas: &Arc<Painting>,
        now: Duration,
    ) {
        let Some(living) = self.images.get_mut(&handle.id()) else { return };
        // Those of the first canvas are there.
        let (of, since) = *living.asked.get_or_insert((living.version, now));
        let is_current = of == living.version && !living.changes_on_gpu;
        let waits = living.read.is_some() || now.saturating_sub(since) < living.every;
        if is_current || waits || living.error.is_some() {
            return;
        }
        living.asked = Some((living.version, now));
        if living.is_on_gpu {
            self.n_reads += 1;
            living.read = Some(self.n_reads);
            return;
        }
        let (name, pixels, canvas) = (image_name(handle), pixels(image), Arc::clone(canvas));
        living.colors = Some(later(move |work: &Work| match &pixels {
            Ok(image) => {
                let image = decoded(&name, image, None, &work.part(0.0, 0.2))?;
                let paint = over_white(image, &work.part(0.2, 0.6))?;
                Ok(Arc::new(canvas.reread_if_wanted(&paint, &work.part(0.6, 1.0))?))
            }
            Err(found) => Err(StyleError::Image { image: name.clone(), found: found.clone() }.into()),
        }));
    }

    /// Whether colors of an image that changed in main memory are still to be asked for.
    pub(crate) fn are_colors_due(&self) -> bool {
        let is_due = |living: &LivingImage| {
            living.asked.is_some_and(|(of, _)| of != living.version) && living.error.is_none()
        };
        self.images.values().any(|living| living.read.is_some() || is_due(living))
    }
}

/// Finds the images that change, counts their changes, and sees what is wrong with them. Forgets the canvases
/// of other images that changed or went.
pub(super) fn find_living(
    mut living: ResMut<LivingImages>,
    mut canvases: ResMut<ImageCanvases>,
    sources: Query<(&StyleLiving, &StyleSource)>,
    images: Res<Assets<Image>>,
    mut events: MessageReader<AssetEvent<Image>>,
    // Bevy puts a copy into the main world. It is absent if the app does not render.
    renderer: Option<Res<RenderAdapterInfo>>,
) {
    let mut handles: HashMap<AssetId<Image>, (&Handle<Image>, Duration)> = HashMap::default();
    for (of, source) in &sources {
        for style in &source.styles {
            let StyleInput::Image(handle) = &style.input else { continue };
            // A part is a new painting with each change.
            if style.crop.is_some() {
                continue;
            }
            let (_, every) = handles.entry(handle.id()).or_insert((handle, of.base_colors_every));
            *every = (*every).min(of.base_colors_every);
        }
    }
    living.images.retain(|id, living| {
        let is_living = handles.contains_key(id);
        // Places of a former picture are those of no painting any more.
        if !is_living && (living.changes_on_gpu || living.of_canvas != living.version) {
            canvases.forget(*id);
        }
        is_living
    });
    for (id, (handle, every)) in handles {
        let living = living.images.entry(id).or_default();
        living.every = every;
        living.see(handle, images.get(id), renderer.is_some());
    }
    for event in events.read() {
        // Before it exists, an image has no canvas, unless it went while strokes showed it.
        let (AssetEvent::Added { id } | AssetEvent::Modified { id } | AssetEvent::Removed { id }) = event
        else {
            continue;
        };
        // Strokes keep their places in an image that changes, and in its last picture.
        if living.follows(&canvases, *id) {
            canvases.forget_parts(*id);
        } else {
            canvases.forget(*id);
        }
        if let Some(living) = living.images.get_mut(id) {
            living.version += 1;
            living.refused = None;
        }
    }
}

impl LivingImage {
    /// Sees how the image is now.
    fn see(&mut self, handle: &Handle<Image>, image: Option<&Image>, renders: bool) {
        let found = match image {
            Some(image) => {
                let written = TextureUsages::RENDER_ATTACHMENT | TextureUsages::STORAGE_BINDING;
                self.is_known = true;
                self.changes_on_gpu = renders && image.texture_descriptor.usage.intersects(written);
                self.is_on_gpu = self.changes_on_gpu || (renders && image.data.is_none());
                match renders && !image.asset_usage.contains(RenderAssetUsages::RENDER_WORLD) {
                    true => {
                        Some("found no picture on the GPU, expected RenderAssetUsages::RENDER_WORLD".into())
                    }
                    false => {
                        check_image(&image.texture_descriptor, image.texture_view_descriptor.as_ref()).err()
                    }
                }
            }
            // It may still be loaded.
            None if !self.is_known => None,
            None => Some("it was removed; its last picture stays".into()),
        };
        let found = found.or_else(|| self.refused.clone());
        let error = found.map(|found| StyleError::Image { image: image_name(handle), found });
        if error.as_ref().map(ToString::to_string) != self.error.as_ref().map(ToString::to_string) {
            self.error = error.map(Arc::new);
            self.is_told = false;
        }
    }
}

/// Takes over copies from the GPU.
pub(super) fn take_reports(
    reports: Option<Res<Reports<LivingReport>>>,
    mut living: ResMut<LivingImages>,
    mut canvases: ResMut<ImageCanvases>,
) {
    let Some(reports) = reports else { return };
    for report in reports.take() {
        match report {
            LivingReport::Read { image, number, paint } => {
                let Some(living) = living.images.get_mut(&image) else { continue };
                if living.read != Some(number) {
                    continue;
                }
                living.read = None;
                let is_new = living.paint.as_deref() != Some(&paint);
                match canvases.made(image) {
                    Some(Ok(canvas)) if is_new => {
                        let (canvas, paint) = (Arc::clone(canvas), Arc::new(paint));
                        living.paint = Some(Arc::clone(&paint));
                        living.colors = Some(later(move |work: &Work| {
                            Ok(Arc::new(canvas.reread_if_wanted(&paint, work)?))
                        }));
                    }
                    // Nothing was drawn into it yet if it has one color. Who waits asks again.
                    None if !is_of_one_color(&paint) => {
                        let paint = Arc::new(paint);
                        living.paint = Some(Arc::clone(&paint));
                        canvases.insert(image, paint);
                    }
                    _ => {}
                }
            }
            LivingReport::Refused { image, reason } => {
                if let Some(living) = living.images.get_mut(&image) {
                    living.read = None;
                    living.refused = Some(reason);
                }
            }
        }
    }
}

/// Whether all pixels are equal.
fn is_of_one_color(paint: &Paint) -> bool {
    let pixels = paint.pixels.as_chunks::<3>().0;
    pixels.iter().all(|pixel| Some(pixel) == pixels.first())
}
