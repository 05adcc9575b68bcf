//! Scene files: `*.sgs`, a safetensors file.
//!
//! | tensor | type and shape | |
//! | --- | --- | --- |
//! | `means`, `scales` | f32 `[N, 3]` | scales linear |
//! | `rotations` | f32 `[N, 4]` | unit quaternions x, y, z, w |
//! | `opacities` | f32 `[N]` | 0..1 |
//! | `sh` | f16 `[N, (degree + 1)^2, 3]` | absent if the scene keeps no colors |
//! | `order` | u32 `[N]` | index in the source file; if absent, 0, 1, 2, ...; equal for parts of one Gaussian |
//! | `features`, `basis`, `offset` | f16 or f32 `[N, L]`, f32 `[D, L]`, f32 `[D]` | all or none |
//! | `extra` | f16 `[N, E]` | optional, with features |
//! | `neighbors` | u32 `[N, K]` | optional |
//! | `cameras` | f32 `[M, 18]` | optional: see [`cameras`] |
//! | `mask` | u8 `[N, C]` | optional, with `mask_channels`: see the mask's format |
//! | `feature_mean` | f32 `[L]` | optional cache of other writers; read for its shape only |
//! | `feature_covariance` | f32 `[L, L]` | the same |
//! | `decoder.layers.{i}.*` | | see the decoder's format |
//!
//! Every f16 tensor may be f32 as well. Metadata: `format`, `version`, `source_count`, if known `encoder`, `up`
//! (`x y z`), `filter` (`antialiased`; absent if classic), `source` and `license`, and the decoder's. Gaussians
//! are written in Morton order.

use std::{borrow::Cow, io::Write};

use glam::{DVec3, Quat, Vec3};
use stylegaussian::{
    encoder_id::EncoderId,
    morton,
    neighbors::Neighbors,
    scene::{Features, Scene, ScreenFilter, Sh},
    sh,
    work::Work,
};

mod cameras;

use super::{
    check::check_scene,
    decoder::{self, Precision},
    error::{Loaded, Mismatch, mismatch},
    format::{Format, Unwritten},
    mask,
    tensors::{
        Dimension::{Any, Is},
        Reader, Writer, expect_finite,
    },
};

/// The format.
pub(super) const FORMAT: Format = Format {
    name: ".sgs",
    extensions: &["sgs"],
    recognizes: |bytes, _| is_safetensors(bytes),
    read: |files, _| Ok(read(&files.main, &files.work)?),
    write: Some(|out, scene, _| write(out, scene).map(|()| Vec::new())),
};

/// Whether a file begins as safetensors do: with the length of their JSON header, 8 bytes, and the header. A
/// length beyond what the library allows (100 MB) is a coordinate in a format without a mark.
fn is_safetensors(bytes: &[u8]) -> bool {
    let Some((length, header)) = bytes.split_first_chunk() else { return false };
    u64::from_le_bytes(*length) <= 100_000_000 && header.first() == Some(&b'{')
}

/// The metadata `filter` of a scene that was trained with mip-splatting's filter.
const ANTIALIASED: &str = "antialiased";

/// The format's name in its metadata.
const FORMAT_NAME: &str = "stylegaussian-scene";

/// The most Gaussians of a source per Gaussian that is left of it: a cut-out of a large capture is fine. Files
/// of colors have a row for each, so that the count must not be believed whatever it says.
const MOST_PER_GAUSSIAN: usize = 64;

/// A source of this many is believed whatever is left of it. Its colors take 200 MB.
const MOST_SOURCE: usize = 1 << 24;

/// Tensors of a scene file, besides the decoder's.
const KNOWN: [&str; 15] = [
    "means",
    "rotations",
    "scales",
    "opacities",
    "sh",
    "order",
    "features",
    "basis",
    "offset",
    "extra",
    "neighbors",
    "feature_mean",
    "feature_covariance",
    mask::TENSOR,
    cameras::TENSOR,
];

