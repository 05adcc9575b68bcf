//! A painting prepared for painting scenes: the scale at which it is read, its detail, its colors, and its
//! places.

use std::sync::{Arc, LazyLock};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{
    detail::Detail,
    painting::{MAX_PIXELS, Paint},
    patch::{PATCH, PLACE, STEP, offset_in_patch},
    picture::{Copies, Picture, mirrored},
    places::Descriptors,
    tints::Tints,
    used::Used,
};
use crate::{
    strokes::StrokeTexture,
    work::{Canceled, Work},
};

/// Scales at which a painting may be read, the largest first: sides of a picture of 512 x 512 pixels of area,
/// in its own. Below half, whole small motifs fit on a stroke's spot.
const SCALES: [f32; 3] = [1.0, 0.71, 0.5];

/// Share of a painting's variance of luminance that should be finer than [`FINE`]. Strokes of any size then
/// land in fine detail. With less, the scene would look like a recolored photograph.
const FINE_SHARE: f32 = 0.6;

/// Standard deviation of fine detail, in pixels.
const FINE: f32 = 4.0;

/// Standard deviation of a place's color, in pixels: a place is read about this far around.
const PLACE_BLUR: f32 = 6.0;

/// Blurred copy by which places are compared: it has shapes and no strokes.
const SHAPES: usize = 4;

/// Least clarity at which strokes are aligned with the scene's edges. Below it, the painting stands upright.
pub(super) const CLEAR: f32 = 0.25;

/// A texture that is made when it is first asked for.
type LateTexture = LazyLock<Arc<StrokeTexture>, Box<dyn FnOnce() -> Arc<StrokeTexture> + Send>>;

/// A painting prepared for painting any scene.
pub struct Canvas {
    /// Size at which it is read, in pixels: a pixel is one of a picture of 512 pixels that shows the whole
    /// scene.
    pub(super) size: Vec2,
    pub(super) detail: Detail,
    /// The texture that its strokes show. That of a picture that was read in another's stead is only made if it
    /// is asked for, since the GPU makes its own.
    texture: LateTexture,
    /// The texture of the picture that was read first. Strokes that stay are known by it.
    first: Arc<StrokeTexture>,
    /// Its colors.
    pub(super) tints: Tints,
    /// Columns and rows of places.
    pub(super) n_places: (usize, usize),
    /// The direction of strokes at each place, a unit vector in pixels (x right, y down) `[P]`, and how clear
    /// it is.
    pub(super) strokes: Vec<(Vec2, f32)>,
    /// Places upright, and along their strokes where these are clear `[P]` each.
    pub(super) places: [Descriptors; 2],
    /// Colors of places, without detail `[P]`.
    pub(super) colors: Vec<Vec3>,
    /// Whether each place may be used `[P]`; `None` if all may.
    pub(super) used: Option<Vec<bool>>,
}

impl Canvas {
    /// Prepares a painting. Takes some 0.1 s on two cores.
    pub fn new(paint: &Paint) -> Self {
        Self::new_if_wanted(paint, &Work::default()).expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`new`](Self::new).
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new_if_wanted(paint: &Paint, work: &Work) -> Result<Self, Canceled> {
        Self::read(paint, None, work)
    }

    /// Another picture in this painting's stead, read at the same size, so that places in one are places in the
    /// other: the next frame of a film. Takes as long as [`new`](Self::new).
    pub fn reread(&self, paint: &Paint) -> Self {
        let work = Work::default();
        self.reread_if_wanted(paint, &work).expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`reread`](Self::reread).
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn reread_if_wanted(&self, paint: &Paint, work: &Work) -> Result<Self, Canceled> {
        Self::read(paint, Some(self), work)
    }

    /// Width and height at which it is read, in pixels.
    pub fn reading_size(&self) -> [u32; 2] {
        self.size.to_array().map(|side| side as u32)
    }

    /// The texture that its strokes show.
    pub fn texture(&self) -> &Arc<StrokeTexture> {
        &self.texture
    }

