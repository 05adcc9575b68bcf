//! Components that runs get from their world: its style, and those that hold for all of it.

use std::sync::Arc;

use bevy::{ecs::entity::EntityHashMap, prelude::*};

use super::{
    budget::{GaussianBudget, within},
    looks::{Given, RunLook},
    reference::{IsReference, Painted, Reference},
    tree::{Run, Tree},
};
use crate::{
    scene::LoadedScene,
    style::{Beside, PaintedBeside, StyleJobs, StyleSource, StyleTransition},
    work::StyleThreads,
};

/// Gaussians that are painted at a time, for each thread: what waits longer can be overtaken by what a camera
/// turned to. A scene of 70,000 takes 1.5 s of processor time, so these take a fifth of a second of one core.
const AT_ONCE: usize = 8192;

/// The Gaussians as which a smaller run counts: its job and its buffers on the GPU cost time whatever its size.
/// A frame of 16 ms hands over 64 of them for each thread at most, as many as jobs of a quarter of a
/// millisecond fill.
const LEAST: usize = 128;

/// The components of a run that say how it is styled.
pub(super) type StyleState =
    (Option<&'static StyleSource>, Option<&'static StyleJobs>, Option<&'static RunLook>);

/// The same, as a query gives them.
type StyleStateItem<'a> = (Option<&'a StyleSource>, Option<&'a StyleJobs>, Option<&'a RunLook>);

/// The style of a world.
#[derive(Clone, Copy)]
pub(super) struct Styling<'a> {
    pub(super) source: Option<&'a StyleSource>,
    /// Whether nothing is shown before it is styled.
    pub(super) hides: bool,
}

impl Styling<'_> {
    /// Whether a run in this state shows the style, or has failed to.
    pub(super) fn is_worn(&self, &(own, jobs, look): &StyleStateItem<'_>) -> bool {
        let Some(source) = self.source.filter(|source| !source.is_none()) else { return true };
        match Given::of(source, look) {
            Given::There(look) => own.is_some_and(|own| own.is_part_of(source, look)) && !is_busy(jobs),
            Given::Awaited => false,
            Given::Absent => true,
        }
    }

    /// Whether a run in this state may be shown. The first one of a node takes nothing away.
    pub(super) fn allows(&self, state: &StyleStateItem<'_>, is_first: bool) -> bool {
        (is_first && !self.hides) || self.is_worn(state)
    }
}

/// Whether a style is on its way.
fn is_busy(jobs: Option<&StyleJobs>) -> bool {
    // Without a job, its scene is not attached yet.
    jobs.is_none_or(|jobs| jobs.of_scene.is_empty() || !jobs.of_scene.iter().all(|job| job.is_settled()))
}

/// A world and its style.
type StyledWorld = (Entity, &'static mut Tree, Option<Ref<'static, StyleSource>>);

