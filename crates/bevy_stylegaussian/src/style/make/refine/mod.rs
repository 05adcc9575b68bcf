//! Refining: a style that is shown is baked further in the background, and better looks replace it.
//!
//! [`StyleApplied`] makes an entity with [`StyleRefine`] want a bake. It begins once the paintings are loaded,
//! runs in the background ([`worker`]), and ends early if anything else is wanted of the entity's style.

use std::sync::Arc;

use bevy::{ecs::system::SystemParam, prelude::*, window::RequestRedraw};
use stylegaussian::strokes::Strokes;
use stylegaussian_bake::BakeConfig;

use crate::{
    colors::{LayerColors, StyleColors, WantedColors},
    scene::LoadedScene,
    style::{
        make::{
            images::pixels::pixels,
            job::{StyleJob, StyleJobs, advance_jobs},
            later::{image_name, loaded},
            prepare::prepare_surfaces,
        },
        show::transition::StyleTransition,
        wish::{
            applied::{AppliedColors, AppliedStyle},
            error::StyleError,
            event::{StyleApplied, StyleEvents},
            source::{StyleInput, StyleSource, WeightedStyle},
        },
    },
    systems::StyleGaussianSystems,
    work::Workers,
};

mod engine;
#[cfg(test)]
mod tests;
mod worker;

use engine::Engine;
use worker::{Better, Request, Running};

/// Refines the styles that are shown.
pub(crate) struct RefinePlugin;

impl Plugin for RefinePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Engine>()
            .add_message::<StyleRefined>()
            .register_type::<StyleRefine>()
            .register_type::<StyleRefined>()
            .add_systems(
                PostUpdate,
                // After the styles: a style that has just been applied is refined, and a changed one no longer.
                (want_refinements, advance_refinements, ask_for_frames)
                    .chain()
                    .in_set(StyleGaussianSystems::Styles)
                    .after(TransformSystems::Propagate)
                    .after(advance_jobs)
                    .before(prepare_surfaces),
            );
    }
}

/// Asks for another frame after an event, for the systems that hear of it in an app that draws on demand.
fn ask_for_frames(mut refined: MessageReader<StyleRefined>, mut redraw: MessageWriter<RequestRedraw>) {
    if refined.read().count() > 0 {
        redraw.write(RequestRedraw);
    }
}

