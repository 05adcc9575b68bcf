//! Values as they lie in memory, and painted scenes of them.

use std::{borrow::Cow, sync::Arc};

use bytemuck::{Pod, cast_slice, pod_collect_to_vec};

use super::ApartError;
use crate::{
    paint::Painted,
    strokes::{FINE_SIDE, StrokeSeed, StrokeTexture, StrokeWord, Strokes, WIDE_SIDE},
};

/// Bytes in pieces, of which large ones are not copied.
pub type Pieces<'a> = Vec<Cow<'a, [u8]>>;

/// The bytes of values.
pub(super) fn piece<T: Pod>(values: &[T]) -> Cow<'_, [u8]> {
    Cow::Borrowed(cast_slice(values))
}

/// The bytes of values that are not kept.
pub(super) fn own<T: Pod>(values: &[T]) -> Cow<'static, [u8]> {
    Cow::Owned(cast_slice(values).to_vec())
}

/// Bytes that are read from their beginning.
pub(super) struct Reader<'a>(pub(super) &'a [u8]);

impl Reader<'_> {
    /// The next `n` values. Nothing is allocated before it is known that they are there.
    pub(super) fn values<T: Pod>(&mut self, n: usize) -> Result<Vec<T>, ApartError> {
        let parts = n.checked_mul(size_of::<T>()).and_then(|n_bytes| self.0.split_at_checked(n_bytes));
        let (part, rest) = parts.ok_or(ApartError::Part)?;
        self.0 = rest;
        Ok(pod_collect_to_vec(part))
    }

    /// The next values, a few of them.
    pub(super) fn some<T: Pod, const N: usize>(&mut self) -> Result<[T; N], ApartError> {
        self.values(N)?.try_into().map_err(|_| ApartError::Part)
    }

    /// The next value.
    pub(super) fn one<T: Pod>(&mut self) -> Result<T, ApartError> {
        Ok(self.some::<T, 1>()?[0])
    }

    /// The next number of things.
    pub(super) fn count(&mut self) -> Result<usize, ApartError> {
        Ok(self.one::<u32>()? as usize)
    }

    /// A list of values, which begins with their number.
    pub(super) fn list<T: Pod>(&mut self) -> Result<Vec<T>, ApartError> {
        let n = self.count()?;
        self.values(n)
    }

    /// Sees that nothing is left.
    pub(super) fn end(self) -> Result<(), ApartError> {
        if self.0.is_empty() { Ok(()) } else { Err(ApartError::More(self.0.len())) }
    }
}

impl Painted {
    /// Colors and strokes as bytes: the numbers of Gaussians, seeds and textures, then colors, words, seeds,
    /// and textures with their mipmaps, as they lie in memory. Nothing is rounded, as it is in the file of a
    /// look. Without seeds there are no words.
    pub fn to_bytes(&self) -> Vec<u8> {
        let Strokes { seeds, words, textures } = &self.strokes;
        let counts = [self.colors.len(), seeds.len(), textures.len()].map(|n| n as u32);
        let words = if seeds.is_empty() { &[] } else { &words[..] };
        let levels = textures.iter().flat_map(|texture| texture.fine.iter().chain(&texture.wide));
        let parts = [cast_slice(&counts), cast_slice(&self.colors), cast_slice(words), cast_slice(seeds)];
        let parts: Vec<&[u8]> = parts.into_iter().chain(levels.map(|level| cast_slice(level))).collect();
        parts.concat()
    }

    /// Reads what [`to_bytes`](Self::to_bytes) has written.
    ///
    /// # Errors
    /// If there are fewer bytes, or more, or if a stroke names a seed or a texture that is not there.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ApartError> {
        let mut reader = Reader(bytes);
        let [n, n_seeds, n_textures] = reader.some::<u32, 3>()?.map(|n| n as usize);
        let colors = reader.values(n)?;
        let words: Vec<u32> = reader.values(if n_seeds > 0 { n } else { 0 })?;
        let seeds: Vec<StrokeSeed> = reader.values(n_seeds)?;
        let textures: Vec<_> =
            (0..n_textures).map(|_| texture(&mut reader)).collect::<Result<_, ApartError>>()?;
        reader.end()?;
        let is_there = |word: StrokeWord| word.share <= 0.0 || (word.seed as usize) < n_seeds;
        if !words.iter().all(|word| is_there(StrokeWord::unpacked(*word))) {
            return Err(ApartError::Unknown { what: "seed" });
        }
        if !seeds.iter().all(|seed| usize::from(seed.plain().texture) < n_textures) {
            return Err(ApartError::Unknown { what: "texture" });
        }
        Ok(Self { colors, strokes: Strokes { seeds, words, textures }, ..Self::default() })
    }
}