/// A run, whether it is shown, its style, its look, and its scene.
type StyledRun = (
    Entity,
    (&'static Run, &'static Visibility),
    Option<&'static mut StyleSource>,
    (Option<&'static StyleJobs>, Option<&'static RunLook>, Option<&'static LoadedScene>),
);

/// Gives runs the style of their world, some at a time: those that are seen first, of these the ones that are
/// shown, since others wait behind coarser ones that may have it, and then the largest on screen.
pub(super) fn style_runs(
    mut commands: Commands,
    mut worlds: Query<StyledWorld, Without<Run>>,
    references: Query<StyleState, (With<IsReference>, Without<Run>)>,
    mut runs: Query<StyledRun>,
    styled: Query<(), (With<Run>, With<StyleSource>)>,
    budget: Res<GaussianBudget>,
    threads: Res<StyleThreads>,
) {
    // In worlds as captured, there are thousands of runs with nothing to do.
    if styled.is_empty() && worlds.iter().all(|(.., source)| source.is_none_or(|source| source.is_none())) {
        return;
    }
    // The painted scenes of the worlds whose runs can be painted.
    let mut ready: EntityHashMap<Option<Arc<Beside>>> = EntityHashMap::default();
    for (world, mut tree, source) in &mut worlds {
        let Some(source) = source.filter(|source| !source.is_none()) else { continue };
        if let Some(beside) = tree.beside(&source, &references, &mut commands) {
            ready.insert(world, beside);
        }
    }
    let most = threads.count.max(1).saturating_mul(AT_ONCE).min(budget.per_frame);
    let (mut waiting, mut painting) = (Vec::new(), (most, 0));
    for (entity, (run, visibility), own, (jobs, look, loaded)) in &mut runs {
        let Ok((_, tree, source)) = worlds.get(run.world) else { continue };
        let is_changed = source.as_ref().is_some_and(|source| source.is_changed());
        let source = source.as_deref();
        let (source, look) = match source.map_or(Given::There(None), |source| Given::of(source, look)) {
            Given::There(look) => (source, look),
            // What is shown stays until then.
            Given::Awaited => continue,
            // It is shown as captured.
            Given::Absent => (None, None),
        };
        match (source, own) {
            (None, None) => {}
            (None, Some(_)) => {
                commands.entity(entity).try_remove::<(StyleSource, PaintedBeside)>();
            }
            (Some(source), None) if source.is_none() => {}
            // Knobs take no time, nor does a style that goes.
            (Some(source), Some(mut own)) if source.is_none() || own.is_part_of(source, look) => {
                // With looks, it is a copy.
                if is_changed || own.is_changed() {
                    own.set_if_neq(source.for_part(look).into_owned());
                }
                if !source.is_none() && jobs.is_none_or(StyleJobs::are_computing) {
                    painting.1 += counted(loaded);
                }
            }
            (Some(_), _) if ready.contains_key(&run.world) => {
                let (is_seen, pixels) = tree.turn(run.node);
                waiting.push((is_seen, *visibility == Visibility::Hidden, pixels, entity));
            }
            (Some(_), _) => {}
        }
    }
    waiting.sort_unstable();
    for (.., entity) in waiting {
        let Ok((_, (run, _), _, (_, look, loaded))) = runs.get(entity) else { continue };
        let (Ok((_, _, Some(source))), Some(beside)) = (worlds.get(run.world), ready.get(&run.world)) else {
            continue;
        };
        let Given::There(look) = Given::of(&source, look) else { continue };
        if !within(&mut painting, counted(loaded)) {
            break;
        }
        let mut run = commands.entity(entity);
        run.try_insert(source.for_part(look).into_owned());
        match beside {
            Some(beside) => run.try_insert(PaintedBeside(Arc::clone(beside))),
            None => run.try_remove::<PaintedBeside>(),
        };
    }
}

/// The Gaussians as which a run counts.
fn counted(loaded: Option<&LoadedScene>) -> usize {
    loaded.map_or(0, |loaded| loaded.scene().len()).max(LEAST)
}

impl Tree {
    /// The painted scene that runs of this style are parts of, `Some(None)` if there is none, or `None` while
    /// it is on its way.
    fn beside(
        &mut self,
        source: &StyleSource,
        references: &Query<StyleState, (With<IsReference>, Without<Run>)>,
        commands: &mut Commands,
    ) -> Option<Option<Arc<Beside>>> {
        if source.folder_of_looks().is_some() {
            return Some(None);
        }
        let (child, painted) = match &mut self.reference {
            None | Some(Reference::Gathering(_)) => return None,
            Some(Reference::Absent) => return Some(None),
            Some(Reference::There { child, painted }) => (*child, painted),
        };
        let (own, jobs, _) = references.get(child).ok()?;
        if !own.is_some_and(|own| own.is_computed_like(source)) {
            commands.entity(child).try_insert(source.clone());
            return None;
        }
        let shown = jobs.filter(|jobs| !is_busy(Some(*jobs)))?.shown();
        // One that failed shows none, or the one before.
        let Some(style) = shown else { return Some(None) };
        if painted.as_ref().is_none_or(|painted| !Arc::ptr_eq(&painted.style, style)) {
            let beside = style.to_others().map(Arc::new);
            *painted = Some(Painted { style: Arc::clone(style), beside });
        }
        Some(painted.as_ref()?.beside.clone())
    }
}

/// A run came, or the component of a world or of a run came or changed.
type IsHandedDown<C> = Or<(Added<Run>, Changed<C>)>;

/// Gives a component of a world to its runs, and takes it from them if it goes.
pub(super) fn hand_down<C: Component + Clone>(
    mut commands: Commands,
    worlds: Query<Ref<C>, Without<Run>>,
    runs: Query<(Entity, Ref<Run>, Has<C>)>,
    changed: Query<(), IsHandedDown<C>>,
    mut removed: RemovedComponents<C>,
) {
    // There are thousands of runs, and mostly nothing to hand down.
    if removed.read().count() == 0 && changed.is_empty() {
        return;
    }
    for (entity, run, has) in &runs {
        match worlds.get(run.world) {
            Ok(given) if given.is_changed() || run.is_added() => {
                commands.entity(entity).try_insert(C::clone(&given));
            }
            Err(_) if has => {
                commands.entity(entity).try_remove::<C>();
            }
            _ => {}
        }
    }
}

/// A run was shown or hidden, or a transition came or changed.
type IsTransitionHandedDown = Or<(Changed<StyleTransition>, (With<Run>, Changed<Visibility>))>;

/// The same for transitions, once a run is shown: it appears in its style.
pub(super) fn hand_down_transitions(
    mut commands: Commands,
    worlds: Query<Ref<StyleTransition>, Without<Run>>,
    runs: Query<(Entity, &Run, Ref<Visibility>, Has<StyleTransition>)>,
    changed: Query<(), IsTransitionHandedDown>,
    mut removed: RemovedComponents<StyleTransition>,
) {
    if removed.read().count() == 0 && changed.is_empty() {
        return;
    }
    for (entity, run, visibility, has) in &runs {
        match worlds.get(run.world) {
            _ if *visibility == Visibility::Hidden => {}
            Ok(given) if given.is_changed() || visibility.is_changed() => {
                commands.entity(entity).try_insert(StyleTransition::clone(&given));
            }
            Err(_) if has => {
                commands.entity(entity).try_remove::<StyleTransition>();
            }
            _ => {}
        }
    }
}
