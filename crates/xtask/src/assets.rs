//! `cargo xtask assets`: makes everything in `assets/`, the default encoder and the default decoder anew.
//!
//! The demo scene and the paintings are reproduced bit for bit. Embedded features and trained networks can
//! differ by the order of floating-point sums. The training data of encoder and decoder is not ours to ship and
//! is in the test data: VGG-19, paintings likely in the public domain, and scenes under open licenses.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};

use crate::{
    demo::stylegaussian,
    steps::{Steps, cargo, data_folder},
};

/// The eight style images, and their statistics beside them.
const STYLES: &str = "assets/styles";
/// The demo scene's looks, one for each style image.
const LOOKS: &str = "assets/looks";
/// The demo scene with its features.
const DEMO: &str = "assets/demo.sgs";
/// The default encoder.
const ENCODER: &str = "crates/stylegaussian_defaults/distilled_relu3_1.encoder.safetensors";
/// The default decoder.
const DECODER: &str = "crates/stylegaussian_defaults/default.decoder.safetensors";
/// Intermediate files, which do not ship.
const WORK: &str = "out/assets";
/// Cameras around the demo scene for the decoder's training: three rings of 8 each.
const DEMO_CAMERAS: &str = "assets/demo_cameras.json";
/// A scene of the test data on which the decoder is trained besides the demo scene (CC BY 4.0).
const PLAYBOT: &str = "playbot_31k_sh2pad3.ply";
/// The paintings on which encoder and decoder are trained, likely in the public domain. Twenty more are held
/// out.
const PAINTINGS: &str = "assets/training_paintings.txt";
/// Ten of the held-out paintings, for evaluation.
const HELD_OUT: &str = "assets/held_out_paintings.txt";

/// A further scene (MIT), from the second run on.
const BIKER: &str = "biker.compressed.ply";
/// Cameras around that scene: a ring at some distance, and three near rings of 6 each.
const BIKER_CAMERAS: &str = "assets/biker_cameras.json";

/// Flags of all training runs: the paper's loss, and colors kept near the range of a display.
const TRAINING: [&str; 4] = ["--holdout-styles", "0", "--range-weight", "300"];

/// Adam's learning rate in all runs but the last.
const RATE: [&str; 2] = ["--learning-rate", "3e-4"];

/// The first run: the warm start on recolored scenes, then the loss on crops of 256 pixels from views of 512.
/// The color-transfer loss keeps colors near the recolored scene's.
const FIRST_RUN: [&str; 12] = [
    "--noise",
    "4",
    "--smoothing",
    "0",
    "--warm-iterations",
    "1500",
    "--iterations",
    "5000",
    "--size",
    "512",
    "--color-transfer-weight",
    "50",
];

/// The second run continues from the first one's decoder.
const SECOND_RUN: [&str; 8] =
    ["--seed", "2", "--iterations", "4000", "--size", "512", "--color-transfer-weight", "50"];

/// Flags from the third run on.
const LATE_RUNS: [&str; 6] = ["--average", "0.4", "--size", "512,256", "--color-transfer-weight", "30"];

/// The penalty on roughness, for decoders with smoothing.
const ROUGHNESS: [&str; 2] = ["--roughness-weight", "2500"];

/// The third run adds small views, in which many Gaussians share a pixel.
const THIRD_RUN: [&str; 4] = ["--seed", "5", "--iterations", "1800"];

/// The fourth run drops the noise inputs, which had become grain, and smooths colors over neighborhoods.
const FOURTH_RUN: [&str; 8] = ["--noise", "0", "--smoothing", "1", "--seed", "11", "--iterations", "1150"];

/// The fifth run adds the contrastive loss: a picture must match its own painting better than others.
const FIFTH_RUN: [&str; 8] =
    ["--learning-rate", "2e-4", "--seed", "12", "--iterations", "800", "--contrastive-weight", "10"];

/// Weights of the mean of the last two runs, which is better than either, and the flags of the final decoder:
/// six smoothing passes and a tenth of the base color.
const SHARES: [&str; 2] = ["35", "65"];
const FINISH: [&str; 6] = ["--iterations", "0", "--smoothing", "6", "--residual", "0.1"];

/// Steps of the encoder's training.
const DISTILLING: [&str; 2] = ["--iterations", "11300"];

/// Views for the encoder's training besides the paintings, of the demo scene, playbot and biker: their numbers
/// and backgrounds. Light and dark backgrounds are both needed, because style images have both.
const VIEWS: [[(&str, &str); 2]; 3] = [
    [("10", "ffffff"), ("6", "203050")],
    [("8", "000000"), ("6", "ffffff")],
    [("8", "808080"), ("6", "e0d0c0")],
];

/// Files of the test data.
struct Data {
    vgg: PathBuf,
    relu4: PathBuf,
    paintings: PathBuf,
    playbot: PathBuf,
    playbot_cameras: PathBuf,
    biker: PathBuf,
}

