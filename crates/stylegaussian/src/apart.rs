//! Paint that is laid on apart: by another instance of this program, which shares no memory with this one, as a
//! worker of a browser.
//!
//! [`Call`]s go there as bytes, [`Apart::answer`] answers them there, and bytes come back. Both run the same
//! program, so numbers are as they lie in memory, and nothing is rounded. What is used again, surfaces and
//! canvases, stays there under a number.

mod answer;
mod bytes;
#[cfg(test)]
mod tests;

use glam::{Affine3A, DVec3, UVec2, Vec2, Vec3};

use crate::{
    camera::Camera,
    frame::Frame,
    neighbors::Neighbors,
    paint::{Direction, Paint, Pin, TintsError},
    restyle::RestyleError,
    scene::{Scene, ScreenFilter, Sh},
    strokes::StrokeSeed,
    work::Canceled,
};
pub use answer::Apart;
pub use bytes::Pieces;
use bytes::{Reader, own, piece};

/// A request.
pub enum Call<'a> {
    /// A scene's surface, under a number. The scene may be a [part](crate::paint::Surface::part_of) of the one
    /// of another surface, which is given by its number.
    Surface(u32, &'a Scene, Option<u32>),
    /// A painting's canvas, under a number.
    Canvas(u32, &'a Paint),
    /// Paint on a scene. The answer is a [`Painted`](crate::paint::Painted) as bytes.
    Lay(Laying<'a>),
    /// Strokes that were laid on by the same call without pins, with its pins: their seeds for those that are
    /// given.
    Pin(Laying<'a>, &'a [StrokeSeed]),
    /// No surface under this number any more.
    ForgetSurface(u32),
    /// No canvas under this number any more.
    ForgetCanvas(u32),
}

/// Paint on a scene.
#[derive(Clone, Copy)]
pub struct Laying<'a> {
    /// The number of the surface.
    pub surface: u32,
    /// The number of the surface that this one is a part of, if it is one. It is painted as the whole is. The
    /// whole is painted in this style first, unless this style was the last one there.
    pub whole: Option<u32>,
    /// Numbers and weights of the canvases.
    pub paintings: &'a [(u32, f64)],
    /// Choices beside them.
    pub hand: Choices<'a>,
    /// Share of the base colors that stays, 0..1.
    pub content: f64,
}

/// Choices beside paintings: a [`Hand`](crate::paint::Hand) whose palette may be that of a canvas.
#[derive(Clone, Copy)]
pub struct Choices<'a> {
    /// As in [`Hand`](crate::paint::Hand).
    pub is_collection: bool,
    /// Colors in the paintings' stead.
    pub tints: Option<TintsOf<'a>>,
    /// As in [`Hand`](crate::paint::Hand).
    pub palette: f32,
    /// As in [`Hand`](crate::paint::Hand).
    pub direction: Option<Direction<'a>>,
    /// As in [`Hand`](crate::paint::Hand).
    pub pins: &'a [Pin],
}

/// Whose colors.
#[derive(Clone, Copy)]
pub enum TintsOf<'a> {
    /// Those of a canvas, by its number.
    Canvas(u32),
    /// These, display-referred.
    Colors(&'a [[f32; 3]]),
}

