//! The left mouse button with a tool: brush, selections and volumes.

use bevy::{ecs::system::SystemParam, prelude::*};
use bevy_egui::input::EguiWantsInput;
use bevy_stylegaussian::{
    SplatRayCast,
    mask::{StyleMask, lasso_in_view},
    style::StylePin,
    stylegaussian::{
        layers::{Region, Shape},
        mask::{Brush, CHANNELS, Combine, Selection},
    },
};
use stylegaussian_app::{Orbit, Subject};

use crate::{
    panel::{Notice, Panel},
    parts::{Parts, Tool},
    scene::ShownScene,
    styles::Styles,
};

/// Least distance between points of a lasso.
const LASSO_STEP: f32 = 4.0;

/// The cursor over the picture.
#[derive(SystemParam)]
pub struct Pointer<'w, 's> {
    buttons: Res<'w, ButtonInput<MouseButton>>,
    window: Single<'w, 's, &'static Window>,
    camera: Single<'w, 's, (&'static Camera, &'static GlobalTransform), With<Orbit>>,
    panel: Res<'w, Panel>,
    egui: Res<'w, EguiWantsInput>,
}

impl Pointer<'_, '_> {
    /// The cursor, if it is on the picture and not on the panel.
    fn on_picture(&self) -> Option<Vec2> {
        let cursor = self.window.cursor_position()?;
        (cursor.x >= self.panel.width() && !self.egui.wants_any_pointer_input()).then_some(cursor)
    }

    fn ray(&self, cursor: Vec2) -> Option<Ray3d> {
        let (camera, place) = *self.camera;
        camera.viewport_to_world(place, cursor).ok()
    }
}

/// Uses the tool.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub fn apply(
    pointer: Pointer,
    mut rays: SplatRayCast,
    mut parts: ResMut<Parts>,
    scene: Res<ShownScene>,
    mut styles: ResMut<Styles>,
    cloud: Single<(&mut StyleMask, &GlobalTransform), With<Subject>>,
    mut notice: ResMut<Notice>,
    mut began_on_picture: Local<bool>,
) {
    // Masks and pins are of single scenes.
    if scene.is_world && parts.tool != Tool::Volume {
        return;
    }
    // The index is there before the first stroke.
    rays.prepare();
    if parts.tool == Tool::View {
        return;
    }
    let (mut mask, transform) = cloud.into_inner();
    let left = MouseButton::Left;
    if pointer.buttons.just_pressed(left) {
        *began_on_picture = pointer.on_picture().is_some();
    }
    if pointer.buttons.just_released(left) {
        let before = mask.undo_len().0;
        mask.end_stroke();
        let ended = mask.undo_len().0 - before;
        parts.note_mask(ended);
        let line = std::mem::take(&mut parts.lasso);
        let (camera, place) = *pointer.camera;
        if let Some(lasso) = lasso_in_view(camera, place, transform, &line).filter(|_| line.len() > 2) {
            select(&mut parts, &mut mask, &Selection::Lasso(lasso), &styles, &mut notice);
        }
        return;
    }
    if !pointer.buttons.pressed(left) || !*began_on_picture {
        return;
    }
    let Some(cursor) = pointer.on_picture() else { return };
    if parts.tool == Tool::Lasso {
        if parts.lasso.last().is_none_or(|last| last.distance(cursor) >= LASSO_STEP) {
            parts.lasso.push(cursor);
        }
        return;
    }
    let Some(hit) = pointer.ray(cursor).and_then(|ray| rays.cast_ray(ray)) else { return };
    // Masks live in the space of the scene.
    let at = transform.affine().inverse().transform_point3(hit.position);
    let radius = parts.radius * scene.framing.radius;
    match parts.tool {
        Tool::Brush => {
            let Some(channel) = channel(&mut parts, &mut mask, &styles, &mut notice) else { return };
            mask.stroke_to(&brush(&parts, channel, radius), at);
        }
        Tool::Ball | Tool::Box if pointer.buttons.just_pressed(left) => {
            let shape = match parts.tool {
                Tool::Ball => Shape::Ellipsoid { radii: Vec3::splat(radius) },
                _ => Shape::Cuboid { half_size: Vec3::splat(radius) },
            };
            let shape_from_scene = bevy::math::Affine3A::from_translation(-at);
            let region = Region { shape, shape_from_scene, softness: parts.softness * radius };
            select(&mut parts, &mut mask, &Selection::Region(region), &styles, &mut notice);
        }
        Tool::Volume => {
            let chosen = parts.chosen;
            if let Some(volume) = chosen.and_then(|chosen| parts.volumes.get_mut(chosen)) {
                volume.center = hit.position;
            }
        }
        Tool::Pin if pointer.buttons.just_pressed(left) => {
            let spot = styles.spot;
            match spot {
                Some((style, place)) => styles.pins.push((style, StylePin { at, place, painting: 0 })),
                None => notice.fail("expected a click on a painting in the panel first".into()),
            }
        }
        _ => {}
    }
}

/// The brush with the panel's settings. It replaces the weights of other channels.
fn brush(parts: &Parts, channel: usize, radius: f32) -> Brush {
    Brush {
        radius,
        softness: parts.softness,
        strength: parts.strength,
        channel,
        lessens: std::array::from_fn(|other| other != channel),
        erases: parts.erases,
    }
}

/// Selects a part in the chosen style, or takes it away if the tool erases.
fn select(parts: &mut Parts, mask: &mut StyleMask, part: &Selection, styles: &Styles, notice: &mut Notice) {
    let Some(channel) = channel(parts, mask, styles, notice) else { return };
    let before = mask.undo_len().0;
    for other in 0..CHANNELS {
        let combine = if other == channel && !parts.erases { Combine::Add } else { Combine::Subtract };
        // As for the brush: erasing leaves other channels as they are.
        if other == channel || !parts.erases {
            mask.select(other, part, combine);
        }
    }
    parts.note_mask(mask.undo_len().0 - before);
}

/// The channel of the chosen style, which gets the style's name.
fn channel(parts: &mut Parts, mask: &mut StyleMask, styles: &Styles, notice: &mut Notice) -> Option<usize> {
    let Some(channel) = parts.channel() else {
        notice.fail(format!("a scene can be painted in {CHANNELS} styles; clear the paint to begin anew"));
        return None;
    };
    let name = parts.style.map_or("captured", |style| &styles.list[style].name);
    if mask.mask().is_some_and(|painted| painted.names[channel] != name) {
        mask.set_name(channel, name);
    }
    Some(channel)
}
