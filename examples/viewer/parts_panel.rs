//! The panel's section for parts of the scene: tools, paint and volumes.

use bevy::math::Vec2;
use bevy_egui::egui::{
    self, Button, Checkbox, Color32, ComboBox, Grid, Painter, Response, Slider, Stroke, Ui, pos2,
};
use bevy_stylegaussian::style::{StrokeDirection, VolumeStrokes};
use stylegaussian_app::Orbit;

use crate::{
    parts::{PartStyle, Parts, Tool, Volume},
    scene::OF_SCENES,
    styles::Styles,
};

const TOOLS: [(Tool, &str, &str); 7] = [
    (Tool::View, "view", "drags turn the camera"),
    (Tool::Brush, "brush", "drags paint along the surface"),
    (Tool::Ball, "ball", "clicks paint a ball around the place"),
    (Tool::Box, "box", "clicks paint a box around the place"),
    (Tool::Lasso, "lasso", "drags draw a line around all that lies behind it"),
    (Tool::Volume, "volume", "drags move the chosen volume"),
    (Tool::Pin, "pin", "a click on a painting, then one on the scene: it is painted from there"),
];

/// Wishes that need more than the parts themselves.
#[derive(Default)]
pub struct Wishes {
    /// To undo (false) or to make again (true).
    pub step: Option<bool>,
    pub clear_paint: bool,
    pub save_mask: bool,
}

/// Draws the section.
pub fn draw(ui: &mut Ui, parts: &mut Parts, styles: &Styles, orbit: &Orbit, is_world: bool) -> Wishes {
    let mut wishes = Wishes::default();
    ui.collapsing("parts of the scene", |ui| {
        ui.horizontal_wrapped(|ui| {
            for (tool, text, hint) in TOOLS {
                let fits = !is_world || matches!(tool, Tool::View | Tool::Volume);
                ui.add_enabled_ui(fits, |ui| {
                    let choice = ui.selectable_value(&mut parts.tool, tool, text);
                    choice.on_hover_text(hint).on_disabled_hover_text(OF_SCENES);
                });
            }
        });
        Grid::new("parts").num_columns(2).show(ui, |ui| {
            ui.label("style").on_hover_text("what is painted, and what new volumes show");
            style(ui, "part style", &mut parts.style, styles);
            ui.end_row();
            slider(ui, "radius", &mut parts.radius, 0.01..=0.5);
            slider(ui, "softness", &mut parts.softness, 0.0..=1.0);
            slider(ui, "strength", &mut parts.strength, 0.02..=1.0);
        });
        ui.horizontal(|ui| {
            ui.add(Checkbox::new(&mut parts.erases, "erase"));
            let hint = "hides what is painted in the style, instead of showing it";
            ui.add(Checkbox::new(&mut parts.hides, "hide")).on_hover_text(hint);
            wishes.clear_paint = ui.button("clear").on_hover_text("all paint").clicked();
            wishes.save_mask =
                ui.button("save").on_hover_text("the paint, as a file to be opened again").clicked();
        });
        ui.horizontal(|ui| {
            let [can_undo, can_redo] = parts.can_step();
            let steps = [(false, "undo", "Ctrl+Z", can_undo), (true, "redo", "Ctrl+Shift+Z", can_redo)];
            for (again, text, key, can) in steps {
                if ui.add_enabled(can, Button::new(text)).on_hover_text(key).clicked() {
                    wishes.step = Some(again);
                }
            }
            ui.separator();
            for (is_box, text) in [(false, "+ ball"), (true, "+ box")] {
                if ui.button(text).on_hover_text("a volume of the style, in the middle of the view").clicked()
                {
                    parts.add_volume(is_box, orbit);
                }
            }
        });
        volumes(ui, parts, styles);
    });
    wishes
}