/// A call or an answer cannot be read, or nothing can be laid on.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum ApartError {
    /// There are too few bytes.
    #[error("found a part of a call or an answer, expected all of it")]
    Part,
    /// There are too many.
    #[error("found {0} bytes after a call or an answer, expected none")]
    More(usize),
    /// Something is named that is not there.
    #[error("found the number of a {what} that is not there")]
    Unknown {
        /// What it would be.
        what: &'static str,
    },
    /// The given colors are no palette.
    #[error(transparent)]
    Tints(#[from] TintsError),
    /// The style cannot be had: the reason.
    #[error("{0}")]
    Style(String),
    /// Nobody wants it any more.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

impl From<RestyleError> for ApartError {
    fn from(error: RestyleError) -> Self {
        Self::Style(error.to_string())
    }
}

/// Kinds of calls, the first number of each.
const SURFACE: u32 = 0;
const CANVAS: u32 = 1;
const LAY: u32 = 2;
const PIN: u32 = 3;
const FORGET_SURFACE: u32 = 4;
const FORGET_CANVAS: u32 = 5;

impl<'a> Call<'a> {
    /// The call as bytes.
    pub fn pieces(&self) -> Pieces<'a> {
        match *self {
            Self::Surface(number, scene, whole) => {
                let mut pieces = vec![own(&[SURFACE, number]), own(&optional(whole))];
                pieces.extend(pieces_of(scene));
                pieces
            }
            Self::Canvas(number, paint) => {
                let Paint { width, height, pixels, used } = paint;
                let header = [CANVAS, number, *width as u32, *height as u32, u32::from(used.is_some())];
                let used = used.iter().flatten().map(|used| u8::from(*used)).collect::<Vec<_>>();
                vec![own(&header), piece(pixels), own(&used)]
            }
            Self::Lay(of) => of.pieces(LAY),
            Self::Pin(of, seeds) => {
                let mut pieces = of.pieces(PIN);
                pieces.extend([own(&[seeds.len() as u32]), piece(seeds)]);
                pieces
            }
            Self::ForgetSurface(number) => vec![own(&[FORGET_SURFACE, number])],
            Self::ForgetCanvas(number) => vec![own(&[FORGET_CANVAS, number])],
        }
    }
}

impl<'a> Laying<'a> {
    fn pieces(&self, kind: u32) -> Pieces<'a> {
        let Choices { is_collection, tints, palette, direction, pins } = self.hand;
        let (numbers, weights): (Vec<u32>, Vec<f64>) = self.paintings.iter().copied().unzip();
        let (tints, colors) = match tints {
            None => ([0, 0], &[][..]),
            Some(TintsOf::Canvas(number)) => ([1, number], &[][..]),
            Some(TintsOf::Colors(colors)) => ([2, 0], colors),
        };
        let places: Vec<[f32; 5]> =
            pins.iter().map(|Pin { at, place, .. }| [at.x, at.y, at.z, place.x, place.y]).collect();
        let of_pins: Vec<u32> = pins.iter().map(|pin| pin.painting as u32).collect();
        let (direction, points) = match direction {
            None => (0, Vec::new()),
            Some(Direction::Along(vector)) => (1, vec![vector]),
            Some(Direction::Curve(points)) => (2, points.to_vec()),
        };
        vec![
            own(&[kind, self.surface]),
            own(&optional(self.whole)),
            own(&[u32::from(is_collection), direction]),
            own(&[points.len() as u32]),
            own(&points),
            own(&[palette]),
            own(&[self.content]),
            own(&[numbers.len() as u32]),
            own(&numbers),
            own(&weights),
            own(&tints),
            own(&[colors.len() as u32]),
            piece(colors),
            own(&[pins.len() as u32]),
            own(&places),
            own(&of_pins),
        ]
    }
}

/// A number that may be none: whether there is one, and which.
fn optional(number: Option<u32>) -> [u32; 2] {
    [u32::from(number.is_some()), number.unwrap_or_default()]
}

/// Reads what [`optional`] gives.
fn read_optional(reader: &mut Reader) -> Result<Option<u32>, ApartError> {
    let [is_there, number] = reader.some()?;
    Ok((is_there != 0_u32).then_some(number))
}

/// All that a surface is found from.
fn pieces_of(scene: &Scene) -> Pieces<'_> {
    let n = scene.len();
    // The color that does not depend on the direction.
    let base: Option<Vec<f32>> = scene.sh.as_ref().map(|sh| {
        let stride = 3 * (usize::from(sh.degree) + 1).pow(2);
        sh.coefficients.chunks_exact(stride).flat_map(|of| of[..3].iter().copied()).collect()
    });
    let neighbors = scene.neighbors.as_ref();
    let header = [
        n,
        usize::from(base.is_some()),
        neighbors.map_or(0, |neighbors| neighbors.k),
        scene.cameras.len(),
        usize::from(scene.up.is_some()),
        usize::from(scene.frame.is_some()),
        usize::from(scene.filter == ScreenFilter::Antialiased),
    ];
    let frame = scene.frame.map_or([0.0; 4], |frame| frame.center.extend(frame.radius).to_array());
    let cameras: Vec<[f32; 17]> = scene.cameras.iter().map(numbers_of).collect();
    let sizes: Vec<[u32; 2]> = scene.cameras.iter().map(|camera| camera.size.to_array()).collect();
    vec![
        own(&header.map(|n| n as u32)),
        own(&[scene.n_source as u64]),
        own(&scene.offset.to_array()),
        own(&scene.up.unwrap_or_default().to_array()),
        own(&frame),
        piece(&scene.means),
        piece(&scene.rotations),
        piece(&scene.scales),
        piece(&scene.opacities),
        piece(&scene.order),
        own(&base.unwrap_or_default()),
        piece(neighbors.map_or(&[], |neighbors| &neighbors.indices)),
        own(&cameras),
        own(&sizes),
    ]
}

