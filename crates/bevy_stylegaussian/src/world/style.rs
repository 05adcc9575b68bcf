//! Components that runs get from their world: its style, and those that hold for all of it.

use std::sync::Arc;

use bevy::prelude::*;

use super::{
    looks::{Given, RunLook},
    reference::{IsReference, Painted, Reference},
    tree::{Run, Tree},
};
use crate::style::{Beside, PaintedBeside, StyleJobs, StyleSource, StyleTransition};

/// Runs that are styled at a time. A lane of threads does one thing after another, and has the next ones in
/// time; what waits longer can be overtaken by what a camera turned to.
const AT_ONCE: usize = 4;

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

/// A run, its style, and its look.
type StyledRun = (
    Entity,
    &'static Run,
    Option<&'static mut StyleSource>,
    Option<&'static StyleJobs>,
    Option<&'static RunLook>,
);

/// Gives runs the style of their world: those that are largest on screen first, a few at a time.
pub(super) fn style_runs(
    mut commands: Commands,
    mut worlds: Query<(&mut Tree, Option<&StyleSource>), Without<Run>>,
    references: Query<StyleState, (With<IsReference>, Without<Run>)>,
    mut runs: Query<StyledRun>,
) {
    let (mut waiting, mut n_busy) = (Vec::new(), 0);
    for (entity, run, own, jobs, look) in &mut runs {
        let Ok((mut tree, source)) = worlds.get_mut(run.world) else { continue };
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
                let wanted = source.for_part(look);
                if *own != *wanted {
                    *own = wanted.into_owned();
                }
                n_busy += usize::from(!source.is_none() && is_busy(jobs));
            }
            (Some(source), _) => {
                if tree.beside(source, &references, &mut commands).is_some() {
                    let node = run.node.and_then(|node| tree.nodes.get(node));
                    // Surroundings are everywhere.
                    let pixels = node.map_or(f32::MAX, |node| node.pixels);
                    waiting.push((pixels, entity, run.world, look.cloned()));
                }
            }
        }
    }
    waiting.sort_by(|(a, first, ..), (b, second, ..)| b.total_cmp(a).then(first.cmp(second)));
    for (_, entity, world, look) in waiting.into_iter().take(AT_ONCE.saturating_sub(n_busy)) {
        let Ok((mut tree, Some(source))) = worlds.get_mut(world) else { continue };
        let beside = tree.beside(source, &references, &mut commands).flatten();
        let mut run = commands.entity(entity);
        run.try_insert(source.for_part(look.as_ref()).into_owned());
        match beside {
            Some(beside) => {
                run.try_insert(PaintedBeside(beside));
            }
            None => {
                run.try_remove::<PaintedBeside>();
            }
        }
    }
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

/// Gives a component of a world to its runs, and takes it from them if it goes.
pub(super) fn hand_down<C: Component + Clone>(
    mut commands: Commands,
    worlds: Query<Ref<C>, Without<Run>>,
    runs: Query<(Entity, Ref<Run>, Has<C>)>,
) {
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

/// The same for transitions, once a run is shown: it appears in its style.
pub(super) fn hand_down_transitions(
    mut commands: Commands,
    worlds: Query<Ref<StyleTransition>, Without<Run>>,
    runs: Query<(Entity, &Run, Ref<Visibility>, Has<StyleTransition>)>,
) {
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