impl Data {
    fn find() -> Result<Self> {
        let folder = data_folder();
        let vgg = folder.join("vgg");
        let data = Self {
            vgg: vgg.join("vgg19_normalised_relu3_1.safetensors"),
            relu4: vgg.join("distilled16x_encoder_relu4_1.safetensors"),
            paintings: folder.join("styles"),
            playbot: folder.join("splats").join(PLAYBOT),
            playbot_cameras: folder.join("reference/playbot_views.json"),
            biker: folder.join("splats").join(BIKER),
        };
        let all =
            [&data.vgg, &data.relu4, &data.paintings, &data.playbot, &data.playbot_cameras, &data.biker];
        for path in all {
            ensure!(
                path.exists(),
                "{} is missing; STYLEGAUSSIAN_DATA names the folder of the test data",
                path.display()
            );
        }
        Ok(data)
    }
}

/// Makes the assets and reports their sizes.
pub fn run() -> Result<()> {
    let data = Data::find()?;
    fs::create_dir_all(WORK).with_context(|| format!("cannot create {WORK}"))?;
    let mut steps = Steps::default();
    // The summary is printed if a step fails, too: the runs before it took hours.
    let outcome = make(&mut steps, &data);
    steps.print_summary();
    outcome?;
    report_sizes()
}

fn make(steps: &mut Steps, data: &Data) -> Result<()> {
    let world = format!("{WORK}/demo.sgs");
    steps.run("paintings", &mut generator("demo_paintings", STYLES))?;
    steps.run("world", &mut generator("demo_world", &world))?;
    let trained_on = paintings(data, "paintings", PAINTINGS)?;
    for image in images(Path::new(STYLES))? {
        copy_into(&trained_on, &image)?;
    }
    distill(steps, data, Path::new(&world), &trained_on)?;
    for image in images(Path::new(STYLES))? {
        let mut style = stylegaussian();
        style.arg("style").arg(&image).arg("-o").arg(image.with_extension("style.safetensors"));
        steps.run(&format!("style {}", image.display()), &mut style)?;
    }
    // Neighbors are found when the scene is loaded, so the file need not hold them.
    embed(steps, Path::new(&world), Path::new(DEMO), &["--no-neighbors".as_ref()])?;
    bake(steps)?;
    let playbot = PathBuf::from(format!("{WORK}/playbot.sgs"));
    embed(steps, &data.playbot, &playbot, &["--cameras".as_ref(), data.playbot_cameras.as_os_str()])?;
    let biker = PathBuf::from(format!("{WORK}/biker.sgs"));
    embed(steps, &data.biker, &biker, &[])?;
    train(steps, data, &playbot, &biker, &trained_on)
}

/// Trains the encoder beside its checkpoint, then copies it. The commands after this one are built with it.
fn distill(steps: &mut Steps, data: &Data, world: &Path, paintings: &Path) -> Result<()> {
    let renders = PathBuf::from(format!("{WORK}/renders"));
    fs::create_dir_all(&renders).with_context(|| format!("cannot create {}", renders.display()))?;
    for (scene, views) in [world, &data.playbot, &data.biker].into_iter().zip(VIEWS) {
        for (n, background) in views {
            let name = scene.file_stem().unwrap_or_default().to_string_lossy();
            let folder = format!("{WORK}/views/{name}_{background}");
            let mut render = stylegaussian();
            render.arg("render").arg(scene).args(["--orbit", n, "--background", background]);
            render.args(["--size", "512x512", "--backend", "cpu", "-o", &folder]);
            steps.run(&format!("views of {name}"), &mut render)?;
            for view in images(Path::new(&folder))? {
                let file = view.file_name().unwrap_or_default().to_string_lossy();
                let to = renders.join(format!("{name}_{background}_{file}"));
                fs::copy(&view, to).with_context(|| format!("cannot copy {}", view.display()))?;
            }
        }
    }
    let encoder = format!("{WORK}/distilled_relu3_1.encoder.safetensors");
    let mut distill = stylegaussian();
    distill.arg("distill").arg("--teacher").arg(&data.vgg).arg("--images").args([paintings, &renders]);
    distill.arg("--held-out").arg(self::paintings(data, "held_out", HELD_OUT)?).args(["-o", &encoder]);
    steps.run("distill", distill.args(DISTILLING))?;
    fs::copy(&encoder, ENCODER).with_context(|| format!("cannot copy {encoder} to {ENCODER}"))?;
    Ok(())
}

fn generator(package: &str, out: &str) -> Command {
    cargo(["run", "--release", "--quiet", "--locked", "--package", package, "--", out])
}

fn embed(steps: &mut Steps, scene: &Path, out: &Path, options: &[&OsStr]) -> Result<()> {
    let mut embed = stylegaussian();
    embed.arg("embed").arg(scene).arg("-o").arg(out).args(options);
    steps.run(&format!("embed {}", scene.display()), &mut embed)
}

