//! The room of files: the model knows none, and a format of them does not open any.

use super::*;

/// The modules that open files, and the table of formats. A format is handed bytes, and knows none of them.
const BESIDE_FORMATS: [&str; 4] = ["atomic", "bytes", "formats", "scenes"];

/// Paths of the standard library that lead out of memory.
const OUTSIDE: [&str; 4] = ["fs", "io", "net", "path"];

/// Words of formats and of what they are packed in, in the names of a source.
const FORMAT_WORDS: [&str; 16] = [
    "checkpoint",
    "deflate",
    "glb",
    "gltf",
    "gzip",
    "json",
    "ksplat",
    "pickle",
    "ply",
    "pytorch",
    "safetensors",
    "sgs",
    "sog",
    "spz",
    "webp",
    "zstd",
];

/// The sources of a crate by module path, without their tests.
fn sources_of(folder: &str) -> BTreeMap<ModulePath, String> {
    let modules = modules_of(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder));
    assert!(!modules.is_empty(), "{folder} has no sources");
    let read = |(module, path): (ModulePath, PathBuf)| {
        let source = fs::read_to_string(path).unwrap();
        (module, without_tests(&source).to_owned())
    };
    modules.into_iter().map(read).collect()
}

/// The words of a name, in lower case: `PlyHeader`, `ply_header` and `PLY_HEADER` have the same two.
fn words(name: &str) -> BTreeSet<String> {
    let mut spaced = String::new();
    let mut is_within_word = false;
    for c in name.chars() {
        if c == '_' || (c.is_uppercase() && is_within_word) {
            spaced.push(' ');
        }
        spaced.extend(c.to_lowercase().filter(|&c| c != '_'));
        is_within_word = c.is_lowercase();
    }
    spaced.split_whitespace().map(String::from).collect()
}

/// The names of files and formats in a source. Comments and texts may name them.
fn file_words(source: &str) -> BTreeSet<String> {
    let tokens = tokens(source);
    let mut found = BTreeSet::new();
    for (at, token) in tokens.iter().enumerate() {
        found.extend(words(token).into_iter().filter(|word| FORMAT_WORDS.contains(&word.as_str())));
        if token == "std" {
            let mut paths = BTreeSet::new();
            tree_paths(&tokens, at, &[], &mut paths);
            let seconds = paths.iter().filter_map(|path| path.get(1));
            found.extend(seconds.filter(|name| OUTSIDE.contains(&name.as_str())).cloned());
        }
    }
    found
}

/// Its manifest names no crate of ours either: all of them are above it.
#[test]
fn the_model_knows_no_file() {
    let mut breaches = Vec::new();
    for (module, source) in sources_of(MODEL) {
        // Modules are named by their files too.
        let found = file_words(&format!("{} {source}", module.join(" ")));
        if !found.is_empty() {
            breaches.push(format!("{}: {found:?}", module.join("::")));
        }
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/stylegaussian/Cargo.toml");
    for line in fs::read_to_string(manifest).unwrap().lines() {
        assert!(!line.starts_with("stylegaussian_"), "the model depends on a crate of ours: {line}");
    }
}

#[test]
fn file_words_are_found_however_they_are_written() {
    for (source, word) in [
        ("use std::fs;", "fs"),
        ("use std::{collections::BTreeMap, io::{self, Write}};", "io"),
        ("fn f(at: &std::path::Path) {}", "path"),
        ("struct PlyHeader;", "ply"),
        ("fn to_spz() {}", "spz"),
        ("const MOST_SGS: usize = 1;", "sgs"),
        ("use safetensors::Dtype;", "safetensors"),
    ] {
        assert_eq!(file_words(source), BTreeSet::from([word.into()]), "{source}");
    }
    for source in [
        "/// The axes of `.ply` files.\nuse std::ops::Range;",
        "fn apply() { multiply(\"spz\") }",
        "use std::fmt::{self, Display};",
    ] {
        assert!(file_words(source).is_empty(), "{source}: {:?}", file_words(source));
    }
}

#[test]
fn a_format_is_handed_bytes_and_knows_no_table() {
    let lib = Path::new(env!("CARGO_MANIFEST_DIR")).join(FILES).join("lib.rs");
    let reexports = reexports(&fs::read_to_string(lib).unwrap());
    let sources = sources_of(FILES);
    let of = |module: &[String]| {
        let names: Vec<&str> = module.iter().map(String::as_str).collect();
        rooms(&sources[module], &names, &reexports)
    };
    // The table imports every format, and what a format is made of.
    let formats: Vec<String> = of(&["formats".into()])
        .into_iter()
        .filter(|room| !["error", "format"].contains(&&room[..]))
        .collect();
    assert!(formats.contains(&"ply".into()) && formats.len() > 5, "{formats:?}");
    let mut breaches = Vec::new();
    for module in sources.keys().filter(|module| module.first().is_some_and(|room| formats.contains(room))) {
        for found in of(module) {
            if BESIDE_FORMATS.contains(&found.as_str()) {
                breaches.push(format!("{} imports {found}", module.join("::")));
            }
        }
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
}
