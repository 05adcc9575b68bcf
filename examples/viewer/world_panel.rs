//! The panel's section for a world: its budget, and the counts of what is there.

use bevy::prelude::*;
use bevy_egui::egui::{Grid, Slider, Ui};
use bevy_stylegaussian::world::{GaussianBudget, WorldState};
use stylegaussian_app::Subject;

use crate::panel::Transfer;

/// Why the buttons that save a scene cannot be used.
pub const NO_FILE: &str = "a world is not saved as one file";

/// Frames after which the counts of a world are surely of the style that was asked for.
const LATE: u32 = 3;

/// Draws the section.
pub fn draw(ui: &mut Ui, budget: &mut GaussianBudget, state: &WorldState) {
    let WorldState { parts, shown_parts, shown, arriving, loading, waiting, unstyled, .. } = *state;
    Grid::new("world").num_columns(2).show(ui, |ui| {
        ui.label("budget").on_hover_text("the most Gaussians that are shown, in millions");
        let mut millions = budget.gaussians as f64 / 1e6;
        if ui.add(Slider::new(&mut millions, 0.05..=20.0).logarithmic(true).fixed_decimals(2)).changed() {
            *budget = GaussianBudget::new((1e6 * millions).round() as usize);
        }
        ui.end_row();
        let rows = [
            ("shown", format!("{shown} Gaussians, {arriving} come and go")),
            ("parts", format!("{shown_parts} of {parts}, {waiting} change their level")),
            ("files", format!("{loading} are read")),
            ("paint", format!("{unstyled} parts wait for it")),
        ];
        for (name, value) in rows {
            ui.weak(name);
            ui.label(value);
            ui.end_row();
        }
    });
}

/// Notes that a style has reached all of a world.
pub fn note_settled(
    state: Option<Single<&WorldState, With<Subject>>>,
    mut transfer: ResMut<Transfer>,
    mut n_frames: Local<u32>,
) {
    if !transfer.is_under_way {
        *n_frames = 0;
        return;
    }
    *n_frames = n_frames.saturating_add(1);
    if *n_frames > LATE && state.is_some_and(|state| state.is_settled()) {
        transfer.is_under_way = false;
    }
}