/// Bakes an entity's style further in the background, from the moment at which it is shown: the colors under
/// its strokes become more like the painting's. Better looks replace it, by a fade if the entity has a
/// [`StyleTransition`](crate::StyleTransition).
///
/// The bake takes half a minute to minutes, on the threads of [`StyleThreads`](crate::StyleThreads). All
/// entities share them, one after the other. It is canceled if the style, the scene or this component changes,
/// and begins anew. It needs the paintings themselves: see [`paintings`](Self::paintings). A mix with a look is
/// not refined, because a look is baked already. With the source's `content` c, the result is c * base color +
/// (1 - c) * baked color.
///
/// In an app that draws on demand, a better look is shown in the next frame that there is. A bake asks for
/// none.
///
/// It needs threads: in a browser, [`StyleFailed`](crate::StyleFailed) says that there are none, and the style
/// stays as it is.
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[require(Refinement)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleRefine {
    /// Steps of the bake. If it is 0, nothing is refined.
    pub steps: u32,
    /// Number of times that a better look is shown, evenly spread over the steps; at least 1. The last one is
    /// complete.
    pub n_shown: u32,
    /// The paintings and their weights. If it is empty, they are the images of the entity's [`StyleSource`]. A
    /// source with presets is refined only if paintings are given here.
    pub paintings: Vec<(Handle<Image>, f32)>,
}

impl Default for StyleRefine {
    fn default() -> Self {
        // As many steps as a bake takes by itself.
        Self { steps: BakeConfig::default().steps, n_shown: 5, paintings: Vec::new() }
    }
}

/// Sent if a better look of an entity's style is shown from this frame on, or begins to fade in: see
/// [`StyleRefine`].
///
/// Written as a message and triggered on the entity for observers.
#[derive(Message, EntityEvent, Clone, Debug, Reflect)]
#[reflect(Clone, Debug)]
pub struct StyleRefined {
    /// The entity.
    pub entity: Entity,
    /// Steps of the bake so far.
    pub steps: u32,
    /// Whether these are all of them.
    pub is_complete: bool,
}

/// Progress of an entity's refinement.
#[derive(Component, Default)]
pub(crate) enum Refinement {
    /// Nothing is to be refined.
    #[default]
    Idle,
    /// The style that is shown is to be refined.
    Wanted,
    /// A bake is under way. Dropping it cancels it.
    Running(Running),
}

impl Refinement {
    /// Share of the bake that is done, 0..1, or `None` if there is none.
    pub(crate) fn progress(&self) -> Option<f32> {
        match self {
            Self::Idle => None,
            Self::Wanted => Some(0.0),
            Self::Running(running) => Some(running.done()),
        }
    }
}

/// Wants a bake of every style that has just been applied, and if [`StyleRefine`] came or changed.
pub(crate) fn want_refinements(
    mut applied: MessageReader<StyleApplied>,
    mut refined: Query<(&mut Refinement, Ref<StyleRefine>)>,
) {
    for (mut refinement, refine) in &mut refined {
        if refine.is_changed() {
            *refinement = Refinement::Wanted;
        }
    }
    for event in applied.read() {
        if let Ok((mut refinement, _)) = refined.get_mut(event.entity) {
            *refinement = Refinement::Wanted;
        }
    }
}

/// The components of an entity that may be refined. Those of its style are absent if it has none.
type Refined = (
    Entity,
    &'static mut Refinement,
    Option<&'static StyleRefine>,
    Option<(
        &'static StyleSource,
        &'static mut StyleJobs,
        &'static LoadedScene,
        Has<AppliedStyle>,
        Option<&'static StyleTransition>,
    )>,
);

/// Everything that a bake is begun with, except the entity's components.
#[derive(SystemParam)]
pub(crate) struct Means<'w> {
    images: Res<'w, Assets<Image>>,
    server: Res<'w, AssetServer>,
    engine: Res<'w, Engine>,
    workers: Res<'w, Workers>,
}

/// Sends [`StyleRefined`], and keeps [`AppliedStyle`] in step with it.
#[derive(SystemParam)]
pub(crate) struct RefinedEvents<'w, 's> {
    commands: Commands<'w, 's>,
    refined: MessageWriter<'w, StyleRefined>,
}

impl RefinedEvents<'_, '_> {
    /// The entity shows a better look of its style.
    fn send(&mut self, entity: Entity, style: AppliedStyle, steps: u32, is_complete: bool) {
        // Before the event is triggered, so that observers already find the component.
        self.commands.entity(entity).try_insert(style);
        let event = StyleRefined { entity, steps, is_complete };
        self.refined.write(event.clone());
        self.commands.trigger(event);
    }
}

impl StyleJob {
    /// The strokes of the style that is shown.
    fn strokes(&self) -> Option<Arc<Strokes>> {
        match self.worn.top() {
            LayerColors::Style(colors) => colors.strokes.clone(),
            LayerColors::Captured | LayerColors::Mix(_) => None,
        }
    }

    /// Replaces the colors of the style that is shown by better ones.
    fn improve(&mut self, colors: Arc<StyleColors>, transition: Option<&StyleTransition>) {
        self.shown = None;
        self.worn.put_on(LayerColors::Style(colors), transition);
    }
}