    /// Whether strokes that were laid on in `texture` follow this painting: it is their own, or was [read in
    /// its stead](Self::reread).
    pub fn follows(&self, texture: &Arc<StrokeTexture>) -> bool {
        Arc::ptr_eq(&self.first, texture)
    }

    /// Whether all of the painting may be used.
    pub fn is_whole(&self) -> bool {
        self.used.is_none()
    }

    /// Prepares a painting that is read in the stead of another one, or else at its own scale.
    fn read(paint: &Paint, instead_of: Option<&Self>, work: &Work) -> Result<Self, Canceled> {
        let reading = Reading::new(paint, instead_of.map(Self::reading_size), work)?;
        let Reading { copies, used, .. } = &reading;
        let picture = copies.picture();
        let (width, height) = (picture.width, picture.height);
        let detail = Detail::new(copies, used.as_ref(), &work.part(0.3, 0.5))?;
        // A pixel for each place, blurred by a place's side.
        let tensors = (0..PLACE.ilog2()).fold(copies.copy(1).structure(), |tensors, _| tensors.halved());
        let strokes: Vec<(Vec2, f32)> = tensors.blurred(1.0).values.into_iter().map(stroke).collect();
        let n_places = (width.div_ceil(PLACE), height.div_ceil(PLACE));
        work.at(0.55)?;
        let places = [false, true].map(|aligned| places(copies, n_places, &strokes, aligned));
        work.at(0.6)?;
        let (texture, first): (LateTexture, _) = match instead_of {
            Some(of) => {
                let (paint, size) = (paint.clone(), of.reading_size());
                (LazyLock::new(Box::new(move || texture_at(&paint, size))), Arc::clone(&of.first))
            }
            None => {
                let texture = detail.texture(copies, &reading.original, &work.part(0.6, 1.0))?;
                let first = Arc::clone(&texture);
                (LazyLock::new(Box::new(move || texture)), first)
            }
        };
        let whole = used.as_ref().map(|used| used.of(&picture.values).collect::<Vec<_>>());
        Ok(Self {
            size: picture.size(),
            tints: Tints::new(whole.as_ref().unwrap_or(&picture.values), &detail.low),
            colors: (0..n_places.0 * n_places.1)
                .map(|place| copies.blurred(center_of(place, n_places), PLACE_BLUR))
                .collect(),
            used: used.as_ref().map(|used| used.places(n_places)),
            n_places,
            strokes,
            places,
            detail,
            texture,
            first,
        })
    }

    /// The colors of the painting, to lay another one's strokes on in.
    pub fn tints(&self) -> &Tints {
        &self.tints
    }

    /// Whether another canvas is of the same painting.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
            || self.size == other.size
                && self.used == other.used
                && self.colors == other.colors
                && *self.texture == *other.texture
                // Strokes that stay show two.
                && self.first == other.first
    }

    /// The center of a place, in pixels.
    pub(super) fn center_of(&self, place: usize) -> Vec2 {
        center_of(place, self.n_places)
    }

    /// Whether a place may be used.
    pub(super) fn is_used(&self, place: usize) -> bool {
        self.used.as_ref().is_none_or(|used| used[place])
    }

    /// The place at a position in pixels, mirrored into the painting.
    pub(super) fn place_at(&self, at: Vec2) -> usize {
        let index = |at: f32, size: f32, n: usize| ((mirrored(at, size) / PLACE as f32) as usize).min(n - 1);
        index(at.y, self.size.y, self.n_places.1) * self.n_places.0
            + index(at.x, self.size.x, self.n_places.0)
    }
}

/// The texture of a painting that is read at a size. Only pixels that may be used count.
pub(super) fn texture_at(paint: &Paint, size: [u32; 2]) -> Arc<StrokeTexture> {
    let work = Work::default();
    let made = || {
        let Reading { original, copies, used } = Reading::new(paint, Some(size), &work)?;
        Detail::new(&copies, used.as_ref(), &work)?.texture(&copies, &original, &work)
    };
    made().expect("nobody else has the work, so nobody cancels it")
}

/// A painting as it is read.
struct Reading {
    /// The painting, filled where it may not be used.
    original: Picture,
    /// It and its blurred copies at the size at which it is read.
    copies: Copies,
    /// Its pixels that may be used at that size; `None` if all may.
    used: Option<Used>,
}

