//! Paint in the colors of small Gaussians, for programs that draw no strokes.
//!
//! A Gaussian has one color, so it hides the detail that is finer than itself. Those that hide most are split,
//! until there are as many as wanted. A part's color is its base color and the mean of the strokes around its
//! own middle.
//!
//! Gaussians overlap, so pictures of such colors are softer than strokes. A picture is linear in the colors:
//! with W the blend weights of a view, it is W c. So the colors are fitted to pictures t with strokes, view
//! after view, by steps of the simultaneous iterative reconstruction technique (Gilbert 1972):
//!
//! ```text
//! c += r W^T (t - W c) / (W^T 1)
//! ```
//!
//! These converge for a relaxation r between 0 and 2. A few steps bring back what the Gaussians still resolve,
//! more of it if r is near 2, and leave what they do not as it was.

use glam::UVec2;
use rayon::prelude::*;

use super::{Manner, Part, assembled, parts, whole};
use crate::{
    camera::Camera,
    morton,
    paint::Painted,
    scene::{Scene, broad_side},
    splat::{BlendWeights, Colors, RenderedImage, blend_weights_if_wanted, render_strokes},
    strokes::{PlainSeed, StrokeKnobs, StrokeTexture, StrokeWord, Strokes, WIDE_LEVEL},
    views::choose_views_if_wanted,
    work::{Canceled, Work},
};

/// Parts as far apart as their neighbors allow, so that few are needed. Dents fill up where Gaussians overlap.
/// 64 parts are an eighth as large along both axes.
const SPLITTING: Manner = Manner { distance: 0.7, rounds: 6 };

/// Deviations of parts, in those of parts that keep the drawn alpha. Narrower ones overlap less, so colors
/// beside one another mix less: on the demo scene, split fourfold, the texture error is 1.54 of 1.75. At 0.6 it
/// is 1.52, and silhouettes lose more.
const NARROWED: f32 = 0.7;

/// Number of views, and the longer side of each in pixels. Strokes are as large as in the painting in a picture
/// of 512 pixels.
const N_VIEWS: usize = 16;
const VIEW_SIDE: u32 = 512;

/// Rounds through all views, and steps in each view of a round.
const ROUNDS: usize = 2;
const STEPS: usize = 3;

/// Relaxation r of a step: near the 2 below which steps converge, since few are made.
const RELAXATION: f32 = 1.8;

/// Pixels that are added to those that a Gaussian fills in a view: what it hardly shows says little.
const HARDLY_SEEN: f32 = 0.5;

/// Least alpha of pixels that count, because the background shines through the others.
const COVERED: f32 = 0.5;

/// The largest color. Formats of a byte for each channel hold up to 1.4; programs take colors below 0 for 0.
const BRIGHTEST: f32 = 1.3;

/// Shares of the time until the scene is split: the choice of views, and looking through them.
const CHOSEN: f32 = 0.15;
const SPLIT: f32 = 0.35;

/// Puts the strokes of `painted` into the colors of `scene`, which then are the same from all sides. For this,
/// Gaussians are split: those that are seen and large beside the strokes' detail, to at most `factor` times as
/// many in the whole scene. Returns the number of Gaussians added.
///
/// Without strokes, only the colors are set. The scene ends in Morton order if it has strokes, and then without
/// neighbor lists. The result does not depend on the number of threads.
///
/// # Errors
/// If `work` is canceled. The scene is then as it was.
///
/// # Panics
/// If `painted` has colors or words for another number of Gaussians.
pub fn split_paint(
    scene: &mut Scene,
    painted: &Painted,
    factor: f64,
    work: &Work,
) -> Result<usize, Canceled> {
    if painted.strokes.seeds.is_empty() {
        scene.set_colors(&painted.colors);
        return Ok(0);
    }
    let before = scene.len();
    // Saturating: a factor may be infinite. Indices have 32 bits.
    let most = ((before as f64 * factor) as usize).clamp(before, u32::MAX as usize);
    let views = views(scene, work)?;
    work.at(CHOSEN)?;
    let whole = whole(scene, &views, &work.part(CHOSEN, SPLIT))?;
    let hidden = Hidden::new(&painted.strokes);
    let parts = parts(scene, &whole, most, SPLITTING, |part| hidden.in_part(part));
    // Before the fit, because Gaussians of equal depth blend in their order.
    let order = morton::order(&parts.iter().map(|part| part.mean).collect::<Vec<_>>());
    let parts: Vec<Part> = order.into_iter().map(|i| parts[i as usize].narrowed()).collect();
    work.at(SPLIT)?;
    let mut split = assembled(scene, &parts);
    let color = |part: &Part| {
        painted.flattened_at(part.gaussian as usize, part.mean, broad_side(part.scales)).map(displayed)
    };
    let mut colors: Vec<[f32; 3]> = parts.par_iter().map(color).collect();
    let strokes = (&painted.strokes, &StrokeKnobs::DEFAULT);
    let draw = |camera| render_strokes(scene, Colors::Rgb(&painted.colors), strokes, camera, None);
    let mut wanted: Vec<RenderedImage> = Vec::with_capacity(views.len());
    for step in 0..ROUNDS * views.len() {
        work.at(SPLIT + (1.0 - SPLIT) * step as f32 / (ROUNDS * views.len()) as f32)?;
        let camera = &views[step % views.len()];
        if step < views.len() {
            wanted.push(draw(camera));
        }
        let weights = blend_weights_if_wanted(&split, camera, 0.0, work)?;
        fit(&mut colors, &weights, &wanted[step % views.len()]);
    }
    split.set_colors(&colors);
    *scene = split;
    Ok(scene.len() - before)
}

