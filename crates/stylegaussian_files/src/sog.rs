//! SOG scenes of PlayCanvas: codes in lossless WebP images, and `meta.json`, which says what the codes mean.
//!
//! A scene is a folder, named by its `meta.json`; a zip archive of it, `.sog`; or chunks of several levels of
//! detail, named by `lod-meta.json`. The layouts are documented at <https://developer.playcanvas.com> (formats,
//! SOG). The coordinates are those of the `.ply` that a scene was made from, whatever that page says: decoded
//! captures match their `.ply` Gaussian by Gaussian.

use std::{borrow::Cow, ops::Range};

use serde::{Deserialize, de::IgnoredAny};
use stylegaussian::{
    axes::Axes,
    scene::{Scene, ScreenFilter, Sh},
    sh,
    work::Work,
};

use super::{
    activate::drop_if,
    archive::{Archive, is_zip},
    check::fault_of_place,
    error::{Loaded, Mismatch, mismatch},
    files::{Files, Unread},
    format::{Format, ReadOptions},
    json::without_mark,
    pages::enlarge,
    world::{self, World},
};

mod chunk;
mod levels;
mod meta;
mod palette;
mod plane;
mod write;

use chunk::{Chunk, Gaussians};
use meta::Meta;
pub(super) use write::files as chunk_files;

/// The name of the metadata in a folder or an archive.
pub(super) const META: &str = "meta.json";

/// The name of the levels of detail in a folder.
pub(super) const LEVELS: &str = world::FILE;

/// The format, bundled. It is read in any shape.
pub(super) const FORMAT: Format =
    Format { name: "SOG", extensions: &["sog"], recognizes, read, write: Some(write::write) };

/// The format as a folder, and streamed.
pub(super) const JSON: Format =
    Format { name: "SOG's meta.json", extensions: &["json"], recognizes, read, write: None };

/// The keys that distinguish SOG's JSON from other JSON.
#[derive(Deserialize)]
struct Keys {
    means: Option<IgnoredAny>,
    #[serde(rename = "lodLevels")]
    levels: Option<IgnoredAny>,
}

fn recognizes(bytes: &[u8], extension: &str) -> bool {
    if is_zip(bytes) {
        // Others are checkpoints of PyTorch.
        return extension == "sog"
            || Archive::open(bytes).is_ok_and(|archive| !folders_of(&archive).is_empty());
    }
    let bytes = without_mark(bytes);
    let is_json = bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{');
    let has_keys = |keys: Keys| keys.means.is_some() || keys.levels.is_some();
    is_json && (extension == "json" || serde_json::from_slice(bytes).is_ok_and(has_keys))
}

/// The folders of an archive that hold metadata, those that are not within another, with the separator at their
/// ends. In most archives that is one, empty, or the name of the scene if a folder was packed as a whole.
fn folders_of<'a>(archive: &Archive<'a>) -> Vec<&'a str> {
    if archive.has(META) {
        return vec![""];
    }
    // Old programs for Windows separate by a backslash. Those for macOS add a folder of their own.
    let folder = |name: &'a str| name.strip_suffix(META).filter(|folder| is_folder(folder));
    let depth = |folder: &str| folder.matches(['/', '\\']).count();
    let mut folders: Vec<&str> =
        archive.names().filter_map(folder).filter(|folder| !folder.starts_with("__MACOSX")).collect();
    let least = folders.iter().map(|folder| depth(folder)).min();
    folders.retain(|folder| Some(depth(folder)) == least);
    folders
}

/// Whether a name ends before the name of a file in its folder.
fn is_folder(name: &str) -> bool {
    name.is_empty() || name.ends_with(['/', '\\'])
}

