//! The description of a look.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use stylegaussian::{Look, look::MadeFrom};
use stylegaussian_files::read_look;

use crate::terminal::{lossy, print};

#[derive(Serialize)]
struct LookInfo<'a> {
    #[serde(serialize_with = "lossy")]
    path: &'a Path,
    n_gaussians: usize,
    /// The fingerprint of its scene.
    fingerprint: String,
    /// Whether strokes are drawn over its colors.
    has_strokes: bool,
    paintings: Vec<PaintingInfo<'a>>,
    strength: f64,
    steps: u64,
    seed: u64,
}

#[derive(Serialize)]
struct PaintingInfo<'a> {
    name: &'a str,
    weight: f64,
}

/// Describes the look at `path`.
///
/// # Errors
/// If it cannot be read.
pub fn run(path: &Path, json: bool) -> Result<()> {
    let look = read_look(path)?;
    let info = describe(path, &look);
    print(json, &info, || text(&info))
}

fn describe<'a>(path: &'a Path, look: &'a Look) -> LookInfo<'a> {
    let MadeFrom { paintings, strength, steps, seed } = &look.made_from;
    let paintings =
        paintings.iter().map(|painting| PaintingInfo { name: &painting.name, weight: painting.weight });
    LookInfo {
        path,
        n_gaussians: look.len(),
        fingerprint: look.scene.to_string(),
        has_strokes: look.has_strokes(),
        paintings: paintings.collect(),
        strength: *strength,
        steps: *steps,
        seed: *seed,
    }
}

fn text(info: &LookInfo) -> String {
    let LookInfo { n_gaussians, fingerprint, has_strokes, strength, steps, seed, .. } = info;
    let painting = |painting: &PaintingInfo| format!("{} ({:.2})", painting.name, painting.weight);
    let paintings: Vec<_> = info.paintings.iter().map(painting).collect();
    [
        info.path.display().to_string(),
        format!("  Gaussians   {n_gaussians}"),
        format!("  fingerprint {fingerprint}"),
        format!("  strokes     {}", if *has_strokes { "over the colors" } else { "none" }),
        format!("  paintings   {}", paintings.join(", ")),
        format!("  made with   strength {strength}, {steps} steps, seed {seed}"),
    ]
    .join("\n")
}
