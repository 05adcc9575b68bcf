//! Two eyes of one head.

use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{extract_component::ExtractComponent, sync_world::MainEntityHashSet, view::RetainedViewEntity},
};

use super::view::ViewSplats;

/// The other eye of the same head: another camera. A component of one of the two cameras, or of both.
///
/// The two share all that does not depend on the eye: which splats are seen, their colors, and their order, by
/// the distance from the middle between the eyes ([`SplatSortKey`](super::SplatSortKey) has no effect). Each
/// splat then has one color and one place in the order for both eyes. Each eye keeps its own projection, off
/// axis or not, its own viewport and its own target, such as a texture of a headset's runtime
/// (`ManualTextureViews`), and is drawn from where the render world has it before views are prepared.
/// `MainPassResolutionOverride` has it draw fewer pixels.
///
/// If the other camera does not exist, is not active, sees no splats or has a parallel projection, either
/// camera draws by itself.
#[derive(Component, ExtractComponent, Clone, Copy, Debug, PartialEq, Eq, Hash, Reflect)]
#[extract_component_filter(With<Camera3d>)]
#[require(Camera3d)]
#[reflect(Component, Clone, Debug, PartialEq)]
pub struct SplatEyes(#[entities] pub Entity);

/// The place of a view in a pair of eyes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pair {
    /// The view of the other eye.
    pub(super) other: RetainedViewEntity,
    /// Whether the order is kept with this view. It is the same one in every frame.
    pub(super) is_first: bool,
}

/// Whether a view is drawn at half the size.
fn is_half(view: &ViewSplats) -> bool {
    view.plan.is_some_and(|plan| plan.settings.half_size)
}

/// Pairs the views that `eyes` names: each view and the camera of its other eye. Both then show what either
/// sees. Views without a plan stay alone.
pub(super) fn pair(
    of_view: &mut HashMap<RetainedViewEntity, ViewSplats>,
    eyes: &[(RetainedViewEntity, SplatEyes)],
) {
    let is_free =
        |view: Option<&ViewSplats>| view.is_some_and(|view| view.plan.is_some() && view.pair.is_none());
    for &(own, SplatEyes(camera)) in eyes {
        let is_other = |key: &&RetainedViewEntity| key.main_entity.id() == camera && **key != own;
        let Some(other) = of_view.keys().find(is_other).copied() else { continue };
        if !is_free(of_view.get(&own)) || !is_free(of_view.get(&other)) {
            continue;
        }
        // Both are projected by the settings of one.
        let [own_is_half, other_is_half] = [&own, &other].map(|view| of_view.get(view).is_some_and(is_half));
        if own_is_half != other_is_half {
            continue;
        }
        let own_is_first = own.main_entity < other.main_entity;
        let [first, second] = if own_is_first { [own, other] } else { [other, own] };
        let mut clouds = of_view.get(&first).map(|view| view.clouds.clone()).unwrap_or_default();
        let beside = of_view.get(&second).map(|view| view.clouds.as_slice()).unwrap_or_default();
        let seen: MainEntityHashSet = clouds.iter().copied().collect();
        clouds.extend(beside.iter().filter(|cloud| !seen.contains(*cloud)));
        for (key, other, is_first) in [(first, second, true), (second, first, false)] {
            if let Some(view) = of_view.get_mut(&key) {
                view.clouds.clone_from(&clouds);
                view.pair = Some(Pair { other, is_first });
            }
        }
    }
}
