//! The world that is shown: levels of detail at an address, which are fetched as the camera needs them.

use std::time::Duration;

use bevy::prelude::*;
use bevy_stylegaussian::{
    GaussianSplats, GaussianWorld, StyleSource,
    style::WeightedStyle,
    world::{GaussianBudget, GaussianWorldFailed, WorldManifest, WorldState},
};
use stylegaussian_app::{Framing, Orbit, Subject};

use crate::{
    bridge::{self, Event, Request},
    scene::Shown,
    style::Wish,
};

/// Shows the next world once its manifest is loaded, and moves the camera to see all of it.
pub fn show_loaded(
    mut commands: Commands,
    mut shown: ResMut<Shown>,
    subject: Single<(Entity, &mut Transform), With<Subject>>,
    view: Single<(&mut Orbit, &Camera)>,
    manifests: Res<Assets<WorldManifest>>,
    mut wish: ResMut<Wish>,
    assets: Res<AssetServer>,
) {
    let (handle, manifest) = match shown.take_world(&manifests, &assets) {
        None => return,
        Some(Ok(found)) => found,
        Some(Err(error)) => return bridge::tell(Event::Failed, &error),
    };
    let levels = manifest.levels();
    let framing = Framing::of_world(levels);
    let (mut orbit, camera) = view.into_inner();
    *orbit = framing.orbit(camera);
    let (entity, mut transform) = subject.into_inner();
    *transform = Transform::from_rotation(framing.world_from_scene());
    commands.entity(entity).remove::<GaussianSplats>().insert(GaussianWorld(handle));
    // Chunks have no features.
    bridge::tell(Event::Loaded, &format!("{} false", levels.count(0)));
    wish.forget_decoded();
    wish.is_due = true;
}

/// Changes the budget of worlds.
pub fn set_budget(mut requests: MessageReader<Request>, mut budget: ResMut<GaussianBudget>) {
    for request in requests.read() {
        if let Request::WorldBudget(gaussians) = request {
            *budget = GaussianBudget::new(*gaussians);
        }
    }
}

/// Events that were told of a world since it was opened.
#[derive(Default)]
pub struct Told {
    /// Whether all of it was seen once.
    is_shown: bool,
    /// The style that was asked for last.
    styles: Vec<WeightedStyle>,
    content: f32,
    /// When it was, until all that is shown has it.
    styled_since: Option<Duration>,
}

/// A world, its counts and its style.
type FollowedWorld = (Ref<'static, GaussianWorld>, &'static WorldState, &'static StyleSource);

/// Tells once that a world is drawn, and after each change of style how long it took to reach all that is
/// shown. Notes the counts.
pub fn follow(
    world: Option<Single<FollowedWorld, With<Subject>>>,
    mut told: Local<Option<Told>>,
    time: Res<Time<Real>>,
) {
    let Some(world) = world else {
        if told.take().is_some() {
            bridge::note_world(None);
        }
        return;
    };
    let (world, state, source) = world.into_inner();
    bridge::note_world(Some(state));
    // The same one may be opened again.
    if world.is_changed() {
        *told = None;
    }
    let told = told.get_or_insert_default();
    if !told.is_shown && state.shown_parts > 0 && state.waiting == 0 {
        told.is_shown = true;
        bridge::tell(Event::Shown, "");
    }
    if told.styles != source.styles || told.content != source.content {
        (told.styles, told.content) = (source.styles.clone(), source.content);
        told.styled_since = Some(time.elapsed());
    }
    let is_worn = told.is_shown && state.is_settled();
    if let Some(since) = told.styled_since.take_if(|_| is_worn) {
        bridge::tell(Event::Applied, &time.elapsed().saturating_sub(since).as_millis().to_string());
    }
}

/// Tells which file of a world cannot be had.
pub fn tell_failed(failed: On<GaussianWorldFailed>) {
    bridge::tell(Event::Failed, &failed.error);
}