/// Reads a scene. Unknown tensors are ignored with a warning, so that other programs can add their own.
pub(super) fn read(bytes: &[u8], work: &Work) -> Result<Loaded, Mismatch> {
    let reader = Reader::new(bytes)?;
    reader.expect_format(FORMAT_NAME)?;
    let mut warnings = Vec::new();
    for name in reader.names() {
        if !KNOWN.contains(&name) && !name.starts_with("decoder.") {
            warnings.push(format!("ignored unknown tensor `{name}`"));
        }
    }
    let mut scene = gaussians(&reader)?;
    let n = scene.len();
    work.at(0.2)?;
    scene.sh = spherical_harmonics(&reader, n)?;
    work.at(0.4)?;
    scene.features = features(&reader, n)?;
    work.at(0.6)?;
    scene.neighbors = neighbors(&reader, n)?;
    if reader.names().iter().any(|name| name.starts_with("decoder.")) {
        scene.decoder = Some(decoder::from_tensors(&reader)?);
    }
    scene.mask = reader.has(mask::TENSOR).then(|| mask::from_tensor(&reader, n)).transpose()?;
    scene.up = reader.metadata("up").map(up_from_text).transpose()?;
    scene.offset = reader.metadata("offset").map_or(Ok(DVec3::ZERO), offset_from_text)?;
    scene.cameras = if reader.has(cameras::TENSOR) { cameras::from_tensor(&reader)? } else { Vec::new() };
    scene.filter = reader.metadata("filter").map_or(Ok(ScreenFilter::Classic), filter_from_text)?;
    scene.source = reader.metadata("source").map(Into::into);
    // Files of earlier versions spell it `licence`.
    let license = reader.metadata("license").or_else(|| reader.metadata("licence"));
    scene.license = license.map(Into::into);
    work.at(0.8)?;
    check_scene(&scene)?;
    Ok(Loaded::new(scene, warnings))
}

/// Means, rotations, scales, opacities and order.
fn gaussians(reader: &Reader) -> Result<Scene, Mismatch> {
    let vec3 = |values: Vec<f32>| values.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>();
    let means = vec3(reader.floats("means", &[Any("N"), Is(3)])?);
    let n = means.len();
    if u32::try_from(n).is_err() {
        return Err(mismatch(format_args!("{n} Gaussians"), "fewer than 2^32"));
    }
    let rotations = reader.floats("rotations", &[Is(n), Is(4)])?;
    let opacities = reader.floats("opacities", &[Is(n)])?;
    let order = match reader.has("order") {
        true => reader.indices("order", &[Is(n)])?,
        false => (0..n as u32).collect(),
    };
    // Files of other writers may lack the count. The last Gaussian kept is then taken for the source's last.
    let least = order.iter().max().map_or(0, |&last| last as usize + 1);
    let n_source = reader.parsed("source_count", "a count of Gaussians")?.unwrap_or(least);
    let most = n.saturating_mul(MOST_PER_GAUSSIAN).max(MOST_SOURCE);
    if n_source > most {
        return Err(mismatch(
            format_args!("a source of {n_source} Gaussians, of which {n} are left"),
            format_args!("at most {most}"),
        ));
    }
    Ok(Scene {
        means,
        rotations: rotations.chunks_exact(4).map(Quat::from_slice).collect(),
        scales: vec3(reader.floats("scales", &[Is(n), Is(3)])?),
        opacities,
        order,
        n_source,
        ..Scene::default()
    })
}

fn spherical_harmonics(reader: &Reader, n: usize) -> Result<Option<Sh>, Mismatch> {
    let Some(shape) = reader.shape("sh") else { return Ok(None) };
    let degree = (0..=sh::MAX_DEGREE).find(|&degree| shape.get(1) == Some(&sh::n_coefficients(degree)));
    let Some(degree) = degree else {
        return Err(mismatch(format_args!("`sh` {shape:?}"), format_args!("[{n}, 1 or 4 or 9 or 16, 3]")));
    };
    let coefficients = reader.floats("sh", &[Is(n), Is(sh::n_coefficients(degree)), Is(3)])?;
    Ok(Some(Sh { degree, coefficients }))
}

