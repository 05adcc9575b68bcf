//! A GPU that fails: a sentence on the page, and the app goes on.

use bevy::{
    prelude::*,
    render::{
        error_handler::{ErrorType, RenderError, RenderErrorHandler, RenderErrorPolicy},
        settings::RenderCreation,
    },
};
use bevy_stylegaussian::{GaussianSplats, GaussianWorld, world::GaussianBudget};
use stylegaussian_app::Subject;

use crate::bridge::{self, Event};

/// The fewest Gaussians to which the budget of a world is halved: a twentieth of a browser's usual one. Several
/// frames may fail before the first half has left memory.
const FEWEST: usize = 50_000;

/// The handler of errors of the GPU. Bevy's own ends the app.
pub fn handler() -> RenderErrorHandler {
    RenderErrorHandler(handle)
}

fn handle(error: &RenderError, main_world: &mut World, _: &mut World) -> RenderErrorPolicy {
    match error.ty {
        // Browsers take the GPU away from pages, for instance when a laptop changes its GPU. Scenes and styles
        // are kept on the CPU, and go to the new device.
        ErrorType::DeviceLost => {
            bridge::tell(Event::Failed, "The browser took the GPU away. The scene is set up again.");
            RenderErrorPolicy::Recover(RenderCreation::default())
        }
        ErrorType::OutOfMemory => {
            bridge::tell(Event::Failed, free(main_world));
            RenderErrorPolicy::Ignore
        }
        ErrorType::Validation | ErrorType::Internal => {
            bridge::tell(Event::Failed, &format!("The GPU refused a command: {}", error.description));
            RenderErrorPolicy::StopRendering
        }
    }
}

/// Shows no scene, or less of a world, so that memory is free again. Returns what to tell.
fn free(main_world: &mut World) -> &'static str {
    let mut worlds = main_world.query_filtered::<(), (With<Subject>, With<GaussianWorld>)>();
    if worlds.iter(main_world).next().is_some() {
        let budget = main_world.get_resource_or_init::<GaussianBudget>().into_inner();
        let Some(half) = halved(*budget) else {
            return "The GPU has no memory left, and no less of the world can be shown. Close other pages \
                    and programs that use the GPU.";
        };
        *budget = half;
        return "The GPU has no memory left. Less of the world is shown.";
    }
    let mut scenes = main_world.query_filtered::<&mut GaussianSplats, With<Subject>>();
    scenes.iter_mut(main_world).for_each(|mut scene| *scene = GaussianSplats::default());
    "The GPU has no memory left for this scene. Open a smaller one."
}

/// Half of a budget, but not fewer than [`FEWEST`]; `None` if it has no more.
fn halved(budget: GaussianBudget) -> Option<GaussianBudget> {
    (budget.gaussians > FEWEST).then(|| GaussianBudget::new((budget.gaussians / 2).max(FEWEST)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_halved_down_to_the_fewest() {
        let of = |gaussians: usize| halved(GaussianBudget::new(gaussians)).map(|half| half.gaussians);
        assert_eq!([1_000_000, 80_000].map(of), [Some(500_000), Some(50_000)]);
        assert_eq!([50_000, 7_000, 0].map(of), [None; 3]);
    }
}
