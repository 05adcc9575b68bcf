//! Styles that follow their images: textures of strokes in each frame, and base colors at an interval.

use std::{sync::Arc, time::Duration};

use bevy::{prelude::*, window::RequestRedraw};

use crate::{
    colors::{LayerColors, LivingPainting, LivingPaintings},
    style::{
        make::{
            images::{canvases::ImageCanvases, living::LivingImages},
            job::{StyleJobs, advance_jobs},
            prepare::prepare_surfaces,
            shared::SharedStyles,
        },
        show::{
            transition::{StyleTransition, TransitionShape},
            volume::StyleVolume,
        },
        wish::{
            event::StyleEvents,
            living::StyleLiving,
            source::{StyleInput, StyleSource},
        },
    },
    systems::StyleGaussianSystems,
    work::Workers,
};

/// Lets styles follow their images.
pub(crate) struct FollowingPlugin;

impl Plugin for FollowingPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            PostUpdate,
            // After the styles: one that has just been put on is followed, and a changed one no longer.
            (follow_images, follow_colors)
                .chain()
                .in_set(StyleGaussianSystems::Styles)
                .after(TransformSystems::Propagate)
                .after(advance_jobs)
                .before(prepare_surfaces),
        );
        #[cfg(target_family = "wasm")]
        app.add_systems(PostUpdate, lay_on_here.before(StyleGaussianSystems::Styles));
    }
}

/// Has styles that begin to follow their images laid on anew on the page's thread: strokes that the browser's
/// worker has laid on do not know their canvases.
#[cfg(target_family = "wasm")]
fn lay_on_here(
    mut begun: Query<(&StyleSource, &mut StyleJobs), Added<StyleLiving>>,
    mut canvases: ResMut<ImageCanvases>,
) {
    for (source, mut jobs) in &mut begun {
        for style in &source.styles {
            if let StyleInput::Image(image) = &style.input {
                canvases.forget(image.id());
            }
        }
        jobs.of_scene.iter_mut().for_each(|job| job.want());
    }
}

/// Asks for the colors of images that changed, has their textures made anew, and tells what is wrong with them.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
fn follow_images(
    mut living: ResMut<LivingImages>,
    canvases: Res<ImageCanvases>,
    images: Res<Assets<Image>>,
    sources: Query<(Entity, &StyleSource), With<StyleLiving>>,
    time: Res<Time<Real>>,
    mut paintings: ResMut<LivingPaintings>,
    mut events: StyleEvents,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    if sources.is_empty() && paintings.shown.is_empty() && paintings.reads.is_empty() {
        return;
    }
    let mut wanted = LivingPaintings::default();
    for (entity, source) in &sources {
        for style in &source.styles {
            let StyleInput::Image(handle) = &style.input else { continue };
            let whole = canvases.followed(handle.id()).filter(|_| style.crop.is_none());
            let Some(canvas) = whole else { continue };
            if let Some(image) = images.get(handle) {
                living.ask_for_colors(handle, image, canvas, time.elapsed());
            }
            let Some(of) = living.images.get(&handle.id()) else { continue };
            match &of.error {
                Some(error) if !of.is_told => events.failed(entity, Arc::clone(error)),
                Some(_) => {}
                None if wanted.shown.iter().any(|shown| shown.image == handle.id()) => {}
                None => wanted.shown.push(LivingPainting {
                    image: handle.id(),
                    texture: Arc::clone(canvas.texture()),
                    reading: canvas.reading_size(),
                    version: of.version,
                    changes_on_gpu: of.changes_on_gpu,
                }),
            }
        }
    }
    for (id, of) in &mut living.images {
        // Without a canvas, the style that waits for it tells.
        of.is_told |= of.error.is_some() && canvases.followed(*id).is_some();
    }
    wanted.reads = living.reads();
    paintings.set_if_neq(wanted);
    if living.are_colors_due() {
        redraw.write(RequestRedraw);
    }
}

/// The components of an entity whose colors follow.
type Following = (
    Entity,
    &'static StyleLiving,
    &'static StyleSource,
    &'static mut StyleJobs,
    Option<&'static StyleTransition>,
    Has<StyleVolume>,
);

/// Computes the colors that styles have by now, and puts them on.
fn follow_colors(
    mut commands: Commands,
    mut entities: Query<Following>,
    living: Res<LivingImages>,
    mut shared: ResMut<SharedStyles>,
    workers: Res<Workers>,
    mut events: StyleEvents,
) {
    for (entity, of, source, mut jobs, transition, is_volume) in &mut entities {
        let inputs = source.styles.iter().filter_map(|style| match &style.input {
            StyleInput::Image(image) if style.crop.is_none() => Some(Some(image.id())),
            StyleInput::Image(_) | StyleInput::Preset(_) => Some(None),
            // It has no canvas.
            StyleInput::Look(_) | StyleInput::ChunkLooks(_) => None,
        });
        let ids: Vec<_> = inputs.collect();
        // Nothing watches for changes of jobs.
        for job in &mut jobs.bypass_change_detection().of_scene {
            if !job.is_settled() {
                // Another style is wanted or under way.
                job.following = None;
                continue;
            }
            let computed = job.following.as_ref().map(|following| following.poll());
            match computed {
                Some(None) => continue,
                Some(Some(Ok(result))) => {
                    let fade = fade(of.base_colors_every, transition);
                    job.worn.put_on(LayerColors::Style(result.colors), Some(&fade));
                    job.shown = job.following.take();
                    job.failure = None;
                    if !is_volume {
                        commands.entity(entity).try_insert(result.style);
                    }
                }
                Some(Some(Err(error))) => {
                    // The same failure is told once, and not computed again.
                    let failure = Some(error.to_string());
                    if job.failure != failure {
                        events.failed(entity, error);
                    }
                    job.failure = failure;
                }
                None => {}
            }
            let colors = |i: usize| living.images.get(&(*ids.get(i)?)?)?.colors.clone();
            let request = job.shown.as_ref().and_then(|shown| shown.following(&colors));
            if let Some(request) = request
                && job.following.as_ref().is_none_or(|failed| !failed.is_of(&request))
            {
                job.following = Some(shared.get(request, &workers));
            }
        }
    }
}

/// The way in which colors follow: they fade, by the clock of the entity's transitions.
fn fade(every: Duration, transition: Option<&StyleTransition>) -> StyleTransition {
    let usual = StyleTransition::default();
    // Done when the next ones come.
    let duration = usual.duration.min(every);
    let clock = transition.map_or(usual.clock, |transition| transition.clock);
    StyleTransition { duration, shape: TransitionShape::Fade, clock, ..usual }
}
