//! The way from a wish to a look, one job per styled entity.
//!
//! A job computes one look at a time and remembers only *that* another is wanted, not which: when it is free again it
//! takes what the entity's components then say. So a thousand changes faster than they complete cost a few
//! computations, some of the looks in between are seen, and the last change is what stays.

use std::{sync::Arc, time::Duration};

use bevy::{
    ecs::system::SystemParam,
    platform::{collections::HashSet, time::Instant},
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, block_on, poll_once},
};

use crate::{
    asset::{GaussianDecoder, StyleStatistics},
    splats::{CloudScene, SceneError, SceneFailed},
};

use super::{
    event::{AppliedStyle, StyleApplied, StyleError, StyleFailed},
    inputs::Inputs,
    look::{GpuReport, GpuReports, Look, LookColors},
    settings::{StyleBackend, StyleEncoder},
    source::{StyleDecoder, StyleInput, StyleSource, StyleTransition},
    transfer::Transferred,
};

/// What is under way for an entity's style.
#[derive(Component, Default)]
pub(crate) struct StyleJob {
    /// Since when another look is wanted than the one under way or shown.
    wanted: Option<Instant>,
    stage: Stage,
    /// Until when (since startup) the present look fades in.
    fading_until: Duration,
    /// Whether the GPU has refused the present scene and decoder.
    gpu_refused: bool,
}

/// How far the look under way is.
#[derive(Default)]
enum Stage {
    /// There is none.
    #[default]
    Idle,
    /// It is computed in the background.
    Computing { since: Instant, backend: StyleBackend, task: Task<Result<Transferred, StyleError>> },
    /// The render world is to run the style pass of this generation.
    Drawing { since: Instant, generation: u64, style: AppliedStyle },
}

impl StyleJob {
    fn want(&mut self) {
        self.wanted.get_or_insert_with(Instant::now);
    }
}

/// Another look may be wanted.
type WishChanged = Or<(Changed<StyleSource>, Changed<StyleDecoder>, Changed<CloudScene>)>;

/// What a wish is about.
type Wishing = (
    Entity,
    &'static mut StyleJob,
    &'static mut Look,
    Ref<'static, CloudScene>,
    Option<Ref<'static, StyleDecoder>>,
);

/// Wants a new look where source, decoder or scene changed. A new scene starts from its own colors.
pub(super) fn ask_for_changed_styles(mut commands: Commands, mut jobs: Query<Wishing, WishChanged>) {
    for (entity, mut job, mut look, scene, decoder) in &mut jobs {
        if scene.is_changed() {
            *job = StyleJob::default();
            if !matches!(look.colors, LookColors::Captured) {
                look.set(LookColors::Captured);
                commands.entity(entity).try_remove::<AppliedStyle>();
            }
        }
        if decoder.is_some_and(|decoder| decoder.is_changed()) {
            job.gpu_refused = false;
        }
        job.want();
    }
}

