//! Lenses that are pinholes apart from their distortion, and photos without it.
//!
//! A point at (x, y) on the plane at z = 1 is seen at (x, y) d + t, as OpenCV and COLMAP define it, with
//! r^2 = x^2 + y^2:
//!
//! ```text
//! d = (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) / (1 + k5 r^2 + k6 r^4 + k7 r^6)
//! t = (2 p1 x y + p2 (r^2 + 2 x^2), p1 (r^2 + 2 y^2) + 2 p2 x y)
//! ```
//!
//! Each pixel of the picture without distortion is looked up in the photo, so nothing has to be solved.

use glam::{DMat2, DVec2, UVec2, Vec2};
use stylegaussian::Camera;
use stylegaussian_encoder::Image;

/// Points along each edge of a picture that are tested. Distortion is smooth: between two of 64, an edge that
/// is bent by a tenth of its length is off by 0.1 / 64^2 of it, a tenth of a pixel in 4,000.
const N_ALONG: u32 = 64;

/// Least share of either side of a photo that must be left without its distortion.
const LEAST_LEFT: f64 = 0.5;

/// Steps in which a side is moved across a picture of more pixels. Each is a thousandth of the picture, and
/// half of them end the search.
const N_STEPS: f64 = 1000.0;

/// A distorted lens and the size of its photos.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distortion {
    /// Focal lengths, in pixels.
    pub focal: DVec2,
    /// The principal point, in pixels.
    pub center: DVec2,
    /// The size of photos, in pixels.
    pub size: UVec2,
    /// The coefficients k1 to k4 of the numerator.
    pub radial: [f64; 4],
    /// The coefficients k5 to k7 of the denominator.
    pub rational: [f64; 3],
    /// The coefficients p1 and p2.
    pub tangential: [f64; 2],
}

impl Distortion {
    /// Whether any coefficient is not 0.
    pub(super) fn is_any(&self) -> bool {
        let all = self.radial.iter().chain(&self.rational).chain(&self.tangential);
        all.into_iter().any(|&k| k != 0.0)
    }

    /// The coefficients that are not 0, for messages.
    pub(super) fn coefficients(&self) -> String {
        let names = ["k1", "k2", "k3", "k4", "k5", "k6", "k7", "p1", "p2"];
        let all = self.radial.iter().chain(&self.rational).chain(&self.tangential);
        let named: Vec<String> = names
            .iter()
            .zip(all)
            .filter(|(_, k)| **k != 0.0)
            .map(|(name, k)| format!("{name} {k}"))
            .collect();
        named.join(", ")
    }