fn read(files: &mut Files, options: &ReadOptions) -> Result<Loaded, Unread> {
    let mut warnings = Vec::new();
    let mut parts = parts(files, options, &mut warnings)?;
    let is_world = parts.iter().any(|part| !part.name.is_empty());
    // All planes are asked for at once.
    let names: Vec<String> = parts.iter().flat_map(Part::files).collect();
    files.others(&names)?;
    let mut planes = Vec::with_capacity(parts.len());
    for part in &mut parts {
        planes.push(part.planes(files)?);
    }
    let mut chunks = Vec::with_capacity(parts.len());
    for (part, planes) in parts.into_iter().zip(&planes) {
        let Part { name, meta, ranges, .. } = part;
        let planes: Vec<&[u8]> = planes.iter().map(|bytes| &bytes[..]).collect();
        let chunk = Chunk::open(meta, &planes).map_err(|mismatch| within(&name, mismatch))?;
        let whole = 0..chunk.count();
        let ranges = ranges.unwrap_or_else(|| Vec::from([whole]));
        if let Some(last) = ranges.last().filter(|last| last.end > chunk.count()) {
            let found = format_args!("Gaussians up to {} of `{name}` in the tree", last.end).to_string();
            return Err(mismatch(found, format_args!("{} at most", chunk.count())).into());
        }
        chunks.push((name, chunk, ranges));
    }
    let scene = scene(chunks, &mut warnings, &files.work)?;
    files.work.at(0.95)?;
    // Tables of other values are finite.
    let mut scene = drop_if(scene, fault_of_place, &mut warnings);
    let (axes, because) = match options.axes {
        Some(axes) => (axes, "they were asked for"),
        None => (Axes::RDF, "SOG keeps the coordinates of the .ply that it was made from"),
    };
    // In the axes of the file, which are turned below.
    scene.up = is_world.then(|| world::UP * axes.signs());
    Ok(Loaded::turned(scene, warnings, axes, because))
}

/// The Gaussians of all chunks, each with the ranges that are wanted of it.
fn scene(
    chunks: Vec<(String, Chunk, Vec<Range<usize>>)>,
    warnings: &mut Vec<String>,
    work: &Work,
) -> Result<Scene, Mismatch> {
    let n: usize = chunks.iter().flat_map(|(_, _, ranges)| ranges).map(Range::len).sum();
    if u32::try_from(n).is_err() {
        return Err(mismatch(format_args!("{n} Gaussians"), "fewer than 2^32"));
    }
    let degree = chunks.iter().map(|(_, chunk, _)| chunk.degree).max().unwrap_or(0);
    let mut scene = Scene {
        means: Vec::with_capacity(n),
        rotations: Vec::with_capacity(n),
        scales: Vec::with_capacity(n),
        opacities: Vec::with_capacity(n),
        sh: Some(Sh { degree, coefficients: vec![0.0; 3 * sh::n_coefficients(degree) * n] }),
        order: (0..n as u32).collect(),
        n_source: n,
        filter: filter(&chunks, warnings),
        ..Scene::default()
    };
    enlarge(&mut scene.means);
    enlarge(&mut scene.rotations);
    enlarge(&mut scene.scales);
    enlarge(&mut scene.opacities);
    scene.sh.iter_mut().for_each(|sh| enlarge(&mut sh.coefficients));
    let mut n_untagged = 0;
    let (n_chunks, mut n_decoded) = (chunks.len().max(1) as f32, 0.0);
    let mut chunks = chunks.into_iter();
    let mut decoded: Option<(Gaussians, Vec<Range<usize>>)> = None;
    loop {
        work.at(0.9 * n_decoded / n_chunks)?;
        n_decoded += 1.0;
        // While a chunk is appended the next one is decoded. The planes of others need not be in memory.
        let append = || {
            let (gaussians, ranges) = decoded.take()?;
            Some(ranges.into_iter().map(|range| gaussians.append(range, &mut scene)).sum::<usize>())
        };
        let next = chunks.next();
        let decode = || {
            next.map(|(name, chunk, ranges)| match chunk.decode(work) {
                Ok(gaussians) => Ok((gaussians, ranges)),
                Err(mismatch) => Err(within(&name, mismatch)),
            })
        };
        let (n, next) = rayon::join(append, decode);
        n_untagged += n.unwrap_or(0);
        decoded = next.transpose()?;
        if decoded.is_none() {
            break;
        }
    }
    if n_untagged > 0 {
        warnings.push(format!("{n_untagged} of {n} Gaussians have no valid rotation, and got none"));
    }
    Ok(scene)
}

/// The filter of all chunks.
fn filter(chunks: &[(String, Chunk, Vec<Range<usize>>)], warnings: &mut Vec<String>) -> ScreenFilter {
    let mut filters = chunks.iter().map(|(_, chunk, _)| chunk.meta().filter);
    let first = filters.next().unwrap_or_default();
    if filters.all(|filter| filter == first) {
        return first;
    }
    warnings.push("only some parts are tagged as antialiased: all are drawn as those that are not".into());
    ScreenFilter::Classic
}

/// A mismatch within one of several files.
fn within(name: &str, mismatch: Mismatch) -> Mismatch {
    if name.is_empty() {
        return mismatch;
    }
    Mismatch { found: format!("`{name}` with {}", mismatch.found), ..mismatch }
}

