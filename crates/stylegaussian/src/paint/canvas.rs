//! A painting prepared for reading: blurred copies, and color and stroke direction of each place.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{
    painting::{PLACE, Paint},
    tone::Tones,
};
use crate::palette::{LUMINANCE, Palette};

/// Standard deviations of the blurred copies, in pixels. The first is the painting itself. The copies serve Gaussians of
/// all sizes: one that is larger than a stroke gets the stroke's mean color, and not that of one pixel of it. The last is the
/// painting's color as opposed to its detail: strokes are detail.
const BLURS: [f32; N_DETAILS + 1] = [0.0, 1.0, 2.0, 4.0, 8.0, 24.0];

/// Sides of the copies, as shares of the painting's. A deviation has at least two pixels, so little is lost.
const SHRUNK: [f32; N_DETAILS + 1] = [1.0, 1.0, 1.0, 0.5, 0.25, 0.125];

/// Bands of a painting's detail: between one copy and the next.
pub(super) const N_DETAILS: usize = 5;

/// Share of a Gaussian's deviation at which it reads. The whole of it would blur twice: drawing does too.
const SHARPNESS: f32 = 0.2;

/// Pixels of a painting of which one in a cell of the color cube is no color of its own: specks of dust.
const RARE: usize = 10_000;

/// Standard deviation of a place's color, in pixels: a place is read about this far around.
const PLACE_BLUR: f32 = 6.0;

/// RGB values of a painting, 0..1.
struct Picture {
    width: usize,
    height: usize,
    values: Vec<Vec3>,
}

/// The color of a place in a picture, and bands of its detail from the finest.
pub(super) type Reading = (Vec3, [Vec3; N_DETAILS]);

/// A picture and blurred copies of it.
pub(super) struct Copies(Vec<Picture>);

/// A painting prepared for reading.
pub(super) struct Canvas {
    /// The painting's colors.
    pub palette: Palette,
    /// Distribution of its luminance.
    pub tones: Tones,
    copies: Copies,
    /// Columns and rows of places.
    pub n_places: (usize, usize),
    /// Mean color of each place `[P]`.
    pub place_colors: Vec<Vec3>,
    /// The direction of strokes at each place, a unit vector in pixels (x right, y down) `[P]`, and how clear it is.
    pub strokes: Vec<(Vec2, f32)>,
}

impl Canvas {
    pub fn new(paint: &Paint) -> Self {
        let copies = Copies::new(paint.colors(), [paint.width, paint.height]);
        let rgb: Vec<f32> = paint.pixels.iter().map(|byte| f32::from(*byte) / 255.0).collect();
        let palette = Palette::new(&rgb, 1 + rgb.len() / 3 / RARE);
        // A pixel for each place, blurred by a place's side.
        let tensors = (0..PLACE.ilog2()).fold(copies.0[1].structure(), |tensors, _| tensors.halved());
        let tensors = tensors.blurred(1.0);
        let n_places = paint.n_places();
        let places = 0..n_places.0 * n_places.1;
        let mut canvas = Self {
            palette,
            tones: Tones::new(copies.luminance()),
            place_colors: Vec::new(),
            strokes: tensors.values.into_iter().map(stroke).collect(),
            n_places,
            copies,
        };
        canvas.place_colors =
            places.map(|place| canvas.copies.blurred(canvas.center_of(place), PLACE_BLUR)).collect();
        canvas
    }

    /// Luminance of each pixel.
    pub fn luminance(&self) -> Vec<f32> {
        self.copies.luminance()
    }

    /// Size in pixels.
    pub fn size(&self) -> Vec2 {
        let Picture { width, height, .. } = self.copies.0[0];
        Vec2::new(width as f32, height as f32)
    }

    /// The painting at `at`, in pixels from its corner, for a Gaussian of standard deviation `sigma` pixels.
    pub fn read(&self, at: Vec2, sigma: f32) -> Reading {
        self.copies.read(at, sigma)
    }

    /// The center of a place, in pixels.
    pub fn center_of(&self, place: usize) -> Vec2 {
        let (x, y) = (place % self.n_places.0, place / self.n_places.0);
        Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * PLACE as f32
    }

    /// The place at a position in pixels, mirrored into the painting.
    pub fn place_at(&self, at: Vec2) -> usize {
        let index = |at: f32, size: f32, n: usize| ((mirrored(at, size) / PLACE as f32) as usize).min(n - 1);
        let size = self.size();
        index(at.y, size.y, self.n_places.1) * self.n_places.0 + index(at.x, size.x, self.n_places.0)
    }
}

