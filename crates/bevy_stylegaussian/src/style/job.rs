//! The way from a changed source to new colors: one job per styled entity.
//!
//! A job computes one style at a time and remembers only *that* another is wanted, not which: when it is free again it
//! reads the entity's components as they are then. So a thousand changes that come faster than they complete cost a few
//! computations, some of the styles in between are seen, and the last change is the one that stays.

use std::{sync::Arc, time::Duration};

use bevy::{
    platform::{collections::HashSet, time::Instant},
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, futures::check_ready},
};

use crate::{
    colors::{ColorReport, ColorSource, ColorWish, StyleTransition},
    reports::Reports,
    scene::LoadedScene,
};

use super::{
    applied::AppliedStyle,
    asset::{GaussianDecoder, ImageEncoder, StyleLook, StyleStatistics},
    error::StyleError,
    event::StyleEvents,
    inputs::Inputs,
    request::StyleResult,
    settings::{StyleBackend, StyleEncoder},
    source::{StyleDecoder, StyleInput, StyleSource},
};

/// Progress of an entity's style.
#[derive(Component, Default)]
pub(crate) struct StyleJob {
    /// Time of the first change that neither the style under way nor the shown one answers, or `None` if both are current.
    wanted: Option<Instant>,
    stage: Stage,
    /// End of the present fade, since startup.
    fading_until: Duration,
    /// Whether the GPU has refused the present scene and decoder.
    gpu_refused: bool,
    /// The last failure, until a component of the entity changes. Assets that come later often change nothing about it.
    failure: Option<String>,
}

/// Stage of the style under way.
#[derive(Default)]
enum Stage {
    /// Nothing is under way.
    #[default]
    Idle,
    /// A task computes the style.
    Computing { since: Instant, backend: StyleBackend, task: Task<Result<StyleResult, StyleError>> },
    /// The render world has to fulfil the wish of this generation.
    // The style is kept here until the GPU shows it, so that `AppliedStyle` never runs ahead of the picture.
    Decoding { since: Instant, generation: u64, style: AppliedStyle },
}

impl StyleJob {
    // The first of several changes counts: `elapsed` is what the user has waited for.
    fn want(&mut self) {
        self.wanted.get_or_insert_with(Instant::now);
    }
}

/// One of the entity's components that a style depends on changed.
type InputChanged = Or<(Changed<StyleSource>, Changed<StyleDecoder>, Changed<LoadedScene>)>;

/// The components that show which input changed.
type ChangedInputs = (
    Entity,
    &'static mut StyleJob,
    &'static mut ColorWish,
    Ref<'static, LoadedScene>,
    Option<Ref<'static, StyleDecoder>>,
);

/// Wants a new style if source, decoder or scene changed. A new scene starts in its captured colors.
pub(super) fn want_changed_styles(mut commands: Commands, mut jobs: Query<ChangedInputs, InputChanged>) {
    for (entity, mut job, mut wish, scene, decoder) in &mut jobs {
        if scene.is_changed() {
            // Drops the task too, which cancels it: its colors would be of the old Gaussians.
            *job = StyleJob::default();
            // A wish that is set again gets a new generation, which the render world would have to answer.
            if !matches!(wish.source, ColorSource::Captured) {
                wish.set(ColorSource::Captured);
                commands.entity(entity).try_remove::<AppliedStyle>();
            }
        }
        // The GPU may have refused the old decoder's weights. The new ones may fit.
        if decoder.is_some_and(|decoder| decoder.is_changed()) {
            job.gpu_refused = false;
        }
        job.failure = None;
        job.want();
    }
}

/// Wants a new style if an asset that the style names came or changed, or the encoder of its images.
pub(super) fn want_changed_assets(
    mut images: MessageReader<AssetEvent<Image>>,
    mut statistics: MessageReader<AssetEvent<StyleStatistics>>,
    mut looks: MessageReader<AssetEvent<StyleLook>>,
    mut decoders: MessageReader<AssetEvent<GaussianDecoder>>,
    mut encoders: MessageReader<AssetEvent<ImageEncoder>>,
    encoder: Res<StyleEncoder>,
    mut jobs: Query<(&mut StyleJob, &StyleSource, Option<&StyleDecoder>)>,
) {
    // Every reader is drained before the first return, or old events would come back in a later frame.
    let images = changed(&mut images);
    let statistics = changed(&mut statistics);
    let looks = changed(&mut looks);
    let decoders = changed(&mut decoders);
    let encoder_asset_changed = changed(&mut encoders).contains(&encoder.0.id());
    // The first frame's resource is no change: nothing was encoded before it.
    let encoder_changed = encoder_asset_changed || (encoder.is_changed() && !encoder.is_added());
    let is_quiet = images.is_empty() && statistics.is_empty() && looks.is_empty() && decoders.is_empty();
    if is_quiet && !encoder_changed {
        return;
    }
    for (mut job, source, decoder) in &mut jobs {
        let input_changed = source.styles.iter().any(|style| match &style.input {
            StyleInput::Image(image) => encoder_changed || images.contains(&image.id()),
            StyleInput::Preset(preset) => statistics.contains(&preset.id()),
            StyleInput::Look(look) => looks.contains(&look.id()),
        });
        let decoder_changed = decoder.is_some_and(|decoder| decoders.contains(&decoder.0.id()));
        if decoder_changed {
            job.gpu_refused = false;
        }
        if input_changed || decoder_changed {
            job.want();
        }
    }
}

