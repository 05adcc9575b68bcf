//! Checks that cargo compiles dependencies once for all commands that build the whole workspace.
//!
//! Cargo unites features over the crates that one command selects, and compiles a dependency once more if the
//! union differs (minutes for Bevy, burn and tract). Lints, tests and examples select the whole workspace with
//! dependencies that only tests and examples have, documentation and programs select it without them. The
//! workspace's own package depends on what makes the two unions equal.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, ensure};

use crate::steps::cargo;

/// The sets of features that each package is compiled with. A package has two if build scripts and derive
/// macros use it with other features than the program does.
type Features = BTreeMap<String, BTreeSet<String>>;

/// The packages that are compared: the program's alone, then those of build scripts and derive macros as well.
/// The second comparison cannot see a set that the program lacks if the other packages have it, hence the
/// first.
const EDGES: [&str; 2] = ["normal,no-proc-macro", "normal,build"];

/// Compares the workspace without its tests and examples with the workspace as a whole.
///
/// # Errors
/// If a package would be compiled with other features. The message names them.
pub fn check() -> Result<()> {
    let mut different = Vec::new();
    for edges in EDGES {
        let whole = features(&format!("{edges},dev"))?;
        different.extend(self::different(&features(edges)?, &whole));
    }
    ensure!(
        different.is_empty(),
        "features differ, so cargo compiles these packages twice; add the features of tests and examples to \
         the dependencies in ./Cargo.toml:\n{}",
        different.join("\n")
    );
    Ok(())
}

/// The packages and features that cargo compiles for the workspace.
fn features(edges: &str) -> Result<Features> {
    let tree =
        ["tree", "--locked", "--workspace", "--prefix", "none", "--format", "{p}|{f}", "--edges", edges];
    let output = cargo(tree).output().context("cannot run `cargo tree`")?;
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

/// A line for each package of `part` with a set of features that `whole` does not compile.
fn different(part: &Features, whole: &Features) -> Vec<String> {
    let none = BTreeSet::new();
    let line = |(package, sets): (&String, &BTreeSet<String>)| {
        let expected = whole.get(package).unwrap_or(&none);
        // A subset is enough: what the whole workspace compiles is there already.
        (!sets.is_subset(expected))
            .then(|| format!("  {package} with {sets:?}, with tests and examples {expected:?}"))
    };
    part.iter().filter_map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_feature_is_found() {
        let whole = parsed("half v2.7.1|bytemuck,serde\nlog v0.4.35|std (*)\nours v0.1.0 (/here)|");
        let part = parsed("half v2.7.1|bytemuck\nlog v0.4.35|std\nours v0.1.0 (/here)|");
        let lines = different(&part, &whole);
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].contains("half v2.7.1 with {\"bytemuck\"}"), "{lines:?}");
        assert!(different(&whole, &whole).is_empty());
    }

    #[test]
    fn a_package_of_the_host_may_have_features_of_its_own() {
        let whole = parsed("syn v3.0.9|full\nsyn v3.0.9|full,visit");
        let part = parsed("syn v3.0.9|full,visit");
        assert!(different(&part, &whole).is_empty());
    }
}
