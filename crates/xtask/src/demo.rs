//! `cargo xtask demo`: the demo scene in every shipped style, as pictures.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};

use crate::steps::{Steps, cargo};

const SCENE: &str = "assets/demo.sgs";
const STYLES: &str = "assets/styles";
const OUT: &str = "out/demo";
const N_VIEWS: &str = "4";
const SIZE: &str = "640x480";

/// Stylizes and renders the demo scene and says where the pictures are.
pub fn run() -> Result<()> {
    ensure!(Path::new(SCENE).is_file(), "{SCENE} is missing; `cargo xtask assets` makes it");
    let styles = style_statistics(Path::new(STYLES))?;
    let mut steps = Steps::default();
    let outcome = render_all(&mut steps, &styles);
    steps.print_summary();
    outcome?;
    println!("\nThe demo scene in {} styles, {N_VIEWS} views each: {OUT}/", styles.len());
    println!("All of them on one sheet: {OUT}/contact_sheet.png");
    Ok(())
}

fn render_all(steps: &mut Steps, styles: &[PathBuf]) -> Result<()> {
    steps.run("build", &mut cargo(["build", "--release", "--locked", "--package", "stylegaussian_tools"]))?;
    let plain = format!("{OUT}/unstyled");
    steps.run("unstyled", &mut render(&plain, None))?;
    let mut sheet = cargo(["run", "--release", "--quiet", "--locked", "--package", "stylegaussian_tools"]);
    sheet.args(["--example", "contact_sheet", "--", &format!("{OUT}/contact_sheet.png"), "-", &plain]);
    for style in styles {
        let name = style_name(style);
        let pictures = format!("{OUT}/{name}");
        steps.run(&name, &mut render(&pictures, Some(style)))?;
        sheet.arg(style_image(style).as_deref().unwrap_or(Path::new("-"))).arg(pictures);
    }
    steps.run("contact sheet", &mut sheet)
}

fn render(out: &str, style: Option<&Path>) -> Command {
    let mut command = stylegaussian();
    command.args(["render", SCENE, "--orbit", N_VIEWS, "--size", SIZE, "-o", out]);
    if let Some(style) = style {
        command.arg("--style").arg(style);
    }
    command
}

/// The command line tool, built for speed.
pub fn stylegaussian() -> Command {
    cargo([
        "run",
        "--release",
        "--quiet",
        "--locked",
        "--package",
        "stylegaussian_tools",
        "--bin",
        "stylegaussian",
        "--",
    ])
}

/// Every `*.style.safetensors` in `folder`, by name.
fn style_statistics(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let path = entry.with_context(|| format!("cannot list {}", folder.display()))?.path();
        if path.to_string_lossy().ends_with(".style.safetensors") {
            found.push(path);
        }
    }
    ensure!(
        !found.is_empty(),
        "{} holds no *.style.safetensors; `cargo xtask assets` makes them",
        folder.display()
    );
    found.sort();
    Ok(found)
}

fn style_name(style: &Path) -> String {
    let name = style.file_name().unwrap_or_default().to_string_lossy();
    name.trim_end_matches(".style.safetensors").to_owned()
}

/// The picture that the statistics were taken of, which lies beside them.
fn style_image(style: &Path) -> Option<PathBuf> {
    let candidates =
        ["png", "jpg"].map(|extension| style.with_file_name(format!("{}.{extension}", style_name(style))));
    candidates.into_iter().find(|path| path.is_file())
}
