//! The light on the thickness of paint, as a slider sets it.

use bevy::prelude::*;
use bevy_stylegaussian::style::StyleRelief;

/// Relief of this factor, 0 to 4, in a light that is as high as it is far. `degrees` are around the world's y
/// axis, from x on.
pub fn relief_lit_from(degrees: f32, amount: f32) -> StyleRelief {
    let to_light = Quat::from_rotation_y(degrees.to_radians()) * Vec3::new(1.0, 1.0, 0.0);
    StyleRelief::lit_from(to_light).with_amount(amount)
}
