//! Writing a GLB: Gaussians as f32 by KHR_gaussian_splatting, colors of points for other viewers, and the
//! scene's features as application attributes if it has any.

use std::{borrow::Cow, io::Write};

use glam::{DVec3, Vec3};
use serde_json::{Map, Value, json};
use stylegaussian::{
    axes::Axes,
    light::linear_from_srgb,
    scene::{Scene, ScreenFilter},
    sh,
};

use super::{
    accessor::Component,
    application,
    document::{BINARY_CHUNK, JSON_CHUNK, MAGIC},
    primitive::EXTENSION,
};
use crate::{
    error::mismatch,
    format::{Unwritten, WriteOptions},
    upright::upright,
};

/// `ARRAY_BUFFER`: the buffer view holds attributes of points.
const ARRAY_BUFFER: u32 = 34962;

/// An attribute of the points. Rows are packed, and their lengths multiples of 4, as glTF demands.
pub(super) struct Attribute<'a> {
    name: String,
    component: Component,
    is_normalized: bool,
    width: usize,
    bounds: Option<(Vec3, Vec3)>,
    /// Makes the bytes when they are written, so that memory holds one attribute at a time.
    bytes: Box<dyn Fn() -> Vec<u8> + 'a>,
}

impl<'a> Attribute<'a> {
    /// An attribute of f32, `row(i)` for each of `n` points.
    pub fn floats<const W: usize>(
        name: impl Into<String>,
        n: usize,
        row: impl Fn(usize) -> [f32; W] + 'a,
    ) -> Self {
        let bytes = move || rows(n, |i| row(i).map(f32::to_le_bytes));
        Self::new(name.into(), Component::F32, W, Box::new(bytes))
    }

    /// An attribute of u16, `row(i)` for each of `n` points. `W` is even.
    pub fn words<const W: usize>(
        name: impl Into<String>,
        n: usize,
        row: impl Fn(usize) -> [u16; W] + 'a,
    ) -> Self {
        let bytes = move || rows(n, |i| row(i).map(u16::to_le_bytes));
        Self::new(name.into(), Component::U16, W, Box::new(bytes))
    }

    fn new(name: String, component: Component, width: usize, bytes: Box<dyn Fn() -> Vec<u8> + 'a>) -> Self {
        Self { name, component, is_normalized: false, width, bounds: None, bytes }
    }

    fn row_bytes(&self) -> usize {
        self.width * self.component.n_bytes()
    }

    /// The accessor of buffer view `index`, for `n` points.
    fn accessor(&self, index: usize, n: usize) -> Value {
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][self.width - 1];
        let mut accessor =
            json!({ "bufferView": index, "componentType": self.component.code(), "count": n, "type": kind });
        if self.is_normalized {
            accessor["normalized"] = true.into();
        }
        if let Some((min, max)) = self.bounds {
            accessor["min"] = json!(min.to_array());
            accessor["max"] = json!(max.to_array());
        }
        accessor
    }
}

/// The bytes of `n` rows.
fn rows<const W: usize, const B: usize>(n: usize, row: impl Fn(usize) -> [[u8; B]; W]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(n * W * B);
    (0..n).for_each(|i| bytes.extend_from_slice(row(i).as_flattened()));
    bytes
}

/// Writes a scene in the source's order, upright, and in axes RUB.
pub(super) fn write(out: &mut dyn Write, scene: &Scene, options: &WriteOptions) -> Result<(), Unwritten> {
    let (turned, up) = upright(Cow::Owned(scene.subset(&scene.by_source())))?;
    let mut turned = turned.into_owned();
    Axes::RUB.turn(&mut turned);
    let n = turned.len();
    let mut attributes = attributes(&turned, options.sh_degree);
    attributes.extend(application::attributes(&turned));
    let n_bytes: usize = attributes.iter().map(|attribute| n * attribute.row_bytes()).sum();
    let mut json = description(&turned, up, &attributes, n_bytes)?.to_string().into_bytes();
    // JSON allows the spaces that align the next chunk. The binary one is aligned as all its rows are.
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + n_bytes;
    let [total, json_bytes, n_bytes] = [total, json.len(), n_bytes].map(u32::try_from).map(|length| {
        length.map_err(|_| mismatch(format_args!("a GLB of {total} bytes"), "fewer than 2^32"))
    });
    out.write_all(MAGIC)?;
    out.write_all(&2_u32.to_le_bytes())?;
    out.write_all(&total?.to_le_bytes())?;
    out.write_all(&json_bytes?.to_le_bytes())?;
    out.write_all(JSON_CHUNK)?;
    out.write_all(&json)?;
    out.write_all(&n_bytes?.to_le_bytes())?;
    out.write_all(BINARY_CHUNK)?;
    for attribute in attributes {
        out.write_all(&(attribute.bytes)())?;
    }
    Ok(())
}

