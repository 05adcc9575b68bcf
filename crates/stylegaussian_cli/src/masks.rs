//! `--mask` and its uses: a style on a part of the scene, hiding, cropping.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use clap::{ArgGroup, Args};
use stylegaussian::{
    Mask, Scene,
    layers::{Layer, Region, mix_layers},
    mask::{MaskUse, Visibility},
    strokes::{StrokeLayer, Strokes, mix_strokes},
};
use stylegaussian_files::read_mask;

/// Options of masks.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("masking").args(["styled_in", "paint_in", "hide", "crop"]).multiple(true)))]
pub struct MaskArgs {
    /// Painted weights of this scene, *.mask.safetensors. Default: those that the scene carries.
    #[arg(long, value_name = "FILE", requires = "masking")]
    mask: Option<PathBuf>,
    /// Show the style where this channel of the mask is painted, and the captured colors elsewhere.
    #[arg(
        long,
        value_name = "0..3",
        requires = "restyling",
        value_parser = clap::value_parser!(u8).range(0..4),
    )]
    styled_in: Option<u8>,
    /// Show strokes as far as this channel of the mask is painted, and the colors under them elsewhere.
    #[arg(
        long,
        value_name = "0..3",
        requires = "restyling",
        value_parser = clap::value_parser!(u8).range(0..4),
    )]
    paint_in: Option<u8>,
    /// Hide what is painted in this channel of the mask.
    #[arg(long, value_name = "0..3", value_parser = clap::value_parser!(u8).range(0..4))]
    hide: Option<u8>,
    /// Hide all but what is painted in this channel of the mask.
    #[arg(
        long,
        value_name = "0..3",
        conflicts_with = "hide",
        value_parser = clap::value_parser!(u8).range(0..4),
    )]
    crop: Option<u8>,
}

impl MaskArgs {
    /// The mask of `scene`, or `None` if no option needs one.
    ///
    /// # Errors
    /// If there is none, it cannot be read, or it belongs to another scene.
    pub fn open(&self, scene: &Scene, scene_path: &Path) -> Result<Option<Mask>> {
        if self.styled_in.or(self.paint_in).or(self.hide).or(self.crop).is_none() {
            return Ok(None);
        }
        let Some(path) = &self.mask else {
            let own = scene.mask.clone();
            let missing =
                || anyhow!("{}: found no mask in the scene, expected --mask FILE", scene_path.display());
            return own.ok_or_else(missing).map(Some);
        };
        let mask = read_mask(path)?.mask_for(scene);
        mask.map(Some).with_context(|| format!("{} for {}", path.display(), scene_path.display()))
    }

    /// The colors of a style under the mask `[N]`, premultiplied; `None` if the style is everywhere.
    pub fn mixed(&self, scene: &Scene, styled: &[[f32; 3]], mask: Option<&Mask>) -> Option<Vec<[f32; 4]>> {
        let (channel, mask) = (self.styled_in?, mask?);
        let look: Vec<[f32; 4]> = styled.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
        let layer = Layer {
            look: Some(&look),
            region: Region::EVERYWHERE,
            strength: 1.0,
            mask: Some((&mask.weights, channel.into())),
        };
        Some(mix_layers(&scene.means, &[layer]))
    }

    /// The strokes of a style, where they are shown.
    pub fn limit(&self, scene: &Scene, strokes: &mut Strokes, mask: Option<&Mask>) {
        let Some(mask) = mask.filter(|_| !strokes.seeds.is_empty()) else { return };
        for channel in [self.styled_in, self.paint_in].into_iter().flatten() {
            let layer = StrokeLayer {
                words: Some(&strokes.words),
                first_seed: 0,
                region: Region::EVERYWHERE,
                strength: 1.0,
                mask: Some((&mask.weights, channel.into())),
                factors: None,
            };
            strokes.words = mix_strokes(&scene.means, &[layer]);
        }
    }

    /// Makes hidden Gaussians transparent. For drawing alone: styles see the whole scene.
    pub fn hide(&self, scene: &mut Scene, mask: Option<&Mask>) {
        let uses = [(self.hide, MaskUse::Hide), (self.crop, MaskUse::Crop)];
        for (channel, is) in uses {
            let (Some(channel), Some(mask)) = (channel, mask) else { continue };
            let visibility = Visibility { weights: &mask.weights, channel: channel.into(), is };
            let opacities = scene.opacities.iter_mut().enumerate();
            opacities.for_each(|(i, opacity)| *opacity *= visibility.share(i));
        }
    }
}