fn texture(reader: &mut Reader) -> Result<Arc<StrokeTexture>, ApartError> {
    let fine = levels(reader, FINE_SIDE)?;
    Ok(Arc::new(StrokeTexture { fine, wide: levels(reader, WIDE_SIDE)? }))
}

/// A texture and its mipmaps down to one texel.
fn levels(reader: &mut Reader, side: usize) -> Result<Vec<Vec<[i8; 4]>>, ApartError> {
    (0..=side.ilog2()).map(|level| reader.values((side >> level).pow(2))).collect()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// Three Gaussians with strokes of two seeds and a texture.
    fn painted() -> Painted {
        let texels =
            |side: usize| (0..side * side).map(|i| Vec3::splat((i % 251) as f32 / 251.0 - 0.5)).collect();
        let seed = |x: f32| StrokeSeed { at: [x, 0.0, 0.0], pitch: 100.0, ..StrokeSeed::default() };
        let word = |seed| StrokeWord { seed, protection: 0.5, share: 1.0 }.packed();
        Painted {
            colors: vec![[0.1, 0.2, 0.3], [-0.25, 0.5, 1.25], [0.7, 0.8, 0.9]],
            strokes: Strokes {
                seeds: vec![seed(1.0), seed(2.0)],
                words: vec![word(1), word(0), word(1)],
                textures: vec![Arc::new(StrokeTexture::new(texels(FINE_SIDE), texels(WIDE_SIDE)))],
            },
            fine_energy: 0.0,
        }
    }

    #[test]
    fn bytes_hold_all_that_is_painted() {
        let mut painted = painted();
        let bytes = painted.to_bytes();
        // A third of the texels more for mipmaps: 4^10 + ... + 1 = (4^10 - 1) / 3 texels of fine detail.
        assert_eq!(
            bytes.len(),
            12 + 3 * 16 + 2 * 32 + 4 * ((4_usize.pow(10) - 1) / 3 + (4_usize.pow(8) - 1) / 3)
        );
        let read = Painted::from_bytes(&bytes).unwrap();
        assert_eq!((read.colors, read.strokes), (painted.colors.clone(), painted.strokes.clone()));
        for end in [0, 11, 12, 60, 124, bytes.len() - 1] {
            assert_eq!(Painted::from_bytes(&bytes[..end]).unwrap_err(), ApartError::Part);
        }
        assert_eq!(Painted::from_bytes(&[&bytes[..], &[0]].concat()).unwrap_err(), ApartError::More(1));
        // Counts that no bytes follow.
        assert_eq!(Painted::from_bytes(&[0xff; 12]).unwrap_err(), ApartError::Part);
        painted.strokes.seeds.clear();
        painted.strokes.textures.clear();
        let read = Painted::from_bytes(&painted.to_bytes()).unwrap();
        assert_eq!((&read.colors, &read.strokes), (&painted.colors, &Strokes::default()));
    }

    #[test]
    fn strokes_that_name_nothing_are_refused() {
        let mut other = painted();
        other.strokes.words[1] = StrokeWord { seed: 2, protection: 0.0, share: 1.0 }.packed();
        let error = Painted::from_bytes(&other.to_bytes()).unwrap_err();
        assert_eq!(error, ApartError::Unknown { what: "seed" });
        let mut other = painted();
        other.strokes.textures.clear();
        let error = Painted::from_bytes(&other.to_bytes()).unwrap_err();
        assert_eq!(error, ApartError::Unknown { what: "texture" });
    }
}
