//! The panel's rows for strokes: how they are drawn, and how they move.

use std::mem::discriminant;

use bevy_egui::egui::{Checkbox, Slider, Ui};
use bevy_stylegaussian::style::StyleMotion;

use crate::styles::Styles;

/// The choice of motions.
pub fn motions() -> [(StyleMotion, &'static str, &'static str); 3] {
    [
        (StyleMotion::Still, "still", "strokes stay where they are"),
        (StyleMotion::boil(8.0), "boiling", "strokes are redrawn some times a second"),
        (StyleMotion::flow(0.5), "flowing", "strokes run along their own direction"),
    ]
}

/// Draws the rows in a grid of two columns.
pub fn draw(ui: &mut Ui, styles: &mut Styles) {
    ui.label("paint").on_hover_text("how much of the painting's strokes is laid on");
    ui.add(Slider::new(&mut styles.paint, 0.0..=3.0).fixed_decimals(2));
    ui.end_row();
    ui.label("clear").on_hover_text("how much of the scene stays clear of strokes");
    ui.add(Slider::new(&mut styles.protection, 0.0..=4.0).fixed_decimals(2));
    ui.end_row();
    ui.label("stroke size");
    ui.add(Slider::new(&mut styles.stroke_scale, 0.25..=4.0).logarithmic(true).fixed_decimals(2));
    ui.end_row();
    ui.label("on screen").on_hover_text("whether strokes keep their size on screen, from near and far");
    ui.add(Checkbox::new(&mut styles.screen_stable, "of one size"));
    ui.end_row();
    ui.label("relief").on_hover_text("the thickness of the paint, which a light falls on");
    ui.add(Slider::new(&mut styles.relief, 0.0..=3.0).fixed_decimals(2));
    ui.end_row();
    if styles.relief > 0.0 {
        ui.label("light from").on_hover_text("around the scene");
        ui.add(Slider::new(&mut styles.light_from, 0.0..=360.0).fixed_decimals(0).suffix("°"));
        ui.end_row();
    }
    ui.label("motion").on_hover_text("the way in which strokes move");
    ui.horizontal(|ui| {
        for (motion, text, hint) in motions() {
            let is_chosen = discriminant(&motion) == discriminant(&styles.motion);
            if ui.selectable_label(is_chosen, text).on_hover_text(hint).clicked() && !is_chosen {
                styles.motion = motion;
            }
        }
    });
    ui.end_row();
    let (rate, amount, most) = match &mut styles.motion {
        StyleMotion::Boil { rate, amount } => (rate, amount, 24.0),
        StyleMotion::Flow { rate, amount, .. } => (rate, amount, 4.0),
        _ => return,
    };
    ui.label("times").on_hover_text("per second");
    ui.add(Slider::new(rate, 0.0..=most).fixed_decimals(1).suffix(" / s"));
    ui.end_row();
    ui.label("distance").on_hover_text("in widths of a stroke");
    ui.add(Slider::new(amount, 0.0..=8.0).fixed_decimals(1));
    ui.end_row();
}
