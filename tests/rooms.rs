//! The rooms of the crates: which module may import which, and how large a circle of imports may be. Sources
//! are read as text, so the rules need no build.
//!
//! ARCHITECTURE.md has the reasons. In short: styling and drawing do not know of one another, they meet in the
//! colors.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

#[path = "rooms/files.rs"]
mod files;
#[path = "rooms/layers.rs"]
mod layers;

/// A room must not import another.
struct Wall {
    /// Folder of the crate's sources, relative to the repository.
    sources: &'static str,
    /// The module that imports.
    room: &'static str,
    /// The modules that it must not import.
    forbidden: &'static [&'static str],
}

const PLUGIN: &str = "crates/bevy_stylegaussian/src";
const GPU: &str = "crates/stylegaussian_gpu/src";
const MODEL: &str = "crates/stylegaussian/src";
const FILES: &str = "crates/stylegaussian_files/src";

/// In the plugin: `style` and `splats` stand on `colors`, and that stands on `scene`. In the GPU crate, the two
/// passes meet in `colors`, and strokes know of neither. In the model crate, the rasterizer knows no decoder
/// and the decoder no rasterizer.
const WALLS: [Wall; 15] = [
    Wall { sources: PLUGIN, room: "style", forbidden: &["splats", "meshes", "world"] },
    Wall { sources: PLUGIN, room: "meshes", forbidden: &["colors", "mask", "splats", "world"] },
    Wall { sources: PLUGIN, room: "world", forbidden: &["mask", "picking", "meshes"] },
    Wall { sources: PLUGIN, room: "splats", forbidden: &["style", "world"] },
    Wall { sources: PLUGIN, room: "colors", forbidden: &["style", "splats", "world"] },
    Wall { sources: PLUGIN, room: "scene", forbidden: &["colors", "mask", "style", "splats", "world"] },
    Wall { sources: PLUGIN, room: "mask", forbidden: &["colors", "style", "splats"] },
    Wall { sources: PLUGIN, room: "picking", forbidden: &["colors", "style", "splats"] },
    Wall { sources: GPU, room: "style", forbidden: &["splat"] },
    Wall { sources: GPU, room: "splat", forbidden: &["style"] },
    Wall { sources: GPU, room: "strokes", forbidden: &["style", "splat", "layers"] },
    Wall { sources: MODEL, room: "splat", forbidden: &["decoder", "fold", "statistics"] },
    Wall { sources: MODEL, room: "decoder", forbidden: &["splat"] },
    Wall { sources: MODEL, room: "fold", forbidden: &["splat"] },
    Wall { sources: MODEL, room: "statistics", forbidden: &["splat"] },
];

/// A path inside of the crate, from its root: `["scene", "GpuScenes"]`.
type ModulePath = Vec<String>;

/// All paths into the crate that a source file names, by `crate::` or `super::`, in imports and in expressions.
///
/// `module` is the path of the file's module. Modules inside of the file are not followed, so a `super::` in
/// one of them counts from the file's module.
fn crate_paths(source: &str, module: &[&str]) -> BTreeSet<ModulePath> {
    let tokens = tokens(source);
    let mut paths = BTreeSet::new();
    let mut at = 0;
    while at < tokens.len() {
        let mut root: Vec<String> = module.iter().map(ToString::to_string).collect();
        let start = at;
        // The reach of a visibility, as in `pub(in crate::splats)`, is no import.
        let is_visibility = at > 0 && tokens[at - 1] == "in";
        while tokens[at..].starts_with(&["super".into(), "::".into()]) {
            root.pop();
            at += 2;
        }
        if tokens[at..].starts_with(&["crate".into(), "::".into()]) {
            root.clear();
            at += 2;
        }
        if at > start && !is_visibility {
            at = tree_paths(&tokens, at, &root, &mut paths);
        } else {
            // Not a path, or one that is passed over: at least one token further, so that the loop ends.
            at = at.max(start + 1);
        }
    }
    paths
}

/// Adds the paths of the use tree that begins at token `at`, and returns the token after it.
fn tree_paths(tokens: &[String], mut at: usize, root: &[String], paths: &mut BTreeSet<ModulePath>) -> usize {
    let mut path = root.to_vec();
    while let Some(token) = tokens.get(at) {
        if token == "{" {
            at += 1;
            while tokens.get(at).is_some_and(|token| token != "}") {
                at =
                    // Broken source must not stop the loop either.
                    if tokens[at] == "," { at + 1 } else { tree_paths(tokens, at, &path, paths).max(at + 1) };
            }
            return at + 1;
        }
        path.push(token.clone());
        at += 1;
        if tokens.get(at).is_none_or(|token| token != "::") {
            break;
        }
        at += 1;
    }
    // A renamed import (`as name`) ends here; its name is no path.
    if tokens.get(at).is_some_and(|token| token == "as") {
        at += 2;
    }
    paths.insert(path);
    at
}

