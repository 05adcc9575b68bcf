//! The part of a painting that may be used, if that is not all of it.

use glam::Vec3;

use super::{
    patch::{PLACE, STEP, reach_of_patch},
    picture::Picture,
};

/// Clearance of a place from pixels that may not be used, in pixels: the corner of its patch, whichever way
/// that is turned, for each position that belongs to the place.
fn clear() -> f32 {
    (reach_of_patch() * STEP + 0.5 * PLACE as f32) * std::f32::consts::SQRT_2
}

/// Share of the largest clearance of a painting's places that is enough if none is clear: of a thin shape, its
/// middle is used.
const OF_LARGEST: f32 = 0.5;

/// Which pixels of a picture may be used.
pub(super) struct Used {
    width: usize,
    height: usize,
    /// `[height * width]`.
    pub pixels: Vec<bool>,
}

impl Used {
    /// Those of a picture of `width` columns; `None` if all or none may be used.
    pub fn new(pixels: &Option<Vec<bool>>, width: usize) -> Option<Self> {
        let pixels = pixels.as_ref().filter(|pixels| pixels.contains(&true) && pixels.contains(&false))?;
        Some(Self { width, height: pixels.len() / width, pixels: pixels.clone() })
    }

    /// The same at another size: a pixel may be used if all may that it covers.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        // The first and the last pixel, exclusive, under pixel `i` of `n`, of `of`.
        let under =
            |i: usize, n: usize, of: usize| i * of / n..((i + 1) * of).div_ceil(n).max(i * of / n + 1);
        let is_used = |i: usize| {
            let (columns, rows) =
                (under(i % width, width, self.width), under(i / width, height, self.height));
            rows.into_iter().all(|y| self.pixels[y * self.width..][columns.clone()].iter().all(|used| *used))
        };
        Self { width, height, pixels: (0..width * height).map(is_used).collect() }
    }

    /// The picture with the colors of used pixels, smoothly continued into the others.
    pub fn filled(&self, picture: &Picture) -> Picture {
        let weights: Vec<f32> = self.pixels.iter().map(|used| f32::from(u8::from(*used))).collect();
        let values = picture.values.iter().zip(&weights).map(|(value, weight)| *value * *weight).collect();
        continued(&Picture { values, ..*picture }, &weights)
    }

    /// The values `[height * width]` of used pixels.
    pub fn of<'a, T: Copy>(&'a self, values: &'a [T]) -> impl Iterator<Item = T> + 'a {
        values.iter().zip(&self.pixels).filter(|(_, used)| **used).map(|(value, _)| *value)
    }

    /// Which places of a grid are clear of pixels that may not be used `[P]`: at least one is.
    pub fn places(&self, (n_x, n_y): (usize, usize)) -> Vec<bool> {
        let distances = self.distances();
        let at = |i: usize, n: usize| (i * PLACE + PLACE / 2).min(n - 1);
        let of_place =
            |place: usize| distances[at(place / n_x, self.height) * self.width + at(place % n_x, self.width)];
        let clearances: Vec<f32> = (0..n_x * n_y).map(of_place).collect();
        let most = clearances.iter().copied().fold(0.0, f32::max);
        let enough = clear().min(OF_LARGEST * most);
        clearances.iter().map(|clearance| *clearance >= enough).collect()
    }

    /// Distance of each pixel from the nearest one that may not be used, in pixels and at most as large as in
    /// truth `[height * width]`.
    fn distances(&self) -> Vec<f32> {
        // Sums of steps from pixel to pixel, two passes of a chamfer (Borgefors, 1986).
        const ACROSS: f32 = std::f32::consts::SQRT_2;
        let far = (self.width + self.height) as f32;
        let mut distances: Vec<f32> = self.pixels.iter().map(|used| if *used { far } else { 0.0 }).collect();
        let (width, height) = (self.width as isize, self.height as isize);
        let mut pass = |backward: bool| {
            for i in 0..distances.len() {
                let i = if backward { distances.len() - 1 - i } else { i };
                let (x, y) = ((i % self.width) as isize, (i / self.width) as isize);
                let sign = if backward { 1 } else { -1 };
                for (dx, dy, step) in [(sign, 0, 1.0), (-1, sign, ACROSS), (0, sign, 1.0), (1, sign, ACROSS)]
                {
                    let (x, y) = (x + dx, y + dy);
                    if (0..width).contains(&x) && (0..height).contains(&y) {
                        distances[i] = distances[i].min(distances[(y * width + x) as usize] + step);
                    }
                }
            }
        };
        pass(false);
        pass(true);
        // Steps to eight sides are longer than the straight line, at most by 1 / cos(22.5 degrees) = 1.0824,
        // halfway between two of them.
        distances.into_iter().map(|distance| distance / 1.083).collect()
    }
}

