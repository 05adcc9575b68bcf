//! One style in the panel: its painting, to be clicked, and its part in the mix, to be dragged.

use bevy_egui::egui::{
    Align2, Color32, FontId, Rect, Sense, Slider, Stroke, StrokeKind, TextureId, Ui, Vec2, pos2, vec2,
};

/// Width and height of a painting, in points.
pub const SIZE: f32 = 92.0;
const CAPTION: f32 = 18.0;
const ROUNDING: u8 = 5;
const ACCENT: Color32 = Color32::from_rgb(255, 178, 62);

/// A painting as egui knows it.
#[derive(Clone, Copy)]
pub struct Picture {
    pub texture: TextureId,
    /// Width by height.
    pub ratio: f32,
}

/// Draws the painting; `share` is its part of the mix, 0..1. Says whether it was clicked.
pub fn painting(ui: &mut Ui, caption: &str, picture: Option<Picture>, share: f32) -> bool {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(SIZE), Sense::click());
    let painter = ui.painter_at(rect.expand(2.0));
    match picture {
        Some(picture) => {
            painter.image(picture.texture, rect, middle_square(picture.ratio), Color32::WHITE);
        }
        None => {
            painter.rect_filled(rect, ROUNDING, Color32::from_gray(58));
        }
    }
    let strip = Rect::from_min_max(pos2(rect.left(), rect.bottom() - CAPTION), rect.max);
    painter.rect_filled(strip, 0, Color32::from_black_alpha(150));
    let font = FontId::proportional(11.5);
    let label = vec2(5.0, -0.5 * CAPTION);
    painter.text(rect.left_bottom() + label, Align2::LEFT_CENTER, caption, font.clone(), Color32::WHITE);
    if share > 0.0 {
        let percent = format!("{:.0}%", 100.0 * share);
        let corner = rect.right_bottom() + vec2(-5.0, -0.5 * CAPTION);
        painter.text(corner, Align2::RIGHT_CENTER, percent, font, ACCENT);
    }
    let (width, color) = match (share > 0.0, response.hovered()) {
        (true, _) => (3.0, ACCENT),
        (false, true) => (2.0, Color32::WHITE),
        (false, false) => (1.0, Color32::from_gray(90)),
    };
    painter.rect_stroke(rect, ROUNDING, Stroke::new(width, color), StrokeKind::Inside);
    response.clicked()
}

/// A slider for a style's weight, as wide as its painting.
pub fn weight(ui: &mut Ui, weight: &mut f32) {
    ui.spacing_mut().slider_width = SIZE;
    ui.add(Slider::new(weight, 0.0..=1.0).show_value(false)).on_hover_text("its part in the mix");
}

/// The part of a texture that fills a square.
fn middle_square(ratio: f32) -> Rect {
    let size = vec2((1.0 / ratio).min(1.0), ratio.min(1.0));
    Rect::from_center_size(pos2(0.5, 0.5), size)
}