/// Words, `::` and single other characters of a source, without comments and strings.
fn tokens(source: &str) -> Vec<String> {
    let mut tokens: Vec<String> = Vec::new();
    let mut rest = source;
    while let Some(first) = rest.chars().next() {
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |end| end + 2)
        } else if rest.starts_with("'\"'") {
            // The one character literal that would look like the start of a string. Lifetimes need no care:
            // their names are words.
            3
        } else if rest.starts_with("r#\"") {
            rest.find("\"#").map_or(rest.len(), |end| end + 2)
        } else if first == '"' {
            string_length(rest)
        } else if first.is_alphanumeric() || first == '_' {
            let length = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            tokens.push(rest[..length].into());
            length
        } else if rest.starts_with("::") {
            tokens.push("::".into());
            2
        } else {
            if !first.is_whitespace() {
                tokens.push(first.into());
            }
            first.len_utf8()
        };
        rest = &rest[length..];
    }
    tokens
}

/// Length of the string literal that `rest` begins with, quotes included.
fn string_length(rest: &str) -> usize {
    let mut is_escaped = false;
    for (i, c) in rest.char_indices().skip(1) {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return i + 1,
            _ => {}
        }
    }
    rest.len()
}

/// Names that the crate's root takes from its modules: `pub use scene::{A, B}` gives `A` and `B` of `scene`.
fn reexports(lib: &str) -> Vec<(String, String)> {
    let tokens = tokens(lib);
    let mut paths = BTreeSet::new();
    for at in 0..tokens.len() {
        if tokens[at] == "use" {
            tree_paths(&tokens, at + 1, &[], &mut paths);
        }
    }
    // A `use crate::` in it, as in a prelude, takes from the root itself.
    let pairs = paths.iter().filter(|path| path.len() > 1 && path[0] != "crate");
    pairs.map(|path| (path[path.len() - 1].clone(), path[0].clone())).collect()
}

/// The rooms that a source file names, through the root's names too.
fn rooms(source: &str, module: &[&str], reexports: &[(String, String)]) -> BTreeSet<String> {
    let mut rooms = BTreeSet::new();
    for path in crate_paths(source, module) {
        let Some(first) = path.first() else { continue };
        let of_root = reexports.iter().find(|(name, _)| name == first);
        rooms.insert(of_root.map_or(first, |(_, room)| room).clone());
    }
    rooms
}

/// All files of a module: `room.rs` and everything in `room/`, each with its module path.
fn files_of(sources: &Path, room: &str) -> Vec<(PathBuf, Vec<String>)> {
    let mut files = Vec::new();
    let file = sources.join(format!("{room}.rs"));
    if file.exists() {
        files.push((file, vec![room.to_owned()]));
    }
    let mut folders = vec![(sources.join(room), vec![room.to_owned()])];
    while let Some((folder, module)) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let mut inner = module.clone();
            if stem != "mod" {
                inner.push(stem);
            }
            if path.is_dir() {
                folders.push((path, inner));
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push((path, inner));
            }
        }
    }
    files
}

#[test]
fn no_room_imports_one_beside_or_above_it() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut breaches = Vec::new();
    for Wall { sources, room, forbidden } in WALLS {
        let sources = repository.join(sources);
        let reexports = reexports(&fs::read_to_string(sources.join("lib.rs")).unwrap());
        let files = files_of(&sources, room);
        assert!(!files.is_empty(), "{} has no module {room}", sources.display());
        for (path, module) in files {
            let module: Vec<&str> = module.iter().map(String::as_str).collect();
            let source = fs::read_to_string(&path).unwrap();
            for found in rooms(&source, &module, &reexports) {
                if forbidden.contains(&found.as_str()) {
                    breaches.push(format!("{} imports {found}", path.display()));
                }
            }
        }
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
}