impl Copies {
    /// Blurs a picture `[H * W]` of `size` (width and height).
    pub fn new(values: Vec<Vec3>, [width, height]: [usize; 2]) -> Self {
        let mut copies = vec![Picture { width, height, values }];
        for (blurs, shrunk) in BLURS.windows(2).zip(SHRUNK.windows(2)) {
            let last = &copies[copies.len() - 1];
            // Variances add up, so each copy is made from the one before it by a smaller blur.
            let mut variance = blurs[1] * blurs[1] - blurs[0] * blurs[0];
            let halved = (shrunk[1] < shrunk[0]).then(|| last.halved());
            if halved.is_some() {
                // The mean of two pixels is a blur as well: -0.5 and 0.5 have a variance of 0.25.
                variance -= 0.25 / (shrunk[0] * shrunk[0]);
            }
            copies.push(halved.as_ref().unwrap_or(last).blurred(shrunk[1] * variance.sqrt()));
        }
        Self(copies)
    }

    /// Luminance of each pixel of the picture.
    fn luminance(&self) -> Vec<f32> {
        self.0[0].values.iter().map(|color| color.dot(LUMINANCE)).collect()
    }

    /// The picture at `at`, in pixels from its corner, for a Gaussian of standard deviation `sigma` pixels. Beyond its
    /// edges the picture is mirrored.
    pub fn read(&self, at: Vec2, sigma: f32) -> Reading {
        let at_least = SHARPNESS * sigma;
        let mut copies = [self.sample(N_DETAILS, at); N_DETAILS + 1];
        for (i, (copy, blur)) in copies[..N_DETAILS].iter_mut().zip(BLURS).enumerate() {
            *copy = if at_least <= blur { self.sample(i, at) } else { self.blurred(at, at_least) };
        }
        (copies[N_DETAILS], std::array::from_fn(|band| copies[band] - copies[band + 1]))
    }

    /// A copy at `at`, in pixels of the picture.
    fn sample(&self, copy: usize, at: Vec2) -> Vec3 {
        self.0[copy].sample(SHRUNK[copy] * at)
    }

    /// The picture at `at`, blurred by `sigma` pixels.
    fn blurred(&self, at: Vec2, sigma: f32) -> Vec3 {
        // Copies double their blur from 1 on, and there is one without.
        let level = if sigma < 0.5 { 0.0 } else { (sigma.log2() + 1.0).clamp(0.0, (N_DETAILS - 1) as f32) };
        let sharper = (level as usize).min(N_DETAILS - 2);
        let between = level - sharper as f32;
        let sharp = self.sample(sharper, at);
        if between > 0.0 { sharp.lerp(self.sample(sharper + 1, at), between) } else { sharp }
    }
}

/// The direction across which a structure tensor (xx, xy, yy) varies least, and how clear it is: 0 to 1.
fn stroke(tensor: Vec3) -> (Vec2, f32) {
    let (difference, trace) = (tensor.x - tensor.z, tensor.x + tensor.z);
    let across = 0.5 * (2.0 * tensor.y).atan2(difference);
    let clarity = difference.hypot(2.0 * tensor.y) / trace.max(f32::MIN_POSITIVE);
    (Vec2::from_angle(across).perp(), clarity)
}

/// `at` folded into 0..=size, as in a mirror at each end.
fn mirrored(at: f32, size: f32) -> f32 {
    if (0.0..=size).contains(&at) {
        return at;
    }
    let at = at.rem_euclid(2.0 * size);
    if at > size { 2.0 * size - at } else { at }
}

impl Picture {
    /// The pixel at column x and row y, or the nearest one.
    fn pixel(&self, x: isize, y: isize) -> Vec3 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.values[y * self.width + x]
    }

    /// The value at a position in pixels, mirrored and interpolated.
    fn sample(&self, at: Vec2) -> Vec3 {
        let (x, y) = (mirrored(at.x, self.width as f32) - 0.5, mirrored(at.y, self.height as f32) - 0.5);
        // Above -1, where casting rounds down.
        let (left, top) = ((x + 1.0) as isize - 1, (y + 1.0) as isize - 1);
        let pixel = |dx, dy| self.pixel(left + dx, top + dy);
        let (x, y) = (x - left as f32, y - top as f32);
        pixel(0, 0).lerp(pixel(1, 0), x).lerp(pixel(0, 1).lerp(pixel(1, 1), x), y)
    }

    /// The picture at half its size, rounded up: means of 2 x 2 pixels.
    fn halved(&self) -> Self {
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
    fn blurred(&self, sigma: f32) -> Self {
        // Three deviations hold 99.7% of the kernel.
        let reach = (3.0 * sigma).ceil() as isize;
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
    fn structure(&self) -> Self {
        let luminance: Vec<f32> = self.values.iter().map(|color| color.dot(LUMINANCE)).collect();
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