/// A camera without its size.
fn numbers_of(camera: &Camera) -> [f32; 17] {
    let mut numbers = [0.0; 17];
    numbers[..12].copy_from_slice(&camera.view_from_world.to_cols_array());
    numbers[12..14].copy_from_slice(&camera.focal.to_array());
    numbers[14..16].copy_from_slice(&camera.center.to_array());
    numbers[16] = camera.near;
    numbers
}

/// The seeds of an answer to [`Call::Pin`].
///
/// # Errors
/// If there are not as many as were given.
pub fn pinned_seeds(answer: &[u8], n: usize) -> Result<Vec<StrokeSeed>, ApartError> {
    let mut reader = Reader(answer);
    let seeds = reader.values(n)?;
    reader.end()?;
    Ok(seeds)
}

fn scene(mut reader: Reader) -> Result<Scene, ApartError> {
    let header = reader.some::<u32, 7>()?.map(|n| n as usize);
    let [n, has_colors, k, n_cameras, has_up, has_frame, is_antialiased] = header;
    let n_source = reader.one::<u64>()? as usize;
    let offset: DVec3 = reader.one()?;
    let up: Vec3 = reader.one()?;
    let [x, y, z, radius] = reader.some()?;
    let (means, rotations, scales) = (reader.values(n)?, reader.values(n)?, reader.values(n)?);
    let (opacities, order) = (reader.values(n)?, reader.values(n)?);
    let coefficients: Vec<[f32; 3]> = reader.values(if has_colors != 0 { n } else { 0 })?;
    let indices: Vec<u32> = reader.values(n.checked_mul(k).ok_or(ApartError::Part)?)?;
    if indices.iter().any(|i| *i as usize >= n) {
        return Err(ApartError::Unknown { what: "neighbor" });
    }
    let numbers: Vec<[f32; 17]> = reader.values(n_cameras)?;
    let sizes: Vec<UVec2> = reader.values(n_cameras)?;
    reader.end()?;
    let camera = |(of, size): (&[f32; 17], UVec2)| Camera {
        view_from_world: Affine3A::from_cols_slice(&of[..12]),
        focal: Vec2::new(of[12], of[13]),
        center: Vec2::new(of[14], of[15]),
        near: of[16],
        size,
    };
    Ok(Scene {
        means,
        offset,
        rotations,
        scales,
        opacities,
        order,
        n_source,
        sh: (has_colors != 0).then(|| Sh { degree: 0, coefficients: coefficients.into_flattened() }),
        neighbors: (k > 0).then_some(Neighbors { k, indices }),
        up: (has_up != 0).then_some(up),
        cameras: numbers.iter().zip(sizes).map(camera).collect(),
        frame: (has_frame != 0).then_some(Frame { center: Vec3::new(x, y, z), radius }),
        filter: if is_antialiased != 0 { ScreenFilter::Antialiased } else { ScreenFilter::Classic },
        ..Scene::default()
    })
}

fn paint(mut reader: Reader) -> Result<Paint, ApartError> {
    let [width, height, has_used] = reader.some::<u32, 3>()?.map(|n| n as usize);
    let n = width.checked_mul(height).ok_or(ApartError::Part)?;
    let pixels = reader.values(n.checked_mul(3).ok_or(ApartError::Part)?)?;
    let used: Vec<u8> = reader.values(if has_used != 0 { n } else { 0 })?;
    reader.end()?;
    let used = (has_used != 0).then(|| used.into_iter().map(|used| used != 0).collect());
    Ok(Paint { width, height, pixels, used })
}
