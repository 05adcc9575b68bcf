//! The published packages, apart from their code. Manifests are read as text, so the rules need no build.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// Texts that a package must carry: MIT asks for its text, and a link would be gone outside of the repository.
const LICENSES: [&str; 2] = ["LICENSE-MIT", "LICENSE-APACHE"];

/// Fields that a registry shows of a package, or builds its documentation by.
const FIELDS: [&str; 5] =
    ["description = ", "readme = ", "keywords = ", "categories = ", "[package.metadata.docs.rs]"];

/// Lines of a package's README: it says what the package is and leaves the rest to the documentation.
const README_LINES: std::ops::RangeInclusive<usize> = 5..=20;

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("cannot read {}: {error}", path.display()))
}

/// Folders and manifests of the members, without the workspace's own package.
fn members() -> Vec<(PathBuf, String)> {
    let crates = fs::read_dir(repository().join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let folders = crates.chain([repository().join("shaders")]).filter(|it| it.join("Cargo.toml").is_file());
    folders.map(|folder| (folder.clone(), read(&folder.join("Cargo.toml")))).collect()
}

fn has_line(text: &str, start: &str) -> bool {
    text.lines().any(|line| line.starts_with(start))
}

/// The members that are published.
fn published() -> Vec<(PathBuf, String)> {
    let published: Vec<_> =
        members().into_iter().filter(|(_, manifest)| !has_line(manifest, "publish = false")).collect();
    assert!(published.len() > 5, "found {} published packages", published.len());
    published
}

#[test]
fn packages_carry_the_licenses() {
    for (folder, _) in published() {
        for name in LICENSES {
            let here = folder.join(name);
            // A link is not packed as a file by every system.
            assert!(!here.is_symlink(), "{} is a link, expected a file", here.display());
            let is_equal = read(&here) == read(&repository().join(name));
            assert!(is_equal, "{} differs from the root's", here.display());
        }
    }
}

#[test]
fn packages_say_what_they_are() {
    for (folder, manifest) in published() {
        for field in FIELDS {
            assert!(has_line(&manifest, field), "{}/Cargo.toml lacks `{field}`", folder.display());
        }
        let readme = read(&folder.join("README.md"));
        let lines = readme.lines().count();
        assert!(README_LINES.contains(&lines), "{}/README.md has {lines} lines", folder.display());
        assert!(
            readme.contains("bevy_stylegaussian"),
            "{}/README.md does not name the plugin",
            folder.display()
        );
    }
}

/// Trained files come with a notice of what they were trained on.
#[test]
fn networks_come_with_a_notice() {
    let notice = read(&repository().join("crates/stylegaussian_defaults/NOTICE"));
    for name in
        ["distilled_relu3_1.encoder.safetensors", "default.decoder.safetensors", "CC BY 4.0", "public domain"]
    {
        assert!(notice.contains(name), "the notice does not mention {name}");
    }
    let files = notice.split_whitespace().map(|word| word.trim_end_matches([',', '.', ';', ':']));
    for file in files.filter(|word| word.starts_with("assets/") || word.starts_with("docs/")) {
        assert!(repository().join(file).is_file(), "the notice names {file}, which does not exist");
    }
}

/// Whoever asks where a painting came from finds a line for it.
#[test]
fn each_painting_has_an_origin() {
    let table = read(&repository().join("assets/paintings.csv"));
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    for row in &rows {
        let is_full = row.len() == 4 && row.iter().all(|field| !field.is_empty());
        assert!(is_full, "expected a name, use, origin and license, found {row:?}");
    }
    for (list, purpose) in [("training_paintings", "training"), ("held_out_paintings", "evaluation")] {
        let names = read(&repository().join(format!("assets/{list}.txt")));
        let found: Vec<&str> = rows.iter().filter(|row| row[1] == purpose).map(|row| row[0]).collect();
        assert_eq!(found, names.lines().collect::<Vec<_>>(), "assets/paintings.csv differs from {list}.txt");
    }
}

/// A game that needs another version of the same package would not resolve.
#[test]
fn no_version_is_pinned() {
    let root = (repository().to_owned(), read(&repository().join("Cargo.toml")));
    for (folder, manifest) in members().into_iter().chain([root]) {
        for line in manifest.lines() {
            assert!(!line.contains("\"="), "{}/Cargo.toml pins a version: {line}", folder.display());
        }
    }
}

/// Makers of assets are for the few who change assets, and not for everyone who calls `cargo build`.
#[test]
fn plain_cargo_selects_the_workspace_package_alone() {
    let manifest = read(&repository().join("Cargo.toml"));
    assert!(has_line(&manifest, "default-members = [\".\"]"), "expected `.` alone in `default-members`");
}

/// Workspaces of their own (`examples/avian`, `examples/openxr`, `fuzz`) have lock files that no other build
/// reads. A dependency that a crate of ours gained or lost without them would stop `--locked` builds there.
#[test]
fn lock_files_of_other_workspaces_know_what_our_crates_need() {
    for lock in ["examples/avian/Cargo.lock", "examples/openxr/Cargo.lock", "fuzz/Cargo.lock"] {
        let text = read(&repository().join(lock));
        let packages: Vec<Locked> = text.split("[[package]]").skip(1).map(Locked::of).collect();
        let mut n_ours = 0;
        for (_, manifest) in members() {
            let name = manifest.lines().find_map(|line| line.strip_prefix("name = ")).unwrap();
            let Some(locked) = packages.iter().find(|it| it.name == name.trim_matches('"')) else { continue };
            n_ours += 1;
            for needed in needed(&manifest) {
                let is_known = locked.dependencies.contains(&needed);
                assert!(is_known, "{lock} does not know that {name} needs {needed}: call cargo there");
            }
            for listed in &locked.dependencies {
                let is_key = |line: &str| {
                    line.strip_prefix(listed).is_some_and(|rest| rest.starts_with(['.', ' ', '=']))
                };
                let is_needed = manifest.lines().any(is_key);
                assert!(is_needed, "{lock} says that {name} needs {listed}: call cargo there");
            }
        }
        assert!(n_ours > 3, "{lock} has {n_ours} of our crates");
    }
}

/// A package of a lock file.
struct Locked<'a> {
    name: &'a str,
    dependencies: Vec<&'a str>,
}

impl<'a> Locked<'a> {
    fn of(text: &'a str) -> Self {
        let name = text.lines().find_map(|line| line.strip_prefix("name = ")).unwrap().trim_matches('"');
        let listed = text.split_once("dependencies = [").map_or("", |(_, listed)| listed);
        let listed = listed.lines().map(|line| line.trim().trim_matches([',', '"'])).skip(1);
        // A version stands behind a name that several packages have.
        let dependencies = listed.take_while(|line| *line != "]");
        Self { name, dependencies: dependencies.filter_map(|line| line.split(' ').next()).collect() }
    }
}

/// The dependencies that a crate of this manifest has with any features and on any target.
fn needed(manifest: &str) -> impl Iterator<Item = &str> {
    let mut is_within = false;
    let lines = manifest.lines().filter(move |line| {
        if line.starts_with('[') {
            is_within = line.ends_with("dependencies]") && !line.contains("dev-");
        }
        is_within && !line.starts_with(['[', '#']) && !line.contains("optional = true")
    });
    lines
        .filter_map(|line| line.split_once(['.', ' ', '=']).map(|(name, _)| name))
        .filter(|name| !name.is_empty())
}
