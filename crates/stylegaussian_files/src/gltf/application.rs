//! Features and neighbors as application attributes, which only files of this project have: a styled scene can
//! be styled anew. Other programs ignore them.
//!
//! | attribute | rows | |
//! | --- | --- | --- |
//! | `_SG_FEATURES_i` | 4 u16 or 4 f32 | channels 4 i to 4 i + 3 of f'; u16: bits of f16; zeros at the end |
//! | `_SG_EXTRA_i` | the same | extra inputs of the decoder |
//! | `_SG_NEIGHBORS_i` | 4 u16 | neighbors 2 i and 2 i + 1, each the lower half before the upper half |
//! | `_SG_ORDER` | 2 u16 | index in the source, lower half and upper half; absent if it is 0, 1, 2, ... |
//!
//! The primitive's `extras.stylegaussian` keeps the rest, which belongs to the scene as a whole, as a
//! safetensors file in base64: tensors `basis` `[D, L]` and `offset` `[D]`, those of a decoder, and metadata
//! `encoder`, `extra` (E) and `neighbors` (K). Programs that rewrite a glTF keep attributes and extras, but
//! drop buffer views that nothing refers to.

use glam::Vec3;
use half::f16;
use serde_json::Value;
use stylegaussian::{
    neighbors::Neighbors,
    scene::{Features, Scene, ScreenFilter},
    work::Work,
};

use super::{
    accessor::{Accessor, Component},
    base64,
    document::{Document, MOST_MEMORY_PER_BYTE},
    primitive::with_rows,
    write::Attribute,
};
use crate::{
    decoder::{self, Precision},
    error::{Mismatch, mismatch},
    tensors::{
        Dimension::{Any, Is},
        Reader, Writer, expect_finite,
    },
};

/// The key in `extras`.
pub(super) const KEY: &str = "stylegaussian";

/// The key in the asset's `extras` of the up direction that a scene had before it was set upright, in axes RDF.
pub(super) const UP_BEFORE: &str = "upBefore";

/// The format's name in its metadata.
const FORMAT_NAME: &str = "stylegaussian-application";

const FEATURES: &str = "_SG_FEATURES";
const EXTRA: &str = "_SG_EXTRA";
const NEIGHBORS: &str = "_SG_NEIGHBORS";
const ORDER: &str = "_SG_ORDER";

/// The attributes of a scene's features and neighbors.
pub(super) fn attributes(scene: &Scene) -> Vec<Attribute<'_>> {
    let mut attributes = Vec::new();
    if let Some(features) = &scene.features {
        attributes.extend(columns(FEATURES, &features.values, features.n_latent));
        attributes.extend(columns(EXTRA, &features.extra, features.n_extra));
    }
    if let Some(Neighbors { k, indices }) = &scene.neighbors {
        for pair in 0..k.div_ceil(2) {
            let row = move |i: usize| {
                let list = &indices[i * k..(i + 1) * k];
                let half = |at: usize, shift: u32| list.get(at).map_or(0, |&index| (index >> shift) as u16);
                [half(2 * pair, 0), half(2 * pair, 16), half(2 * pair + 1, 0), half(2 * pair + 1, 16)]
            };
            attributes.push(Attribute::words(format!("{NEIGHBORS}_{pair}"), scene.len(), row));
        }
    }
    let is_plain = scene.order.iter().enumerate().all(|(i, &index)| i == index as usize);
    if !attributes.is_empty() && !is_plain {
        // Noise of the decoder belongs to the index.
        let halves = |index: u32| [index as u16, (index >> 16) as u16];
        attributes.push(Attribute::words(ORDER, scene.len(), move |i| halves(scene.order[i])));
    }
    attributes
}

/// `values` `[N, width]` in attributes of four columns, f16 if that is exact.
fn columns<'a>(name: &'a str, values: &'a [f32], width: usize) -> impl Iterator<Item = Attribute<'a>> {
    let is_half = values.iter().all(|&value| f16::from_f32(value).to_f32().to_bits() == value.to_bits());
    (0..width.div_ceil(4)).map(move |group| {
        let value = move |i: usize, column: usize| match 4 * group + column {
            at if at < width => values[i * width + at],
            _ => 0.0,
        };
        let (name, n) = (format!("{name}_{group}"), values.len() / width);
        match is_half {
            true => {
                Attribute::words(name, n, move |i| [0, 1, 2, 3].map(|c| f16::from_f32(value(i, c)).to_bits()))
            }
            false => Attribute::floats(name, n, move |i| [0, 1, 2, 3].map(|c| value(i, c))),
        }
    })
}