/// The assets that came or were replaced. A job usually waits for an asset that comes, but not after a failure.
fn changed<A: Asset>(events: &mut MessageReader<AssetEvent<A>>) -> HashSet<AssetId<A>> {
    let id = |event: &AssetEvent<A>| match event {
        AssetEvent::Added { id } | AssetEvent::Modified { id } => Some(*id),
        _ => None,
    };
    events.read().filter_map(id).collect()
}

/// Resets entities to their captured colors if their source was removed, and wants a new style if their decoder was.
pub(super) fn drop_removed_styles(
    mut commands: Commands,
    mut sources: RemovedComponents<StyleSource>,
    mut decoders: RemovedComponents<StyleDecoder>,
    mut jobs: Query<&mut StyleJob, With<StyleSource>>,
    mut wishes: Query<&mut ColorWish>,
) {
    // A source that was removed and put back in the same frame is in `jobs`, and `want_changed_styles` has seen it.
    for entity in sources.read().filter(|&entity| !jobs.contains(entity)) {
        // The wish stays: the next one must have a higher generation.
        if let Ok(mut wish) = wishes.get_mut(entity) {
            wish.set(ColorSource::Captured);
            commands.entity(entity).try_remove::<(StyleJob, AppliedStyle)>();
        }
    }
    for entity in decoders.read() {
        if let Ok(mut job) = jobs.get_mut(entity) {
            job.gpu_refused = false;
            job.want();
        }
    }
}

/// Takes over the reports of the render world.
pub(super) fn read_gpu_reports(
    reports: Res<Reports<ColorReport>>,
    mut jobs: Query<(&mut StyleJob, Option<&StyleTransition>)>,
    backend: Res<StyleBackend>,
    time: Res<Time<Real>>,
    mut events: StyleEvents,
) {
    for ColorReport { entity, generation, result } in reports.take() {
        let Ok((mut job, transition)) = jobs.get_mut(entity) else { continue };
        // Reports arrive a frame late, so the wish may have changed since.
        let Some((since, style)) = job.finish_decoding(generation) else { continue };
        match result {
            Ok(()) => {
                // The render world began the fade in an earlier frame, so it ends no later than this.
                job.fading_until = time.elapsed().saturating_add(fade_duration(transition));
                events.applied(entity, style, StyleBackend::Gpu, since);
            }
            Err(reason) => {
                job.gpu_refused = true;
                if *backend == StyleBackend::Auto {
                    events.warn(
                        entity,
                        &format_args!("the GPU cannot decode its style ({reason}); the CPU does"),
                    );
                    // The time goes on: the user has been waiting since the first attempt.
                    job.wanted.get_or_insert(since);
                } else {
                    events.failed(entity, Arc::new(StyleError::Gpu(reason)));
                }
            }
        }
    }
}

impl StyleJob {
    /// The style that the render world was to decode, or `None` if it is not of this generation.
    fn finish_decoding(&mut self, reported: u64) -> Option<(Instant, AppliedStyle)> {
        match std::mem::take(&mut self.stage) {
            Stage::Decoding { since, generation, style } if generation == reported => Some((since, style)),
            other => {
                self.stage = other;
                None
            }
        }
    }
}

/// The duration of an entity's fades.
pub(super) fn fade_duration(transition: Option<&StyleTransition>) -> Duration {
    transition.map_or(Duration::ZERO, |transition| transition.duration)
}

/// The components of a styled entity.
type StyledEntity = (
    Entity,
    &'static StyleSource,
    &'static mut StyleJob,
    &'static mut ColorWish,
    Option<&'static LoadedScene>,
    Option<&'static StyleDecoder>,
    Option<&'static StyleTransition>,
);

