//! The panel's section for the parts of paintings that are used: a drag over a painting chooses one.

use bevy::math::{Rect, Vec2};
use bevy_egui::egui::{self, Color32, Pos2, Sense, Stroke, StrokeKind, Ui, pos2, vec2};

use crate::{
    styles::Styles,
    tile::{ACCENT, Picture},
};

/// Largest height of a painting, in points.
const HEIGHT: f32 = 220.0;

/// Least width and height of a part, as shares of the painting's. A smaller one is a click.
const LEAST: f32 = 0.03;

/// Draws the section.
pub fn draw(ui: &mut Ui, styles: &mut Styles, pictures: &[Option<Picture>]) {
    ui.collapsing("parts of the paintings", |ui| {
        let pictures = pictures.iter().copied().enumerate();
        let shown: Vec<_> = pictures
            .filter_map(|(index, picture)| Some((index, picture.filter(|_| styles.has_parts(index))?)))
            .collect();
        ui.weak(match shown.is_empty() {
            true => "of those that are used, and are no baked looks",
            false => "drag: no more than this part is used    click: all of it",
        });
        for (index, picture) in shown {
            painting(ui, styles, index, picture);
        }
    });
}

/// Draws a painting, dark where it is not used.
fn painting(ui: &mut Ui, styles: &mut Styles, index: usize, picture: Picture) {
    let height = HEIGHT.min(ui.available_width() / picture.ratio);
    let (rect, response) =
        ui.allocate_exact_size(vec2(height * picture.ratio, height), Sense::click_and_drag());
    let share = |at: Pos2| {
        let share = (at - rect.min) / rect.size();
        Vec2::new(share.x, share.y).clamp(Vec2::ZERO, Vec2::ONE)
    };
    if response.drag_started() {
        // Where the button went down, which is some points from where a drag is known to be one.
        let origin = ui.input(|input| input.pointer.press_origin());
        styles.corner = origin.map(|origin| (index, share(origin)));
    }
    let corner = styles.corner.filter(|(of, _)| *of == index).map(|(_, corner)| corner);
    let dragged = corner.zip(response.interact_pointer_pos());
    let dragged = dragged.map(|(corner, at)| Rect::from_corners(corner, share(at)));
    // Not before the button is up: each change is painted.
    if response.drag_stopped() || response.clicked() {
        styles.corner = None;
        styles.list[index].crop = dragged.filter(|part| part.size().min_element() >= LEAST);
    }
    let part = match styles.corner {
        Some((of, _)) if of == index => dragged,
        _ => styles.list[index].crop,
    };
    let painter = ui.painter_at(rect);
    let whole = egui::Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    painter.image(picture.texture, rect, whole, Color32::WHITE);
    let Some(part) = part else { return };
    let on_screen = |at: Vec2| rect.min + vec2(at.x, at.y) * rect.size();
    let used = egui::Rect::from_min_max(on_screen(part.min), on_screen(part.max));
    let beside = |min: Pos2, max: Pos2| {
        painter.rect_filled(egui::Rect::from_min_max(min, max), 0, Color32::from_black_alpha(170));
    };
    beside(rect.min, pos2(rect.right(), used.top()));
    beside(pos2(rect.left(), used.bottom()), rect.max);
    beside(pos2(rect.left(), used.top()), used.left_bottom());
    beside(used.right_top(), pos2(rect.right(), used.bottom()));
    painter.rect_stroke(used, 0, Stroke::new(2.0, ACCENT), StrokeKind::Inside);
}
