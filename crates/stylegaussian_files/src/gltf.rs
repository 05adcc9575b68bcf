//! glTF with Gaussians: the ratified extension KHR_gaussian_splatting, in one file (`.glb`) or with buffers
//! beside it (`.gltf`).
//!
//! A primitive of points carries one accessor per property of its Gaussians. All such primitives of the scene
//! become one scene, each moved by its node; other primitives are left out. Bases of spherical harmonics are
//! those of 3DGS.
//!
//! Files of drafts keep logarithms in `SCALE`, and the compression draft `.._spz_2` keeps an SPZ file. Both are
//! read.

use glam::DAffine3;
use serde_json::Value;
use stylegaussian::axes::Axes;

use super::{
    activate::drop_broken,
    error::{Loaded, Mismatch, mismatch},
    files::{Files, Unread},
    format::{Format, ReadOptions},
    place,
    upright::laid_back,
};

mod accessor;
mod application;
mod base64;
mod color;
mod document;
mod merge;
mod nodes;
mod primitive;
mod write;

use document::{Document, MOST_MEMORY_PER_BYTE, item};
use primitive::{EXTENSION, Limits, SPZ_EXTENSION, Splats};

/// The format in one file.
pub(super) const GLB: Format = Format {
    name: "GLB with KHR_gaussian_splatting",
    extensions: &["glb"],
    recognizes: |bytes, _| bytes.starts_with(document::MAGIC),
    read,
    write: Some(|out, scene, options| write::write(out, scene, options).map(|()| Vec::new())),
};

/// The format as text, with buffers inside or beside it.
pub(super) const GLTF: Format = Format {
    name: "glTF with KHR_gaussian_splatting",
    extensions: &["gltf"],
    // Text without a mark.
    recognizes: |_, extension| extension == "gltf",
    read,
    write: None,
};

/// Reads all Gaussians.
fn read(files: &mut Files, options: &ReadOptions) -> Result<Loaded, Unread> {
    let mut document = Document::open(files)?;
    let json = document.json.clone();
    let mut warnings = Vec::new();
    warn_of_requirements(&json, &mut warnings);
    let found = splats(&json, &mut warnings)?;
    let are_logarithms = primitive::scales_are_logarithms(&document, &found)?;
    if are_logarithms {
        warnings.push("scales below 0: taken for logarithms, as drafts of the extension had them".into());
    }
    let mut memory_left = document.n_bytes().saturating_mul(MOST_MEMORY_PER_BYTE);
    let mut parts = Vec::with_capacity(found.len());
    let is_alone = found.len() == 1;
    for (splats, world_from_mesh) in &found {
        let limits = Limits { memory_left: &mut memory_left, is_last: is_alone };
        let mut part = splats.read(&mut document, are_logarithms, limits, &mut warnings)?;
        place::place(&mut part, *world_from_mesh, &mut warnings)?;
        parts.push(part);
    }
    let mut scene = merge::merge(parts);
    // The features of several primitives may be of several kinds.
    if let ([(splats, _)], true) = (&found[..], is_alone) {
        application::read(&document, splats.primitive, &mut scene, &mut warnings);
    }
    let mut seen = std::collections::BTreeSet::new();
    warnings.retain(|warning| seen.insert(warning.clone()));
    let scene = drop_broken(scene, &mut warnings);
    if let Some(axes) = options.axes {
        return Ok(Loaded::turned(scene, warnings, axes, "they were asked for"));
    }
    let because = "glTF is y-up by its specification";
    let up_before = application::up_before(&json);
    Ok(laid_back(Loaded::turned(scene, warnings, Axes::RUB, because), up_before)?)
}

/// The primitives with Gaussians, each with the transform of its node.
fn splats<'a>(json: &'a Value, warnings: &mut Vec<String>) -> Result<Vec<(Splats<'a>, DAffine3)>, Mismatch> {
    let mut found = Vec::new();
    let mut n_others = 0;
    for (mesh, world_from_mesh) in nodes::meshes(json)? {
        let primitives = item(json, "meshes", mesh)?["primitives"].as_array();
        for primitive in primitives.into_iter().flatten() {
            match Splats::new(primitive) {
                Some(splats) => found.push((splats, world_from_mesh)),
                None => n_others += 1,
            }
        }
    }
    if found.is_empty() {
        return Err(mismatch(
            format_args!("a glTF without {EXTENSION} ({n_others} other primitives)"),
            "Gaussians in its scene",
        ));
    }
    if n_others > 0 {
        warnings.push(format!("left out {n_others} primitives that are no Gaussians"));
    }
    Ok(found)
}

/// Warns of extensions that the file cannot do without and that are not read.
fn warn_of_requirements(json: &Value, warnings: &mut Vec<String>) {
    let required = json["extensionsRequired"].as_array().into_iter().flatten().filter_map(Value::as_str);
    let unknown: Vec<&str> =
        required.filter(|name| ![EXTENSION, SPZ_EXTENSION].contains(name)).take(8).collect();
    if !unknown.is_empty() {
        warnings.push(format!("the file requires {}, which is not supported", unknown.join(", ")));
    }
}

#[cfg(test)]
mod tests;