/// The text of `extras.stylegaussian`, or `None` if the scene has nothing for it.
pub(super) fn extras(scene: &Scene) -> Result<Option<String>, Mismatch> {
    if scene.features.is_none() && scene.neighbors.is_none() && scene.decoder.is_none() {
        return Ok(None);
    }
    let mut writer = Writer::new(FORMAT_NAME);
    let mut encoder = None;
    if let Some(features) = &scene.features {
        let (d, l) = (features.n_channels(), features.n_latent);
        if d == 0 || l == 0 {
            return Err(mismatch(
                format_args!("features of {d} channels, {l} stored"),
                "at least one of each",
            ));
        }
        expect_finite("basis", &features.basis)?;
        expect_finite("offset", &features.offset)?;
        writer.f32("basis", &[d, l], &features.basis);
        writer.f32("offset", &[d], &features.offset);
        writer.set("extra", features.n_extra);
        encoder = features.encoder.as_ref();
    }
    if let Some(decoder) = &scene.decoder {
        decoder::to_tensors(decoder, Precision::F32, &mut writer)?;
        encoder = encoder.or(decoder.encoder.as_ref());
    }
    if let Some(encoder) = encoder {
        writer.set("encoder", encoder);
    }
    if let Some(neighbors) = &scene.neighbors {
        writer.set("neighbors", neighbors.k);
    }
    let mut bytes = Vec::new();
    // Writing into memory does not fail.
    writer.write(&mut bytes).map_err(|error| mismatch(error, "memory"))?;
    Ok(Some(base64::encode(&bytes)))
}

/// Adds the contents of [`attributes`] and [`extras`] to a scene, and the asset's own metadata. If that
/// contradicts itself, a warning says so, and the scene stays as it is. So it does if `work` is canceled.
pub(super) fn read(
    document: &Document,
    primitive: &Value,
    scene: &mut Scene,
    warnings: &mut Vec<String>,
    work: &Work,
) {
    let asset = &document.json["asset"];
    scene.license = asset["copyright"].as_str().map(Into::into);
    scene.source = asset["extras"]["source"].as_str().map(Into::into);
    if asset["extras"]["antialiased"] == true {
        scene.filter = ScreenFilter::Antialiased;
    }
    scene.up = direction(&asset["extras"]["up"]);
    let Some(text) = primitive["extras"][KEY].as_str() else { return };
    if let Err(Mismatch { found, expected }) = read_parts(document, primitive, text, scene, work) {
        warnings.push(format!("ignored features, neighbors and decoder: found {found}, expected {expected}"));
    }
}

/// The up direction of a scene before our writer set it upright, or `None` if it did not.
pub(super) fn up_before(json: &Value) -> Option<Vec3> {
    direction(&json["asset"]["extras"][UP_BEFORE])
}

fn direction(value: &Value) -> Option<Vec3> {
    let up = value.as_array().filter(|up| up.len() == 3)?;
    let up = Vec3::from_array([0, 1, 2].map(|i| up[i].as_f64().unwrap_or(f64::NAN) as f32));
    Some(up).filter(|up| up.is_finite() && *up != Vec3::ZERO)
}

fn read_parts(
    document: &Document,
    primitive: &Value,
    text: &str,
    scene: &mut Scene,
    work: &Work,
) -> Result<(), Mismatch> {
    let bytes = base64::decode(text)?;
    let reader = Reader::new(&bytes)?;
    reader.expect_format(FORMAT_NAME)?;
    let rows = Rows { document, primitive, n: scene.len(), work };
    let features = match reader.has("offset") {
        true => Some(features(&reader, &rows)?),
        false => None,
    };
    let neighbors = match reader.parsed("neighbors", "a number of neighbors")? {
        Some(k) => Some(rows.neighbors(k)?),
        None => None,
    };
    let has_decoder = reader.names().iter().any(|name| name.starts_with("decoder."));
    let decoder = if has_decoder { Some(decoder::from_tensors(&reader)?) } else { None };
    if let Some(order) = rows.order()? {
        scene.n_source = order.iter().max().map_or(0, |&last| last as usize + 1).max(scene.len());
        scene.order = order;
    }
    // All at once, after the last error.
    (scene.features, scene.neighbors, scene.decoder) = (features, neighbors, decoder);
    Ok(())
}