impl Reading {
    /// Reads a painting at a size, or else at its own scale: 0.3 of `work`.
    ///
    /// # Errors
    /// If `work` is canceled.
    fn new(paint: &Paint, size: Option<[u32; 2]>, work: &Work) -> Result<Self, Canceled> {
        work.check()?;
        let mut original = paint.picture();
        let used = Used::new(&paint.used, paint.width);
        if let Some(used) = &used {
            original = used.filled(&original);
        }
        let (width, height) = match size {
            Some(size) => size.map(|side| side as usize).into(),
            None => own_size(&original, used.as_ref(), work)?,
        };
        work.at(0.1)?;
        let copies = Copies::new(original.resized(width, height));
        work.at(0.3)?;
        let used = used.map(|used| used.resized(width, height)).filter(|used| used.pixels.contains(&true));
        Ok(Self { original, copies, used })
    }
}

fn center_of(place: usize, n_places: (usize, usize)) -> Vec2 {
    let (x, y) = (place % n_places.0, place / n_places.0);
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * PLACE as f32
}

/// The size at which a painting is read, in pixels: the largest of [`SCALES`] at which enough of it is fine.
/// Only `used` pixels count.
///
/// # Errors
/// If `work` is canceled.
fn own_size(original: &Picture, used: Option<&Used>, work: &Work) -> Result<(usize, usize), Canceled> {
    // Whatever its size, strokes have the size that they have in a painting of 512 x 512 pixels.
    let usual = (MAX_PIXELS as f32 / original.values.len().max(1) as f32).sqrt();
    let variance = |picture: &Picture, used: Option<&Used>| {
        let mut values = picture.luminance();
        if let Some(used) = used {
            values = used.of(&values).collect();
        }
        let mean = values.iter().sum::<f32>() / values.len().max(1) as f32;
        values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / values.len().max(1) as f32
    };
    let all = variance(original, used);
    // Halved, since only coarse shapes remain.
    let half = original.halved();
    let half_used = used.map(|used| used.resized(half.width, half.height));
    let is_enough = |scale: f32| {
        let sigma = 0.5 * FINE / (scale * usual);
        all - variance(&half.blurred(sigma.max(0.1)), half_used.as_ref()) >= FINE_SHARE * all
    };
    let mut scale = SCALES[SCALES.len() - 1];
    for larger in SCALES {
        work.check()?;
        if is_enough(larger) {
            scale = larger;
            break;
        }
    }
    let side = |side: usize| ((side as f32 * usual * scale).round() as usize).max(1);
    Ok((side(original.width), side(original.height)))
}

/// Descriptors of all places, upright or along their strokes.
fn places(copies: &Copies, n_places: (usize, usize), strokes: &[(Vec2, f32)], aligned: bool) -> Descriptors {
    let of_place = |place: usize| {
        let (stroke, clarity) = strokes[place];
        // The painting's up is -y in pixels.
        let along = if aligned && clarity > CLEAR { stroke } else { Vec2::NEG_Y };
        let beside = Vec2::new(-along.y, along.x);
        let center = center_of(place, n_places);
        let colors: [Vec3; PATCH] = std::array::from_fn(|k| {
            let (a, b) = offset_in_patch(k);
            copies.sample(SHAPES, center + (along * a + beside * b) * STEP)
        });
        (colors, copies.blurred(center, PLACE_BLUR))
    };
    let of_places: Vec<_> = (0..n_places.0 * n_places.1).into_par_iter().map(of_place).collect();
    Descriptors::new(of_places.into_iter())
}

/// The direction across which a structure tensor (xx, xy, yy) varies least, and how clear it is: 0 to 1.
fn stroke(tensor: Vec3) -> (Vec2, f32) {
    let (difference, trace) = (tensor.x - tensor.z, tensor.x + tensor.z);
    let across = 0.5 * (2.0 * tensor.y).atan2(difference);
    let clarity = difference.hypot(2.0 * tensor.y) / trace.max(f32::MIN_POSITIVE);
    (Vec2::from_angle(across).perp(), clarity)
}