fn features(reader: &Reader, n: usize) -> Result<Option<Features>, Mismatch> {
    if !["features", "basis", "offset", "extra"].iter().any(|name| reader.has(name)) {
        return Ok(None);
    }
    let offset = reader.floats("offset", &[Any("D")])?;
    let d = offset.len();
    let basis = reader.floats("basis", &[Is(d), Any("L")])?;
    // The shape comes from the file, and D may be 0.
    let n_latent = basis.len().checked_div(d).unwrap_or(0);
    if n_latent == 0 {
        return Err(mismatch(
            format_args!("features of {d} channels, {n_latent} stored"),
            "at least one of each",
        ));
    }
    let values = reader.floats("features", &[Is(n), Is(n_latent)])?;
    let extra = match reader.has("extra") {
        true => reader.floats("extra", &[Is(n), Any("E")])?,
        false => Vec::new(),
    };
    for (name, shape) in
        [("feature_mean", &[Is(n_latent)][..]), ("feature_covariance", &[Is(n_latent), Is(n_latent)])]
    {
        if reader.has(name) {
            reader.floats(name, shape)?;
        }
    }
    let n_extra = extra.len().checked_div(n).unwrap_or(0);
    let encoder = reader.parsed("encoder", "an encoder `name@hash`")?;
    Ok(Some(Features { values, n_latent, basis, offset, extra, n_extra, encoder }))
}

fn neighbors(reader: &Reader, n: usize) -> Result<Option<Neighbors>, Mismatch> {
    if !reader.has("neighbors") {
        return Ok(None);
    }
    let indices = reader.indices("neighbors", &[Is(n), Any("K")])?;
    let k = indices.len().checked_div(n).unwrap_or(0);
    if k == 0 && n > 0 {
        return Err(mismatch("`neighbors` with K = 0", "K at least 1"));
    }
    Ok(Some(Neighbors { k, indices }))
}

fn up_from_text(text: &str) -> Result<Vec3, Mismatch> {
    // Words that are no numbers are dropped here, so the number of words is compared as well.
    let numbers: Vec<f32> = text.split_ascii_whitespace().filter_map(|word| word.parse().ok()).collect();
    let up = match numbers[..] {
        [x, y, z] if text.split_ascii_whitespace().count() == 3 => Vec3::new(x, y, z),
        // Refused below, with the message for other directions that are none.
        _ => Vec3::NAN,
    };
    match up.is_finite() && up != Vec3::ZERO {
        true => Ok(up),
        false => Err(mismatch(format_args!("metadata `up` = `{text}`"), "a direction `x y z`")),
    }
}

fn offset_from_text(text: &str) -> Result<DVec3, Mismatch> {
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    let numbers: Vec<f64> = words.iter().filter_map(|word| word.parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if words.len() == 3 && DVec3::new(x, y, z).is_finite() => Ok(DVec3::new(x, y, z)),
        _ => {
            let text: String = text.chars().take(60).collect();
            Err(mismatch(format_args!("metadata `offset` = `{text}`"), "three numbers `x y z`"))
        }
    }
}

fn filter_from_text(text: &str) -> Result<ScreenFilter, Mismatch> {
    match text {
        "classic" => Ok(ScreenFilter::Classic),
        ANTIALIASED => Ok(ScreenFilter::Antialiased),
        _ => Err(mismatch(
            format_args!("metadata `filter` = `{text}`"),
            format_args!("`{ANTIALIASED}` or none"),
        )),
    }
}

/// Writes a scene that has passed [`check_scene`].
fn write(out: &mut dyn Write, scene: &Scene) -> Result<(), Unwritten> {
    let order = morton::order(&scene.means);
    // A scene that is in this order already, as every `.sgs` is, need not be copied.
    let sorted = match order.is_sorted() {
        true => Cow::Borrowed(scene),
        false => Cow::Owned(scene.subset(&order)),
    };
    Ok(prepare(&sorted)?.write(out)?)
}

