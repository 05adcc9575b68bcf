//! First colors: a scene in the palette of its style, shown while the style is still being painted.
//!
//! Reading an image and laying on paint takes seconds on a slow machine. Moving the scene's colors to the
//! image's mean and covariance takes milliseconds ([`recolor`](stylegaussian::recolor)), so a change is
//! answered at once.

use std::sync::Arc;

use bevy::prelude::*;
use stylegaussian::{
    Scene,
    paint::Paint,
    recolor::{ColorMoments, Recoloring},
    work::{Canceled, Work},
};

use crate::{
    colors::{LayerColors, StyleColors},
    style::show::{transition::StyleTransition, worn::Worn},
    work::{Background, Lane, Workers},
};

/// Most Gaussians that are recolored at once, without a frame's wait for a thread. They take 3 ms of a core
/// (AMD EPYC, Zen 4).
const AT_ONCE: usize = 100_000;

/// Most pixels of a painting from which its palette is found, spread over it.
const PALETTE_PIXELS: usize = 1 << 16;

/// The palette of a painting, from some of its pixels.
pub(crate) fn palette_of<P>(pixels: &[P], color: impl Fn(&P) -> [f32; 3]) -> ColorMoments {
    let stride = pixels.len().div_ceil(PALETTE_PIXELS).max(1);
    let some: Vec<[f32; 3]> = pixels.iter().step_by(stride).map(color).collect();
    ColorMoments::of_rgb(some.as_flattened())
}

/// The palette of a painting, from some of those of its pixels that may be used.
pub(crate) fn palette_of_paint(paint: &Paint) -> ColorMoments {
    let color = |pixel: &[u8; 3]| pixel.map(|byte| f32::from(byte) / 255.0);
    let pixels: &[[u8; 3]] = paint.pixels.as_chunks().0;
    match &paint.used {
        Some(used) => {
            let used: Vec<_> = pixels.iter().zip(used).filter(|(_, used)| **used).map(|(p, _)| *p).collect();
            palette_of(&used, color)
        }
        None => palette_of(pixels, color),
    }
}

/// The palette of one style of a mix.
pub(crate) enum Palette {
    /// That of an image.
    Moments(ColorMoments),
    /// That of a preset's paint.
    Paint(Arc<Paint>),
}

/// Inputs of a style's first colors.
pub(crate) struct FirstRequest {
    pub(crate) scene: Arc<Scene>,
    /// Palettes and their weights, which sum to 1.
    pub(crate) palettes: Vec<(Palette, f64)>,
    /// Share of the base colors that stays, 0..1.
    pub(crate) content: f64,
}

impl FirstRequest {
    /// The recolored scene.
    ///
    /// # Errors
    /// If `work` is canceled.
    fn colors(&self, work: &Work) -> Result<Arc<StyleColors>, Canceled> {
        let base = self.scene.base_colors();
        work.check()?;
        // What pictures show of each Gaussian is not known yet. Opacities tell it well enough for the first
        // seconds.
        let weighted = base.iter().map(|color| Vec3::from(*color)).zip(self.scene.opacities.iter().copied());
        let from = ColorMoments::of_weighted(weighted);
        work.check()?;
        let recolorings: Vec<(Recoloring, f32)> = (self.palettes.iter())
            .map(|(palette, weight)| {
                let to = match palette {
                    Palette::Moments(moments) => *moments,
                    Palette::Paint(paint) => palette_of_paint(paint),
                };
                (Recoloring::new(&from, &to), (weight * (1.0 - self.content)) as f32)
            })
            .collect();
        work.check()?;
        let color = |color: [f32; 3]| {
            let kept = Vec3::from(color) * self.content as f32;
            let recolored = recolorings.iter().map(|(recoloring, weight)| {
                // Within a display's range: pictures of paint are, and colors far beyond it would glow.
                let recolored = Vec3::from(recoloring.color(color)).clamp(Vec3::ZERO, Vec3::ONE);
                recolored * *weight
            });
            (kept + recolored.sum::<Vec3>()).to_array()
        };
        Ok(StyleColors::known(base.into_iter().map(color).collect(), None))
    }
}

/// First colors of the style that is wanted, from the request to the paint that replaces them.
#[derive(Default)]
pub(crate) struct FirstColors {
    /// The place where they appear, once they were asked for.
    computed: Option<Background<Arc<StyleColors>>>,
    /// Whether none are to be put on any more: they were, or the style is painted.
    are_over: bool,
    /// Colors that were shown before them, as long as they are.
    before: Option<LayerColors>,
}

impl FirstColors {
    /// The state once the style is painted: none are shown until [`Self::restart`].
    pub(crate) fn done() -> Self {
        Self { are_over: true, ..Self::default() }
    }