/// The JSON of the file. `up` is the up direction that the scene had before it was set upright.
fn description(
    scene: &Scene,
    up: Option<Vec3>,
    attributes: &[Attribute],
    n_bytes: usize,
) -> Result<Value, Unwritten> {
    let n = scene.len();
    let mut offset = 0;
    let mut views = Vec::new();
    for attribute in attributes {
        let length = n * attribute.row_bytes();
        views
            .push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length, "target": ARRAY_BUFFER }));
        offset += length;
    }
    let accessors: Vec<Value> =
        attributes.iter().enumerate().map(|(i, attribute)| attribute.accessor(i, n)).collect();
    let indices: Map<String, Value> =
        attributes.iter().enumerate().map(|(i, attribute)| (attribute.name.clone(), i.into())).collect();
    let mut primitive = json!({
        "attributes": indices,
        "mode": 0,
        "extensions": { EXTENSION: {
            "kernel": "ellipse",
            "colorSpace": "srgb_rec709_display",
            "projection": "perspective",
            "sortingMethod": "cameraDistance",
        } },
    });
    if let Some(text) = application::extras(scene)? {
        primitive["extras"] = json!({ application::KEY: text });
    }
    let mut node = json!({ "mesh": 0 });
    if scene.offset != DVec3::ZERO {
        // Numbers of JSON are f64, so that our readers lose nothing. Viewers with matrices of f32 round it.
        node["translation"] = json!(scene.offset.to_array());
    }
    Ok(json!({
        "asset": asset(scene, up),
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "primitives": [primitive] }],
        "buffers": [{ "byteLength": n_bytes }],
        "bufferViews": views,
        "accessors": accessors,
    }))
}

/// The generator, and the scene's metadata.
fn asset(scene: &Scene, up_before: Option<Vec3>) -> Value {
    let generator = concat!("stylegaussian ", env!("CARGO_PKG_VERSION"));
    let mut asset = json!({ "version": "2.0", "generator": generator });
    if let Some(license) = &scene.license {
        asset["copyright"] = json!(license);
    }
    let mut extras = Map::new();
    if let Some(source) = &scene.source {
        extras.insert("source".into(), json!(source));
    }
    if let Some(up) = scene.up {
        extras.insert("up".into(), json!(up.to_array()));
    }
    if let Some(up) = up_before {
        extras.insert(application::UP_BEFORE.into(), json!(up.to_array()));
    }
    if scene.filter == ScreenFilter::Antialiased {
        extras.insert("antialiased".into(), true.into());
    }
    if !extras.is_empty() {
        asset["extras"] = extras.into();
    }
    asset
}

/// The attributes of the extension, and `COLOR_0`.
fn attributes(scene: &Scene, sh_degree: u8) -> Vec<Attribute<'_>> {
    let n = scene.len();
    let named = |name: &str| format!("{EXTENSION}:{name}");
    let mut position = Attribute::floats("POSITION", n, |i| scene.means[i].to_array());
    position.bounds = scene.bounds();
    let base = scene.base_colors();
    let mut color = Attribute::words("COLOR_0", n, move |i| {
        let [r, g, b] = base[i].map(|value| linear_from_srgb(value.clamp(0.0, 1.0)));
        [r, g, b, scene.opacities[i]].map(|value| (value * 65535.0).round() as u16)
    });
    color.is_normalized = true;
    let mut attributes = vec![
        position,
        color,
        Attribute::floats(named("ROTATION"), n, |i| scene.rotations[i].to_array()),
        Attribute::floats(named("SCALE"), n, |i| scene.scales[i].to_array()),
        Attribute::floats(named("OPACITY"), n, |i| [scene.opacities[i]]),
    ];
    let coefficients = match &scene.sh {
        Some(sh) => Cow::Borrowed(&sh.coefficients[..]),
        // The extension demands degree 0. Zeros are mid-gray.
        None => Cow::Owned(vec![0.0; 3 * n]),
    };
    let captured = scene.sh.as_ref().map_or(0, |sh| sh.degree);
    let width = 3 * sh::n_coefficients(captured);
    let coefficients = std::rc::Rc::new(coefficients);
    for degree in 0..=captured.min(sh_degree) {
        for i in 0..=2 * usize::from(degree) {
            let at = 3 * (usize::from(degree).pow(2) + i);
            let coefficients = coefficients.clone();
            let row = move |n: usize| std::array::from_fn::<_, 3, _>(|c| coefficients[n * width + at + c]);
            attributes.push(Attribute::floats(named(&format!("SH_DEGREE_{degree}_COEF_{i}")), n, row));
        }
    }
    attributes
}
