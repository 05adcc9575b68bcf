//! Pictures of colors, and blurred copies of them.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::palette::LUMINANCE;

/// Standard deviations of the blurred copies, in pixels. The first is the picture itself. Bands of detail lie
/// between one copy and the next; the last is a painting's color as opposed to its detail.
pub(super) const BLURS: [f32; N_COPIES] = [0.0, 1.0, 2.0, 4.0, 8.0, 24.0];

/// Copies of a picture.
pub const N_COPIES: usize = 6;

/// Sides of the blurred copies, as shares of the picture's. A deviation has at least two pixels, so little is
/// lost.
pub const SHRUNK: [f32; N_COPIES] = [1.0, 1.0, 1.0, 0.5, 0.25, 0.125];

/// RGB values, 0..1.
#[derive(Clone)]
pub(super) struct Picture {
    pub width: usize,
    pub height: usize,
    pub values: Vec<Vec3>,
}

/// A picture and blurred copies of it.
pub(super) struct Copies(Vec<Picture>);

impl Copies {
    /// Blurs a picture.
    pub fn new(picture: Picture) -> Self {
        let mut copies = vec![picture];
        for (is_halved, sigma) in copy_steps() {
            let last = &copies[copies.len() - 1];
            let halved = is_halved.then(|| last.halved());
            copies.push(halved.as_ref().unwrap_or(last).blurred(sigma));
        }
        Self(copies)
    }

    /// The picture itself.
    pub fn picture(&self) -> &Picture {
        &self.0[0]
    }

    /// The copy of a number.
    pub fn copy(&self, copy: usize) -> &Picture {
        &self.0[copy]
    }

    /// A copy at `at`, in pixels of the picture.
    pub fn sample(&self, copy: usize, at: Vec2) -> Vec3 {
        self.0[copy].sample(SHRUNK[copy] * at)
    }

    /// The picture at `at`, blurred by `sigma` pixels, 1 to 8.
    pub fn blurred(&self, at: Vec2, sigma: f32) -> Vec3 {
        // Copies double their blur from the second on.
        let level = (sigma.log2() + 1.0).clamp(1.0, 4.0);
        let sharper = (level as usize).min(3);
        self.sample(sharper, at).lerp(self.sample(sharper + 1, at), level - sharper as f32)
    }
}

/// How each blurred copy is made from the one before it, from the second on: whether that is halved first, and
/// the standard deviation of the blur, in pixels of the copy. The first copy is the picture itself.
pub fn copy_steps() -> [(bool, f32); N_COPIES - 1] {
    std::array::from_fn(|i| {
        // Variances add up, so each copy is made by a smaller blur than its own.
        let mut variance = BLURS[i + 1] * BLURS[i + 1] - BLURS[i] * BLURS[i];
        let is_halved = SHRUNK[i + 1] < SHRUNK[i];
        if is_halved {
            // The mean of two pixels is a blur as well: -0.5 and 0.5 have a variance of 0.25.
            variance -= 0.25 / (SHRUNK[i] * SHRUNK[i]);
        }
        (is_halved, SHRUNK[i + 1] * variance.sqrt())
    })
}

/// The standard deviation, in old pixels, by which a picture is blurred before it is read at steps of `step`
/// old pixels, or `None` if it need not be.
pub(super) fn softening(step: Vec2) -> Option<f32> {
    // Deviation of a box of one new pixel, less that of an old one: sqrt((s^2 - 1) / 12).
    let sigma = ((step.x * step.y - 1.0).max(0.0) / 12.0).sqrt();
    (sigma > 0.1).then_some(sigma)
}

/// Pixels on each side that a blur of standard deviation `sigma` reads: three deviations hold 99.7% of it.
pub fn reach(sigma: f32) -> u32 {
    (3.0 * sigma).ceil() as u32
}

/// `at` folded into 0..=size, as in a mirror at each end.
pub(super) fn mirrored(at: f32, size: f32) -> f32 {
    if (0.0..=size).contains(&at) {
        return at;
    }
    let at = at.rem_euclid(2.0 * size);
    if at > size { 2.0 * size - at } else { at }
}

impl Picture {
    /// Width and height.
    pub fn size(&self) -> Vec2 {
        Vec2::new(self.width as f32, self.height as f32)
    }

    /// Luminance of each pixel.
    pub fn luminance(&self) -> Vec<f32> {
        self.values.iter().map(|color| color.dot(LUMINANCE)).collect()
    }

