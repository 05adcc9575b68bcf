//! Textures of strokes in bytes.
//!
//! Two bytes, the steps of luminance and of chroma in 127ths, then a zlib stream: for fine detail (512 x 512)
//! and wide detail (128 x 128), planes of luminance Y, red - Y and blue - Y in signed bytes of that many
//! 127ths, row by row. A byte is the difference from the median of the texel to the left, the one above, and
//! left + above - above left (as in LOCO-I, Weinberger et al. 2000). Mipmaps are made anew.
//!
//! Chroma has larger steps and not fewer texels: dots of a print are chroma, of a texel's size, and half as
//! many texels would put them off by 24 of 255 in the mean. The finest steps are taken that fit [`MOST_BYTES`].
//! Those of the eight paintings in `assets/styles` are 1 to 4 of luminance and 2 to 12 of chroma. The demo
//! scene drawn with a look and with the strokes that it was written from differs by 2.3 (halftone), 3.5
//! (mosaic) and 4.7 (dots) of 255, root mean square, bytes of color included. It is not seen.

use std::io::{Read, Write};

use flate2::{Compression, read::ZlibDecoder, write::ZlibEncoder};
use glam::Vec3;
use stylegaussian::{
    palette::LUMINANCE,
    strokes::{FINE_SIDE, StrokeTexture, WIDE_SIDE},
};

use crate::error::{Mismatch, mismatch};

/// Bytes that a texture should not exceed.
const MOST_BYTES: usize = 300_000;

/// Steps of luminance and of chroma, the finest first. Differences of chroma span twice the range of a byte.
const STEPS: [(u8, u8); 9] = [(1, 2), (1, 4), (2, 4), (2, 6), (3, 6), (3, 8), (3, 10), (4, 12), (8, 24)];

/// Sides of the two textures.
const SIDES: [usize; 2] = [FINE_SIDE, WIDE_SIDE];

/// Bytes of all planes.
const N_BYTES: usize = 3 * (FINE_SIDE * FINE_SIDE + WIDE_SIDE * WIDE_SIDE);

/// The largest value of a texel.
const LARGEST: f32 = 127.0;

/// The texture in bytes.
pub fn encode(texture: &StrokeTexture) -> Vec<u8> {
    let levels = [&texture.fine[0], &texture.wide[0]];
    let with_steps = |steps: (u8, u8)| {
        let mut planes = Vec::with_capacity(N_BYTES);
        for (texels, side) in levels.into_iter().zip(SIDES) {
            for plane in split(texels, steps) {
                planes.extend(differences(&plane, side));
            }
        }
        let mut out = ZlibEncoder::new(vec![steps.0, steps.1], Compression::best());
        // A vector takes everything.
        out.write_all(&planes).and_then(|()| out.finish()).unwrap_or_default()
    };
    let mut bytes = Vec::new();
    for steps in STEPS {
        bytes = with_steps(steps);
        if bytes.len() <= MOST_BYTES {
            break;
        }
    }
    bytes
}

/// The texture in these bytes, which `name` names in errors.
pub fn decode(name: &str, bytes: &[u8]) -> Result<StrokeTexture, Mismatch> {
    let broken = |found: &str| mismatch(format_args!("`{name}` {found}"), "the bytes of a texture");
    let ([luminance, chroma], packed) = bytes.split_first_chunk().ok_or_else(|| broken("without steps"))?;
    let steps = [luminance, chroma].map(|step| f32::from(*step));
    // One more than expected, so that a longer stream is seen.
    let mut planes = Vec::new();
    let unpacked = ZlibDecoder::new(packed).take(N_BYTES as u64 + 1).read_to_end(&mut planes);
    if unpacked.is_err() || planes.len() != N_BYTES {
        return Err(broken(&format!("of {} unpacked bytes or more", planes.len())));
    }
    let mut rest = &planes[..];
    let mut texels = |side: usize| {
        let planes: [Vec<i8>; 3] = std::array::from_fn(|_| {
            let (plane, after) = rest.split_at(side * side);
            rest = after;
            summed(plane, side)
        });
        joined(&planes, steps)
    };
    let [fine, wide] = SIDES.map(&mut texels);
    Ok(StrokeTexture::new(fine, wide))
}

/// Planes of luminance, red - luminance and blue - luminance.
fn split(texels: &[[i8; 4]], (luminance, chroma): (u8, u8)) -> [Vec<i8>; 3] {
    let steps = [luminance, chroma].map(f32::from);
    let mut planes: [Vec<i8>; 3] = std::array::from_fn(|_| Vec::with_capacity(texels.len()));
    for [r, g, b, _] in texels {
        let color = Vec3::new((*r).into(), (*g).into(), (*b).into());
        // The casts saturate.
        let y = (color.dot(LUMINANCE) / steps[0]).round() as i8;
        // From the luminance as it will be read, so that its error is not added.
        let from_y = |x: f32| ((x - f32::from(y) * steps[0]) / steps[1]).round() as i8;
        for (plane, value) in planes.iter_mut().zip([y, from_y(color.x), from_y(color.z)]) {
            plane.push(value);
        }
    }
    planes
}

