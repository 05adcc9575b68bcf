//! Progress of styles that are on their way.

use bevy::prelude::*;

use crate::style::make::{job::StyleJobs, refine::Refinement, surfaces::Surfaces};

/// Progress of an entity's style: there as long as a style is on its way or is refined.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[reflect(Component, Clone, Debug, Default, PartialEq)]
pub struct StyleProgress {
    /// Share of the style's computation that is done, 0..1, or `None` if none is on its way.
    pub style: Option<f32>,
    /// Share of the bake of a `StyleRefine` that is done, 0..1, or `None` if there is none, as always without
    /// the feature `refine`.
    pub refine: Option<f32>,
}

/// The components that progress is told of.
type Entities = (Entity, &'static StyleJobs, Option<&'static Refinement>, Option<&'static mut StyleProgress>);

/// Tells progress.
pub(crate) fn report_progress(
    mut commands: Commands,
    mut entities: Query<Entities>,
    surfaces: Res<Surfaces>,
) {
    for (entity, jobs, refinement, told) in &mut entities {
        let style = jobs.of_scene.iter().filter_map(|job| job.progress(&surfaces)).reduce(f32::min);
        let progress = StyleProgress { style, refine: refinement.and_then(Refinement::progress) };
        match told {
            Some(_) if progress == StyleProgress::default() => {
                commands.entity(entity).try_remove::<StyleProgress>();
            }
            Some(mut told) => {
                told.set_if_neq(progress);
            }
            None if progress == StyleProgress::default() => {}
            None => {
                commands.entity(entity).try_insert(progress);
            }
        }
    }
}
