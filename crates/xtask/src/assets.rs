//! `cargo xtask assets`: everything in `assets/` and the default decoder, made anew by the commands of this file.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail, ensure};

use crate::{
    demo::stylegaussian,
    steps::{Steps, cargo},
};

const STYLES: &str = "assets/styles";
const SCENE: &str = "out/assets/demo.ply";
const EMBEDDED: &str = "assets/demo.sgs";
const DECODER: &str = "crates/stylegaussian_defaults/default.decoder.safetensors";

/// Makes the assets with the encoder at `encoder`, or else the one that `STYLEGAUSSIAN_ENCODER` names.
pub fn run(encoder: Option<&str>) -> Result<()> {
    let encoder = match encoder
        .map(PathBuf::from)
        .or_else(|| env::var_os("STYLEGAUSSIAN_ENCODER").map(PathBuf::from))
    {
        Some(file) => file,
        None => bail!("no encoder: give --encoder FILE or set STYLEGAUSSIAN_ENCODER (no encoder ships yet)"),
    };
    ensure!(encoder.is_file(), "the encoder {} is not a file", encoder.display());
    fs::create_dir_all("out/assets").context("cannot create out/assets")?;
    let mut steps = Steps::default();
    let outcome = make(&mut steps, &encoder);
    steps.print_summary();
    outcome?;
    report_sizes()
}

fn make(steps: &mut Steps, encoder: &Path) -> Result<()> {
    steps.run("paintings", &mut generator("demo_paintings", STYLES))?;
    steps.run("world", &mut generator("demo_world", SCENE))?;
    for image in style_images()? {
        let mut style = stylegaussian();
        style.arg("style").arg(&image).arg("-o").arg(image.with_extension("style.safetensors"));
        steps.run(&format!("statistics of {}", image.display()), style.arg("--encoder").arg(encoder))?;
    }
    let mut embed = stylegaussian();
    steps.run("embed", embed.args(["embed", SCENE, "-o", EMBEDDED]).arg("--encoder").arg(encoder))?;
    let mut train = stylegaussian();
    train.args(["train", EMBEDDED, "--styles", STYLES, "-o", DECODER]).arg("--encoder").arg(encoder);
    steps.run("train", &mut train)
}

fn generator(package: &str, out: &str) -> Command {
    cargo(["run", "--release", "--quiet", "--locked", "--package", package, "--", out])
}

fn style_images() -> Result<Vec<PathBuf>> {
    let mut images: Vec<_> = files(Path::new(STYLES))?
        .into_iter()
        .filter(|path| path.extension().is_some_and(|extension| extension == "png" || extension == "jpg"))
        .collect();
    images.sort();
    ensure!(!images.is_empty(), "{STYLES} holds no picture");
    Ok(images)
}

fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let list = || -> std::io::Result<Vec<PathBuf>> {
        fs::read_dir(folder)?
            .map(|entry| Ok(entry?.path()))
            .filter(|path| path.as_ref().map_or(true, |p| p.is_file()))
            .collect()
    };
    list().with_context(|| format!("cannot list {}", folder.display()))
}

fn report_sizes() -> Result<()> {
    let mut paths = files(Path::new("assets"))?;
    paths.extend(files(Path::new(STYLES))?);
    paths.push(DECODER.into());
    paths.sort();
    let mut total = 0;
    for path in paths {
        let n_bytes = fs::metadata(&path).with_context(|| format!("cannot read {}", path.display()))?.len();
        total += n_bytes;
        println!("{n_bytes:>10}  {}", path.display());
    }
    println!("{total:>10}  bytes together");
    Ok(())
}
