//! Strokes of a look.

use std::sync::Arc;

use half::f16;
use stylegaussian::strokes::{MAX_SEEDS, MAX_TEXTURES, StrokeSeed, StrokeWord, Strokes};

use super::texture;
use crate::{
    error::{Mismatch, mismatch},
    tensors::{
        Dimension::{Any, Is},
        Reader, Writer,
    },
};

/// Bytes of a seed.
const SEED_BYTES: usize = 32;

/// The strokes of a look of `n` Gaussians.
pub fn read(reader: &Reader, n: usize) -> Result<Strokes, Mismatch> {
    let words = reader.indices("words", &[Is(n)])?;
    let (bytes, _) = reader.bytes("seeds", &[Any("M"), Is(SEED_BYTES)])?;
    let seeds: Vec<StrokeSeed> = bytes.as_chunks().0.iter().map(seed).collect();
    let names: Vec<String> =
        (0..=MAX_TEXTURES).map(texture_name).take_while(|name| reader.has(name)).collect();
    // Before textures are unpacked, which takes most of the time.
    validate(&words, &seeds, names.len())?;
    let texture = |name: &String| {
        let (bytes, _) = reader.bytes(name, &[Any("bytes")])?;
        texture::decode(name, bytes).map(Arc::new)
    };
    let textures = names.iter().map(texture).collect::<Result<_, Mismatch>>()?;
    Ok(Strokes { seeds, words, textures })
}

/// Adds the strokes of a look of `n` Gaussians to a file.
pub fn write<'a>(strokes: &'a Strokes, n: usize, writer: &mut Writer<'a>) -> Result<(), Mismatch> {
    let Strokes { seeds, words, textures } = strokes;
    if words.len() != n {
        return Err(mismatch(
            format_args!("{} words of strokes", words.len()),
            format_args!("{n}, one per Gaussian"),
        ));
    }
    validate(words, seeds, textures.len())?;
    writer.u32("words", &[n], words);
    let bytes: Vec<u8> = seeds.iter().flat_map(seed_bytes).collect();
    writer.u8("seeds", &[seeds.len(), SEED_BYTES], bytes);
    for (t, texture) in textures.iter().enumerate() {
        let bytes = texture::encode(texture);
        writer.u8(&texture_name(t), &[bytes.len()], bytes);
    }
    Ok(())
}

fn texture_name(t: usize) -> String {
    format!("texture.{t}")
}

fn seed(bytes: &[u8; SEED_BYTES]) -> StrokeSeed {
    let numbers: [u32; SEED_BYTES / 4] =
        std::array::from_fn(|i| u32::from_le_bytes(std::array::from_fn(|k| bytes[4 * i + k])));
    let [x, y, z, pitch, rotation_xy, rotation_z_aspect, place, look] = numbers;
    let at = [x, y, z].map(f32::from_bits);
    StrokeSeed { at, pitch: f32::from_bits(pitch), rotation_xy, rotation_z_aspect, place, look }
}

fn seed_bytes(seed: &StrokeSeed) -> impl Iterator<Item = u8> + use<> {
    let [x, y, z] = seed.at.map(f32::to_bits);
    let StrokeSeed { rotation_xy, rotation_z_aspect, place, look, .. } = *seed;
    [x, y, z, seed.pitch.to_bits(), rotation_xy, rotation_z_aspect, place, look]
        .into_iter()
        .flat_map(u32::to_le_bytes)
}

/// Checks that words name seeds, seeds name textures, and numbers can be drawn with.
fn validate(words: &[u32], seeds: &[StrokeSeed], n_textures: usize) -> Result<(), Mismatch> {
    if seeds.len() > MAX_SEEDS {
        return Err(mismatch(format_args!("{} seeds", seeds.len()), format_args!("at most {MAX_SEEDS}")));
    }
    if n_textures > MAX_TEXTURES {
        return Err(mismatch(format_args!("more than {MAX_TEXTURES} textures"), "no more"));
    }
    // A Gaussian without strokes names the first seed, which need not be there.
    let is_there = |word: &u32| {
        let StrokeWord { seed, share, .. } = StrokeWord::unpacked(*word);
        (seed as usize) < seeds.len() || (seed == 0 && share == 0.0)
    };
    if let Some(i) = words.iter().position(|word| !is_there(word)) {
        let seed = StrokeWord::unpacked(words[i]).seed;
        let found = format_args!("`words` with seed {seed} at {i}");
        return Err(mismatch(found, format_args!("one of {} seeds", seeds.len())));
    }
    for (i, seed) in seeds.iter().enumerate() {
        let aspect = f16::from_bits((seed.rotation_z_aspect >> 16) as u16).to_f32();
        let is_size = |x: f32| x > 0.0 && x.is_finite();
        if !seed.at.iter().all(|x| x.is_finite()) || !is_size(seed.pitch) || !is_size(aspect) {
            let StrokeSeed { at, pitch, .. } = seed;
            let found = format_args!("seed {i} at {at:?} with {pitch} and {aspect} texels to a unit");
            return Err(mismatch(found, "finite positions and sizes above 0"));
        }
        let texture = usize::from((seed.look >> 16) as u8);
        if texture >= n_textures {
            let found = format_args!("seed {i} with texture {texture}");
            return Err(mismatch(found, format_args!("one of {n_textures} textures")));
        }
    }
    Ok(())
}
