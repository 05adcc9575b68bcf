//! The canvas of every painting: color and paint thickness of each pixel, brushes, fills and light.

use glam::{Vec2, Vec3};

use crate::shapes::along_segment;

/// Width and height of every painting, in pixels.
pub const SIZE: usize = 512;

/// Color (display-encoded RGB, 0..1) and paint thickness of each pixel, row-major from the top left.
///
/// Positions are in pixels, with y down. Pixel `(x, y)` has its center at `(x + 0.5, y + 0.5)`.
#[derive(Clone, Debug)]
pub struct Canvas {
    color: Vec<Vec3>,
    height: Vec<f32>,
}

/// A pixel that a stroke's brush touches, and its place within the stroke.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// The pixel's center.
    pub at: Vec2,
    /// Position along the stroke, from 0 at its start to 1 at its end.
    pub along: f32,
    /// Length of the stroke's path up to this pixel, in pixels.
    pub arc: f32,
    /// Position across the brush, from -1 at its left edge to 1 at its right edge.
    pub across: f32,
    /// Color of the pixel before this stroke.
    pub ground: Vec3,
}

/// Paint that the brush leaves at one pixel.
#[derive(Clone, Copy, Debug)]
pub struct Touch {
    /// Color of the paint.
    pub color: Vec3,
    /// Opacity of the paint: 0 leaves the ground as it was, 1 covers it.
    pub opacity: f32,
    /// Thickness of the paint, in pixels.
    pub height: f32,
}

impl Canvas {
    /// A bare canvas of one color.
    pub fn new(color: Vec3) -> Self {
        Self { color: vec![color; SIZE * SIZE], height: vec![0.0; SIZE * SIZE] }
    }

    /// Indices and centers of the pixels that a box touches, clipped to the canvas.
    fn pixels(low: Vec2, high: Vec2) -> impl Iterator<Item = (usize, Vec2)> {
        let clip = |v: f32| v.clamp(0.0, SIZE as f32) as usize;
        let (x0, x1) = (clip(low.x.floor()), clip(high.x.ceil()));
        let (y0, y1) = (clip(low.y.floor()), clip(high.y.ceil()));
        (y0..y1).flat_map(move |y| {
            (x0..x1).map(move |x| (y * SIZE + x, Vec2::new(x as f32 + 0.5, y as f32 + 0.5)))
        })
    }

    /// Draws a brush along `path`. Edges are anti-aliased over one pixel.
    ///
    /// `radius` is half the brush's width at a position along the stroke (0..1), and `touch` the paint at a
    /// pixel.
    pub fn stroke(
        &mut self,
        path: &[Vec2],
        radius: impl Fn(f32) -> f32,
        mut touch: impl FnMut(Contact) -> Touch,
    ) {
        let arcs: Vec<f32> = path
            .windows(2)
            .scan(0.0, |arc, ends| {
                let start = *arc;
                *arc += ends[0].distance(ends[1]);
                Some(start)
            })
            .collect();
        let Some(&last) = arcs.last() else { return };
        let length = (last + path[path.len() - 1].distance(path[path.len() - 2])).max(1e-3);
        // The radius is sampled, and a pixel added for the soft edge.
        let widest = (0..=8).map(|i| radius(i as f32 / 8.0)).fold(0.0, f32::max) + 1.0;
        let low = path.iter().fold(Vec2::MAX, |a, &b| a.min(b)) - widest;
        let high = path.iter().fold(Vec2::MIN, |a, &b| a.max(b)) + widest;
        for (i, at) in Self::pixels(low, high) {
            // The point of the path nearest to the pixel, by trying every segment: paths are short.
            let (mut nearest, mut arc, mut side) = (f32::MAX, 0.0, 1.0);
            for (ends, start) in path.windows(2).zip(&arcs) {
                let t = along_segment(at, ends[0], ends[1]);
                let foot = ends[0].lerp(ends[1], t);
                let distance = at.distance_squared(foot);
                if distance < nearest {
                    nearest = distance;
                    arc = start + t * ends[0].distance(ends[1]);
                    side = if (ends[1] - ends[0]).perp_dot(at - ends[0]) < 0.0 { -1.0 } else { 1.0 };
                }
            }
            let along = arc / length;
            let reach = radius(along);
            // The second bound fades a brush thinner than a pixel instead of drawing it too wide.
            let coverage = (reach - nearest.sqrt() + 0.5).clamp(0.0, 1.0).min(2.0 * reach);
            if coverage > 0.0 {
                let across = side * (nearest.sqrt() / reach.max(0.1)).min(1.0);
                let ground = self.color[i];
                self.blend(i, touch(Contact { at, along, arc, across, ground }), coverage);
            }
        }
    }

