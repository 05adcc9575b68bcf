//! `stylegaussian info`: describes a scene file, a world, a style, a look, a mask or a decoder.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::Result;
use clap::Args;
use glam::{DVec3, Vec3};
use serde::Serialize;
use stylegaussian::{
    Decoder, EncoderId, Features, Scene, SceneFingerprint, scene::ScreenFilter,
    views::bounds_without_backdrop,
};
use stylegaussian_files::{
    Loaded, ReadOptions,
    world::{World, manifest_at},
};
use stylegaussian_gpu::{colors::GaussianColors, splat::GpuScene, style::StyleScene};

use crate::{
    arguments::is_named,
    choose,
    scenes::ReadArgs,
    terminal::{lossy, print, warn},
};

mod decoder;
mod look;
mod mask;
mod style;
mod world;

/// Describe a scene (format, axes, counts, SH degree, bounds, features, encoder, decoder, and memory needed at
/// run time), a world (levels of detail, parts, chunks, bounds; with --budget or --axes the scene that it is
/// read as), a style, a look, a mask or a decoder.
#[derive(Args, Debug)]
pub struct InfoArgs {
    /// A scene in any format (`stylegaussian --help` lists them), or one of *.style.safetensors,
    /// *.look.safetensors, *.mask.safetensors and *.decoder.safetensors.
    file: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Info<'a> {
    #[serde(serialize_with = "lossy")]
    path: &'a Path,
    /// The format's name.
    format: &'static str,
    /// The axes of the file's coordinates, and the reason for them.
    axes: String,
    axes_because: &'a str,
    /// The filter that the scene must be drawn with: `classic` or `antialiased`.
    filter: &'static str,
    /// Gaussians in the scene.
    n_gaussians: usize,
    /// Gaussians in the file it was made of.
    n_source: usize,
    /// The fingerprint that looks of the scene have.
    fingerprint: String,
    sh_degree: Option<u8>,
    /// The box around the means.
    bounds: Option<[[f32; 3]; 2]>,
    /// What the means lack to the positions in the file, if that is anything.
    offset: Option<[f64; 3]>,
    /// The bounds without a sky or strays far behind the scene, if there are any.
    bounds_without_backdrop: Option<[[f32; 3]; 2]>,
    up: Option<[f32; 3]>,
    /// Cameras of the capture.
    n_cameras: usize,
    source: Option<&'a str>,
    license: Option<&'a str>,
    features: Option<FeaturesInfo>,
    /// K of the stored neighbor lists.
    neighbors: Option<usize>,
    decoder: Option<decoder::DecoderInfo>,
    /// Channels of the mask that the file carries.
    mask: Option<Vec<mask::Channel<'a>>>,
    gpu_bytes: GpuBytes,
    warnings: Vec<String>,
}

#[derive(Debug, Serialize)]
struct FeaturesInfo {
    /// L.
    #[serde(rename = "n_low")]
    n_latent: usize,
    /// D.
    n_channels: usize,
    /// E.
    n_extra: usize,
    encoder: Option<String>,
}

/// Bytes on the GPU, computed and not measured. Memory for the picture itself is not included.
#[derive(Debug, PartialEq, Serialize)]
struct GpuBytes {
    /// Permanent memory: geometry, SH in f16 and a color of 4 f16 for each Gaussian; with features also the
    /// decoder's inputs and neighbor lists.
    scene: u64,
    /// Memory during a change of style: activations between layers, and the decoder's weights. 0 without
    /// features, and if the decoder does not fit them.
    style_pass: u64,
}

impl GpuBytes {
    fn of(scene: &Scene, decoder: Option<&Decoder>) -> Self {
        let geometry = GpuScene::bytes(scene) + GaussianColors::bytes(scene.len());
        let style = decoder.and_then(|decoder| {
            let scratch = StyleScene::scratch_bytes(scene, decoder).ok()?;
            Some((StyleScene::bytes(scene, decoder).ok()? - scratch, scratch))
        });
        let (inputs, style_pass) = style.unwrap_or_default();
        Self { scene: geometry + inputs, style_pass }
    }
}

/// Runs the command.
pub fn run(arguments: &InfoArgs) -> Result<()> {
    let InfoArgs { file: path, reading, json } = arguments;
    type Describe = fn(&Path, bool) -> Result<()>;
    let kinds: [(&str, Describe); 4] =
        [("look", look::run), ("mask", mask::run), ("style", style::run), ("decoder", decoder::run)];
    if let Some((_, run)) = kinds.iter().find(|(kind, _)| is_named(path, kind)) {
        return run(path, *json);
    }
    if let Some(manifest) = manifest_at(path).filter(|_| reading.options() == ReadOptions::default()) {
        match World::open(&manifest) {
            Ok(found) => return world::run(&manifest, &found, *json),
            // As one scene, some can be read all the same.
            Err(error) => warn([format!("it is no world that can be streamed: {error}")]),
        }
    }
    let loaded = reading.read(path)?;
    let info = describe(path, &loaded);
    print(*json, &info, || text(&info))
}