/// The inverse of [`split`], as numbers -1..1.
fn joined([y, red, blue]: &[Vec<i8>; 3], steps: [f32; 2]) -> Vec<Vec3> {
    let texel = |((y, red), blue): ((&i8, &i8), &i8)| {
        let y = f32::from(*y) * steps[0];
        let [r, b] = [red, blue].map(|x| y + f32::from(*x) * steps[1]);
        let g = (y - LUMINANCE.x * r - LUMINANCE.z * b) / LUMINANCE.y;
        Vec3::new(r, g, b) / LARGEST
    };
    y.iter().zip(red).zip(blue).map(texel).collect()
}

/// The expected value of texel `i`, from those before it: the median of its neighbors and their plane.
fn expected(plane: &[i8], side: usize, i: usize) -> i16 {
    let at = |is_there: bool, back: usize| if is_there { i16::from(plane[i - back]) } else { 0 };
    let (has_left, has_above) = (!i.is_multiple_of(side), i >= side);
    let (left, above) = (at(has_left, 1), at(has_above, side));
    let corner = at(has_left && has_above, side + 1);
    (left + above - corner).clamp(left.min(above), left.max(above))
}

/// Texels less their predictions.
fn differences(plane: &[i8], side: usize) -> impl Iterator<Item = u8> {
    // The cast keeps the low byte, and so does the way back.
    plane.iter().enumerate().map(move |(i, value)| (i16::from(*value) - expected(plane, side, i)) as u8)
}

/// The inverse of [`differences`].
fn summed(differences: &[u8], side: usize) -> Vec<i8> {
    let mut plane = Vec::with_capacity(differences.len());
    for (i, difference) in differences.iter().enumerate() {
        plane.push((expected(&plane, side, i) + i16::from(*difference)) as i8);
    }
    plane
}

#[cfg(test)]
mod tests {
    use stylegaussian::random::Random;

    use super::*;

    /// Waves of color, of texels' size and larger, and some noise.
    fn texture(noise: f32) -> StrokeTexture {
        let mut random = Random::new(3);
        let mut texels = |side: usize| -> Vec<Vec3> {
            let texel = |i: usize| {
                let (x, y) = ((i % side) as f32, (i / side) as f32);
                let waves = Vec3::new((0.9 * x).sin(), (0.2 * x + 0.1 * y).cos(), (0.31 * y).sin());
                0.4 * waves + noise * (random.uniform() - 0.5)
            };
            (0..side * side).map(texel).collect()
        };
        StrokeTexture::new(texels(FINE_SIDE), texels(WIDE_SIDE))
    }

    #[test]
    fn textures_come_back_within_their_steps() {
        for noise in [0.0, 0.05, 0.4] {
            let texture = texture(noise);
            let bytes = encode(&texture);
            assert!(bytes.len() <= MOST_BYTES, "{} bytes at noise {noise}", bytes.len());
            let steps = [bytes[0], bytes[1]].map(f32::from);
            assert!(noise > 0.0 || steps == [1.0, 2.0], "{steps:?}");
            let read = decode("t", &bytes).unwrap();
            let levels = [(&texture.fine[0], &read.fine[0]), (&texture.wide[0], &read.wide[0])];
            for (a, b) in levels.into_iter().flat_map(|(a, b)| a.iter().zip(b)) {
                let luminance = |t: &[i8; 4]| Vec3::new(t[0].into(), t[1].into(), t[2].into()).dot(LUMINANCE);
                // Half a step, and the rounding of the texel that is read.
                assert!((luminance(a) - luminance(b)).abs() <= 0.5 * steps[0] + 0.51, "{a:?} {b:?}");
                for c in [0, 2] {
                    let error = (f32::from(a[c]) - f32::from(b[c])).abs();
                    assert!(error <= 0.5 * steps[1] + 0.51, "{a:?} {b:?}, steps {steps:?}");
                }
            }
        }
    }

    #[test]
    fn the_median_of_neighbors_by_hand() {
        let plane = [10, 20, 5, 12];
        // Nothing; the left one; the one above; 5 + 20 - 10 = 15, between 5 and 20.
        assert_eq!([0, 1, 2, 3].map(|i| expected(&plane, 2, i)), [0, 10, 10, 15]);
        assert_eq!(differences(&plane, 2).collect::<Vec<_>>(), [10, 10, 251, 253]);
        assert_eq!(summed(&[10, 10, 251, 253], 2), plane);
    }

    #[test]
    fn other_bytes_are_refused() {
        let bytes = encode(&texture(0.0));
        let refused = |bytes: &[u8]| decode("t", bytes).unwrap_err();
        for end in [0, 1, 2, 3, 100, bytes.len() - 1] {
            refused(&bytes[..end]);
        }
        // A stream of zeros that would fill the memory.
        let mut long = ZlibEncoder::new(vec![1, 2], Compression::best());
        long.write_all(&vec![0; 4 * N_BYTES]).unwrap();
        let message = format!("{:?}", refused(&long.finish().unwrap()));
        assert!(message.contains(&format!("of {} unpacked", N_BYTES + 1)), "{message}");
        let mut changed = bytes.clone();
        changed[bytes.len() / 2] ^= 0x10;
        // The stream's sum tells, if nothing else does.
        refused(&changed);
    }
}
