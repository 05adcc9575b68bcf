//! A painting prepared for reading: blurred copies, and color and stroke direction of each place.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::painting::{PLACE, Paint};
use crate::palette::{LUMINANCE, Palette};

/// Standard deviations of the blurred copies, in pixels. The first is the painting itself. The copies serve Gaussians of
/// all sizes: one that is larger than a stroke gets the stroke's mean color, and not that of one pixel of it.
const BLURS: [f32; 5] = [0.0, 1.0, 2.0, 4.0, 8.0];

/// Standard deviation of the painting's color as opposed to its detail, in pixels: strokes are detail.
const LOW: f32 = 24.0;

/// Pixels of the painting to one of its color, each way. Nothing is lost after so wide a blur.
const LOW_STEP: usize = 4;

/// Bands of a painting's detail: between one copy and the next, and between the last and the painting's color.
pub(super) const N_DETAILS: usize = BLURS.len();

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
pub(super) struct Copies {
    copies: Vec<Picture>,
    /// The picture's color: every [`LOW_STEP`]th pixel.
    low: Picture,
}

/// A painting prepared for reading.
pub(super) struct Canvas {
    /// The painting's colors.
    pub palette: Palette,
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
        let tensors = copies.copies[1].structure().blurred(PLACE as f32);
        let n_places = paint.n_places();
        let at_place = |picture: &Picture, place: usize| {
            let (x, y) = (place % n_places.0, place / n_places.0);
            picture.pixel((x * PLACE + PLACE / 2) as isize, (y * PLACE + PLACE / 2) as isize)
        };
        let places = 0..n_places.0 * n_places.1;
        let mut canvas = Self {
            palette,
            place_colors: Vec::new(),
            strokes: places.clone().map(|place| stroke(at_place(&tensors, place))).collect(),
            n_places,
            copies,
        };
        canvas.place_colors =
            places.map(|place| canvas.copies.blurred(canvas.center_of(place), PLACE_BLUR)).collect();
        canvas
    }

    /// Luminance of each pixel.
    pub fn luminance(&self) -> Vec<f32> {
        self.copies.copies[0].values.iter().map(|color| color.dot(LUMINANCE)).collect()
    }

    /// Size in pixels.
    pub fn size(&self) -> Vec2 {
        let Picture { width, height, .. } = self.copies.copies[0];
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
        for pair in BLURS.windows(2) {
            // Variances add up, so each copy is made from the one before it by a smaller blur.
            let next = copies[copies.len() - 1].blurred((pair[1] * pair[1] - pair[0] * pair[0]).sqrt());
            copies.push(next);
        }
        let low =
            copies[4].thinned(LOW_STEP).blurred((LOW * LOW - BLURS[4] * BLURS[4]).sqrt() / LOW_STEP as f32);
        Self { copies, low }
    }

    /// The picture at `at`, in pixels from its corner, for a Gaussian of standard deviation `sigma` pixels. Beyond its
    /// edges the picture is mirrored.
    pub fn read(&self, at: Vec2, sigma: f32) -> Reading {
        let low = self.low.sample(at / LOW_STEP as f32);
        let copies = BLURS.map(|blur| self.blurred(at, blur.max(SHARPNESS * sigma)));
        (low, std::array::from_fn(|band| copies[band] - copies.get(band + 1).unwrap_or(&low)))
    }

    /// The picture at `at`, blurred by `sigma` pixels.
    fn blurred(&self, at: Vec2, sigma: f32) -> Vec3 {
        // Copies double their blur from 1 on, and there is one without.
        let level = if sigma < 0.5 { 0.0 } else { (sigma.log2() + 1.0).clamp(0.0, (BLURS.len() - 1) as f32) };
        let sharper = (level as usize).min(BLURS.len() - 2);
        let between = level - sharper as f32;
        let sharp = self.copies[sharper].sample(at);
        if between > 0.0 { sharp.lerp(self.copies[sharper + 1].sample(at), between) } else { sharp }
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
        let (left, top) = (x.floor(), y.floor());
        let pixel = |dx, dy| self.pixel(left as isize + dx, top as isize + dy);
        let upper = pixel(0, 0).lerp(pixel(1, 0), x - left);
        upper.lerp(pixel(0, 1).lerp(pixel(1, 1), x - left), y - top)
    }

    /// One of `step` x `step` pixels, in the middle of each block.
    fn thinned(&self, step: usize) -> Self {
        let (width, height) = (self.width.div_ceil(step), self.height.div_ceil(step));
        let at = |i: usize| {
            self.pixel((i % width * step + step / 2) as isize, (i / width * step + step / 2) as isize)
        };
        Self { width, height, values: (0..width * height).map(at).collect() }
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
        let luminance = |x: isize, y: isize| self.pixel(x, y).dot(LUMINANCE);
        let tensor = |i: usize| {
            let (x, y) = ((i % self.width) as isize, (i / self.width) as isize);
            let dx = luminance(x + 1, y) - luminance(x - 1, y);
            let dy = luminance(x, y + 1) - luminance(x, y - 1);
            Vec3::new(dx * dx, dx * dy, dy * dy)
        };
        let values = (0..self.values.len()).into_par_iter().map(tensor).collect();
        Self { values, width: self.width, height: self.height }
    }
}