    /// Begins anew for another painting. First colors that are shown stay until the next ones.
    pub(crate) fn restart(&mut self) {
        *self = Self { before: self.before.take(), ..Self::default() };
    }

    /// Whether there is nothing to ask for any more.
    pub(crate) fn are_asked(&self) -> bool {
        self.computed.is_some() || self.are_over
    }

    /// Whether they are shown, and only captured colors were shown before.
    pub(crate) fn are_over_captured(&self) -> bool {
        matches!(self.before, Some(LayerColors::Captured))
    }

    /// Computes them, those of large scenes in the background.
    pub(crate) fn ask(&mut self, request: FirstRequest, workers: &Workers) {
        self.computed = match request.scene.len() <= AT_ONCE {
            // Nobody cancels it.
            true => request.colors(&Work::default()).ok().map(Background::Ready),
            false => {
                let running = workers.start(Lane::Short, move |work| request.colors(work));
                Some(Background::Building(running))
            }
        };
    }

    /// Puts them on if they are there, and returns whether it did.
    pub(crate) fn show(&mut self, worn: &mut Worn, transition: Option<&StyleTransition>) -> bool {
        if !self.are_over
            && let Some(colors) = self.computed.as_ref().and_then(Background::get)
        {
            self.are_over = true;
            self.before.get_or_insert_with(|| worn.top());
            worn.put_on(LayerColors::Style(Arc::clone(colors)), transition);
            return true;
        }
        false
    }

    /// Puts back what was shown before, since the style cannot be had.
    pub(crate) fn give_up(&mut self, worn: &mut Worn, transition: Option<&StyleTransition>) {
        if let Some(before) = std::mem::take(self).before {
            worn.put_on(before, transition);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{colors::ColorSource, tests::world::small_scene};

    #[test]
    fn first_colors_have_the_palette_and_keep_the_content() {
        let scene = Arc::new(small_scene(500, 1));
        let rgb: Vec<f32> =
            (0..300).flat_map(|i| [0.2 + 0.002 * i as f32, 0.3, 0.6 - 0.001 * i as f32]).collect();
        let palettes = || vec![(Palette::Moments(ColorMoments::of_rgb(&rgb)), 1.0)];
        let colors = |scene: &Arc<Scene>, content| {
            let request = FirstRequest { scene: Arc::clone(scene), palettes: palettes(), content };
            let colors = request.colors(&Work::default()).unwrap();
            let ColorSource::Rgb(colors) = &colors.source else { panic!("first colors are no weights") };
            colors.to_vec()
        };
        let recolored = colors(&scene, 0.0);
        let mean = |channel: usize| recolored.iter().map(|color| color[channel]).sum::<f32>() / 500.0;
        for (channel, expected) in [0.499, 0.3, 0.4505].into_iter().enumerate() {
            assert!((mean(channel) - expected).abs() < 0.03, "{channel}: {}", mean(channel));
        }
        assert_eq!(colors(&scene, 1.0), scene.base_colors());
        let (request, work) =
            (FirstRequest { scene: Arc::clone(&scene), palettes: palettes(), content: 0.0 }, Work::default());
        work.cancel();
        assert_eq!(request.colors(&work).err(), Some(Canceled));
        let large = Arc::new(small_scene(AT_ONCE, 1));
        let begun = std::time::Instant::now();
        colors(&large, 0.0);
        eprintln!("first colors of {AT_ONCE} Gaussians: {:?}", begun.elapsed());
    }

    /// Updates until first colors are shown.
    fn until_shown(first: &mut FirstColors, worn: &mut Worn) {
        let begun = std::time::Instant::now();
        while !first.are_over {
            assert!(begun.elapsed().as_secs() < 60, "no first colors");
            first.show(worn, None);
        }
    }

    #[test]
    fn a_style_that_fails_gives_back_what_was_shown() {
        let scene = Arc::new(small_scene(50, 1));
        let request = || FirstRequest {
            scene: Arc::clone(&scene),
            palettes: vec![(Palette::Moments(ColorMoments::of_rgb(&[0.5; 6])), 1.0)],
            content: 0.0,
        };
        let (mut first, mut worn) = (FirstColors::default(), Worn::default());
        let style = StyleColors::known(vec![[0.1; 3]; 50].into(), None);
        worn.put_on(LayerColors::Style(Arc::clone(&style)), None);
        // The second change comes before the first one is painted.
        for _ in 0..2 {
            first.restart();
            assert!(!first.are_asked());
            first.ask(request(), &Workers::default());
            until_shown(&mut first, &mut worn);
            assert!(first.are_asked() && !first.are_over_captured() && !worn.is_topped_by(&style));
        }
        first.give_up(&mut worn, None);
        assert!(worn.is_topped_by(&style));
        // Nothing is left to give up.
        let mut other = Worn::default();
        first.give_up(&mut other, None);
        assert!(other.is_empty());
    }
}
