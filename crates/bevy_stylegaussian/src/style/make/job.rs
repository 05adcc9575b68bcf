//! The way from a changed source to new colors: one job per styled entity and scene.
//!
//! A job computes one style at a time and remembers only *that* another is wanted, not which: when it is free
//! again it reads the entity's components as they are then. So a thousand changes that come faster than they
//! complete cost a few computations, some of the styles in between are seen, and the last change is the one
//! that stays.

use std::sync::Arc;

use bevy::{platform::time::Instant, prelude::*, render::renderer::RenderAdapterInfo};

use crate::{
    colors::{ColorLayers, LayerColors, WantedColors},
    scene::{GaussianSplats, LoadedScene, NextScene},
    style::{
        make::{
            beside::PaintedBeside,
            first::FirstColors,
            inputs::Inputs,
            request::StyleResult,
            shared::{SharedStyle, SharedStyles},
            surfaces::Surfaces,
        },
        show::{transition::StyleTransition, volume::StyleVolume, worn::Worn},
        wish::{
            applied::AppliedStyle,
            error::StyleError,
            event::StyleEvents,
            settings::StyleBackend,
            source::{StyleDecoder, StyleSource},
        },
    },
};

/// The jobs of a styled entity: one for the scene that it shows, or one for each scene that its volume comes
/// near.
#[derive(Component, Default)]
pub(crate) struct StyleJobs {
    pub(crate) of_scene: Vec<StyleJob>,
    /// The source that the jobs know of.
    pub(super) known: Option<StyleSource>,
    /// Whether the source was changed to no style, and nothing has answered that.
    pub(super) is_unstyling: bool,
}

impl StyleJobs {
    /// The style that is shown, if there is one: of the first scene, for a volume.
    pub(crate) fn shown(&self) -> Option<&Arc<SharedStyle>> {
        self.of_scene.first()?.shown.as_ref()
    }

    /// Whether a style is still to be computed, also of a scene that is not attached yet.
    pub(crate) fn are_computing(&self) -> bool {
        self.of_scene.is_empty() || self.of_scene.iter().any(StyleJob::is_computing)
    }
}

/// Share of a style's first computation that the scene's surface takes: 1.1 of 1.5 s on the demo scene.
const SURFACE: f32 = 0.7;

/// Progress of an entity's style on a scene.
pub(crate) struct StyleJob {
    pub(crate) scene: LoadedScene,
    /// An entity that shows the scene.
    pub(crate) cloud: Entity,
    /// When the pending request was made; `None` if nothing is pending.
    wanted: Option<Instant>,
    pub(super) stage: Stage,
    /// Whether the style that is wanted has waited for the scene's surface.
    has_waited: bool,
    /// The style that was put on and is not drawn yet.
    coming: Option<Coming>,
    /// Whether the GPU has refused the present scene and decoder.
    pub(super) gpu_refused: bool,
    /// The last failure, until a component of the entity changes. Assets that come later often change nothing
    /// about it.
    pub(super) failure: Option<String>,
    /// First colors, which are shown until the wanted style is painted.
    pub(super) first: FirstColors,
    /// The styles that are shown.
    pub(crate) worn: Worn,
    /// The shared style that is shown, kept so that others find it.
    pub(super) shown: Option<Arc<SharedStyle>>,
    /// The same style in the present colors of its images, while it is computed, or if it failed.
    pub(super) following: Option<Arc<SharedStyle>>,
}

/// Stage of the style under way.
#[derive(Default)]
pub(super) enum Stage {
    /// Nothing is under way.
    #[default]
    Idle,
    /// A task computes the style.
    Computing { since: Instant, backend: StyleBackend, shared: Arc<SharedStyle> },
    /// The GPU is to take the colors.
    Uploading { since: Instant, backend: StyleBackend, shared: Arc<SharedStyle>, result: StyleResult },
}

/// A style that is about to be drawn.
struct Coming {
    since: Instant,
    backend: StyleBackend,
    /// The style, or `None` for the captured colors.
    // Kept here until it is drawn, so that `AppliedStyle` never runs ahead of the picture.
    style: Option<AppliedStyle>,
    /// The generation of the cloud's colors that shows it, or `None` if it is not known yet.
    generation: Option<u64>,
}

