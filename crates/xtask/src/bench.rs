//! `cargo xtask bench`, `cargo xtask world` and `cargo xtask fly`: builds programs for speed, and calls them.

use anyhow::Result;

use crate::{
    demo::example,
    packages::install_graphics,
    steps::{Steps, cargo},
};

/// Calls the harness with `arguments`. It explains them with `--help`.
pub fn run(arguments: &[String]) -> Result<()> {
    let mut steps = Steps::default();
    install_graphics(&mut steps, false)?;
    let harness = ["run", "--release", "--locked", "--package", "stylegaussian_bench", "--"];
    steps.run("bench", cargo(harness).args(arguments))
}

/// Calls the maker of large worlds with `arguments`. It explains them with `--help`.
pub fn world(arguments: &[String]) -> Result<()> {
    let maker = ["run", "--release", "--locked", "--package", "stylegaussian_bench", "--bin", "world", "--"];
    Steps::default().run("world", cargo(maker).args(arguments))
}

/// Calls the flight through a world with `arguments`. It explains them with `--help`.
pub fn fly(arguments: &[String]) -> Result<()> {
    let mut steps = Steps::default();
    install_graphics(&mut steps, false)?;
    steps.run("fly", example("fly").args(arguments))
}
