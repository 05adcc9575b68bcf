//! The world that is shown: levels of detail at an address, which are fetched as the camera needs them.

use std::time::Duration;

use bevy::prelude::*;
use bevy_stylegaussian::{
    GaussianWorld, StyleSource,
    style::WeightedStyle,
    world::{GaussianWorldFailed, WorldState},
};
use stylegaussian_app::Subject;

use crate::bridge::{self, Event};

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