/// The list of volumes, and the settings of the chosen one.
fn volumes(ui: &mut Ui, parts: &mut Parts, styles: &Styles) {
    ui.horizontal_wrapped(|ui| {
        for (i, volume) in parts.volumes.iter().enumerate() {
            let shape = if volume.is_box { "box" } else { "ball" };
            let text = format!("{} {shape}: {}", i + 1, name(volume.style, styles));
            if ui.selectable_label(parts.chosen == Some(i), text).clicked() {
                parts.chosen = Some(i);
            }
        }
    });
    let Some(chosen) = parts.chosen.filter(|chosen| *chosen < parts.volumes.len()) else { return };
    let volume = &mut parts.volumes[chosen];
    Grid::new("volume").num_columns(2).show(ui, |ui| {
        ui.label("shows");
        style(ui, "volume style", &mut volume.style, styles);
        ui.end_row();
        slider(ui, "size", &mut volume.size, 0.02..=1.5);
        slider(ui, "edge", &mut volume.softness, 0.0..=1.0);
        strokes(ui, volume);
    });
    if ui.button("remove").clicked() {
        parts.volumes.remove(chosen);
        parts.chosen = None;
    }
}

/// The changes of the strokes in a volume.
fn strokes(ui: &mut Ui, volume: &mut Volume) {
    let mut changes = volume.strokes.is_some();
    ui.label("strokes").on_hover_text("without a style, those that are there");
    if ui.add(Checkbox::new(&mut changes, "change")).changed() {
        volume.strokes = changes.then(VolumeStrokes::default);
    }
    ui.end_row();
    let Some(strokes) = &mut volume.strokes else { return };
    slider(ui, "x paint", &mut strokes.paint, 0.0..=3.0);
    slider(ui, "x size", &mut strokes.stroke_scale, 0.25..=4.0);
    slider(ui, "x clear", &mut strokes.protection, 0.0..=5.0);
    slider(ui, "x relief", &mut strokes.relief, 0.0..=4.0);
    slider(ui, "+ relief", &mut strokes.added_relief, 0.0..=4.0);
    ui.label("run");
    ui.horizontal(|ui| {
        for (direction, text) in crate::hand_panel::DIRECTIONS {
            let direction = direction.map(StrokeDirection::Along);
            ui.selectable_value(&mut strokes.direction, direction, text);
        }
    });
    ui.end_row();
    ui.label("motion");
    ui.horizontal(|ui| {
        let motions = crate::strokes_panel::motions().map(|(motion, text, _)| (Some(motion), text));
        for (motion, text) in std::iter::once((None, "its own")).chain(motions) {
            ui.selectable_value(&mut strokes.motion, motion, text);
        }
    });
    ui.end_row();
}

fn slider(ui: &mut Ui, name: &str, value: &mut f32, range: std::ops::RangeInclusive<f32>) {
    ui.label(name);
    ui.add(Slider::new(value, range).fixed_decimals(2));
    ui.end_row();
}

fn name(style: PartStyle, styles: &Styles) -> &str {
    style.and_then(|style| styles.list.get(style)).map_or("as captured", |style| &style.name)
}

/// A choice of the captured colors or a style.
fn style(ui: &mut Ui, id: &str, chosen: &mut PartStyle, styles: &Styles) -> Response {
    let choice = ComboBox::from_id_salt(id).selected_text(name(*chosen, styles).to_owned());
    let all = std::iter::once(None).chain((0..styles.list.len()).map(Some));
    choice
        .show_ui(ui, |ui| {
            for style in all {
                ui.selectable_value(chosen, style, name(style, styles));
            }
        })
        .response
}

/// Draws the line of a lasso over the picture.
pub fn draw_lasso(painter: &Painter, line: &[Vec2]) {
    let points: Vec<_> = line.iter().map(|point| pos2(point.x, point.y)).collect();
    // Seen on bright and dark ground.
    for (width, color) in [(3.0, Color32::BLACK), (1.5, Color32::WHITE)] {
        painter.add(egui::Shape::closed_line(points.clone(), Stroke::new(width, color)));
    }
}
