//! The start of a bake: instant paint, and how far its colors may go.

use stylegaussian::{
    Scene,
    paint::{Canvas, Company, Hand, Painted, Surface, lay, lay_beside},
    recolor::ColorMoments,
    strokes::{StrokeWord, Strokes},
    work::{Canceled, Work},
};
use stylegaussian_encoder::{Image, paint_of_if_wanted};

use crate::{cameras::Cameras, config::BakeConfig, error::BakeError};

/// Pull of every Gaussian toward the start, relative to that of the smallest things. Without it, the colors
/// under the strokes take up grain that competes with them.
const KEPT: f32 = 0.3;

/// Standard deviations of Gaussians in pixels, seen from their broad sides: Gaussians below the first carry
/// shades of strokes, those above the second do not. On the bonsai half of the visible ones are below 0.7
/// pixels, and a tenth above 6.4: shadows on cloth, pot and tray.
const LARGE: [f32; 2] = [6.0, 11.0];

/// Protection of the largest Gaussians, relative to that of the smallest things. Without it they turn to flat
/// color, and all things are lost in the shadows of a capture, where Gaussians are few and large
/// (docs/notes.md, "Bakes").
pub(crate) const LARGE_WEIGHT: f32 = 10.0;

/// Colors and strokes of a scene before the first step.
pub(crate) struct Start {
    /// Colors under the strokes `[N * 3]`.
    pub colors: Vec<f32>,
    /// The strokes, which no step changes.
    pub strokes: Strokes,
    /// How much each Gaussian is kept near its color here `[N]`: 0..1, and up to [`LARGE_WEIGHT`] for large
    /// Gaussians.
    pub protected: Vec<f32>,
}

/// A painted scene that others are parts of: they get its colors, its contrast and its strokes.
pub(crate) struct Whole {
    /// Moments of the captured colors, as views show them.
    pub colors: ColorMoments,
    surface: Surface,
    /// The paintings and their weights.
    canvases: Vec<(Canvas, f64)>,
    /// `None` if it has no strokes.
    company: Option<Company>,
}

impl Whole {
    /// Paints the scene.
    ///
    /// # Errors
    /// If nothing of it is visible, or `work` is canceled.
    pub fn new(
        scene: &Scene,
        config: &BakeConfig,
        paintings: &[(Image, f32)],
        work: &Work,
    ) -> Result<Self, BakeError> {
        let cameras = Cameras::survey(scene, &[], config.view, config.crop, &work.part(0.0, 0.4))?
            .ok_or(BakeError::NothingVisible { n_gaussians: scene.len() })?;
        let surface = surface(scene, &cameras, &work.part(0.4, 0.6))?;
        let (canvases, hand) = (canvases(paintings, &work.part(0.6, 0.6))?, Hand::default());
        let weighted = weighted(&canvases);
        let painted = lay(scene, &surface, &weighted, &hand, 0.0, &work.part(0.6, 0.9))?;
        let company = Company::new(&surface, &weighted, &hand, &painted.strokes, &work.part(0.9, 1.0))?;
        Ok(Self { colors: cameras.colors, surface, canvases, company })
    }
}

impl Start {
    /// The scene between its `recolored` colors `[N * 3]` (`paint` 0, without strokes) and instant paint (1),
    /// as a part of `whole` if there is one.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub fn new(
        scene: &Scene,
        (cameras, whole): (&Cameras, Option<&Whole>),
        paintings: &[(Image, f32)],
        recolored: Vec<f32>,
        paint: f32,
        work: &Work,
    ) -> Result<Self, Canceled> {
        let mut colors = recolored;
        let mut strokes =
            Strokes { words: vec![StrokeWord::NONE.packed(); scene.len()], ..Strokes::default() };
        if paint > 0.0 {
            let painted = painted(scene, cameras, whole, paintings, work)?;
            for (color, painted) in colors.iter_mut().zip(painted.colors.into_iter().flatten()) {
                *color += paint * (painted - *color);
            }
            strokes = painted.strokes;
            strokes.fade(paint.min(1.0));
        }
        let protected = protections(&strokes.words, &scene.broad_sides(), cameras.pixel_size);
        Ok(Self { colors, strokes, protected })
    }
}

/// The scene in the paintings' own paint.
fn painted(
    scene: &Scene,
    cameras: &Cameras,
    whole: Option<&Whole>,
    paintings: &[(Image, f32)],
    work: &Work,
) -> Result<Painted, Canceled> {
    let hand = Hand::default();
    if let Some(Whole { surface, canvases, company: Some(company), .. }) = whole {
        let surface = Surface::part_of(scene, surface, work)?;
        return lay_beside(scene, &surface, &weighted(canvases), (&hand, 0.0, company), work);
    }
    let canvases = canvases(paintings, &work.part(0.0, 0.0))?;
    lay(scene, &surface(scene, cameras, work)?, &weighted(&canvases), &hand, 0.0, work)
}

/// The surfaces of a scene, as the bake's views show them.
fn surface(scene: &Scene, cameras: &Cameras, work: &Work) -> Result<Surface, Canceled> {
    // Choosing views takes seconds, so it is done once.
    match &cameras.chosen[..] {
        [] => Surface::new(scene, work),
        chosen => Surface::seen_from(scene, chosen, work),
    }
}

/// The paintings as paint is taken from them, and their weights.
///
/// # Errors
/// If `work` is canceled.
fn canvases(paintings: &[(Image, f32)], work: &Work) -> Result<Vec<(Canvas, f64)>, Canceled> {
    let used = paintings.iter().filter(|(_, weight)| *weight > 0.0);
    let canvas = |(image, weight): &(Image, f32)| {
        let paint = paint_of_if_wanted(image, work)?;
        Ok::<_, Canceled>((Canvas::new_if_wanted(&paint, work)?, f64::from(*weight)))
    };
    used.map(canvas).collect()
}

/// The same, as paint takes them.
fn weighted(canvases: &[(Canvas, f64)]) -> Vec<(&Canvas, f64)> {
    canvases.iter().map(|(canvas, weight)| (canvas, *weight)).collect()
}

/// Protection of Gaussians `[N]`, because they stand out (by their `words`) or are larger than a stroke.
/// `sides` are their deviations, in units of which a pixel has `pixel_size`.
pub(crate) fn protections(words: &[u32], sides: &[f32], pixel_size: f32) -> Vec<f32> {
    let [low, high] = LARGE;
    let share = |(word, side): (&u32, &f32)| {
        let large = ((side / pixel_size - low) / (high - low)).clamp(0.0, 1.0);
        let small = (KEPT + StrokeWord::unpacked(*word).protection).min(1.0);
        // Smooth at both ends.
        small.max(LARGE_WEIGHT * large * large * (3.0 - 2.0 * large))
    };
    words.iter().zip(sides).map(share).collect()
}