    /// The place on the plane at z = 1 at which the lens shows what is at `at`.
    pub fn distorted(&self, at: DVec2) -> DVec2 {
        let DVec2 { x, y } = at;
        let r2 = at.length_squared();
        let ([k1, k2, k3, k4], [k5, k6, k7]) = (self.radial, self.rational);
        let [p1, p2] = self.tangential;
        let d = (1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))) / (1.0 + r2 * (k5 + r2 * (k6 + r2 * k7)));
        let t = DVec2::new(
            2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        at * d + t
    }

    /// The pixel of the photo that shows a pixel of the picture without distortion, both from the photo's
    /// corner.
    fn photo_from_pinhole(&self, pixel: DVec2) -> DVec2 {
        self.focal * self.distorted((pixel - self.center) / self.focal) + self.center
    }

    /// Whether the photo shows this pixel of the picture without distortion. Beyond some radius, polynomials
    /// turn back and would show things twice.
    fn is_shown(&self, pixel: DVec2) -> bool {
        let shown = self.photo_from_pinhole(pixel);
        // A step of a pixel is small beside the photo, and large beside the rounding of f64.
        let along = |step: DVec2| self.photo_from_pinhole(pixel + step) - shown;
        let keeps_sides = DMat2::from_cols(along(DVec2::X), along(DVec2::Y)).determinant() > 0.0;
        // A picture that is turned back along both directions keeps its sides, but is on its head.
        let keeps_directions = (shown - self.center).dot(pixel - self.center) >= 0.0;
        // Half a pixel beyond the edge, its color is as good.
        let is_within =
            shown.cmpge(DVec2::splat(-0.5)).all() && shown.cmple(self.size.as_dvec2() + 0.5).all();
        keeps_sides && keeps_directions && is_within
    }

    /// The largest picture without distortion, of the photo's pixels, that the photo fills: its top left corner
    /// and its size. `None` if less than half of a side is left.
    pub(super) fn filled(&self) -> Option<(UVec2, UVec2)> {
        let size = self.size.as_dvec2();
        let (mut low, mut high) = (DVec2::ZERO, size);
        // Whether a side is seen whole, between these corners.
        let is_whole = |from: DVec2, to: DVec2| {
            (0..=N_ALONG).all(|i| self.is_shown(from.lerp(to, f64::from(i) / f64::from(N_ALONG))))
        };
        loop {
            let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
            let [top, right, bottom, left] =
                [0, 1, 2, 3].map(|i| !is_whole(corners[i], corners[(i + 1) % 4]));
            if !(left || right || top || bottom) {
                let (low, high) = (low.as_uvec2(), high.as_uvec2());
                return Some((low, high - low));
            }
            // The sides move together, so that none takes what another one lost.
            let step = (size / N_STEPS).floor().max(DVec2::ONE);
            let by = |x: bool, y: bool| step * DVec2::new(f64::from(u8::from(x)), f64::from(u8::from(y)));
            low += by(left, top);
            high -= by(right, bottom);
            if !(high - low).cmpge(LEAST_LEFT * size).all() {
                return None;
            }
        }
    }

    /// The share of the photo that a picture without distortion leaves out, 0..1.
    pub(super) fn lost(&self, corner: UVec2, size: UVec2) -> f64 {
        let [low, high] = [corner, corner + size].map(|pixel| pixel.as_dvec2());
        let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
        let along = |i: u32| {
            let (side, step) = ((i / N_ALONG) as usize, i % N_ALONG);
            corners[side].lerp(corners[(side + 1) % 4], f64::from(step) / f64::from(N_ALONG))
        };
        let outline: Vec<DVec2> = (0..4 * N_ALONG).map(|i| self.photo_from_pinhole(along(i))).collect();
        // Twice the area of a polygon is the sum of its edges' cross products.
        let next = outline.iter().cycle().skip(1);
        let twice: f64 = outline.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum();
        (1.0 - twice / 2.0 / self.size.as_dvec2().element_product()).clamp(0.0, 1.0)
    }

    /// The picture that a pinhole of this principal point and size takes, from a photo of any scale.
    pub fn undistorted(&self, photo: &Image, pinhole: &Camera) -> Image {
        let scale = DVec2::new(f64::from(photo.width), f64::from(photo.height)) / self.size.as_dvec2();
        let size = (pinhole.size.as_dvec2() * scale).round().as_uvec2().max(UVec2::ONE);
        let step = pinhole.size.as_dvec2() / size.as_dvec2();
        let (focal, center) = (pinhole.focal.as_dvec2(), pinhole.center.as_dvec2());
        let looked_up = |i: u32| {
            let pixel = (UVec2::new(i % size.x, i / size.x).as_dvec2() + 0.5) * step;
            let shown = self.focal * self.distorted((pixel - center) / focal) + self.center;
            bilinear(photo, (shown * scale - 0.5).as_vec2())
        };
        let n = size.x * size.y;
        Image { width: size.x, height: size.y, rgb: (0..n).flat_map(looked_up).collect(), alpha: None }
    }
}

/// The color between the middles of four pixels. Beyond the edge, it is that of the edge.
fn bilinear(image: &Image, at: Vec2) -> [f32; 3] {
    let last = UVec2::new(image.width, image.height) - 1;
    let at = at.clamp(Vec2::ZERO, last.as_vec2());
    let low = at.as_uvec2();
    let high = (low + 1).min(last);
    let share = at - low.as_vec2();
    let color = |x: u32, y: u32| &image.rgb[3 * (y as usize * image.width as usize + x as usize)..][..3];
    let corners = [color(low.x, low.y), color(high.x, low.y), color(low.x, high.y), color(high.x, high.y)];
    [0, 1, 2].map(|i| {
        let row = |left: &[f32], right: &[f32]| left[i] + share.x * (right[i] - left[i]);
        let (upper, lower) = (row(corners[0], corners[1]), row(corners[2], corners[3]));
        upper + share.y * (lower - upper)
    })
}