    /// Lays paint over a pixel of which the brush covers the share `coverage`.
    fn blend(&mut self, i: usize, touch: Touch, coverage: f32) {
        let opacity = (touch.opacity * coverage).clamp(0.0, 1.0);
        self.color[i] = self.color[i].lerp(touch.color, opacity);
        // Wet paint is pushed aside by the next stroke: little of the thickness below shows through.
        let below = self.height[i];
        self.height[i] = below + (0.25 * below + touch.height - below) * opacity;
    }

    /// Covers the inside of a shape, given by its signed `distance` in pixels (negative inside). Only pixels
    /// from `low` to `high` are considered. `color` takes the position and the distance.
    pub fn fill(
        &mut self,
        (low, high): (Vec2, Vec2),
        distance: impl Fn(Vec2) -> f32,
        color: impl Fn(Vec2, f32) -> Vec3,
    ) {
        for (i, at) in Self::pixels(low, high) {
            let d = distance(at);
            if d < 0.5 {
                self.color[i] = self.color[i].lerp(color(at, d), (0.5 - d).min(1.0));
            }
        }
    }

    /// Replaces the color of each pixel from `low` to `high` by a function of its position and its color so
    /// far.
    pub fn change(&mut self, (low, high): (Vec2, Vec2), color: impl Fn(Vec2, Vec3) -> Vec3) {
        for (i, at) in Self::pixels(low, high) {
            self.color[i] = color(at, self.color[i]);
        }
    }

    /// Sets every pixel to the mean of `color` over 3 x 3 positions in it.
    pub fn shade(&mut self, color: impl Fn(Vec2) -> Vec3) {
        for (i, at) in Self::pixels(Vec2::ZERO, Vec2::splat(SIZE as f32)) {
            let sub = |k: i32| (k - 1) as f32 / 3.0;
            self.color[i] = (0..9).map(|k| color(at + Vec2::new(sub(k % 3), sub(k / 3)))).sum::<Vec3>() / 9.0;
        }
    }

    /// Lights the paint's relief from the top left. Slopes that face the light gain brightness by `relief`, and
    /// steep ones a highlight by `gloss`.
    pub fn light(&mut self, relief: f32, gloss: f32) {
        let at = |x: usize, y: usize| self.height[y.min(SIZE - 1) * SIZE + x.min(SIZE - 1)];
        let lit: Vec<Vec3> = (0..SIZE * SIZE)
            .map(|i| {
                let (x, y) = (i % SIZE, i / SIZE);
                let dx = at(x + 1, y) - at(x.saturating_sub(1), y);
                let dy = at(x, y + 1) - at(x, y.saturating_sub(1));
                // Toward the light: 3, 4, 5 are the sides of a right triangle.
                let slope = (0.6 * dx + 0.8 * dy).clamp(-2.0, 2.0);
                let shine = gloss * (slope - 0.45).clamp(0.0, 1.0);
                (self.color[i] * (1.0 + relief * slope).max(0.25) + Vec3::splat(shine))
                    .clamp(Vec3::ZERO, Vec3::ONE)
            })
            .collect();
        self.color = lit;
    }

    /// The finished painting: 8-bit RGB, row-major.
    pub fn to_rgb(&self) -> Vec<u8> {
        self.color
            .iter()
            .flat_map(|c| (c.clamp(Vec3::ZERO, Vec3::ONE) * 255.0 + 0.5).to_array())
            .map(|v| v as u8)
            .collect()
    }
}

/// The box of the whole canvas, for [`Canvas::fill`] and [`Canvas::change`].
pub const WHOLE: (Vec2, Vec2) = (Vec2::ZERO, Vec2::splat(SIZE as f32));

/// The box of half-width `radius` around `center`.
pub fn around(center: Vec2, radius: f32) -> (Vec2, Vec2) {
    (center - radius, center + radius)
}

/// A color from its usual notation, `0xRRGGBB`.
pub fn rgb(hex: u32) -> Vec3 {
    Vec3::new((hex >> 16 & 255) as f32, (hex >> 8 & 255) as f32, (hex & 255) as f32) / 255.0
}

/// The color at `t` (0..1) of a gradient through two or more evenly spaced `stops`.
pub fn ramp(stops: &[u32], t: f32) -> Vec3 {
    let position = t.clamp(0.0, 1.0) * (stops.len() - 1) as f32;
    let i = (position as usize).min(stops.len() - 2);
    rgb(stops[i]).lerp(rgb(stops[i + 1]), position - i as f32)
}

/// A smooth step of `x`: 0 below `low`, 1 above `high`, cubic between. If `low` > `high`, it falls.
pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