/// A made-up file `src/style/job.rs` that breaks the rule in every way there is.
#[test]
fn imports_are_found_however_they_are_written() {
    let reexports = reexports(
        "mod splats;\npub use splats::{view::SplatView, SplatSortKey};\npub use glam;\n\
         mod prelude { pub use crate::SplatSortKey; }",
    );
    let found = |source: &str| rooms(source, &["style", "job"], &reexports);
    for source in [
        "use crate::splats::pass;",
        "use crate::splats;",
        "use crate::{colors::ColorWish, splats::{SplatView, pass::*}};",
        "use crate::{\n    colors::{self, ColorWish},\n    splats,\n};",
        "pub(crate) use crate :: splats::SplatView as View;",
        "use super::super::splats::SplatView;",
        "use crate::SplatSortKey;",
        "use crate::{SplatView, scene::LoadedScene};",
        "fn f(view: &crate::splats::SplatView) {}",
    ] {
        assert!(found(source).contains("splats"), "{source}: {:?}", found(source));
    }
    for source in [
        "// use crate::splats::pass;",
        "/// See [`crate::splats`].\nuse crate::colors::ColorWish;",
        "/* use crate::splats; */ fn f() { panic!(\"crate::splats\"); }",
        "use super::splats::pass;",
        "use stylegaussian_gpu::splats;",
        "use crate::colors::splats;",
        "pub(in crate::splats) fn f() {}",
        "use crate::scene::{LoadedScene as splats, GpuScenes};",
        "const QUOTE: char = '\"'; const RAW: &str = r#\"use crate::splats;\"#;",
    ] {
        assert!(!found(source).contains("splats"), "{source}: {:?}", found(source));
    }
    // `super` in `style/mod.rs` is the root, in `style/job.rs` it is `style`.
    let source = "use crate::{colors::{A, b::{C, D}}, scene::E};\nuse super::event::F;";
    let names = |names: [&str; 3]| BTreeSet::from(names.map(String::from));
    assert_eq!(rooms(source, &["style"], &[]), names(["colors", "scene", "event"]));
    assert_eq!(found(source), names(["colors", "scene", "style"]));
}

/// The names of a crate's root: its public modules, and what it takes from modules and from other crates.
fn root_names(lib: &str) -> BTreeSet<String> {
    let tokens = tokens(lib);
    let mut paths = BTreeSet::new();
    for at in 1..tokens.len() {
        if tokens[at - 1] == "pub" && ["use", "mod"].contains(&tokens[at].as_str()) {
            tree_paths(&tokens, at + 1, &[], &mut paths);
        }
    }
    // A prelude may repeat the root.
    paths.into_iter().filter(|path| path[0] != "crate").filter_map(|mut path| path.pop()).collect()
}

/// More names than one reads before one uses the plugin belong in modules.
#[test]
fn the_root_of_the_plugin_has_few_names() {
    let lib = Path::new(env!("CARGO_MANIFEST_DIR")).join(PLUGIN).join("lib.rs");
    let names = root_names(&fs::read_to_string(lib).unwrap());
    assert!(names.contains("StyleGaussianPlugin") && names.contains("prelude"), "{names:?}");
    assert!(names.len() <= 30, "{} names: {names:?}", names.len());
}

/// The most files that may import one another in a circle. Two or three are a module and its parts; more is a
/// room whose parts cannot be read alone.
const LARGEST_CIRCLE: usize = 3;

/// The folders of all crates, relative to the repository.
fn crate_folders() -> Vec<PathBuf> {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    let entries = fs::read_dir(repository.join("crates")).unwrap();
    let names = entries.map(|entry| Path::new("crates").join(entry.unwrap().file_name()));
    let is_crate = |folder: &PathBuf| repository.join(folder).join("Cargo.toml").is_file();
    names.chain([PathBuf::from("shaders")]).filter(is_crate).collect()
}

/// Paths that a file names relative to itself: those that begin with one of its own modules, as in
/// `pub use wish::Wish`.
fn child_paths(source: &str, module: &[&str]) -> BTreeSet<ModulePath> {
    let tokens = tokens(source);
    let children: BTreeSet<&String> = tokens
        .windows(3)
        .filter(|window| window[0] == "mod" && window[2] == ";")
        .map(|window| &window[1])
        .collect();
    let root: Vec<String> = module.iter().map(ToString::to_string).collect();
    let mut paths = BTreeSet::new();
    for at in 0..tokens.len() {
        let is_path = tokens.get(at + 1).is_some_and(|token| token == "::");
        let begins = at == 0 || tokens[at - 1] != "::";
        if is_path && begins && children.contains(&tokens[at]) {
            tree_paths(&tokens, at, &root, &mut paths);
        }
    }
    paths
}

/// The files of a crate by module path, tests left out: they may look at everything.
fn modules_of(sources: &Path) -> BTreeMap<ModulePath, PathBuf> {
    let mut modules = BTreeMap::new();
    let mut folders = vec![(sources.to_owned(), Vec::new())];
    while let Some((folder, module)) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let mut inner = module.clone();
            if !["mod", "lib", "main"].contains(&stem.as_str()) {
                inner.push(stem.clone());
            }
            if stem == "tests" || stem == "testing" {
                continue;
            } else if path.is_dir() {
                folders.push((path, inner));
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                modules.insert(inner, path);
            }
        }
    }
    modules
}