/// Wants a new look where an asset came or changed that the style names, or the encoder that reads its images.
pub(super) fn ask_for_changed_assets(
    mut images: MessageReader<AssetEvent<Image>>,
    mut statistics: MessageReader<AssetEvent<StyleStatistics>>,
    mut decoders: MessageReader<AssetEvent<GaussianDecoder>>,
    encoder: Res<StyleEncoder>,
    mut jobs: Query<(&mut StyleJob, &StyleSource, Option<&StyleDecoder>)>,
) {
    let images = changed(&mut images);
    let statistics = changed(&mut statistics);
    let decoders = changed(&mut decoders);
    let new_encoder = encoder.is_changed() && !encoder.is_added();
    if images.is_empty() && statistics.is_empty() && decoders.is_empty() && !new_encoder {
        return;
    }
    for (mut job, source, decoder) in &mut jobs {
        let input_changed = source.styles.iter().any(|style| match &style.input {
            StyleInput::Image(image) => new_encoder || images.contains(&image.id()),
            StyleInput::Preset(preset) => statistics.contains(&preset.id()),
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

/// The assets that came or were replaced. One that comes is mostly waited for already; after a failure it is not.
fn changed<A: Asset>(events: &mut MessageReader<AssetEvent<A>>) -> HashSet<AssetId<A>> {
    let id = |event: &AssetEvent<A>| match event {
        AssetEvent::Added { id } | AssetEvent::Modified { id } => Some(*id),
        _ => None,
    };
    events.read().filter_map(id).collect()
}

/// Gives entities their own colors back whose source was removed, and wants a new look where a decoder was.
pub(super) fn drop_removed_styles(
    mut commands: Commands,
    mut sources: RemovedComponents<StyleSource>,
    mut decoders: RemovedComponents<StyleDecoder>,
    mut jobs: Query<&mut StyleJob, With<StyleSource>>,
    mut looks: Query<&mut Look>,
) {
    for entity in sources.read().filter(|&entity| !jobs.contains(entity)) {
        if let Ok(mut look) = looks.get_mut(entity) {
            look.set(LookColors::Captured);
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

/// Takes over what the render world reports.
pub(super) fn hear_from_gpu(
    reports: Res<GpuReports>,
    mut jobs: Query<(&mut StyleJob, Option<&StyleTransition>)>,
    backend: Res<StyleBackend>,
    time: Res<Time<Real>>,
    mut news: News,
) {
    for report in reports.take() {
        match report {
            GpuReport::Styled { entity, generation } => {
                let Ok((mut job, transition)) = jobs.get_mut(entity) else { continue };
                if let Some((since, style)) = job.finish_drawing(generation) {
                    job.fading_until = time.elapsed().saturating_add(fade_duration(transition));
                    news.applied(entity, style, StyleBackend::Gpu, since);
                }
            }
            GpuReport::StyleRefused { entity, generation, reason } => {
                let Ok((mut job, _)) = jobs.get_mut(entity) else { continue };
                let Some((since, _)) = job.finish_drawing(generation) else { continue };
                job.gpu_refused = true;
                if *backend == StyleBackend::Auto {
                    warn!("{entity}: the GPU cannot decode its style ({reason}); the processor does");
                    job.wanted.get_or_insert(since);
                } else {
                    news.failed(entity, Arc::new(StyleError::Gpu(reason)));
                }
            }
            GpuReport::SceneRefused { entity, reason } => {
                let event = SceneFailed { entity, error: Arc::new(SceneError::Gpu(reason)) };
                error!("{entity}: {}", event.error);
                news.scene_failed.write(event.clone());
                news.commands.trigger(event);
            }
        }
    }
}

impl StyleJob {
    /// The style whose pass was awaited, if it is of this generation.
    fn finish_drawing(&mut self, awaited: u64) -> Option<(Instant, AppliedStyle)> {
        match std::mem::take(&mut self.stage) {
            Stage::Drawing { since, generation, style } if generation == awaited => Some((since, style)),
            other => {
                self.stage = other;
                None
            }
        }
    }
}

fn fade_duration(transition: Option<&StyleTransition>) -> Duration {
    transition.map_or(Duration::ZERO, |transition| transition.duration)
}

/// An entity whose style is worked on.
type Styled = (
    Entity,
    &'static StyleSource,
    &'static mut StyleJob,
    &'static mut Look,
    Option<&'static CloudScene>,
    Option<&'static StyleDecoder>,
    Option<&'static StyleTransition>,
);

/// Takes over what is computed, then starts what is wanted.
pub(super) fn advance_jobs(
    mut jobs: Query<Styled>,
    mut inputs: Inputs,
    time: Res<Time<Real>>,
    mut news: News,
) {
    let now = time.elapsed();
    for (entity, source, mut job, mut look, scene, decoder, transition) in &mut jobs {
        // A look that is ready during a fade waits: a fade has one beginning and one end.
        if job.is_at_rest() || now < job.fading_until {
            continue;
        }
        let fading_until = now.saturating_add(fade_duration(transition));
        match scene {
            // What is under way is for a scene that is gone; what is wanted waits for the next.
            None => job.stage = Stage::Idle,
            Some(_) if source.is_none() => job.unstyle(entity, &mut look, fading_until, &mut news),
            Some(scene) => {
                job.take_over(entity, scene, &mut look, fading_until, &mut news);
                job.start(entity, source, scene, decoder, &mut inputs, &mut news);
            }
        }
    }
}

impl StyleJob {
    /// Gives the entity its own colors back, which takes no computing.
    fn unstyle(&mut self, entity: Entity, look: &mut Mut<Look>, fading_until: Duration, news: &mut News) {
        self.stage = Stage::Idle;
        let Some(since) = self.wanted.take() else { return };
        if matches!(look.colors, LookColors::Captured) {
            return;
        }
        look.set(LookColors::Captured);
        self.fading_until = fading_until;
        news.commands.entity(entity).try_remove::<AppliedStyle>();
        news.tell_applied(entity, StyleBackend::Cpu, since);
    }

    /// Takes over what the background has computed, if it has.
    fn take_over(
        &mut self,
        entity: Entity,
        scene: &CloudScene,
        look: &mut Mut<Look>,
        fading_until: Duration,
        news: &mut News,
    ) {
        let Some((result, backend, since)) = self.computed() else { return };
        match result {
            // The scene was replaced meanwhile: the colors are another scene's.
            Ok(transferred) if !Arc::ptr_eq(&transferred.style.scene, scene.0.scene()) => {}
            Ok(Transferred { style, colors }) => {
                look.set(colors);
                if backend == StyleBackend::Gpu {
                    self.stage = Stage::Drawing { since, generation: look.generation, style };
                } else {
                    self.fading_until = fading_until;
                    news.applied(entity, style, backend, since);
                }
            }
            // A failure that a later change has made void is nobody's concern.
            Err(_) if self.wanted.is_some() => {}
            Err(error) => news.failed(entity, Arc::new(error)),
        }
    }

    /// Starts to compute what is wanted, if nothing is under way and all that it takes is there.
    fn start(
        &mut self,
        entity: Entity,
        source: &StyleSource,
        scene: &CloudScene,
        decoder: Option<&StyleDecoder>,
        inputs: &mut Inputs,
        news: &mut News,
    ) {
        let (Stage::Idle, Some(since)) = (&self.stage, self.wanted) else { return };
        let Some(order) = inputs.order(source, scene, decoder, self.gpu_refused) else { return };
        self.wanted = None;
        match order {
            Ok(order) => {
                let backend = order.backend;
                let task = AsyncComputeTaskPool::get().spawn(async move { order.carry_out() });
                self.stage = Stage::Computing { since, backend, task };
            }
            Err(error) => news.failed(entity, error),
        }
    }
}

impl StyleJob {
    fn is_at_rest(&self) -> bool {
        self.wanted.is_none() && !matches!(self.stage, Stage::Computing { .. })
    }

    /// What the background has computed, once.
    fn computed(&mut self) -> Option<(Result<Transferred, StyleError>, StyleBackend, Instant)> {
        let Stage::Computing { since, backend, task } = &mut self.stage else { return None };
        let computed = (block_on(poll_once(task))?, *backend, *since);
        self.stage = Stage::Idle;
        Some(computed)
    }
}

/// Where results are told.
#[derive(SystemParam)]
pub(super) struct News<'w, 's> {
    commands: Commands<'w, 's>,
    applied: MessageWriter<'w, StyleApplied>,
    failed: MessageWriter<'w, StyleFailed>,
    scene_failed: MessageWriter<'w, SceneFailed>,
}

impl News<'_, '_> {
    fn applied(&mut self, entity: Entity, style: AppliedStyle, backend: StyleBackend, since: Instant) {
        self.commands.entity(entity).try_insert(style);
        self.tell_applied(entity, backend, since);
    }

    fn tell_applied(&mut self, entity: Entity, backend: StyleBackend, since: Instant) {
        let event = StyleApplied { entity, backend, elapsed: since.elapsed() };
        self.applied.write(event.clone());
        self.commands.trigger(event);
    }

    fn failed(&mut self, entity: Entity, error: Arc<StyleError>) {
        warn!("{entity}: {error}");
        let event = StyleFailed { entity, error };
        self.failed.write(event.clone());
        self.commands.trigger(event);
    }
}