/// Takes over results of tasks, then starts wanted styles.
pub(super) fn advance_jobs(
    mut jobs: Query<StyledEntity>,
    mut inputs: Inputs,
    time: Res<Time<Real>>,
    mut events: StyleEvents,
) {
    let now = time.elapsed();
    for (entity, source, mut job, mut wish, scene, decoder, transition) in &mut jobs {
        // A style that is ready during a fade waits: a fade has one beginning and one end.
        if job.is_at_rest() || job.is_fading(now) {
            continue;
        }
        // A fade may last for `Duration::MAX`.
        let fading_until = now.saturating_add(fade_duration(transition));
        match scene {
            // The style under way is for a scene that is gone; the wanted one waits for the next scene.
            None => job.stage = Stage::Idle,
            Some(_) if source.is_none() => job.unstyle(entity, &mut wish, fading_until, &mut events),
            Some(scene) => {
                job.take_over(entity, scene, &mut wish, fading_until, &mut events);
                job.start(entity, source, scene, decoder, &mut inputs, &mut events);
            }
        }
    }
}

impl StyleJob {
    /// Resets the entity to its captured colors, which needs no task.
    fn unstyle(
        &mut self,
        entity: Entity,
        wish: &mut Mut<ColorWish>,
        fading_until: Duration,
        events: &mut StyleEvents,
    ) {
        self.stage = Stage::Idle;
        // A task under way is canceled in any case; the event is sent if somebody asked.
        let Some(since) = self.wanted.take() else { return };
        if matches!(wish.source, ColorSource::Captured) {
            return;
        }
        wish.set(ColorSource::Captured);
        self.fading_until = fading_until;
        events.removed(entity, since);
    }

    /// Takes over the task's result if it is ready.
    fn take_over(
        &mut self,
        entity: Entity,
        scene: &LoadedScene,
        wish: &mut Mut<ColorWish>,
        fading_until: Duration,
        events: &mut StyleEvents,
    ) {
        let Some((result, backend, since)) = self.computed() else { return };
        match result {
            // The scene was replaced meanwhile: the colors belong to another one.
            Ok(result) if !Arc::ptr_eq(&result.style.scene, scene.scene()) => {}
            Ok(StyleResult { style, colors }) => {
                wish.set(colors);
                if backend == StyleBackend::Gpu {
                    self.stage = Stage::Decoding { since, generation: wish.generation, style };
                } else {
                    self.fading_until = fading_until;
                    events.applied(entity, style, backend, since);
                }
            }
            // A later change has made the failure obsolete.
            Err(_) if self.wanted.is_some() => {}
            Err(error) => events.failed(entity, Arc::new(error)),
        }
    }

    /// Starts the wanted style if nothing is under way and all inputs are available.
    fn start(
        &mut self,
        entity: Entity,
        source: &StyleSource,
        scene: &LoadedScene,
        decoder: Option<&StyleDecoder>,
        inputs: &mut Inputs,
        events: &mut StyleEvents,
    ) {
        let (Stage::Idle, Some(since)) = (&self.stage, self.wanted) else { return };
        match inputs.request(source, scene, decoder, self.gpu_refused) {
            // Still wanted, so the next frame asks again. The events of assets are not needed for that.
            Ok(None) => return,
            Ok(Some(request)) => {
                self.failure = None;
                let backend = request.backend;
                let task = AsyncComputeTaskPool::get().spawn(async move { request.run() });
                self.stage = Stage::Computing { since, backend, task };
            }
            Err(error) => {
                let failure = Some(error.to_string());
                if self.failure != failure {
                    events.failed(entity, error);
                }
                self.failure = failure;
            }
        }
        // After a failure too: the same inputs would fail again, and the next change wants anew.
        self.wanted = None;
    }

    /// Whether the style that is wanted is shown.
    pub(super) fn is_settled(&self) -> bool {
        self.wanted.is_none() && matches!(self.stage, Stage::Idle)
    }

    /// Whether a fade is under way at `now`.
    pub(super) fn is_fading(&self, now: Duration) -> bool {
        now < self.fading_until
    }

    /// Replaces the colors of the style that is shown by better ones.
    pub(super) fn improve(&mut self, wish: &mut ColorWish, colors: &Arc<[[f32; 3]]>, fading_until: Duration) {
        wish.set(ColorSource::Rgb(Arc::clone(colors)));
        self.fading_until = fading_until;
    }

    /// Whether there is nothing to do until something changes or the render world reports.
    fn is_at_rest(&self) -> bool {
        self.wanted.is_none() && !matches!(self.stage, Stage::Computing { .. })
    }

    /// The task's result if it is ready, once.
    fn computed(&mut self) -> Option<(Result<StyleResult, StyleError>, StyleBackend, Instant)> {
        let Stage::Computing { since, backend, task } = &mut self.stage else { return None };
        let computed = (check_ready(task)?, *backend, *since);
        self.stage = Stage::Idle;
        Some(computed)
    }
}