fn describe<'a>(path: &'a Path, loaded: &'a Loaded) -> Info<'a> {
    let scene = &loaded.scene;
    let decoder = scene.features.as_ref().and_then(|_| choose::decoder(None, scene).ok());
    let gpu_bytes = GpuBytes::of(scene, decoder.as_ref().map(|named| &named.decoder));
    Info {
        path,
        format: loaded.format,
        axes: loaded.axes.to_string(),
        axes_because: &loaded.axes_because,
        filter: match scene.filter {
            ScreenFilter::Classic => "classic",
            ScreenFilter::Antialiased => "antialiased",
        },
        n_gaussians: scene.len(),
        n_source: scene.n_source,
        fingerprint: SceneFingerprint::of(scene).to_string(),
        sh_degree: scene.sh.as_ref().map(|sh| sh.degree),
        bounds: scene.bounds().map(corners),
        offset: (scene.offset != DVec3::ZERO).then(|| scene.offset.to_array()),
        bounds_without_backdrop: bounds_without_backdrop(scene).map(corners),
        up: scene.up.map(|up| up.to_array()),
        n_cameras: scene.cameras.len(),
        source: scene.source.as_deref(),
        license: scene.license.as_deref(),
        features: scene.features.as_ref().map(FeaturesInfo::of),
        neighbors: scene.neighbors.as_ref().map(|neighbors| neighbors.k),
        decoder: scene.decoder.as_ref().map(decoder::DecoderInfo::of),
        mask: scene.mask.as_ref().map(|mask| mask::channels(&mask.names, &mask.weights)),
        gpu_bytes,
        warnings: loaded.warnings.clone(),
    }
}

fn corners((min, max): (Vec3, Vec3)) -> [[f32; 3]; 2] {
    [min.to_array(), max.to_array()]
}

impl FeaturesInfo {
    fn of(features: &Features) -> Self {
        Self {
            n_latent: features.n_latent,
            n_channels: features.n_channels(),
            n_extra: features.n_extra,
            encoder: features.encoder.as_ref().map(EncoderId::to_string),
        }
    }
}

fn text(info: &Info) -> String {
    let mut text = info.path.display().to_string();
    let mut row = |name: &str, value: String| {
        // Writing to a String cannot fail.
        let _ = write!(text, "\n  {name:<11} {value}");
    };
    row("format", info.format.into());
    row("axes", format!("{}, because {}", info.axes, info.axes_because));
    if info.filter != "classic" {
        row("filter", info.filter.into());
    }
    let dropped = info.n_source.saturating_sub(info.n_gaussians);
    let of_source = if dropped > 0 { format!(" ({} in its source)", info.n_source) } else { String::new() };
    row("Gaussians", format!("{}{of_source}", info.n_gaussians));
    row("fingerprint", info.fingerprint.clone());
    row("SH degree", info.sh_degree.map_or("none: no captured colors".into(), |degree| degree.to_string()));
    if let Some([min, max]) = info.bounds {
        row("bounds", format!("{min:?} to {max:?}"));
    }
    if let Some([min, max]) = info.bounds_without_backdrop {
        row("", format!("{min:?} to {max:?} without what lies far behind"));
    }
    if let Some(offset) = info.offset {
        row("offset", format!("{offset:?} from these bounds to the positions in the file"));
    }
    if let Some(up) = info.up {
        row("up", format!("{up:?}"));
    }
    if info.n_cameras > 0 {
        row("cameras", format!("{} of its capture", info.n_cameras));
    }
    let strings = [("source", info.source), ("license", info.license)];
    strings.into_iter().for_each(|(name, value)| value.into_iter().for_each(|value| row(name, value.into())));
    row(
        "features",
        info.features.as_ref().map_or("none: `stylegaussian embed` adds them".into(), |f| {
            let extra =
                if f.n_extra > 0 { format!(" and {} extra inputs", f.n_extra) } else { String::new() };
            format!(
                "{} latent features of {} channels{extra}, encoder {}",
                f.n_latent,
                f.n_channels,
                or_unknown(&f.encoder)
            )
        }),
    );
    row(
        "neighbors",
        info.neighbors.map_or("none: found when needed".into(), |k| format!("{k} of each Gaussian")),
    );
    row("decoder", info.decoder.as_ref().map_or("none: the built-in one is used".into(), decoder::text_of));
    if let Some(mask) = &info.mask {
        row("mask", mask::text_of(mask));
    }
    let mb = |bytes: u64| bytes as f64 / 1e6;
    let GpuBytes { scene, style_pass } = info.gpu_bytes;
    let restyling = if style_pass > 0 {
        format!(", and {:.1} MB while a style changes", mb(style_pass))
    } else {
        String::new()
    };
    row("GPU memory", format!("{:.1} MB{restyling}", mb(scene)));
    text
}

fn or_unknown(encoder: &Option<String>) -> &str {
    encoder.as_deref().unwrap_or("unknown")
}

#[cfg(test)]
mod tests {
    use stylegaussian::{Layer, scene::Sh};

    use super::*;

    #[test]
    fn gpu_bytes_by_hand() {
        let layer = |d_in, d_out| Layer { weight: vec![], bias: vec![], d_in, d_out };
        let decoder =
            Decoder { layers: vec![layer(256, 64), layer(64, 32), layer(32, 3)], k: 8, ..Decoder::default() };
        let mut scene = Scene { means: vec![glam::Vec3::ZERO; 10], ..Scene::default() };
        scene.sh = Some(Sh { degree: 1, coefficients: vec![0.0; 10 * 12] });
        assert_eq!(
            GpuBytes::of(&scene, Some(&decoder)),
            GpuBytes { scene: 10 * (32 + 24 + 8), style_pass: 0 }
        );
        scene.features = Some(Features {
            values: vec![0.0; 320],
            n_latent: 32,
            basis: vec![0.0; 256 * 32],
            offset: vec![0.0; 256],
            extra: vec![],
            n_extra: 0,
            encoder: None,
        });
        // The last layer's rows hold 4 columns.
        let weights = 64 * (8 * 32 + 1) + 32 * (8 * 64 + 1) + 4 * (8 * 32 + 1);
        let expected = GpuBytes { scene: 10 * (64 + 64 + 32), style_pass: 2 * 10 * (64 + 32) + 4 * weights };
        assert_eq!(GpuBytes::of(&scene, Some(&decoder)), expected);
    }
}