/// The views by which paint is judged: some of the capture's, or chosen ones.
fn views(scene: &Scene, work: &Work) -> Result<Vec<Camera>, Canceled> {
    if scene.cameras.is_empty() || scene.frame.is_some() {
        return choose_views_if_wanted(scene, N_VIEWS, UVec2::splat(VIEW_SIDE), &work.part(0.0, CHOSEN));
    }
    let stride = scene.cameras.len().div_ceil(N_VIEWS);
    let fitted = |camera: &Camera| camera.near_among(&scene.means).fitted(VIEW_SIDE);
    Ok(scene.cameras.iter().step_by(stride).map(fitted).collect())
}

impl Part {
    /// The part with [`NARROWED`] deviations, if it was split. Its optical depth grows as its area shrinks, so
    /// it takes as much of the light.
    fn narrowed(&self) -> Self {
        if self.rounds == 0 {
            return *self;
        }
        let opacity = 1.0 - (1.0 - self.opacity).powf(1.0 / (NARROWED * NARROWED));
        Self { scales: NARROWED * self.scales, opacity, ..*self }
    }
}

/// Moves `colors` toward those that draw the picture `wanted`.
fn fit(colors: &mut [[f32; 3]], weights: &BlendWeights, wanted: &RenderedImage) {
    for _ in 0..STEPS {
        // A fourth channel of ones costs hardly more than three: it becomes alpha in the picture, and the
        // pixels that a Gaussian fills on the way back.
        let values: Vec<f32> = colors.iter().flat_map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
        let mut picture = weights.apply(&values, 4);
        picture.par_chunks_exact_mut(4).enumerate().for_each(|(i, pixel)| {
            let alpha = pixel[3];
            let is_covered = alpha.min(wanted.alpha[i]) > COVERED;
            // Both colors are multiplied by alphas that differ a little.
            let scale = alpha / wanted.alpha[i];
            let missing = |c: usize| wanted.color[i][c] * scale - pixel[c];
            let missing = [0, 1, 2].map(|c| if is_covered { missing(c) } else { 0.0 });
            pixel[..3].copy_from_slice(&missing);
            pixel[3] = 1.0;
        });
        let steps = weights.apply_transposed(&picture, 4);
        for (color, step) in colors.iter_mut().zip(steps.as_chunks::<4>().0) {
            let filled = step[3] + HARDLY_SEEN;
            *color = std::array::from_fn(|c| displayed(color[c] + RELAXATION * step[c] / filled));
        }
    }
}

/// A channel that all programs show.
fn displayed(channel: f32) -> f32 {
    channel.clamp(0.0, BRIGHTEST)
}

/// The energy of detail that Gaussians hide.
struct Hidden<'a> {
    strokes: &'a Strokes,
    seeds: Vec<PlainSeed>,
    /// Energy of each texture's fine and wide detail, by levels of detail.
    energies: Vec<[Vec<f32>; 2]>,
}

impl<'a> Hidden<'a> {
    fn new(strokes: &'a Strokes) -> Self {
        let seeds = strokes.seeds.iter().map(crate::strokes::StrokeSeed::plain).collect();
        let of = |texture: &StrokeTexture| {
            [&texture.fine, &texture.wide].map(|levels| levels.iter().map(|level| energy(level)).collect())
        };
        Self { strokes, seeds, energies: strokes.textures.iter().map(|texture| of(texture)).collect() }
    }

    /// The square of what is missing in pictures if a part has one color, summed over the pixels that it fills.
    fn in_part(&self, part: &Part) -> f32 {
        let word = StrokeWord::unpacked(self.strokes.words[part.gaussian as usize]);
        if part.visible <= 0.0 || word.share <= 0.0 {
            return 0.0;
        }
        let seed = &self.seeds[word.seed as usize];
        let [of_fine, of_wide] = &self.energies[usize::from(seed.texture)];
        let level = seed.level_of(broad_side(part.scales));
        let [fine, wide] = seed.gains(&word);
        let hidden = fine * fine * finer_than(of_fine, level)
            + wide * wide * finer_than(of_wide, (level - WIDE_LEVEL).max(0.0));
        part.visible * hidden
    }
}

/// The energy of detail that is gone at `level`, at least 0.
fn finer_than(energies: &[f32], level: f32) -> f32 {
    let last = energies.len() - 1;
    let (first, between) = (level as usize, level.fract());
    let at = |level: usize| energies[level.min(last)];
    energies[0] - (at(first) + between * (at(first + 1) - at(first)))
}

/// The mean square of a texture's values.
fn energy(texels: &[[i8; 4]]) -> f32 {
    let square = |texel: &[i8; 4]| texel.map(|value| (f64::from(value) / 127.0).powi(2)).iter().sum::<f64>();
    (texels.iter().map(square).sum::<f64>() / texels.len() as f64) as f32
}

#[cfg(test)]
mod tests;