/// The tensors and metadata of a scene in Morton order.
fn prepare(scene: &Scene) -> Result<Writer<'_>, Mismatch> {
    let n = scene.len();
    let mut writer = Writer::new(FORMAT_NAME);
    writer.f32("means", &[n, 3], bytemuck::cast_slice(&scene.means));
    writer.f32("rotations", &[n, 4], bytemuck::cast_slice(&scene.rotations));
    writer.f32("scales", &[n, 3], bytemuck::cast_slice(&scene.scales));
    writer.f32("opacities", &[n], &scene.opacities);
    writer.u32("order", &[n], &scene.order);
    if let Some(sh) = &scene.sh {
        writer.f16("sh", &[n, sh::n_coefficients(sh.degree), 3], &sh.coefficients);
    }
    if let Some(features) = &scene.features {
        add_features(features, n, &mut writer)?;
    }
    if let Some(neighbors) = &scene.neighbors {
        writer.u32("neighbors", &[n, neighbors.k], &neighbors.indices);
    }
    if let Some(decoder) = &scene.decoder {
        decoder::to_tensors(decoder, Precision::F32, &mut writer)?;
    }
    if let Some(painted) = &scene.mask {
        mask::to_tensor(&painted.weights, &painted.names, &mut writer);
    }
    if !scene.cameras.is_empty() {
        cameras::to_tensor(&scene.cameras, &mut writer)?;
    }
    add_metadata(scene, &mut writer)?;
    Ok(writer)
}

fn add_features<'a>(features: &'a Features, n: usize, writer: &mut Writer<'a>) -> Result<(), Mismatch> {
    let (d, l) = (features.n_channels(), features.n_latent);
    if d == 0 || l == 0 {
        return Err(mismatch(format_args!("features of {d} channels, {l} stored"), "at least one of each"));
    }
    expect_finite("basis", &features.basis)?;
    expect_finite("offset", &features.offset)?;
    // Features of checkpoints stay f32, since they must stylize exactly like the original. Such features have
    // full rank or name no encoder.
    if l == d || features.encoder.is_none() || exceeds_f16(&features.values) {
        writer.f32("features", &[n, l], &features.values);
    } else {
        writer.f16("features", &[n, l], &features.values);
    }
    writer.f32("basis", &[d, l], &features.basis);
    writer.f32("offset", &[d], &features.offset);
    match features.n_extra {
        0 => {}
        e if exceeds_f16(&features.extra) => writer.f32("extra", &[n, e], &features.extra),
        e => writer.f16("extra", &[n, e], &features.extra),
    }
    Ok(())
}

/// Whether rounding to f16 would clamp a value.
fn exceeds_f16(values: &[f32]) -> bool {
    values.iter().any(|value| value.abs() > half::f16::MAX.to_f32())
}

fn add_metadata(scene: &Scene, writer: &mut Writer) -> Result<(), Mismatch> {
    let of_features = scene.features.as_ref().and_then(|features| features.encoder.as_ref());
    let of_decoder = scene.decoder.as_ref().and_then(|decoder| decoder.encoder.as_ref());
    // The file has one key for both.
    EncoderId::expect_same(("the decoder", of_decoder), ("the features", of_features)).map_err(|error| {
        let found = format_args!("a decoder for encoder `{}`", error.found).to_string();
        mismatch(found, format_args!("one for the features' encoder `{}`", error.expected))
    })?;
    if let Some(encoder) = of_features.or(of_decoder) {
        writer.set("encoder", encoder);
    }
    writer.set("source_count", scene.n_source);
    if let Some(up) = scene.up {
        writer.set("up", format_args!("{} {} {}", up.x, up.y, up.z));
    }
    if scene.offset != DVec3::ZERO {
        let DVec3 { x, y, z } = scene.offset;
        writer.set("offset", format_args!("{x} {y} {z}"));
    }
    if scene.filter == ScreenFilter::Antialiased {
        writer.set("filter", ANTIALIASED);
    }
    if let Some(source) = &scene.source {
        writer.set("source", source);
    }
    if let Some(license) = &scene.license {
        writer.set("license", license);
    }
    Ok(())
}
