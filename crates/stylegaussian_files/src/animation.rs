//! Animated pictures as WebP, without loss: <https://developers.google.com/speed/webp/docs/riff_container>.

use std::path::{Path, PathBuf};

use glam::UVec2;
use image_webp::{ColorType, WebPEncoder};

use super::{
    atomic::write_atomically,
    error::{FileError, mismatch},
};

/// Bytes before the first chunk of a picture's file: `RIFF`, a length, `WEBP`.
const RIFF_HEADER: usize = 12;

/// The longest side of a picture, in pixels: lossless ones have 14 bits for it.
const MAX_SIDE: u32 = 1 << 14;

/// Flags of the chunk `VP8X`.
const IS_ANIMATED: u8 = 1 << 1;
const HAS_ALPHA: u8 = 1 << 4;

/// Flag of the chunk `ANMF`: a picture replaces the one before, and is not blended with it.
const REPLACES: u8 = 1 << 1;

/// A film that begins again at its end, as the bytes of a WebP file.
pub struct WebpAnimation {
    path: PathBuf,
    size: UVec2,
    frames_per_second: f64,
    n_frames: u32,
    has_alpha: bool,
    /// The pictures' chunks.
    chunks: Vec<u8>,
}

impl WebpAnimation {
    /// An empty film of pictures of `size` pixels for the file at `path`. Up to 1000 frames per second differ
    /// in time.
    ///
    /// # Errors
    /// If WebP has no pictures of this size.
    pub fn new(path: &Path, size: UVec2, frames_per_second: f64) -> Result<Self, FileError> {
        if size.min_element() == 0 || size.max_element() > MAX_SIDE {
            let found = format_args!("pictures of {}x{} pixels", size.x, size.y).to_string();
            return Err(mismatch(found, format_args!("1 to {MAX_SIDE} on a side, as WebP has them")).at(path));
        }
        let (path, chunks) = (path.into(), Vec::new());
        Ok(Self { path, size, frames_per_second, n_frames: 0, has_alpha: false, chunks })
    }

    /// Adds a picture: row-major RGBA with straight alpha, `[H, W]`, from the top left.
    ///
    /// # Errors
    /// If the film becomes too long for the format, which holds 4 GiB.
    ///
    /// # Panics
    /// If there are more or fewer pixels.
    pub fn push(&mut self, rgba: &[[u8; 4]]) -> Result<(), FileError> {
        let UVec2 { x: width, y: height } = self.size;
        let is_opaque = rgba.iter().all(|[.., alpha]| *alpha == 255);
        let mut picture = Vec::new();
        let encoder = WebPEncoder::new(&mut picture);
        let encoded = if is_opaque {
            let rgb: Vec<[u8; 3]> = rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
            encoder.encode(rgb.as_flattened(), width, height, ColorType::Rgb8)
        } else {
            encoder.encode(rgba.as_flattened(), width, height, ColorType::Rgba8)
        };
        encoded.map_err(|error| self.error(error.to_string(), "pictures that WebP can hold"))?;
        self.has_alpha |= !is_opaque;
        // Frames begin at the nearest millisecond, so that rounding does not add up.
        let begin = |frame: u32| (f64::from(frame) * 1000.0 / self.frames_per_second).round() as u32;
        let milliseconds = begin(self.n_frames + 1) - begin(self.n_frames);
        let mut frame = Vec::with_capacity(16 + picture.len());
        for number in [0, 0, width - 1, height - 1, milliseconds] {
            frame.extend(&number.to_le_bytes()[..3]);
        }
        frame.push(REPLACES);
        frame.extend(&picture[RIFF_HEADER..]);
        if self.chunks.len() as u64 + frame.len() as u64 > u64::from(u32::MAX) - 64 {
            return Err(self.error(format!("a film of {} pictures", self.n_frames + 1), "at most 4 GiB"));
        }
        push_chunk(&mut self.chunks, *b"ANMF", &frame);
        self.n_frames += 1;
        Ok(())
    }

