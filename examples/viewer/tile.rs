//! One style in the panel: its painting to click, and a slider for its weight.

use bevy_egui::egui::{
    Align2, Color32, FontId, Mesh, Rect, Sense, Slider, Stroke, StrokeKind, TextureId, Ui, Vec2, pos2, vec2,
};

/// Width and height of a painting, in points.
pub const SIZE: f32 = 97.0;
const CAPTION: f32 = 18.0;
const ROUNDING: u8 = 5;
/// Color of what is chosen.
pub const ACCENT: Color32 = Color32::from_rgb(255, 178, 62);

/// A painting as an egui texture.
#[derive(Clone, Copy)]
pub struct Picture {
    pub texture: TextureId,
    /// Width divided by height.
    pub ratio: f32,
}

/// Content of a tile.
pub struct Tile<'a> {
    pub caption: &'a str,
    /// The painting, or `None` for the captured colors and while it is being loaded.
    pub picture: Option<Picture>,
    /// Whether the scene shows the style.
    pub is_used: bool,
    /// Share of the mix, or `None` if it is not used.
    pub percent: Option<f32>,
}

/// Draws a tile. Returns the spot of the painting that was clicked: shares of its sides, from the left and top.
pub fn draw(ui: &mut Ui, tile: &Tile) -> Option<Vec2> {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(SIZE), Sense::click());
    let painter = ui.painter_at(rect.expand(2.0));
    match tile.picture {
        Some(picture) => {
            painter.image(picture.texture, rect, middle_square(picture.ratio), Color32::WHITE);
        }
        None => {
            painter.add(land_and_sky(rect));
        }
    }
    // A dark strip, so that the caption can be read on any painting.
    let strip = Rect::from_min_max(pos2(rect.left(), rect.bottom() - CAPTION), rect.max);
    painter.rect_filled(strip, 0, Color32::from_black_alpha(215));
    let font = FontId::proportional(11.5);
    let percent = tile.percent.map_or_else(String::new, |percent| format!("{percent:.0}%"));
    let right = rect.right_bottom() + vec2(-5.0, -0.5 * CAPTION);
    // Drawn first: the caption takes the room that it leaves.
    let percent = painter.text(right, Align2::RIGHT_CENTER, percent, font.clone(), ACCENT);
    let left = rect.left_bottom() + vec2(5.0, -0.5 * CAPTION);
    let beside = Rect::from_min_max(strip.min, pos2(percent.left() - 3.0, strip.bottom()));
    painter.with_clip_rect(beside).text(left, Align2::LEFT_CENTER, tile.caption, font, Color32::WHITE);
    let (width, color) = match (tile.is_used, response.hovered()) {
        (true, _) => (3.0, ACCENT),
        (false, true) => (2.0, Color32::WHITE),
        (false, false) => (1.0, Color32::from_gray(90)),
    };
    painter.rect_stroke(rect, ROUNDING, Stroke::new(width, color), StrokeKind::Inside);
    if !response.clicked() {
        return None;
    }
    let shown = tile.picture.map_or(middle_square(1.0), |picture| middle_square(picture.ratio));
    let at = response.interact_pointer_pos().unwrap_or(rect.center()) - rect.min;
    let spot = shown.min + shown.size() * (at / SIZE);
    Some(vec2(spot.x.clamp(0.0, 1.0), spot.y.clamp(0.0, 1.0)))
}

/// A slider for a style's weight, as wide as its painting.
pub fn weight(ui: &mut Ui, weight: &mut f32) {
    ui.spacing_mut().slider_width = SIZE;
    ui.add(Slider::new(weight, 0.0..=1.0).show_value(false)).on_hover_text("its part in the mix");
}

/// A picture for the captured colors: blue above, green below.
fn land_and_sky(rect: Rect) -> Mesh {
    // Each band has vertices of its own, so that the horizon stays sharp.
    let sky = [Color32::from_rgb(92, 140, 199), Color32::from_rgb(219, 224, 222)];
    let land = [Color32::from_rgb(122, 160, 74), Color32::from_rgb(52, 96, 40)];
    let mut mesh = Mesh::default();
    for (index, (y, color)) in
        [(0.0, sky[0]), (0.5, sky[1]), (0.5, land[0]), (1.0, land[1])].into_iter().enumerate()
    {
        let y = rect.top() + y * rect.height();
        mesh.colored_vertex(pos2(rect.left(), y), color);
        mesh.colored_vertex(pos2(rect.right(), y), color);
        if index % 2 == 1 {
            let corner = 2 * index as u32 - 2;
            mesh.add_triangle(corner, corner + 1, corner + 2);
            mesh.add_triangle(corner + 1, corner + 2, corner + 3);
        }
    }
    mesh
}

/// The part of a texture that fills a square.
fn middle_square(ratio: f32) -> Rect {
    // In the texture's own coordinates, where the longer side is cut.
    let size = vec2((1.0 / ratio).min(1.0), ratio.min(1.0));
    Rect::from_center_size(pos2(0.5, 0.5), size)
}
