//! Checks that building one crate and building the workspace compile the same dependencies.
//!
//! Cargo unites features over the crates that one command selects. If the union for `-p CRATE` differs from
//! that for `--workspace`, switching between the two compiles every affected dependency twice (minutes for
//! Bevy, burn and tract). `crates/stylegaussian_features` and the sections `cfg(stylegaussian_workspace)` of
//! the manifests keep the unions equal. Packages are made without them: see [`crate::publish`].

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, ensure};

use crate::steps::cargo;

/// The crates that people build alone. The other members depend on these, or compile in seconds.
const BUILT_ALONE: [&str; 8] = [
    "stylegaussian",
    "stylegaussian_files",
    "stylegaussian_encoder",
    "stylegaussian_gpu",
    "bevy_stylegaussian",
    "stylegaussian_train",
    "stylegaussian_cli",
    "stylegaussian_bench",
];

/// The sets of features that each package is compiled with. A package has two if build scripts and derive
/// macros use it with other features than the program does.
type Features = BTreeMap<String, BTreeSet<String>>;

/// The packages that are compared: the program's alone, then those of build scripts and derive macros as well.
/// The second comparison cannot see a set that the program lacks if the other packages have it, hence the
/// first.
const EDGES: [&str; 2] = ["normal,no-proc-macro", "normal,build"];

/// Compares each crate alone, and the workspace without its tests and examples, with the workspace as a whole.
///
/// # Errors
/// If a package would be compiled with other features. The message names them.
pub fn check() -> Result<()> {
    let mut different = Vec::new();
    for edges in EDGES {
        // With `dev`, since tests and examples are built with the whole workspace.
        let whole = features(&["--workspace", "--edges", &format!("{edges},dev")])?;
        let selected = features(&["--workspace", "--edges", edges])?;
        different.extend(self::different(&selected, &whole, "--workspace"));
        for name in BUILT_ALONE {
            let alone = features(&["--package", name, "--edges", edges])?;
            different.extend(self::different(&alone, &whole, name));
        }
    }
    ensure!(
        different.is_empty(),
        "features differ, so cargo compiles these packages twice; add the features to \
         crates/stylegaussian_features or under cfg(stylegaussian_workspace) in the crate's manifest:\n{}",
        different.join("\n")
    );
    Ok(())
}

/// The packages and features that cargo compiles for this selection.
fn features(selection: &[&str]) -> Result<Features> {
    let mut command = cargo(["tree", "--locked", "--prefix", "none", "--format", "{p}|{f}"]);
    let output = command.args(selection).output().context("cannot run `cargo tree`")?;
    ensure!(output.status.success(), "cargo tree: {}", String::from_utf8_lossy(&output.stderr).trim());
    Ok(parsed(&String::from_utf8_lossy(&output.stdout)))
}

/// Parses lines `NAME vVERSION (SOURCE)|FEATURE,FEATURE`.
fn parsed(tree: &str) -> Features {
    let mut features = Features::new();
    for (package, list) in tree.lines().filter_map(|line| line.split_once('|')) {
        let mut words = package.split(' ');
        let name = [words.next(), words.next()].into_iter().flatten().collect::<Vec<_>>().join(" ");
        // `cargo tree` marks packages whose dependencies it has printed before.
        features.entry(name).or_default().insert(list.trim_end_matches(" (*)").to_owned());
    }
    features
}

/// A line for each package of `selected` with a set of features that `whole` does not compile.
fn different(selected: &Features, whole: &Features, selection: &str) -> Vec<String> {
    let none = BTreeSet::new();
    let line = |(package, sets): (&String, &BTreeSet<String>)| {
        let expected = whole.get(package).unwrap_or(&none);
        // A subset is enough: what the whole workspace compiles is there already.
        (!sets.is_subset(expected))
            .then(|| format!("  {selection}: {package} with {sets:?}, the whole workspace with {expected:?}"))
    };
    selected.iter().filter_map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_feature_is_found() {
        let whole = parsed("half v2.7.1|bytemuck,serde\nlog v0.4.35|std (*)\nours v0.1.0 (/here)|");
        let alone = parsed("half v2.7.1|bytemuck\nlog v0.4.35|std\nours v0.1.0 (/here)|");
        let lines = different(&alone, &whole, "ours");
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].contains("ours: half v2.7.1 with {\"bytemuck\"}"), "{lines:?}");
        assert!(different(&whole, &whole, "--workspace").is_empty());
    }

    #[test]
    fn a_package_of_the_host_may_have_features_of_its_own() {
        let whole = parsed("syn v3.0.9|full\nsyn v3.0.9|full,visit");
        let alone = parsed("syn v3.0.9|full,visit");
        assert!(different(&alone, &whole, "ours").is_empty());
    }
}