    /// Writes the file, as a whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written, or there is no picture.
    pub fn write(&self) -> Result<(), FileError> {
        if self.n_frames == 0 {
            return Err(self.error("no picture".into(), "at least one"));
        }
        let mut head = b"WEBP".to_vec();
        let flags = IS_ANIMATED | if self.has_alpha { HAS_ALPHA } else { 0 };
        let mut extended = vec![flags, 0, 0, 0];
        for side in [self.size.x, self.size.y] {
            extended.extend(&(side - 1).to_le_bytes()[..3]);
        }
        push_chunk(&mut head, *b"VP8X", &extended);
        // A transparent background, and no end.
        push_chunk(&mut head, *b"ANIM", &[0; 6]);
        // Below 4 GiB: `push` has checked it.
        let length = (head.len() + self.chunks.len()) as u32;
        write_atomically(&self.path, |out| {
            out.write_all(b"RIFF")?;
            out.write_all(&length.to_le_bytes())?;
            out.write_all(&head)?;
            out.write_all(&self.chunks)
        })
    }

    fn error(&self, found: String, expected: &str) -> FileError {
        mismatch(found, expected).at(&self.path)
    }
}

/// Appends a chunk, padded to an even length.
fn push_chunk(bytes: &mut Vec<u8>, name: [u8; 4], contents: &[u8]) {
    bytes.extend(name);
    bytes.extend((contents.len() as u32).to_le_bytes());
    bytes.extend(contents);
    if !contents.len().is_multiple_of(2) {
        bytes.push(0);
    }
}

#[cfg(test)]
mod tests {
    use std::{fs, io::Cursor};

    use image_webp::{LoopCount, WebPDecoder};

    use super::*;

    /// A picture of 5 x 3 pixels.
    fn picture(frame: u8, alpha: u8) -> Vec<[u8; 4]> {
        (0..15).map(|i| [frame, 16 * i, 255 - i, if i == 7 { alpha } else { 255 }]).collect()
    }

    #[test]
    fn a_film_is_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.webp");
        for alpha in [255, 30] {
            let mut film = WebpAnimation::new(&path, UVec2::new(5, 3), 30.0).unwrap();
            let pictures: Vec<_> = (0..4).map(|frame| picture(frame, alpha)).collect();
            pictures.iter().for_each(|picture| film.push(picture).unwrap());
            film.write().unwrap();
            let mut read = WebPDecoder::new(Cursor::new(fs::read(&path).unwrap())).unwrap();
            assert!(read.is_animated());
            assert_eq!((read.dimensions(), read.num_frames()), ((5, 3), 4));
            assert_eq!((read.loop_count(), read.has_alpha()), (LoopCount::Forever, alpha < 255));
            let channels = if alpha < 255 { 4 } else { 3 };
            let mut durations = Vec::new();
            for picture in &pictures {
                let mut pixels = vec![0; 15 * channels];
                durations.push(read.read_frame(&mut pixels).unwrap());
                let found: Vec<&[u8]> = pixels.chunks(channels).collect();
                let expected: Vec<&[u8]> = picture.iter().map(|pixel| &pixel[..channels]).collect();
                assert_eq!(found, expected);
            }
            // 33.3 ms each.
            assert_eq!(durations, [33, 34, 33, 33]);
        }
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn nothing_and_impossible_sizes_are_refused() {
        let path = Path::new("a.webp");
        let error = WebpAnimation::new(path, UVec2::new(16_385, 4), 30.0).err().unwrap().to_string();
        assert!(error.starts_with("a.webp: found pictures of 16385x4 pixels, expected"), "{error}");
        let empty = WebpAnimation::new(path, UVec2::new(4, 4), 30.0).unwrap();
        assert!(empty.write().unwrap_err().to_string().contains("found no picture"));
    }
}