impl StyleJob {
    pub(crate) fn new(cloud: Entity, scene: &LoadedScene) -> Self {
        Self {
            scene: scene.clone(),
            cloud,
            wanted: Some(Instant::now()),
            stage: Stage::Idle,
            has_waited: false,
            coming: None,
            gpu_refused: false,
            failure: None,
            first: FirstColors::default(),
            worn: Worn::default(),
            shown: None,
            following: None,
        }
    }

    /// Whether the job is of this scene.
    pub(crate) fn is_of(&self, scene: &LoadedScene) -> bool {
        Arc::ptr_eq(self.scene.scene(), scene.scene())
    }

    /// Wants a style, since an asset of it came. The time of the change that asked for it counts.
    pub(super) fn want(&mut self) {
        self.wanted.get_or_insert_with(Instant::now);
    }

    /// Wants another style from now on.
    pub(super) fn want_another(&mut self) {
        self.wanted = Some(Instant::now());
    }

    /// Whether the style that is wanted is shown.
    pub(crate) fn is_settled(&self) -> bool {
        self.wanted.is_none() && matches!(self.stage, Stage::Idle)
    }

    /// Whether the style that is wanted is still to be computed.
    fn is_computing(&self) -> bool {
        let is_under_way = matches!(&self.stage, Stage::Computing { shared, .. } if !shared.is_there());
        self.wanted.is_some() || is_under_way
    }

    /// Share of the style under way that is computed, 0..1, or `None` if there is none.
    pub(crate) fn progress(&self, surfaces: &Surfaces) -> Option<f32> {
        match &self.stage {
            Stage::Idle => self.wanted.map(|_| SURFACE * surfaces.done(&self.scene)),
            Stage::Computing { shared, .. } if self.has_waited => {
                Some(SURFACE + (1.0 - SURFACE) * shared.done())
            }
            Stage::Computing { shared, .. } => Some(shared.done()),
            Stage::Uploading { .. } => Some(1.0),
        }
    }

    /// Whether no style has been shown yet, apart from first colors.
    pub(crate) fn is_unstyled(&self) -> bool {
        self.worn.is_empty() || self.first.are_over_captured()
    }

    /// Whether it is drawn as well.
    #[cfg(test)]
    pub(crate) fn is_shown(&self) -> bool {
        self.is_settled() && self.coming.is_none()
    }
}

/// The components of a styled entity.
type StyledEntity = (
    Entity,
    &'static StyleSource,
    &'static mut StyleJobs,
    Option<&'static StyleDecoder>,
    Option<&'static StyleTransition>,
    (Option<&'static GaussianSplats>, Has<NextScene>, Option<&'static PaintedBeside>),
    Has<StyleVolume>,
);

/// The components that a style is asked for by.
type AskedBy<'a> =
    (&'a StyleSource, Option<&'a StyleDecoder>, Option<&'a StyleTransition>, Option<&'a PaintedBeside>);

