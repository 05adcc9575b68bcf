//! Light, air, and the size at which splats are drawn: the panel's section for them, and what it changes.

use bevy::prelude::*;
use bevy_egui::egui::{Checkbox, Grid, Slider, Ui};
use bevy_stylegaussian::{SplatTint, splats::SplatCuts};
use stylegaussian_app::{Orbit, Subject};

use crate::scene::ShownScene;

/// The color of fog, near the horizon of the backdrop.
const FOG: Color = Color::srgb(0.74, 0.80, 0.85);

/// The settings.
#[derive(Resource, Clone, Copy, PartialEq)]
pub struct Light {
    /// In stops.
    exposure: f32,
    saturation: f32,
    /// Density of the fog over the radius of the scene.
    fog: f32,
    /// Whether splats are drawn at half the width and height.
    half_size: bool,
}

impl Default for Light {
    fn default() -> Self {
        Self { exposure: 0.0, saturation: 1.0, fog: 0.0, half_size: false }
    }
}

/// Draws the section.
pub fn draw(ui: &mut Ui, light: &mut Light) {
    ui.collapsing("light", |ui| {
        Grid::new("light").num_columns(2).show(ui, |ui| {
            ui.label("exposure").on_hover_text("how much brighter or darker the scene is, in stops");
            ui.add(Slider::new(&mut light.exposure, -4.0..=4.0).fixed_decimals(1));
            ui.end_row();
            ui.label("saturation").on_hover_text("how far its colors are from gray");
            ui.add(Slider::new(&mut light.saturation, 0.0..=2.0).fixed_decimals(2));
            ui.end_row();
            ui.label("fog").on_hover_text("how dense the air is before it");
            ui.add(Slider::new(&mut light.fog, 0.0..=1.0).fixed_decimals(2));
            ui.end_row();
            ui.label("size").on_hover_text("for weak GPUs: a quarter of the pixels");
            ui.add(Checkbox::new(&mut light.half_size, "half"));
            ui.end_row();
        });
    });
}

/// Applies the settings if they changed, or if another scene has another size.
pub fn show(
    mut commands: Commands,
    light: Res<Light>,
    shown: Res<ShownScene>,
    scene: Single<Entity, With<Subject>>,
    camera: Single<Entity, With<Orbit>>,
    mut last: Local<Option<(Light, f32)>>,
) {
    let now = (*light, shown.framing.radius);
    if last.replace(now) == Some(now) {
        return;
    }
    let tint = SplatTint { exposure: light.exposure, saturation: light.saturation, ..default() };
    commands.entity(*scene).insert(tint);
    let mut camera = commands.entity(*camera);
    camera.insert(SplatCuts { half_size: light.half_size, ..default() });
    if light.fog > 0.0 {
        let density = light.fog / shown.framing.radius;
        let falloff = FogFalloff::ExponentialSquared { density };
        camera.insert(DistanceFog { color: FOG, falloff, ..default() });
    } else {
        camera.remove::<DistanceFog>();
    }
}