    /// The pixel at column x and row y, or the nearest one.
    fn pixel(&self, x: isize, y: isize) -> Vec3 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.values[y * self.width + x]
    }

    /// The value at a position in pixels, mirrored and interpolated.
    pub fn sample(&self, at: Vec2) -> Vec3 {
        let (x, y) = (mirrored(at.x, self.width as f32) - 0.5, mirrored(at.y, self.height as f32) - 0.5);
        // Above -1, where casting rounds down.
        let (left, top) = ((x + 1.0) as isize - 1, (y + 1.0) as isize - 1);
        let pixel = |dx, dy| self.pixel(left + dx, top + dy);
        let (x, y) = (x - left as f32, y - top as f32);
        pixel(0, 0).lerp(pixel(1, 0), x).lerp(pixel(0, 1).lerp(pixel(1, 1), x), y)
    }

    /// The picture at `width` x `height` pixels. Smaller ones are blurred first, so that nothing aliases.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let step = self.size() / Vec2::new(width as f32, height as f32);
        let soft = softening(step).map(|sigma| self.blurred(sigma));
        let source = soft.as_ref().unwrap_or(self);
        let mut values = vec![Vec3::ZERO; width * height];
        values.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                *value = source.sample(step * Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
            }
        });
        Self { width, height, values }
    }

    /// The picture at half its size, rounded up: means of 2 x 2 pixels.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut values = vec![Vec3::ZERO; width * height];
        values.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            let row = |y: usize| &self.values[y.min(self.height - 1) * self.width..][..self.width];
            let (upper, lower) = (row(2 * y), row(2 * y + 1));
            for (x, out) in out.iter_mut().enumerate() {
                let (left, right) = (2 * x, (2 * x + 1).min(self.width - 1));
                *out = 0.25 * (upper[left] + upper[right] + lower[left] + lower[right]);
            }
        });
        Self { width, height, values }
    }

    /// The picture blurred by a Gaussian of standard deviation `sigma`, in pixels.
    pub fn blurred(&self, sigma: f32) -> Self {
        let reach = reach(sigma) as isize;
        let kernel: Vec<f32> = (-reach..=reach).map(|d| (-0.5 * (d as f32 / sigma).powi(2)).exp()).collect();
        let total: f32 = kernel.iter().sum();
        // Whole rows at a time, from which the compiler makes vectors.
        let add = |sum: &mut [Vec3], values: &[Vec3], weight: f32| {
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += *value * (weight / total));
        };
        let clamped = |at: isize, n: usize| at.clamp(0, n as isize - 1) as usize;
        let (width, height) = (self.width, self.height);
        let mut rows = vec![Vec3::ZERO; width * height];
        rows.par_chunks_mut(width).zip(self.values.par_chunks(width)).for_each(|(sum, row)| {
            let wide = -reach..width as isize + reach;
            let wide: Vec<Vec3> = wide.map(|x| row[clamped(x, width)]).collect();
            for (tap, weight) in kernel.iter().enumerate() {
                add(sum, &wide[tap..], *weight);
            }
        });
        let mut values = vec![Vec3::ZERO; width * height];
        values.par_chunks_mut(width).enumerate().for_each(|(y, sum)| {
            for (d, weight) in (-reach..=reach).zip(&kernel) {
                add(sum, &rows[clamped(y as isize + d, height) * width..][..width], *weight);
            }
        });
        Self { values, width, height }
    }

    /// Products of the luminance's gradient with itself at each pixel: (xx, xy, yy).
    pub fn structure(&self) -> Self {
        let luminance = self.luminance();
        let row = |y: usize| &luminance[y.min(self.height - 1) * self.width..][..self.width];
        let mut values = vec![Vec3::ZERO; self.values.len()];
        values.par_chunks_mut(self.width).enumerate().for_each(|(y, out)| {
            let (above, here, below) = (row(y.saturating_sub(1)), row(y), row(y + 1));
            for (x, out) in out.iter_mut().enumerate() {
                let dx = here[(x + 1).min(self.width - 1)] - here[x.saturating_sub(1)];
                let dy = below[x] - above[x];
                *out = Vec3::new(dx * dx, dx * dy, dy * dy);
            }
        });
        Self { values, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resizing_keeps_the_mean_and_smooth_shapes() {
        let (width, height) = (90, 60);
        let value =
            |i: usize| Vec3::new((i % width) as f32 / 90.0, (i / width) as f32 / 60.0, (i % 2) as f32);
        let picture = Picture { width, height, values: (0..width * height).map(value).collect() };
        for (width, height) in [(45, 30), (30, 31), (180, 90)] {
            let resized = picture.resized(width, height);
            assert_eq!(resized.values.len(), width * height);
            let mean = resized.values.iter().sum::<Vec3>() / resized.values.len() as f32;
            assert!((mean - 0.5).abs().max_element() < 0.02, "{mean}");
            let middle = resized.sample(resized.size() * Vec2::new(0.3, 0.7));
            assert!((middle.x - 0.3).abs() < 0.02 && (middle.y - 0.7).abs() < 0.03, "{middle}");
        }
        // Stripes of one pixel are gray in a third of the size.
        assert!(picture.resized(30, 20).values.iter().all(|value| (value.z - 0.5).abs() < 0.2));
    }
}
