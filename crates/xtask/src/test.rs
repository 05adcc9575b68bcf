//! `cargo xtask test`: everything that CI runs, cheapest first. Stops at the first failure.

use std::{path::Path, process::Command};

use anyhow::Result;

use crate::{
    examples::{self, Display},
    features, files, lines,
    packages::{install_graphics, missing_for_virtual_display},
    publish,
    steps::{Steps, cargo, data_folder, is_installed, keep_colors},
    web,
};

/// Runs every check and prints a summary, also if one fails.
pub fn run() -> Result<()> {
    let mut steps = Steps::default();
    let outcome = run_all(&mut steps);
    steps.print_summary();
    let data = data_folder();
    if data.is_dir() {
        eprintln!("   test data: {}", data.display());
    } else {
        eprintln!(
            "   test data: NOT FOUND at {}: the tests that need it were skipped \
             (STYLEGAUSSIAN_DATA names another place)",
            data.display()
        );
    }
    match &outcome {
        Ok(()) => eprintln!("   all that ran passed"),
        Err(_) => eprintln!("   stopped at the first failure: later steps did not run"),
    }
    outcome
}

fn run_all(steps: &mut Steps) -> Result<()> {
    add_components(steps)?;
    install_graphics(steps, false)?;
    steps.run("format", &mut cargo(["fmt", "--all", "--check"]))?;
    match files::listed(lines::CODE) {
        Some(files) => steps.check("lines", || lines::check(&files))?,
        None => steps.not_run("lines", "git lists no sources here"),
    }
    run_if_installed(steps, "spelling", "typos", &[])?;
    run_if_installed(steps, "toml", "taplo", &["format", "--check"])?;
    run_if_installed(steps, "licenses", "cargo-deny", &["check", "licenses", "sources"])?;
    steps.check("features", features::check)?;
    steps.run(
        "lints",
        &mut cargo(["clippy", "--locked", "--workspace", "--all-targets", "--", "-D", "warnings"]),
    )?;
    fewer_features(steps)?;
    steps.run(
        "docs",
        cargo(["doc", "--locked", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"),
    )?;
    tests(steps)?;
    tests_in_atmospheres(steps)?;
    steps.run("examples", &mut cargo(["build", "--locked", "--workspace", "--examples"]))?;
    start_examples(steps)?;
    web::test(steps)?;
    publish::pack(steps)
}

/// Installs rustfmt and clippy if the toolchain lacks them, as minimal ones do.
fn add_components(steps: &mut Steps) -> Result<()> {
    let is_there = |tool| cargo([tool, "--version"]).output().is_ok_and(|output| output.status.success());
    if is_there("fmt") && is_there("clippy") {
        return Ok(());
    }
    steps.run("set-up", Command::new("rustup").args(["component", "add", "rustfmt", "clippy"]))
}

/// Checks the plugin as games build it that show looks and presets alone, and those that refine nothing.
fn fewer_features(steps: &mut Steps) -> Result<()> {
    let plugin = ["clippy", "--locked", "--package", "bevy_stylegaussian", "--all-targets"];
    for features in [&["--no-default-features"][..], &["--no-default-features", "--features", "images"]] {
        let mut clippy = cargo(plugin);
        steps.run("lints of fewer features", clippy.args(features).args(["--", "-D", "warnings"]))?;
    }
    Ok(())
}

fn tests(steps: &mut Steps) -> Result<()> {
    if is_installed("cargo-nextest") {
        let mut nextest = cargo(["nextest", "run", "--locked", "--workspace", "--no-tests", "pass"]);
        steps.run_keeping("tests", keep_colors(&mut nextest), |line| line.contains("Summary"))?;
    } else {
        let mut test = cargo(["test", "--locked", "--workspace", "--lib", "--bins", "--tests"]);
        steps.run_keeping("tests", keep_colors(&mut test), |line| line.starts_with("test result"))?;
    }
    // nextest runs no doc tests.
    let mut doc = cargo(["test", "--locked", "--workspace", "--doc"]);
    steps.run_keeping("doc tests", keep_colors(&mut doc), |line| line.starts_with("test result"))
}

/// Draws Bevy's atmosphere on SwiftShader, which comes with Chromium: on Mesa's software driver, these tests
/// skip themselves.
fn tests_in_atmospheres(steps: &mut Steps) -> Result<()> {
    let driver = Path::new("/usr/lib/chromium/vk_swiftshader_icd.json");
    if !driver.is_file() {
        steps.not_run("tests in atmospheres", &format!("{} is not there", driver.display()));
        return Ok(());
    }
    let mut test = cargo(["test", "--locked", "--workspace", "--lib", "--", "of_an_atmosphere"]);
    test.env("VK_DRIVER_FILES", driver).env("VK_ICD_FILENAMES", driver);
    steps.run_keeping("tests in atmospheres", keep_colors(&mut test), |line| line.starts_with("test tests::"))
}

fn start_examples(steps: &mut Steps) -> Result<()> {
    if !cfg!(target_os = "linux") {
        steps.not_run("examples start", "only Linux has a display without a screen for them");
        return Ok(());
    }
    let missing = missing_for_virtual_display();
    if !missing.is_empty() {
        steps.not_run("examples start", &format!("{} not installed", missing.join(" ")));
        return Ok(());
    }
    match Display::start() {
        Ok(display) => steps.check("examples start", || examples::start_all(&display)),
        Err(error) => {
            steps.not_run("examples start", &format!("{error:#}"));
            Ok(())
        }
    }
}

fn run_if_installed(steps: &mut Steps, name: &str, program: &str, arguments: &[&str]) -> Result<()> {
    if is_installed(program) {
        steps.run(name, Command::new(program).args(arguments))
    } else {
        steps.not_run(name, &format!("`{program}` is not installed"));
        Ok(())
    }
}
