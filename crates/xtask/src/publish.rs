//! `cargo xtask package`: packs the published crates, from a copy of the sources.
//!
//! The copy's manifests lack the sections under `cfg(stylegaussian_workspace)`, which spare builds inside the
//! workspace (see [`crate::features`]). Nobody else sets that configuration, but cargo resolves dependencies
//! for all configurations: each game's lock file would hold the sections' packages, and a registry would have
//! to hold `stylegaussian_features`. It does not, so a crate that has the sections cannot be packed or
//! published by mistake.

use std::{
    env, fs,
    path::{Path, PathBuf, absolute},
    process::Command,
};

use anyhow::{Context, Result, ensure};

use crate::{
    files::{copy, fresh_folder, listed},
    steps::{Steps, cargo, target_folder},
};

/// The workspace's own configuration.
const CONFIGURATION: &str = "stylegaussian_workspace";

/// What a workspace consists of, for cargo.
const COPIED: [&str; 6] = ["Cargo.toml", "Cargo.lock", "crates", "shaders", "tests", "examples"];

/// Folders of the published crates.
const PACKED: [&str; 2] = ["crates", "shaders"];

/// Packs the published crates and says where to publish from.
///
/// # Errors
/// If a crate cannot be packed.
pub fn run() -> Result<()> {
    let mut steps = Steps::default();
    let outcome = pack(&mut steps);
    steps.print_summary();
    outcome?;
    println!("\nTo publish: cargo publish --manifest-path {} --package ...", copied("Cargo.toml")?.display());
    Ok(())
}

/// Packs the published crates, without building them from their packages. Uncommitted changes are included,
/// except on CI, which requires a clean tree.
///
/// # Errors
/// If a crate cannot be packed.
pub fn pack(steps: &mut Steps) -> Result<()> {
    let files = listed(&[&["--cached", "--others", "--exclude-standard", "--"], &COPIED[..]].concat());
    let Some(files) = files else {
        steps.not_run("packages", "git lists no sources here");
        return Ok(());
    };
    steps.check("sources of packages", || copy_sources(&files))?;
    steps.run("packages", &mut package()?)
}

/// A path in the copy. Absolute, since cargo resolves some paths from its own folder.
fn copied(path: &str) -> Result<PathBuf> {
    absolute(target_folder().join("publish").join(path)).context("the current folder is gone")
}

fn copy_sources(files: &[String]) -> Result<()> {
    if env::var_os("CI").is_some() {
        let status = Command::new("git").args(["status", "--porcelain", "--"]).args(PACKED).output();
        let changes = status.context("cannot run `git status`")?.stdout;
        let changes = String::from_utf8_lossy(&changes);
        ensure!(changes.is_empty(), "found uncommitted changes, expected none on CI:\n{changes}");
    }
    fresh_folder(&copied("")?)?;
    for file in files {
        let to = copied(file)?;
        copy(Path::new(file), &to)?;
        if to.file_name().is_some_and(|name| name == "Cargo.toml") {
            let manifest = fs::read_to_string(file).with_context(|| format!("cannot read {file}"))?;
            let manifest = without_workspace_sections(&manifest);
            fs::write(&to, manifest).with_context(|| format!("cannot write {}", to.display()))?;
        }
    }
    Ok(())
}

/// A manifest without the sections under the workspace's own configuration, and without the comments above
/// them.
fn without_workspace_sections(manifest: &str) -> String {
    let mut kept: Vec<&str> = Vec::new();
    let mut is_kept = true;
    for line in manifest.lines() {
        if line.starts_with('[') {
            is_kept = !line.contains(CONFIGURATION);
            let is_comment = |line: &&str| line.is_empty() || line.starts_with('#');
            while !is_kept && kept.last().is_some_and(is_comment) {
                kept.pop();
            }
        }
        if is_kept {
            kept.push(line);
        }
    }
    kept.join("\n") + "\n"
}

fn package() -> Result<Command> {
    // The copy's lock file is the workspace's: not as short as it could be, so not `--locked`. Offline, cargo
    // takes the versions that it holds. The copy is not under git, whatever folder it is in.
    let mut command = cargo(["package", "--offline", "--workspace", "--no-verify", "--allow-dirty"]);
    command.arg("--manifest-path").arg(copied("Cargo.toml")?);
    command.arg("--target-dir").arg(absolute(target_folder()).context("the current folder is gone")?);
    for name in unpublished()? {
        command.args(["--exclude", &name]);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_of_the_workspace_alone_are_left_out() {
        let manifest = "[dependencies]\nglam = \"0.32\"\n\n# Inside this workspace only.\n\
                        [target.'cfg(all(stylegaussian_workspace, unix))'.dependencies]\nlog = \"0.4\"\n\n\
                        [[bin]]\nname = \"a\"\n\n# More.\n\
                        [target.'cfg(stylegaussian_workspace)'.dependencies]\nbytes = \"1\"\n";
        let expected = "[dependencies]\nglam = \"0.32\"\n[[bin]]\nname = \"a\"\n";
        assert_eq!(without_workspace_sections(manifest), expected);
        assert_eq!(without_workspace_sections(expected), expected);
    }
}
