//! What runs have of their world: its style, and the other components that hold for all of it.

use bevy::prelude::*;

use super::tree::{Run, Tree};
use crate::style::{StyleJobs, StyleSource, StyleTransition};

/// Runs that are styled at a time. A lane of threads does one thing after another, and has the next ones in
/// time; what waits longer can be overtaken by what a camera turned to.
const AT_ONCE: usize = 4;

/// The components of a run that say how it is styled.
pub(super) type StyleState = (Option<&'static StyleSource>, Option<&'static StyleJobs>);

/// The style of a world.
#[derive(Clone, Copy)]
pub(super) struct Styling<'a> {
    pub(super) source: Option<&'a StyleSource>,
    /// Whether nothing is shown before it is styled.
    pub(super) hides: bool,
}

impl Styling<'_> {
    /// Whether a run in this state shows the style, or has failed to.
    pub(super) fn is_worn(&self, (own, jobs): &(Option<&StyleSource>, Option<&StyleJobs>)) -> bool {
        let Some(source) = self.source.filter(|source| !source.is_none()) else { return true };
        own.is_some_and(|own| own.is_computed_like(source)) && !is_busy(*jobs)
    }

    /// Whether a run in this state may be shown. The first one of a node takes nothing away.
    pub(super) fn allows(&self, state: &(Option<&StyleSource>, Option<&StyleJobs>), is_first: bool) -> bool {
        (is_first && !self.hides) || self.is_worn(state)
    }
}

/// Whether a style is on its way.
fn is_busy(jobs: Option<&StyleJobs>) -> bool {
    // Without a job, its scene is not attached yet.
    jobs.is_none_or(|jobs| jobs.of_scene.is_empty() || !jobs.of_scene.iter().all(|job| job.is_settled()))
}

/// A run, and its style.
type StyledRun = (Entity, &'static Run, Option<&'static mut StyleSource>, Option<&'static StyleJobs>);

/// Gives runs the style of their world: those that are largest on screen first, a few at a time.
pub(super) fn style_runs(
    mut commands: Commands,
    worlds: Query<(&Tree, Option<&StyleSource>), Without<Run>>,
    mut runs: Query<StyledRun>,
) {
    let (mut waiting, mut n_busy) = (Vec::new(), 0);
    for (entity, run, own, jobs) in &mut runs {
        let Ok((tree, source)) = worlds.get(run.world) else { continue };
        match (source, own) {
            (None, None) => {}
            (None, Some(_)) => {
                commands.entity(entity).try_remove::<StyleSource>();
            }
            (Some(source), None) if source.is_none() => {}
            // Knobs and a style that goes take no time, and one that nobody wants any more is not computed.
            (Some(source), Some(mut own))
                if source.is_none() || own.is_computed_like(source) || is_busy(jobs) =>
            {
                if *own != *source {
                    own.clone_from(source);
                }
                n_busy += usize::from(!source.is_none() && is_busy(jobs));
            }
            (Some(source), _) => {
                let node = run.node.and_then(|node| tree.nodes.get(node));
                // Surroundings are everywhere.
                waiting.push((node.map_or(f32::MAX, |node| node.pixels), entity, source));
            }
        }
    }
    waiting.sort_by(|(a, first, _), (b, second, _)| b.total_cmp(a).then(first.cmp(second)));
    for (_, entity, source) in waiting.into_iter().take(AT_ONCE.saturating_sub(n_busy)) {
        commands.entity(entity).try_insert(source.clone());
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