/// Colors by weights, divided by the weights; where there is none, those of the picture at half its size.
fn continued(colors: &Picture, weights: &[f32]) -> Picture {
    let own = |(color, weight): (&Vec3, &f32)| *color / weight.max(f32::MIN_POSITIVE);
    if colors.values.len() == 1 || weights.iter().all(|weight| *weight >= 1.0) {
        return Picture { values: colors.values.iter().zip(weights).map(own).collect(), ..*colors };
    }
    let share = Picture { values: weights.iter().map(|weight| Vec3::splat(*weight)).collect(), ..*colors };
    let half = colors.halved();
    let half_weights: Vec<f32> = share.halved().values.iter().map(|weight| weight.x).collect();
    let coarse = continued(&half, &half_weights).resized(colors.width, colors.height);
    let values = colors.values.iter().zip(weights).zip(&coarse.values);
    // A weight below 1 belongs to a pixel of a smaller picture, of which a part is known.
    let values = values.map(
        |((color, weight), coarse)| {
            if *weight >= 1.0 { *color } else { *color + *coarse * (1.0 - weight) }
        },
    );
    Picture { values: values.collect(), ..*colors }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc of radius `r` around the middle of 64 x 48 pixels.
    fn disc(r: f32) -> Used {
        let is_used = |i: usize| ((i % 64) as f32 - 32.0).hypot((i / 64) as f32 - 24.0) < r;
        Used { width: 64, height: 48, pixels: (0..64 * 48).map(is_used).collect() }
    }

    #[test]
    fn distances_are_never_too_large() {
        let used = disc(20.0);
        let others: Vec<usize> = (0..64 * 48).filter(|&i| !used.pixels[i]).collect();
        for (i, found) in used.distances().into_iter().enumerate() {
            let apart = |j: &usize| {
                let of = |i: usize| ((i % 64) as f32, (i / 64) as f32);
                (of(i).0 - of(*j).0).hypot(of(i).1 - of(*j).1)
            };
            let exact = others.iter().map(apart).fold(f32::INFINITY, f32::min);
            assert!(found <= exact + 1e-4 && found >= 0.9 * exact, "{i}: {found} for {exact}");
        }
    }

    #[test]
    fn colors_are_continued_without_an_edge() {
        let used = disc(15.0);
        let value = |i: usize| if used.pixels[i] { Vec3::new(0.2, 0.5, 0.7) } else { Vec3::ONE };
        let picture = Picture { width: 64, height: 48, values: (0..64 * 48).map(value).collect() };
        let filled = used.filled(&picture);
        assert!(filled.values.iter().all(|v| v.distance(Vec3::new(0.2, 0.5, 0.7)) < 1e-3));
        // Known pixels stay as they are.
        let value = |i: usize| Vec3::splat((i % 64) as f32 / 64.0);
        let picture = Picture { width: 64, height: 48, values: (0..64 * 48).map(value).collect() };
        let filled = used.filled(&picture);
        assert!((0..64 * 48).all(|i| !used.pixels[i] || filled.values[i] == picture.values[i]));
        assert!(filled.values.iter().all(|v| (0.2..0.8).contains(&v.x)));
    }

    #[test]
    fn a_pixel_of_another_size_is_used_if_all_under_it_are() {
        let half = Used { width: 4, height: 2, pixels: (0..8).map(|i| i % 4 > 0).collect() };
        assert_eq!(half.resized(2, 1).pixels, [false, true]);
        assert_eq!(half.resized(8, 2).pixels[..8], [false, false, true, true, true, true, true, true]);
    }

    #[test]
    fn some_place_is_used_however_thin_the_shape() {
        for r in [0.8, 3.0, 9.0, 30.0] {
            assert!(disc(r).places((8, 6)).contains(&true), "{r}");
        }
        assert!(
            Used::new(&Some(vec![false; 8]), 4).is_none() && Used::new(&Some(vec![true; 8]), 4).is_none()
        );
    }
}