fn features(reader: &Reader, rows: &Rows) -> Result<Features, Mismatch> {
    let offset = reader.floats("offset", &[Any("D")])?;
    let basis = reader.floats("basis", &[Is(offset.len()), Any("L")])?;
    let n_latent = basis.len().checked_div(offset.len()).unwrap_or(0);
    if n_latent == 0 {
        return Err(mismatch("features without a channel", "at least one"));
    }
    let n_extra = reader.parsed("extra", "a number of extra inputs")?.unwrap_or(0);
    Ok(Features {
        values: rows.columns(FEATURES, n_latent)?,
        n_latent,
        basis,
        offset,
        extra: rows.columns(EXTRA, n_extra)?,
        n_extra,
        encoder: reader.parsed("encoder", "an encoder `name@hash`")?,
    })
}

/// The application attributes of a primitive of `n` Gaussians.
struct Rows<'a> {
    document: &'a Document<'a>,
    primitive: &'a Value,
    n: usize,
    work: &'a Work,
}

impl Rows<'_> {
    fn accessor(&self, name: &str, width: usize) -> Result<Accessor<'_>, Mismatch> {
        let index = &self.primitive["attributes"][name];
        with_rows(Accessor::new(self.document, index, width, name)?, name, self.n)
    }

    /// Indices in the source, or `None` if they are 0, 1, 2, ...
    fn order(&self) -> Result<Option<Vec<u32>>, Mismatch> {
        if self.primitive["attributes"].get(ORDER).is_none() {
            return Ok(None);
        }
        let accessor = self.accessor(ORDER, 2)?;
        if accessor.component != Component::U16 {
            return Err(mismatch("an order of another type", "unsigned short"));
        }
        let index = |[lower, upper]: [u16; 2]| u32::from(lower) | u32::from(upper) << 16;
        Ok(Some((0..self.n).map(|i| index(accessor.words(i))).collect()))
    }

    /// An allocation for `width` numbers of each Gaussian, of a size that the file warrants.
    fn reserved<T>(&self, width: usize, name: &str) -> Result<Vec<T>, Mismatch> {
        let limit = self.document.n_bytes().saturating_mul(MOST_MEMORY_PER_BYTE);
        match self.n.checked_mul(width).filter(|n| n.saturating_mul(size_of::<T>()) <= limit) {
            Some(n) => Ok(Vec::with_capacity(n)),
            None => Err(mismatch(format_args!("{width} columns of {name}"), "as many as the file has")),
        }
    }

    /// The numbers that [`columns`] wrote `[N, width]`.
    fn columns(&self, name: &str, width: usize) -> Result<Vec<f32>, Mismatch> {
        let mut values: Vec<f32> = self.reserved(width, name)?;
        values.resize(self.n * width, 0.0);
        for group in 0..width.div_ceil(4) {
            self.work.check()?;
            let accessor = self.accessor(&format!("{name}_{group}"), 4)?;
            let (start, end) = (4 * group, (4 * group + 4).min(width));
            for (i, row) in values.chunks_exact_mut(width).enumerate() {
                let found = match accessor.component {
                    Component::U16 => accessor.words::<4>(i).map(|bits| f16::from_bits(bits).to_f32()),
                    _ => accessor.row::<4>(i),
                };
                row[start..end].copy_from_slice(&found[..end - start]);
            }
        }
        expect_finite(name, &values)?;
        Ok(values)
    }

    fn neighbors(&self, k: usize) -> Result<Neighbors, Mismatch> {
        if k == 0 {
            return Err(mismatch("lists of 0 neighbors", "at least 1"));
        }
        let mut indices: Vec<u32> = self.reserved(k, NEIGHBORS)?;
        indices.resize(self.n * k, 0);
        for pair in 0..k.div_ceil(2) {
            self.work.check()?;
            let accessor = self.accessor(&format!("{NEIGHBORS}_{pair}"), 4)?;
            if accessor.component != Component::U16 {
                return Err(mismatch("neighbors of another type", "unsigned short"));
            }
            for (i, list) in indices.chunks_exact_mut(k).enumerate() {
                let words = accessor.words::<4>(i).map(u32::from);
                let pairs = [words[0] | words[1] << 16, words[2] | words[3] << 16];
                for (entry, index) in list[2 * pair..].iter_mut().zip(pairs) {
                    *entry = index;
                }
            }
        }
        match indices.iter().find(|&&index| index as usize >= self.n) {
            Some(index) => Err(mismatch(format_args!("neighbor {index}"), format_args!("below {}", self.n))),
            None => Ok(Neighbors { k, indices }),
        }
    }
}