/// Begins wanted bakes, cancels those that are out of date, and shows what they give.
pub(crate) fn advance_refinements(
    mut entities: Query<Refined>,
    means: Means,
    mut wanted: ResMut<WantedColors>,
    mut events: StyleEvents,
    mut refined: RefinedEvents,
) {
    for (entity, mut refinement, refine, styled) in &mut entities {
        if matches!(*refinement, Refinement::Idle) {
            continue;
        }
        let (Some(refine), Some((source, mut jobs, scene, is_styled, transition))) = (refine, styled) else {
            *refinement = Refinement::Idle;
            continue;
        };
        let Some(job) = jobs.of_scene.iter_mut().find(|job| job.is_of(scene)) else { continue };
        // Another style is wanted or under way. Once it is shown, it wants a bake of its own.
        if !job.is_settled() || source.is_none() || !is_styled {
            *refinement = Refinement::Idle;
            continue;
        }
        match &mut *refinement {
            Refinement::Idle => {}
            Refinement::Wanted => match means.begin(refine, source, scene, job.strokes()) {
                Ok(Some(begun)) => *refinement = begun,
                Ok(None) => {}
                Err(error) => {
                    *refinement = Refinement::Idle;
                    events.failed(entity, error);
                }
            },
            Refinement::Running(running) => match running.take() {
                None => {}
                Some(Err(error)) => {
                    *refinement = Refinement::Idle;
                    events.failed(entity, Arc::new(error));
                }
                Some(Ok(better)) => {
                    let Better { colors, strokes, steps } = better;
                    if strokes.is_some() {
                        WantedColors::expect_strokes(&mut wanted);
                    }
                    job.improve(StyleColors::known(Arc::clone(&colors), strokes.clone()), transition);
                    let colors = AppliedColors::Known { colors, strokes };
                    let style = AppliedStyle { scene: Arc::clone(scene.scene()), colors };
                    let is_complete = steps == refine.steps;
                    refined.send(entity, style, steps, is_complete);
                    if is_complete {
                        *refinement = Refinement::Idle;
                    }
                }
            },
        }
    }
}

impl Means<'_> {
    /// The bake of a style, or `Ok(None)` while a painting is being loaded.
    fn begin(
        &self,
        refine: &StyleRefine,
        source: &StyleSource,
        scene: &LoadedScene,
        strokes: Option<Arc<Strokes>>,
    ) -> Result<Option<Refinement>, Arc<StyleError>> {
        let handles = paintings(refine, source);
        if handles.is_empty() || refine.steps == 0 {
            return Ok(Some(Refinement::Idle));
        }
        let mut paintings = Vec::with_capacity(handles.len());
        for (handle, weight) in handles {
            let Some(image) = loaded(&self.server, &self.images, handle)? else { return Ok(None) };
            let failed = |found| Arc::new(StyleError::Image { image: image_name(handle), found });
            paintings.push((pixels(image).map_err(failed)?, weight));
        }
        let request = Request {
            scene: Arc::clone(scene.scene()),
            paintings,
            steps: refine.steps,
            n_shown: refine.n_shown.max(1),
            content: f64::from(source.content),
            strokes,
        };
        Ok(Some(Refinement::Running(Running::start(&self.workers, &self.engine, request))))
    }
}

/// The paintings that a style is baked toward, and their weights. None if it cannot be refined: a bake knows
/// whole paintings alone.
fn paintings<'a>(refine: &'a StyleRefine, source: &'a StyleSource) -> Vec<(&'a Handle<Image>, f32)> {
    let used = || source.styles.iter().filter(|style| style.weight > 0.0);
    let is_look =
        |style: &WeightedStyle| matches!(style.input, StyleInput::Look(_) | StyleInput::ChunkLooks(_));
    if source.has_hand() || used().any(is_look) {
        return Vec::new();
    }
    if !refine.paintings.is_empty() {
        return refine.paintings.iter().map(|(handle, weight)| (handle, *weight)).collect();
    }
    let image = |style: &'a WeightedStyle| match &style.input {
        StyleInput::Image(image) => Some((image, style.weight)),
        StyleInput::Preset(_) | StyleInput::Look(_) | StyleInput::ChunkLooks(_) => None,
    };
    used().map(image).collect::<Option<_>>().unwrap_or_default()
}
