//! A painted scene as bytes, for the way between the page and its worker. Nothing is rounded, as it is in the
//! file of a look.

use std::sync::Arc;

use bevy_stylegaussian::stylegaussian::{
    paint::Painted,
    strokes::{FINE_SIDE, StrokeTexture, Strokes, WIDE_SIDE},
};
use bytemuck::{Pod, cast_slice, pod_collect_to_vec};

/// The numbers of Gaussians, seeds and textures, then colors, words, seeds, and textures with their mipmaps, as
/// they lie in memory: page and worker run the same module. Without seeds there are no words.
pub fn to_bytes(painted: &Painted) -> Vec<u8> {
    let Strokes { seeds, words, textures } = &painted.strokes;
    let counts = [painted.colors.len(), seeds.len(), textures.len()].map(|n| n as u32);
    let words = if seeds.is_empty() { &[] } else { &words[..] };
    let levels = textures.iter().flat_map(|texture| texture.fine.iter().chain(&texture.wide));
    let parts = [cast_slice(&counts), cast_slice(&painted.colors), cast_slice(words), cast_slice(seeds)];
    let parts: Vec<&[u8]> = parts.into_iter().chain(levels.map(|level| cast_slice(level))).collect();
    parts.concat()
}

/// Reads a painted scene that [`to_bytes`] has written.
///
/// # Errors
/// If there are fewer bytes, or more.
pub fn from_bytes(bytes: &[u8]) -> Result<Painted, String> {
    let mut rest = bytes;
    let counts: Vec<u32> = take(&mut rest, 3)?;
    let [n, n_seeds, n_textures] = [0, 1, 2].map(|i| counts[i] as usize);
    let colors = take(&mut rest, n)?;
    let words = take(&mut rest, if n_seeds > 0 { n } else { 0 })?;
    let seeds = take(&mut rest, n_seeds)?;
    let mut texture = |_| {
        let texture =
            StrokeTexture { fine: levels(&mut rest, FINE_SIDE)?, wide: levels(&mut rest, WIDE_SIDE)? };
        Ok(Arc::new(texture))
    };
    let textures = (0..n_textures).map(&mut texture).collect::<Result<_, String>>()?;
    match rest.len() {
        0 => Ok(Painted { colors, strokes: Strokes { seeds, words, textures }, ..Painted::default() }),
        more => Err(format!("found {more} bytes after a painted scene")),
    }
}

/// A texture and its mipmaps down to one texel.
fn levels(rest: &mut &[u8], side: usize) -> Result<Vec<Vec<[i8; 4]>>, String> {
    (0..=side.ilog2()).map(|level| take(rest, (side >> level).pow(2))).collect()
}

/// The next `n` values.
fn take<T: Pod>(rest: &mut &[u8], n: usize) -> Result<Vec<T>, String> {
    let parts = n.checked_mul(size_of::<T>()).and_then(|n_bytes| rest.split_at_checked(n_bytes));
    let (part, after) = parts.ok_or("found a part of a painted scene")?;
    *rest = after;
    Ok(pod_collect_to_vec(part))
}

/// A painted scene with its Gaussians in another order, `indices` `[N]` into the present one.
pub fn in_order(painted: &Painted, indices: &[u32]) -> Painted {
    fn of<T: Copy>(values: &[T], indices: &[u32]) -> Vec<T> {
        indices.iter().map(|i| values[*i as usize]).collect()
    }
    let Strokes { seeds, words, textures } = painted.strokes.clone();
    let words = if words.is_empty() { words } else { of(&words, indices) };
    let strokes = Strokes { seeds, words, textures };
    Painted { colors: of(&painted.colors, indices), strokes, ..*painted }
}

#[cfg(test)]
pub(crate) mod tests {
    use bevy::math::Vec3;
    use bevy_stylegaussian::stylegaussian::strokes::StrokeSeed;

    use super::*;

    /// Three Gaussians with strokes of two seeds and a texture.
    pub(crate) fn painted() -> Painted {
        let texels =
            |side: usize| (0..side * side).map(|i| Vec3::splat((i % 251) as f32 / 251.0 - 0.5)).collect();
        let seed = |x: f32| StrokeSeed { at: [x, 0.0, 0.0], pitch: 100.0, ..StrokeSeed::default() };
        Painted {
            colors: vec![[0.1, 0.2, 0.3], [-0.25, 0.5, 1.25], [0.7, 0.8, 0.9]],
            strokes: Strokes {
                seeds: vec![seed(1.0), seed(2.0)],
                words: vec![7, 8, 9],
                textures: vec![Arc::new(StrokeTexture::new(texels(FINE_SIDE), texels(WIDE_SIDE)))],
            },
            fine_energy: 0.0,
        }
    }

    #[test]
    fn bytes_hold_all_that_is_painted() {
        let painted = painted();
        let bytes = to_bytes(&painted);
        // A third of the texels more for mipmaps: 4^10 + ... + 1 = (4^10 - 1) / 3 texels of fine detail.
        assert_eq!(
            bytes.len(),
            12 + 3 * 16 + 2 * 32 + 4 * ((4_usize.pow(10) - 1) / 3 + (4_usize.pow(8) - 1) / 3)
        );
        let read = from_bytes(&bytes).unwrap();
        assert_eq!((read.colors, read.strokes), (painted.colors, painted.strokes));
        for end in [0, 11, 12, 60, 124, bytes.len() - 1] {
            assert_eq!(from_bytes(&bytes[..end]).unwrap_err(), "found a part of a painted scene");
        }
        assert_eq!(
            from_bytes(&[&bytes[..], &[0]].concat()).unwrap_err(),
            "found 1 bytes after a painted scene"
        );
        // Counts that no bytes follow.
        assert!(from_bytes(&[0xff; 12]).is_err());
    }

    #[test]
    fn words_go_with_seeds_and_gaussians() {
        let mut painted = painted();
        let turned = in_order(&painted, &[2, 0, 1]);
        assert_eq!((turned.colors[0], &turned.strokes.words[..]), (painted.colors[2], &[9, 7, 8][..]));
        assert_eq!(turned.strokes.seeds, painted.strokes.seeds);
        painted.strokes.seeds.clear();
        painted.strokes.textures.clear();
        let read = from_bytes(&to_bytes(&painted)).unwrap();
        assert_eq!((&read.colors, &read.strokes), (&painted.colors, &Strokes::default()));
        assert!(in_order(&read, &[2, 1, 0]).strokes.words.is_empty());
    }
}
