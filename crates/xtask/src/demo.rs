//! `cargo xtask demo`: the demo scene in every shipped style, in a window, or as pictures if there is no
//! display. `cargo xtask pictures`: a picture of each feature.

use std::{path::Path, process::Command};

use anyhow::{Result, ensure};

use crate::{
    packages::{has_display, install_graphics},
    steps::{Steps, cargo},
};

const SCENE: &str = "assets/demo.sgs";
const OUT: &str = "out/demo";
const PICTURES: &str = "docs/features";

/// Opens the viewer. If there is no display, renders a turntable and prints the paths of the pictures.
pub fn run() -> Result<()> {
    ensure!(Path::new(SCENE).is_file(), "{SCENE} is missing; `cargo xtask assets` makes it");
    let window = has_display();
    let mut steps = Steps::default();
    install_graphics(&mut steps, window)?;
    if window {
        return steps.run("viewer", &mut example("viewer"));
    }
    eprintln!(
        "No display was found (DISPLAY and WAYLAND_DISPLAY are empty): drawing pictures instead of a window."
    );
    let outcome = steps.run("turntable", example("headless").arg(OUT));
    steps.print_summary();
    outcome?;
    println!("\nThe demo scene, once around through all styles: {OUT}/000.png and on");
    println!("All of them on one sheet: {OUT}/sheet.png");
    Ok(())
}

/// Draws the pictures of `docs/features.md` anew.
pub fn pictures() -> Result<()> {
    ensure!(Path::new(SCENE).is_file(), "{SCENE} is missing; `cargo xtask assets` makes it");
    let mut steps = Steps::default();
    install_graphics(&mut steps, false)?;
    let outcome = steps.run("pictures", example("pictures").arg(PICTURES));
    steps.print_summary();
    outcome
}

/// An example of the workspace, as a release build.
pub fn example(name: &str) -> Command {
    cargo(["run", "--release", "--locked", "--example", name, "--"])
}

/// The command line tool, as a release build.
pub fn stylegaussian() -> Command {
    cargo([
        "run",
        "--release",
        "--quiet",
        "--locked",
        "--package",
        "stylegaussian_cli",
        "--bin",
        "stylegaussian",
        "--",
    ])
}