/// Takes over results of tasks, then starts wanted styles.
pub(crate) fn advance_jobs(
    mut entities: Query<StyledEntity>,
    mut inputs: Inputs,
    mut shared: ResMut<SharedStyles>,
    mut wanted: ResMut<WantedColors>,
    // Bevy puts a copy into the main world. It is absent if the app does not render.
    renderer: Option<Res<RenderAdapterInfo>>,
    mut events: StyleEvents,
) {
    let (mut uploading, mut has_strokes) = (Vec::new(), false);
    for (entity, source, mut jobs, decoder, transition, (splats, has_next, beside), is_volume) in
        &mut entities
    {
        // Borrowed mutably only where there is something to do.
        if jobs.of_scene.iter().all(StyleJob::is_settled) {
            continue;
        }
        if source.is_none() {
            let is_asked = std::mem::take(&mut jobs.is_unstyling);
            let plain = jobs.of_scene.iter_mut().filter_map(|job| job.unstyle(transition, is_volume));
            // There is nothing to draw first.
            if let Some(since) = plain.last().filter(|_| is_asked) {
                events.removed(entity, since);
            }
            continue;
        }
        for job in &mut jobs.of_scene {
            // The entity is about to show another scene, whose job will follow.
            if has_next || splats.is_some_and(|of| of.0.id() != job.scene.id && inputs.is_loading(&of.0)) {
                // If that scene never comes, the style is still wanted of this one.
                if let Stage::Computing { since, .. } | Stage::Uploading { since, .. } =
                    std::mem::take(&mut job.stage)
                {
                    job.wanted.get_or_insert(since);
                }
                continue;
            }
            job.take_over(entity, transition, renderer.is_some(), &mut events);
            let by = (source, decoder, transition, beside);
            job.start(entity, by, &mut inputs, &mut shared, &mut events);
            // Alone, it would not look like what is beside it.
            if beside.is_none() && job.show_first_colors(source, decoder, transition, &inputs) {
                events.recolored(entity, job.is_unstyled());
            }
            match &job.stage {
                Stage::Idle => {}
                Stage::Computing { shared, .. } => has_strokes |= shared.has_strokes(),
                Stage::Uploading { result, .. } => uploading.push(Arc::clone(&result.colors)),
            }
        }
    }
    // Only a change is extracted.
    if !(wanted.styles.is_empty() && uploading.is_empty()) {
        wanted.styles = uploading;
    }
    if has_strokes {
        WantedColors::expect_strokes(&mut wanted);
    }
}

impl StyleJob {
    /// Puts on the captured colors, which needs no task. Returns the time of the change if they are shown
    /// already.
    fn unstyle(&mut self, transition: Option<&StyleTransition>, is_volume: bool) -> Option<Instant> {
        // A task under way is canceled in any case; the event is sent if somebody asked.
        self.stage = Stage::Idle;
        let since = self.wanted.take()?;
        (self.shown, self.following) = (None, None);
        self.coming = None;
        self.first = FirstColors::default();
        // A volume in captured colors covers what lies below it. Splats without a style are in theirs already.
        if !is_volume && self.worn.is_empty() {
            return Some(since);
        }
        self.worn.put_on(LayerColors::Captured, transition);
        self.coming = Some(Coming { since, backend: StyleBackend::Cpu, style: None, generation: None });
        None
    }

    /// Puts everything off: the entity has no source any more.
    pub(super) fn take_off(&mut self, transition: Option<&StyleTransition>) {
        (self.wanted, self.stage, self.coming) = (None, Stage::Idle, None);
        (self.shown, self.following) = (None, None);
        self.first = FirstColors::default();
        if !self.worn.is_empty() {
            self.worn.put_on(LayerColors::Captured, transition);
        }
    }

    /// Takes over the task's result if it is ready, and puts it on once the GPU has it.
    fn take_over(
        &mut self,
        entity: Entity,
        transition: Option<&StyleTransition>,
        renders: bool,
        events: &mut StyleEvents,
    ) {
        if let Stage::Computing { since, backend, shared } = &self.stage
            && let Some(computed) = shared.poll()
        {
            let (since, backend, shared) = (*since, *backend, Arc::clone(shared));
            self.stage = Stage::Idle;
            match computed {
                Ok(result) => self.stage = Stage::Uploading { since, backend, shared, result },
                // A later change has made the failure obsolete.
                Err(_) if self.wanted.is_some() => {}
                Err(error) => {
                    self.first.give_up(&mut self.worn, transition);
                    events.failed(entity, error);
                }
            }
        }
        let Stage::Uploading { result, .. } = &self.stage else { return };
        let answer = if renders { result.colors.on_gpu().cloned() } else { Some(Ok(())) };
        let Some(answer) = answer else { return };
        let Stage::Uploading { since, backend, shared, result } = std::mem::take(&mut self.stage) else {
            return;
        };
        match answer {
            Ok(()) => {
                self.shown = Some(shared);
                self.first = FirstColors::done();
                self.has_waited = false;
                if !self.worn.is_topped_by(&result.colors) {
                    self.worn.put_on(LayerColors::Style(result.colors), transition);
                }
                let style = Some(result.style);
                self.coming = Some(Coming { since, backend, style, generation: None });
            }
            Err(reason) => {
                self.gpu_refused = true;
                if backend == StyleBackend::Gpu && events.may_use_cpu() {
                    events.warn(
                        entity,
                        &format_args!("the GPU cannot decode its style ({reason}); the CPU does"),
                    );
                    // The time goes on: the user has been waiting since the first attempt.
                    self.wanted.get_or_insert(since);
                } else {
                    self.first.give_up(&mut self.worn, transition);
                    events.failed(entity, Arc::new(StyleError::Gpu(reason)));
                }
            }
        }
    }

