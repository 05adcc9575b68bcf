//! glTF with Gaussians: the ratified extension KHR_gaussian_splatting, in one file (`.glb`) or with buffers
//! beside it (`.gltf`).
//!
//! A primitive of points carries one accessor per property of its Gaussians. All such primitives of the scene
//! become one scene, each moved by its node; other primitives are left out. Bases of spherical harmonics are
//! those of 3DGS.
//!
//! Files of drafts keep logarithms in `SCALE`, and the compression drafts up to `.._spz_2` keep an SPZ file.
//! All of them are read.

use serde_json::Value;
use stylegaussian::axes::Axes;

use super::{
    activate::drop_broken,
    error::{Loaded, Mismatch, mismatch},
    files::{Files, Unread},
    format::{Format, ReadOptions},
    upright::laid_back,
};

mod accessor;
mod application;
mod base64;
mod document;
mod instances;
mod nodes;
mod parts;
mod primitive;
mod write;

use document::{Document, MOST_MEMORY_PER_BYTE, item};
use nodes::Shown;
use parts::Part;
use primitive::{EXTENSION, Limits, Splats};

/// The extension that allows integers in accessors of positions. They are read with or without it.
const QUANTIZATION: &str = "KHR_mesh_quantization";

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

/// Share of a reading that the primitives are said to take. The rest is for their places.
const PRIMITIVES: f32 = 0.8;

/// Reads all Gaussians.
fn read(files: &mut Files, options: &ReadOptions) -> Result<Loaded, Unread> {
    let work = files.work.clone();
    let mut document = Document::open(files)?;
    let json = document.json.clone();
    let mut warnings = Vec::new();
    let found = splats(&json, &mut warnings)?;
    check_requirements(&json, &found, &mut warnings)?;
    if let Some(center) = json["extensions"][CESIUM_RTC].get("center") {
        warnings.push(format!("left out {CESIUM_RTC}: positions count from its center {center}"));
    }
    let are_logarithms = primitive::scales_are_logarithms(&document, found.iter().map(|found| found.splats))?;
    if are_logarithms {
        warnings.push("scales below 0: taken for logarithms, as drafts of the extension had them".into());
    }
    let mut memory_left = document.n_bytes().saturating_mul(MOST_MEMORY_PER_BYTE);
    let mut memory_for_instances = memory_left.max(instances::FREE_MEMORY);
    let mut parts = Vec::with_capacity(found.len());
    let share = |i: usize| PRIMITIVES * i as f32 / found.len() as f32;
    for (i, Found { splats, shown }) in found.iter().enumerate() {
        let work = work.part(share(i), share(i + 1));
        work.at(0.0)?;
        let is_last = found.len() == 1 && shown.instances.is_none();
        let limits = Limits { memory_left: &mut memory_left, is_last };
        let scene = splats.read(&mut document, are_logarithms, limits, &mut warnings, &work)?;
        let (node, memory) = (shown.world_from_node, &mut memory_for_instances);
        let places = match shown.instances {
            Some(rows) => instances::places(&document, rows, node, &scene, memory, &mut warnings)?,
            None => vec![node],
        };
        parts.push(Part { scene, places });
    }
    let is_alone = matches!(&parts[..], [Part { places, .. }] if places.len() == 1);
    work.at(PRIMITIVES)?;
    let mut scene = parts::placed(parts, &mut warnings, &work)?;
    // The features of several primitives may be of several kinds.
    if let ([Found { splats, .. }], true) = (&found[..], is_alone) {
        application::read(&document, splats.primitive, &mut scene, &mut warnings, &work);
    }
    work.at(0.9)?;
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

/// A primitive with Gaussians, and where it is shown.
struct Found<'a> {
    splats: Splats<'a>,
    shown: Shown<'a>,
}

/// The primitives with Gaussians, once for each node that shows them.
fn splats<'a>(json: &'a Value, warnings: &mut Vec<String>) -> Result<Vec<Found<'a>>, Mismatch> {
    let mut found = Vec::new();
    let mut n_others = 0;
    for shown in nodes::meshes(json)? {
        let primitives = item(json, "meshes", shown.mesh)?["primitives"].as_array();
        for primitive in primitives.into_iter().flatten() {
            match Splats::new(primitive) {
                Some(splats) => found.push(Found { splats, shown }),
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

/// The extension that moves the whole file. Its readers do not agree on the axes of its center.
const CESIUM_RTC: &str = "CESIUM_RTC";

/// The extension that compresses the primitives that name it.
const DRACO: &str = "KHR_draco_mesh_compression";

/// Beginnings of the names of extensions that change no Gaussians: materials, textures, lights, and facts about
/// the file.
const OF_OTHERS: [&str; 14] = [
    CESIUM_RTC,
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_techniques_webgl",
    "KHR_xmp",
    "KHR_animation_",
    "EXT_texture_",
    "EXT_lights_",
    "EXT_mesh_features",
    "EXT_instance_features",
    "EXT_structural_metadata",
    "MSFT_texture_",
    "MSFT_packing_",
];

/// Checks the extensions that the file cannot do without, and warns of those that are not read and change no
/// Gaussians.
///
/// # Errors
/// If one is not read that may change them: a reader must not load the file then (glTF 2.0, section 3.12).
fn check_requirements(json: &Value, found: &[Found], warnings: &mut Vec<String>) -> Result<(), Mismatch> {
    let required = json["extensionsRequired"].as_array().into_iter().flatten().filter_map(Value::as_str);
    let is_known = |name: &str| {
        let known = [EXTENSION, instances::EXTENSION, QUANTIZATION];
        // A compressed view that is needed is an error of its own.
        known.iter().chain(&primitive::SPZ_EXTENSIONS).chain(&document::COMPRESSIONS).any(|it| *it == name)
    };
    let is_named = |name: &str| found.iter().any(|it| it.splats.primitive["extensions"].get(name).is_some());
    let is_of_others = |name: &&str| match *name {
        DRACO => !is_named(DRACO),
        name => OF_OTHERS.iter().any(|start| name.starts_with(start)),
    };
    let unknown = required.filter(|name| !is_known(name));
    let (others, needed): (Vec<&str>, Vec<&str>) = unknown.partition(is_of_others);
    let listed = |names: &[&str]| names[..names.len().min(8)].join(", ");
    if !needed.is_empty() {
        return Err(mismatch(
            format_args!("a glTF that requires {}, which is not supported", listed(&needed)),
            "one without it",
        ));
    }
    if !others.is_empty() {
        warnings.push(format!("the file requires {}, which is not supported", listed(&others)));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
