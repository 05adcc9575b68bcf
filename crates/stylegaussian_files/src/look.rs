//! Looks: `*.look.safetensors`.
//!
//! | tensor | type and shape | |
//! | --- | --- | --- |
//! | `colors` | u8 `[N, 3]` | one row per Gaussian of the scene, in the order of its source |
//! | `scale`, `offset` | f32 `[3]` | color = offset + scale * `colors`, display-referred RGB |
//!
//! A look with strokes has metadata `version` 2, and also:
//!
//! | tensor | type and shape | |
//! | --- | --- | --- |
//! | `words` | u32 `[N]` | [`StrokeWord`]s, in the order of `colors` |
//! | `seeds` | u8 `[M, 32]` | [`StrokeSeed`]s: 8 little-endian numbers of 4 bytes |
//! | `texture.{t}` | u8 | the detail of painting t, from 0 on: see `texture` |
//!
//! | metadata | value |
//! | --- | --- |
//! | `scene` | `N@hash`, the scene's [`SceneFingerprint`] |
//! | `paintings` | a JSON list of `[name, weight]` |
//! | `strength`, `steps`, `seed` | numbers |
//!
//! [`StrokeWord`]: stylegaussian::strokes::StrokeWord
//! [`StrokeSeed`]: stylegaussian::strokes::StrokeSeed

use serde_json::{Value, json};
use stylegaussian::look::{Look, MadeFrom, Painting, SceneFingerprint};

mod strokes;
mod texture;

use super::{
    error::{Mismatch, mismatch},
    tensors::{Dimension::Is, Reader, Writer, expect_finite},
};

const FORMAT: &str = "stylegaussian-look";

/// Version of a look with strokes. One without them is of version 1, which older readers know.
const WITH_STROKES: &str = "2";

/// The largest value of a u8.
const LAST_STEP: f32 = 255.0;

pub(super) fn from_bytes(bytes: &[u8]) -> Result<Look, Mismatch> {
    let reader = Reader::new(bytes)?;
    let has_strokes = reader.metadata("version") == Some(WITH_STROKES);
    match has_strokes {
        true => reader.expect_value("format", FORMAT)?,
        false => reader.expect_format(FORMAT)?,
    }
    let scene: SceneFingerprint = reader.required("scene", "`scene` = `N@hash`, the scene's fingerprint")?;
    let (steps, _) = reader.bytes("colors", &[Is(scene.n_gaussians), Is(3)])?;
    let coding = Coding { scale: channels(&reader, "scale")?, offset: channels(&reader, "offset")? };
    // Each is finite, but a damaged scale may lead beyond the range of f32.
    expect_finite("offset + 255 scale", &coding.decode([255; 3]))?;
    let colors = steps.chunks_exact(3).map(|row| coding.decode([row[0], row[1], row[2]])).collect();
    let made_from = made_from(&reader)?;
    let strokes = if has_strokes { Some(strokes::read(&reader, scene.n_gaussians)?) } else { None };
    Ok(Look { colors, strokes, scene, made_from })
}

fn channels(reader: &Reader, name: &str) -> Result<[f32; 3], Mismatch> {
    let values = reader.floats(name, &[Is(3)])?;
    Ok([values[0], values[1], values[2]])
}

fn made_from(reader: &Reader) -> Result<MadeFrom, Mismatch> {
    let text: String = reader.required("paintings", "`paintings` = a JSON list")?;
    let paintings = serde_json::from_str(&text).ok().and_then(paintings_of);
    let strength: f64 = reader.required("strength", "`strength` = a number")?;
    expect_finite("strength", &[strength as f32])?;
    Ok(MadeFrom {
        paintings: paintings
            .ok_or_else(|| mismatch("metadata `paintings` of another form", "[[name, weight], ...]"))?,
        strength,
        steps: reader.required("steps", "`steps` = a count")?,
        seed: reader.required("seed", "`seed` = a number")?,
    })
}

fn paintings_of(list: Value) -> Option<Vec<Painting>> {
    let painting = |pair: &Value| match pair.as_array()?.as_slice() {
        [name, weight] => Some(Painting { name: name.as_str()?.into(), weight: weight.as_f64()? }),
        _ => None,
    };
    list.as_array()?.iter().map(painting).collect()
}

/// The tensors and metadata of a look file.
pub(super) fn prepare(look: &Look) -> Result<Writer<'_>, Mismatch> {
    let n = look.scene.n_gaussians;
    if look.len() != n {
        return Err(mismatch(format_args!("{} colors", look.len()), format_args!("{n}, one per Gaussian")));
    }
    expect_finite("colors", look.colors.as_flattened())?;
    let coding = Coding::of(&look.colors);
    // A range beyond that of f32 would come back as infinity.
    expect_finite("range of colors", &coding.decode([255; 3]))?;
    let mut writer = Writer::new(FORMAT);
    writer.u8(
        "colors",
        &[n, 3],
        look.colors.iter().flat_map(|&color| coding.encode(color)).collect::<Vec<u8>>(),
    );
    writer.made("scale", &[3], move |channel| coding.scale[channel]);
    writer.made("offset", &[3], move |channel| coding.offset[channel]);
    let MadeFrom { paintings, strength, steps, seed } = &look.made_from;
    // JSON has no NaN.
    let weights: Vec<f32> = paintings.iter().map(|painting| painting.weight as f32).collect();
    expect_finite("weights", &weights)?;
    expect_finite("strength", &[*strength as f32])?;
    let pairs = paintings.iter().map(|painting| json!([painting.name, painting.weight]));
    writer.set("scene", look.scene);
    writer.set("paintings", Value::from_iter(pairs));
    writer.set("strength", strength);
    writer.set("steps", steps);
    writer.set("seed", seed);
    if let Some(strokes) = &look.strokes {
        writer.set("version", WITH_STROKES);
        strokes::write(strokes, n, &mut writer)?;
    }
    Ok(writer)
}

/// The affine code of colors in bytes: color = offset + scale * byte, channel by channel.
#[derive(Clone, Copy)]
struct Coding {
    scale: [f32; 3],
    offset: [f32; 3],
}

impl Coding {
    /// The code in which each channel's smallest value is 0 and its largest is 255.
    fn of(colors: &[[f32; 3]]) -> Self {
        let first = colors.first().copied().unwrap_or_default();
        let extremes = |c: usize| {
            let values = colors.iter().map(|color| color[c]);
            values.fold((first[c], first[c]), |(min, max), value| (min.min(value), max.max(value)))
        };
        let range = [0, 1, 2].map(extremes);
        Self { scale: range.map(|(min, max)| (max - min) / LAST_STEP), offset: range.map(|(min, _)| min) }
    }

    fn encode(&self, color: [f32; 3]) -> [u8; 3] {
        // A channel of one value has scale 0. Its quotient is NaN, which the cast makes 0.
        [0, 1, 2].map(|c| ((color[c] - self.offset[c]) / self.scale[c]).round() as u8)
    }

    fn decode(&self, steps: [u8; 3]) -> [f32; 3] {
        [0, 1, 2].map(|c| self.offset[c] + self.scale[c] * f32::from(steps[c]))
    }
}

#[cfg(test)]
pub(super) mod tests;