    /// Starts the wanted style if nothing is under way and all inputs are available.
    fn start(
        &mut self,
        entity: Entity,
        (source, decoder, transition, beside): AskedBy,
        inputs: &mut Inputs,
        shared: &mut SharedStyles,
        events: &mut StyleEvents,
    ) {
        let (Stage::Idle, Some(since)) = (&self.stage, self.wanted) else { return };
        let beside = beside.map(|beside| &beside.0);
        match inputs.request(source, &self.scene, decoder, self.gpu_refused, beside) {
            // Still wanted, so the next frame asks again. The events of assets are not needed for that.
            Ok(None) => {
                self.has_waited |= inputs.surfaces.done(&self.scene) < 1.0;
                return;
            }
            Ok(Some(request)) => {
                self.failure = None;
                let backend = request.backend;
                let shared = shared.get(request, &inputs.workers);
                self.stage = Stage::Computing { since, backend, shared };
            }
            Err(error) => {
                let failure = Some(error.to_string());
                if self.failure != failure {
                    events.failed(entity, error);
                }
                self.failure = failure;
                self.first.give_up(&mut self.worn, transition);
            }
        }
        // After a failure too: the same inputs would fail again, and the next change wants anew.
        self.wanted = None;
    }

    /// Shows the scene in the style's palette until the style is painted. Returns whether it begins to.
    fn show_first_colors(
        &mut self,
        source: &StyleSource,
        decoder: Option<&StyleDecoder>,
        transition: Option<&StyleTransition>,
        inputs: &Inputs,
    ) -> bool {
        let is_computed = match &self.stage {
            Stage::Idle => self.wanted.is_none(),
            // The source is another one by now, or the style is there.
            Stage::Computing { shared, .. } => self.wanted.is_some() || shared.poll().is_some(),
            Stage::Uploading { .. } => true,
        };
        if is_computed {
            return false;
        }
        if !self.first.are_asked()
            && let Some(request) = inputs.first_request(source, &self.scene, decoder)
        {
            self.first.ask(request, &inputs.workers);
        }
        self.first.show(&mut self.worn, transition)
    }
}

/// Sends the events of styles that are drawn from this frame on.
pub(crate) fn report_drawn_styles(
    mut entities: Query<(Entity, &mut StyleJobs, Has<StyleVolume>)>,
    clouds: Query<&ColorLayers>,
    renderer: Option<Res<RenderAdapterInfo>>,
    mut events: StyleEvents,
) {
    for (entity, mut jobs, is_volume) in &mut entities {
        if jobs.of_scene.iter().all(|job| job.coming.is_none()) {
            continue;
        }
        for job in &mut jobs.of_scene {
            let Some(coming) = &mut job.coming else { continue };
            let is_drawn = match clouds.get(job.cloud) {
                // The layers that show it were set in the frame in which it was put on.
                Ok(colors) if renderer.is_some() => {
                    let generation = *coming.generation.get_or_insert(colors.generation);
                    colors.is_drawn(generation)
                }
                _ => true,
            };
            if is_drawn && let Some(Coming { since, backend, style, .. }) = job.coming.take() {
                match style {
                    // A volume shows several scenes, so no one style is the applied one.
                    Some(_) if is_volume => events.sent(entity, backend, since),
                    Some(style) => events.applied(entity, style, backend, since),
                    None => events.removed(entity, since),
                }
            }
        }
    }
}