/// Bakes the demo scene in every style. Its own cameras frame it better than chosen ones.
fn bake(steps: &mut Steps) -> Result<()> {
    fs::create_dir_all(LOOKS).with_context(|| format!("cannot create {LOOKS}"))?;
    for image in images(Path::new(STYLES))? {
        let name = image.file_stem().unwrap_or_default().to_string_lossy();
        let mut bake = stylegaussian();
        bake.args(["bake", DEMO, "-o"]).arg(format!("{LOOKS}/{name}.look.safetensors"));
        bake.args(["--cameras", DEMO_CAMERAS, "--style"]).arg(&image);
        steps.run(&format!("bake {name}"), &mut bake)?;
    }
    Ok(())
}

/// Trains the decoder beside checkpoints, loss curves and contact sheets, which do not ship, then copies it.
fn train(steps: &mut Steps, data: &Data, playbot: &Path, biker: &Path, paintings: &Path) -> Result<()> {
    let run = |scenes: &[&Path], cameras: &[&Path], out: &str| {
        let mut train = stylegaussian();
        train.arg("train").args(scenes).args(["-o", out]).arg("--styles").arg(paintings);
        for file in cameras {
            train.arg("--cameras").arg(file);
        }
        train.arg("--vgg").arg(&data.vgg).arg("--relu4").arg(&data.relu4).args(TRAINING);
        train
    };
    let (demo, cameras) =
        (Path::new(DEMO), [Path::new(DEMO_CAMERAS), &data.playbot_cameras, BIKER_CAMERAS.as_ref()]);
    let file = |name: &str| format!("{WORK}/{name}.decoder.safetensors");
    // The first run has two scenes. The third one came with the second run.
    let mut last = file("first");
    steps.run("first run", run(&[demo, playbot], &cameras[..2], &last).args(RATE).args(FIRST_RUN))?;
    let all = [demo, playbot, biker];
    let later: [(&str, &[&[&str]]); 4] = [
        ("second", &[&RATE, &SECOND_RUN]),
        ("third", &[&RATE, &LATE_RUNS, &THIRD_RUN]),
        ("fourth", &[&RATE, &LATE_RUNS, &ROUGHNESS, &FOURTH_RUN]),
        ("fifth", &[&LATE_RUNS, &ROUGHNESS, &FIFTH_RUN]),
    ];
    for (name, arguments) in later {
        let out = file(name);
        let mut train = run(&all, &cameras, &out);
        steps.run(&format!("{name} run"), train.args(["--init", &last]).args(arguments.concat()))?;
        last = out;
    }
    let decoder = file("default");
    let mut train = run(&all, &cameras, &decoder);
    for (name, share) in ["fourth", "fifth"].into_iter().zip(SHARES) {
        train.arg("--init").arg(format!("{}:{share}", file(name)));
    }
    steps.run("what ships", train.args(FINISH))?;
    fs::copy(&decoder, DECODER).with_context(|| format!("cannot copy {decoder} to {DECODER}"))?;
    Ok(())
}

/// Makes a folder `name` with the paintings of the test data that `list` names.
fn paintings(data: &Data, name: &str, list: &str) -> Result<PathBuf> {
    let folder = PathBuf::from(format!("{WORK}/{name}"));
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let names = fs::read_to_string(list).with_context(|| format!("cannot read {list}"))?;
    names.lines().try_for_each(|name| copy_into(&folder, &data.paintings.join(name)))?;
    Ok(folder)
}

fn copy_into(folder: &Path, file: &Path) -> Result<()> {
    let to = folder.join(file.file_name().unwrap_or_default());
    fs::copy(file, to).with_context(|| format!("cannot copy {}", file.display()))?;
    Ok(())
}

/// Pictures in `folder`, by name.
fn images(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut images = files(folder)?;
    images.retain(|path| path.extension().is_some_and(|extension| extension == "png" || extension == "jpg"));
    ensure!(!images.is_empty(), "{} holds no picture (.png, .jpg)", folder.display());
    Ok(images)
}

/// The files in `folder`, by name.
fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let list = || fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>();
    let mut paths = list().with_context(|| format!("cannot list {}", folder.display()))?;
    paths.retain(|path| path.is_file());
    paths.sort();
    Ok(paths)
}

fn report_sizes() -> Result<()> {
    let mut paths = files(Path::new("assets"))?;
    paths.extend(files(Path::new(STYLES))?);
    paths.extend(files(Path::new(LOOKS))?);
    paths.extend([ENCODER.into(), DECODER.into()]);
    let mut total = 0;
    for path in paths {
        let n_bytes = fs::metadata(&path).with_context(|| format!("cannot read {}", path.display()))?.len();
        total += n_bytes;
        println!("{n_bytes:>10}  {}", path.display());
    }
    println!("{total:>10}  bytes together");
    Ok(())
}
