//! The crates' layers: a crate depends on crates of lower layers alone. Manifests are read as text.

use super::*;

/// The order of ARCHITECTURE.md, from the bottom. Crates of one layer do not know of one another: files and
/// the GPU, the plugin and training. Bevy stands beside the plugin, so nothing below may depend on it.
const LAYERS: [&[&str]; 8] = [
    &["stylegaussian", "stylegaussian_defaults", "demo_paintings", "xtask"],
    &["stylegaussian_shaders"],
    &["stylegaussian_files", "stylegaussian_gpu"],
    &["stylegaussian_encoder", "demo_world"],
    &["stylegaussian_bake", "bevy"],
    &["bevy_stylegaussian", "stylegaussian_train"],
    &["stylegaussian_app", "stylegaussian_cli", "stylegaussian_bench"],
    &["stylegaussian_web"],
];

/// The layer of a crate, or `None` of a crate that is not listed. Parts of Bevy are in Bevy's.
fn layer_of(name: &str) -> Option<usize> {
    let of = |name: &str| LAYERS.iter().position(|layer| layer.contains(&name));
    of(name).or_else(|| if name.starts_with("bevy_") { of("bevy") } else { None })
}

/// The name of a package, the first of its manifest.
fn name_of(manifest: &str) -> Option<&str> {
    manifest.lines().find_map(|line| line.strip_prefix("name = \"")?.strip_suffix('"'))
}

/// Dependencies of a manifest, on any system. Those of tests and build scripts do not count.
fn dependencies_of(manifest: &str) -> BTreeSet<&str> {
    let mut names: BTreeSet<&str> = BTreeSet::new();
    let mut is_inside = false;
    for line in manifest.lines() {
        if let Some(header) = line.strip_prefix('[') {
            let header = header.trim_end_matches(']');
            let is_of_system = header.starts_with("target.") && header.ends_with(".dependencies");
            is_inside = header == "dependencies" || is_of_system;
            // A dependency may have a table of its own.
            names.extend(header.strip_prefix("dependencies."));
        } else if is_inside && line.starts_with(|c: char| c.is_alphanumeric()) {
            names.extend(line.split(['.', ' ', '=']).next());
        }
    }
    names
}

#[test]
fn crates_depend_on_lower_layers_alone() {
    let mut breaches = Vec::new();
    let mut found = BTreeSet::from(["bevy".to_owned()]);
    for folder in crate_folders() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder).join("Cargo.toml");
        let manifest = fs::read_to_string(&path).unwrap();
        let name = name_of(&manifest).unwrap_or_else(|| panic!("{} has no name", path.display()));
        let layer = layer_of(name).unwrap_or_else(|| panic!("{name} is in no layer"));
        for dependency in dependencies_of(&manifest) {
            if layer_of(dependency).is_some_and(|other| other >= layer) {
                breaches.push(format!("{name} depends on {dependency}, which is not in a lower layer"));
            }
            if dependency == "burn" && name != "stylegaussian_train" {
                breaches.push(format!("{name} depends on a training framework"));
            }
        }
        found.insert(name.to_owned());
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
    // A name that is written wrongly would let all pass.
    let listed: BTreeSet<String> =
        LAYERS.iter().flat_map(|layer| layer.iter().map(ToString::to_string)).collect();
    assert_eq!(found, listed);
}

#[test]
fn dependencies_are_found_however_they_are_written() {
    let manifest = r#"[package]
name = "made_up"

[[bin]]
name = "other"

[dependencies]
a.workspace = true
b = { version = "1", features = [
    "inner",
] }
# no = "1"

[target.'cfg(not(target_family = "wasm"))'.dependencies]
c = "1"

[target.'cfg(unix)'.dev-dependencies]
d = "1"

[dev-dependencies]
e = "1"

[dependencies.f]
path = "g"
"#;
    assert_eq!(name_of(manifest), Some("made_up"));
    assert_eq!(dependencies_of(manifest), BTreeSet::from(["a", "b", "c", "f"]));
}