/// A source up to its inline tests, which may import what the file itself must not. A declaration `mod tests;`
/// is no end.
fn without_tests(source: &str) -> &str {
    const MARK: &str = "#[cfg(test)]\nmod ";
    let is_inline = |&(at, _): &(usize, &str)| {
        let name = source[at + MARK.len()..].trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
        name.starts_with(" {")
    };
    source.match_indices(MARK).find(is_inline).map_or(source, |(at, _)| &source[..at])
}

/// For each module the modules that it imports.
fn imports_of(sources: &BTreeMap<ModulePath, String>) -> BTreeMap<ModulePath, BTreeSet<ModulePath>> {
    let file_of = |path: &ModulePath| {
        // The longest first: `scene::gpu::GpuScenes` is in the file of `scene::gpu`, not of `scene`.
        let prefixes = (1..=path.len()).rev().map(|n| path[..n].to_vec());
        prefixes.into_iter().find(|prefix| sources.contains_key(prefix))
    };
    let imports = |(module, source): (&ModulePath, &String)| {
        let source = without_tests(source);
        let names: Vec<&str> = module.iter().map(String::as_str).collect();
        let mut paths = crate_paths(source, &names);
        paths.extend(child_paths(source, &names));
        let files = paths.iter().filter_map(file_of).filter(|file| file != module);
        (module.clone(), files.collect())
    };
    sources.iter().map(imports).collect()
}

/// The modules that can be reached from `start` by imports.
fn reachable(
    start: &ModulePath,
    imports: &BTreeMap<ModulePath, BTreeSet<ModulePath>>,
) -> BTreeSet<ModulePath> {
    let mut found = BTreeSet::new();
    let mut next = vec![start];
    while let Some(module) = next.pop() {
        for import in imports.get(module).into_iter().flatten() {
            if found.insert(import.clone()) {
                next.push(import);
            }
        }
    }
    found
}

/// Groups of modules that import one another, directly or through others.
fn circles(imports: &BTreeMap<ModulePath, BTreeSet<ModulePath>>) -> BTreeSet<BTreeSet<ModulePath>> {
    let reach: BTreeMap<&ModulePath, BTreeSet<ModulePath>> =
        imports.keys().map(|module| (module, reachable(module, imports))).collect();
    let circle = |(module, reached): (&&ModulePath, &BTreeSet<ModulePath>)| -> BTreeSet<ModulePath> {
        reached
            .iter()
            .filter(|other| reach.get(other).is_some_and(|back| back.contains(*module)))
            .cloned()
            .collect()
    };
    reach.iter().map(circle).filter(|circle| circle.len() > 1).collect()
}

#[test]
fn no_circle_of_imports_is_large() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut large = Vec::new();
    for folder in crate_folders() {
        let modules = modules_of(&repository.join(&folder).join("src"));
        let folder = folder.display();
        assert!(!modules.is_empty(), "{folder} has no sources");
        let read =
            |(module, path): (&ModulePath, &PathBuf)| (module.clone(), fs::read_to_string(path).unwrap());
        let imports = imports_of(&modules.iter().map(read).collect());
        for circle in circles(&imports) {
            let names: Vec<String> = circle.iter().map(|module| module.join("::")).collect();
            println!("{folder}: {}", names.join(", "));
            if circle.len() > LARGEST_CIRCLE {
                large.push(format!(
                    "{folder}: {} files import one another: {}",
                    circle.len(),
                    names.join(", ")
                ));
            }
        }
    }
    assert!(large.is_empty(), "{}", large.join("\n"));
}

/// A made-up crate in which `a` imports its part `a::b`, that imports `c`, and that imports `a`.
#[test]
fn a_circle_is_found_through_parts_and_parents() {
    let path = |text: &str| -> ModulePath { text.split("::").map(String::from).collect() };
    let sources = |c: &str| {
        BTreeMap::from([
            (path("a"), "#[cfg(test)]\nmod tests;\nmod b;\npub use b::B;".to_owned()),
            (path("a::b"), "use crate::{c::C, d};".to_owned()),
            (path("c"), c.to_owned()),
            (path("d"), "#[cfg(test)]\nmod tests {\n    use crate::a::B;\n}".to_owned()),
        ])
    };
    let found = circles(&imports_of(&sources("use super::a::B;")));
    assert_eq!(found, BTreeSet::from([BTreeSet::from(["a", "a::b", "c"].map(path))]));
    assert!(circles(&imports_of(&sources("use crate::d::D;"))).is_empty());
}
