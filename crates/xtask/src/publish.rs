//! `cargo xtask package`: packs the published crates, builds each from its package, and builds their
//! documentation.
//!
//! Uncommitted changes are packed too, except on CI, where cargo requires a clean tree.

use std::{
    env, fs,
    path::{PathBuf, absolute},
    process::Command,
    time::UNIX_EPOCH,
};

use anyhow::{Context, Result, bail, ensure};

use crate::{
    files::fresh_folder,
    steps::{Steps, cargo, target_folder},
};

/// Packs the published crates and builds each from its package. The packages of the others take the place of a
/// registry's. Then builds their documentation, from the workspace.
///
/// # Errors
/// If a crate cannot be packed or built, or its documentation has warnings.
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
    let outcome = outcome.and_then(|()| docs(&mut steps));
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

/// The packages that are not published: the workspace's own, and crates.
fn unpublished() -> Result<Vec<String>> {
    let mut names = vec![String::from("stylegaussian_workspace")];
    for (_, manifest) in crates()?.iter().filter(|(_, manifest)| !is_published(manifest)) {
        names.push(name(manifest)?.into());
    }
    names.sort();
    Ok(names)
}

/// Folders and manifests of the crates.
fn crates() -> Result<Vec<(PathBuf, String)>> {
    let mut folders = vec![PathBuf::from("shaders")];
    for entry in fs::read_dir("crates").context("cannot list crates/")? {
        folders.push(entry.context("cannot list crates/")?.path());
    }
    folders.sort();
    // A folder without a manifest is no crate.
    let with_manifest =
        |folder: PathBuf| Some((folder.clone(), fs::read_to_string(folder.join("Cargo.toml")).ok()?));
    Ok(folders.into_iter().filter_map(with_manifest).collect())
}

fn is_published(manifest: &str) -> bool {
    manifest.lines().all(|line| line.trim() != "publish = false")
}

/// The name of a package, the first of its manifest.
fn name(manifest: &str) -> Result<&str> {
    let mut lines = manifest.lines();
    let name = lines.find_map(|line| line.strip_prefix("name = \"")?.strip_suffix('"'));
    name.context("a manifest has no line `name = \"...\"`")
}

/// Builds the documentation of the published crates as docs.rs does: each by itself, with the features that its
/// manifest says. Warnings are errors. The target is this machine's, whatever the manifest says.
fn docs(steps: &mut Steps) -> Result<()> {
    for (folder, manifest) in crates()? {
        // A program alone has no page.
        if is_published(&manifest) && folder.join("src").join("lib.rs").is_file() {
            let name = name(&manifest)?;
            let mut doc = cargo(["doc", "--locked", "--no-deps", "--package", name]);
            doc.args(docs_arguments(&manifest)?).env("RUSTDOCFLAGS", "-D warnings");
            steps.run(&format!("docs of {name}"), &mut doc)?;
        }
    }
    Ok(())
}

/// Arguments of `cargo doc` for a manifest's table `[package.metadata.docs.rs]`.
fn docs_arguments(manifest: &str) -> Result<Vec<String>> {
    let lines = manifest.lines().skip_while(|line| *line != "[package.metadata.docs.rs]").skip(1);
    let mut arguments = Vec::new();
    for line in lines.take_while(|line| !line.starts_with('[')).filter(|line| line.contains('=')) {
        match line.split_once(" = ") {
            Some(("targets", _)) => {}
            Some((key @ ("all-features" | "no-default-features"), "true")) => {
                arguments.push(format!("--{key}"));
            }
            Some(("features", list)) => {
                let names = list.trim_matches(['[', ']']).replace(['"', ' '], "");
                arguments.extend([String::from("--features"), names]);
            }
            _ => bail!(
                "[package.metadata.docs.rs] has `{line}`, expected `targets`, `all-features = true`, \
                 `no-default-features = true` or `features` on one line"
            ),
        }
    }
    Ok(arguments)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn docs_have_the_features_of_the_manifest() {
        let arguments = |settings: &str| {
            let table = format!("[package.metadata.docs.rs]\n{settings}\n");
            docs_arguments(&format!("[package]\nname = \"a\"\n\n{table}\n[features]\nfeatures = []\n"))
        };
        assert_eq!(arguments("all-features = true\ntargets = [\"x\"]").unwrap(), ["--all-features"]);
        let some = "no-default-features = true\nfeatures = [\"b\", \"c\"]";
        assert_eq!(arguments(some).unwrap(), ["--no-default-features", "--features", "b,c"]);
        assert!(arguments("").unwrap().is_empty());
        assert!(docs_arguments("[package]\nname = \"a\"\n").unwrap().is_empty());
        assert!(arguments("all-features = false").is_err());
    }

    #[test]
    fn crates_are_named_by_their_manifest() {
        let manifest = "[package]\nname = \"a\"\n\n[[bin]]\nname = \"b\"\n";
        assert_eq!(name(manifest).unwrap(), "a");
        assert!(is_published(manifest));
        assert!(!is_published("[package]\npublish = false\n"));
    }
}
