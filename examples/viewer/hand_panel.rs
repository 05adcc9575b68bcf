//! The panel's rows for what is decided beside the paintings: a collection, other colors, pinned places.

use bevy::math::Vec3;
use bevy_egui::egui::{ComboBox, Slider, Ui};

use crate::styles::Styles;

/// The choice of what becomes of several paintings.
const GATHERINGS: [(bool, &str, &str); 2] = [
    (false, "mixed", "their colors are means, and each spot shows the strokes of one"),
    (true, "as one", "each spot shows the painting that has a place like it"),
];

/// The directions of strokes, along the axes of the scene or of a volume.
pub const DIRECTIONS: [(Option<Vec3>, &str); 4] =
    [(None, "edges"), (Some(Vec3::X), "x"), (Some(Vec3::Y), "y"), (Some(Vec3::Z), "z")];

/// Draws the rows of a grid. Returns whether pins are to be saved.
pub fn rows(ui: &mut Ui, styles: &mut Styles) -> bool {
    let mut saves_pins = false;
    ui.label("several").on_hover_text("what becomes of more than one painting");
    ui.horizontal(|ui| {
        for (is_collection, text, hint) in GATHERINGS {
            ui.selectable_value(&mut styles.is_collection, is_collection, text).on_hover_text(hint);
        }
    });
    ui.end_row();
    ui.label("colors").on_hover_text("the painting whose colors are used");
    let name = |style: Option<usize>| {
        style.and_then(|style| styles.list.get(style)).map_or("its own", |style| &style.name).to_owned()
    };
    let names: Vec<String> = (0..styles.list.len()).map(|style| name(Some(style))).collect();
    ComboBox::from_id_salt("palette").selected_text(name(styles.palette)).show_ui(ui, |ui| {
        ui.selectable_value(&mut styles.palette, None, "its own");
        for (style, name) in names.into_iter().enumerate() {
            ui.selectable_value(&mut styles.palette, Some(style), name);
        }
    });
    ui.end_row();
    ui.label("palette").on_hover_text("how much hues are pulled to those of the painting");
    ui.add(Slider::new(&mut styles.palette_strength, 0.0..=1.0).fixed_decimals(2));
    ui.end_row();
    ui.label("strokes").on_hover_text("the direction that they follow");
    ui.horizontal(|ui| {
        for (direction, text) in DIRECTIONS {
            ui.selectable_value(&mut styles.direction, direction, text);
        }
    });
    ui.end_row();
    ui.label("pins").on_hover_text("by the tool `pin` of the parts of the scene");
    ui.horizontal(|ui| {
        ui.label(styles.pins.len().to_string());
        if ui.button("clear").clicked() {
            styles.pins.clear();
        }
        saves_pins = ui.button("save").on_hover_text("as a file to be opened again").clicked();
    });
    ui.end_row();
    saves_pins
}