/// A set of planes that a scene consists of.
struct Part<'a> {
    /// The path of the metadata, empty for the file that was named itself.
    name: String,
    /// The archive that holds the planes, or `None` if they lie beside the metadata.
    archive: Option<Archive<'a>>,
    meta: Meta,
    /// The Gaussians that are wanted, or `None` for all.
    ranges: Option<Vec<Range<usize>>>,
}

impl<'a> Part<'a> {
    /// Reads the metadata in `bytes`, an archive or JSON.
    fn open(
        name: &str,
        bytes: &'a [u8],
        ranges: Option<Vec<Range<usize>>>,
        warnings: &mut Vec<String>,
    ) -> Result<Self, Mismatch> {
        let mut archive = is_zip(bytes).then(|| Archive::open(bytes)).transpose()?;
        let folder = match archive.as_ref().map(folders_of).unwrap_or_default()[..] {
            [first, second, ..] => {
                let [first, second] = [first, second].map(str::escape_debug);
                return Err(mismatch(
                    format_args!("a zip archive with `{first}{META}` and `{second}{META}`"),
                    "the files of one scene",
                ));
            }
            [folder] => folder,
            // An archive without the metadata is refused by the name of the file that is missing.
            [] => "",
        };
        let json = match &mut archive {
            Some(archive) => archive.unpack(&format!("{folder}{META}"))?,
            None => Cow::Borrowed(bytes),
        };
        let mut meta = Meta::parse(&json, warnings).map_err(|mismatch| within(name, mismatch))?;
        meta.planes.iter_mut().for_each(|plane| plane.insert_str(0, folder));
        Ok(Self { name: name.into(), archive, meta, ranges })
    }

    /// The paths of the planes that lie beside the metadata.
    fn files(&self) -> Vec<String> {
        if self.archive.is_some() {
            return Vec::new();
        }
        let folder = self.name.rfind('/').map_or("", |end| &self.name[..=end]);
        self.meta.planes.iter().map(|plane| format!("{folder}{plane}")).collect()
    }

    /// The planes' bytes.
    fn planes(&mut self, files: &'a Files) -> Result<Vec<Cow<'a, [u8]>>, Unread> {
        match &mut self.archive {
            None => Ok(files.others(&self.files())?.into_iter().map(Cow::Borrowed).collect()),
            Some(archive) => {
                let unpacked: Result<_, Mismatch> =
                    self.meta.planes.iter().map(|plane| archive.unpack(plane)).collect();
                Ok(unpacked.map_err(|mismatch| within(&self.name, mismatch))?)
            }
        }
    }
}

/// The sets of planes that are wanted: one, or the chunks of the levels of detail that fit the budget.
fn parts<'a>(
    files: &'a Files,
    options: &ReadOptions,
    warnings: &mut Vec<String>,
) -> Result<Vec<Part<'a>>, Unread> {
    let keys: Option<Keys> =
        if is_zip(&files.main) { None } else { serde_json::from_slice(without_mark(&files.main)).ok() };
    if keys.is_none_or(|keys| keys.levels.is_none()) {
        return Ok(vec![Part::open("", &files.main, None, warnings)?]);
    }
    let world = World::read_runs(&files.main)?;
    let mut parts = Vec::new();
    let mut budget = options.budget;
    if let Some(path) = &world.environment {
        let bytes = files.others(std::slice::from_ref(path))?;
        let environment = Part::open(path, bytes[0], None, warnings)?;
        let n = environment.meta.count;
        match budget.map(|budget| budget.checked_sub(n)) {
            Some(None) => {
                warnings.push(format!("left out the environment: its {n} Gaussians exceed the budget"))
            }
            rest => {
                budget = rest.flatten();
                parts.push(environment);
            }
        }
    }
    let chosen = levels::choose(&world, budget, warnings);
    let paths: Vec<String> = chosen.keys().map(|&file| world.files[file].clone()).collect();
    let metadata = files.others(&paths)?;
    for ((path, bytes), ranges) in paths.iter().zip(metadata).zip(chosen.into_values()) {
        parts.push(Part::open(path, bytes, Some(ranges), warnings)?);
    }
    // The environment comes last: whoever looks at the first Gaussians sees the scene.
    let n_environments = parts.len() - paths.len();
    parts.rotate_left(n_environments);
    Ok(parts)
}

#[cfg(test)]
mod tests;
