//! `cargo xtask package`: packs the published crates, and builds each from its package.
//!
//! Uncommitted changes are packed too, except on CI, where cargo requires a clean tree.

use std::{
    env, fs,
    path::{PathBuf, absolute},
    process::Command,
    time::UNIX_EPOCH,
};

use anyhow::{Context, Result, ensure};

use crate::{
    files::fresh_folder,
    steps::{Steps, cargo, target_folder},
};

/// Packs the published crates and builds each from its package. The packages of the others take the place of a
/// registry's.
///
/// # Errors
/// If a crate cannot be packed or built.
pub fn run() -> Result<()> {
    let mut steps = Steps::default();
    let mut command = package()?;
    command.arg("--target-dir").arg(new_build_folder()?);
    // Packages have no profile. As in the workspace's, debug info would cost build time.
    command.args(["--config", "profile.dev.debug=0"]);
    // Not `Steps::run`: it prints the command for people to repeat, and the build folder would not be new then.
    let outcome = steps.check("packages", || {
        let status = command.status().context("cannot run `cargo package`")?;
        ensure!(status.success(), "the messages of `cargo package` are above");
        Ok(())
    });
    steps.print_summary();
    outcome?;
    println!("\nTo publish what was built: cargo publish --locked --workspace --no-verify");
    Ok(())
}

/// Packs the published crates, without building them from their packages.
///
/// # Errors
/// If a crate cannot be packed.
pub fn pack(steps: &mut Steps) -> Result<()> {
    // Cargo would ask the registry whether it has our crates.
    steps.run("packages", package()?.args(["--no-verify", "--offline"]))
}

/// A build folder whose path is new. In one that it knows, cargo takes packages of the same version for those
/// that it unpacked and compiled before, and builds the crates above them with old code.
fn new_build_folder() -> Result<PathBuf> {
    let folder = target_folder().join("packages");
    fresh_folder(&folder)?;
    let name = UNIX_EPOCH.elapsed().context("the clock is before 1970")?.as_secs().to_string();
    absolute(folder.join(name)).context("the current folder is gone")
}

fn package() -> Result<Command> {
    let mut command = cargo(["package", "--locked", "--workspace"]);
    for name in unpublished()? {
        command.args(["--exclude", &name]);
    }
    if env::var_os("CI").is_none() {
        command.arg("--allow-dirty");
    }
    Ok(command)
}

/// The packages with `publish = false` in their manifest: the workspace's own, and crates. Crates are named
/// like their folders.
fn unpublished() -> Result<Vec<String>> {
    let mut names = vec![String::from("stylegaussian_workspace")];
    for entry in fs::read_dir("crates").context("cannot list crates/")? {
        let folder = entry.context("cannot list crates/")?.path();
        let manifest = folder.join("Cargo.toml");
        let Ok(text) = fs::read_to_string(&manifest) else { continue };
        if text.lines().any(|line| line.trim() == "publish = false") {
            names.extend(folder.file_name().map(|name| name.to_string_lossy().into_owned()));
        }
    }
    names.sort();
    Ok(names)
}
