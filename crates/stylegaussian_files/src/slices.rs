//! Scenes that are read in slices, for those that need not fit in memory.

use std::{
    fs::File,
    io::{Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

use super::{
    error::{FileError, Loaded, Mismatch, mismatch},
    files::{Files, Unread},
    format::ReadOptions,
    formats::format_of,
    ply,
    rows::Header,
    scenes::{extension, read_as_told, read_scene_with},
    splat,
};

/// Gaussians of a slice: with spherical harmonics of degree 3, 65 MB of a `.ply`.
const ROWS: u64 = 1 << 18;

/// Bytes at the beginning of a file that hold a header. Longer ones are read as a whole.
const HEAD: u64 = 1 << 16;

/// The parts of a scene, one after another: slices of a binary `.ply` or a `.splat`, the whole of any other
/// file. A slice may have no usable Gaussian.
#[derive(Debug)]
pub struct Slices {
    path: PathBuf,
    options: ReadOptions,
    rows: Option<Rows>,
    is_done: bool,
}

/// A file of rows of one size.
#[derive(Debug)]
struct Rows {
    file: File,
    /// The header for this many rows.
    header: Header,
    /// Rows that are not read yet.
    left: u64,
    /// Most rows of a slice.
    most: u64,
}

impl Slices {
    /// The slices of the scene at `path`.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(path: &Path, options: ReadOptions) -> Result<Self, FileError> {
        Self::of(path, options, ROWS)
    }

    /// As [`open`](Self::open), with `most` Gaussians in a slice.
    fn of(path: &Path, options: ReadOptions, most: u64) -> Result<Self, FileError> {
        let rows = if path.is_file() { rows(path, most)? } else { None };
        Ok(Self { path: path.into(), options, rows, is_done: false })
    }

    fn slice(&mut self) -> Option<Result<Loaded, FileError>> {
        let Some(rows) = &mut self.rows else {
            return (!std::mem::replace(&mut self.is_done, true))
                .then(|| read_scene_with(&self.path, self.options));
        };
        if rows.left == 0 {
            return None;
        }
        let n = rows.left.min(rows.most);
        let mut bytes = rows.header.of(n);
        let begin = bytes.len();
        bytes.resize(begin + (n * rows.header.row) as usize, 0);
        let read = rows.file.read_exact(&mut bytes[begin..]);
        rows.left -= n;
        let path = &self.path;
        Some(match read {
            Err(source) => Err(FileError::Io { path: path.into(), source }),
            Ok(()) => parsed(bytes, &extension(path), self.options).map_err(|mismatch| mismatch.at(path)),
        })
    }
}

impl Iterator for Slices {
    type Item = Result<Loaded, FileError>;

    fn next(&mut self) -> Option<Self::Item> {
        let slice = self.slice()?;
        if slice.is_err() {
            // Nothing follows an error.
            self.is_done = true;
            if let Some(rows) = &mut self.rows {
                rows.left = 0;
            }
        }
        Some(slice)
    }
}

/// The rows of a file, or `None` if it is read as a whole: of another format, with several elements, or of
/// another size than its header says, for which its reader has the words.
fn rows(path: &Path, most: u64) -> Result<Option<Rows>, FileError> {
    let at = |source| FileError::Io { path: path.into(), source };
    let mut file = File::open(path).map_err(at)?;
    let size = file.metadata().map_err(at)?.len();
    let mut head = Vec::new();
    file.by_ref().take(HEAD).read_to_end(&mut head).map_err(at)?;
    let header = match format_of(&head, &extension(path)) {
        Ok(format) if format.name == ply::FORMAT.name => ply::rows(&head),
        Ok(format) if format.name == splat::FORMAT.name => {
            Some(Header { row: splat::ROW as u64, ..Header::default() })
        }
        _ => None,
    };
    let Some(header) = header.filter(|header| header.row > 0) else { return Ok(None) };
    let n_bytes = size.saturating_sub(header.size);
    let left = n_bytes / header.row;
    if left * header.row != n_bytes || header.count.is_some_and(|count| count != left) || left <= most {
        return Ok(None);
    }
    file.seek(SeekFrom::Start(header.size)).map_err(at)?;
    Ok(Some(Rows { file, header, left, most }))
}

/// Reads a slice as a file of its own.
fn parsed(bytes: Vec<u8>, extension: &str, options: ReadOptions) -> Result<Loaded, Mismatch> {
    read_as_told(&mut Files::new(bytes, extension.into()), &options).map_err(|error| match error {
        Unread::Mismatch(refused) => refused,
        Unread::Needs(names) => {
            let found = format_args!("a scene that names {}", names.join(", ")).to_string();
            mismatch(found, "one in a single file")
        }
    })
}

#[cfg(test)]
mod tests {
    use stylegaussian::Scene;

    use super::*;
    use crate::{tests::full_scene, write_scene};

    fn many(n: usize) -> Scene {
        let scene = full_scene();
        let indices: Vec<u32> = (0..n).map(|i| (i % scene.len()) as u32).collect();
        let mut many = scene.subset(&indices);
        many.order = (0..n as u32).collect();
        many.n_source = n;
        many.means.iter_mut().enumerate().for_each(|(i, mean)| mean.x += i as f32);
        many
    }

    #[test]
    fn slices_together_are_the_scene() {
        let dir = tempfile::tempdir().unwrap();
        let scene = Scene { features: None, neighbors: None, decoder: None, mask: None, ..many(37) };
        for name in ["a.splat", "a.ply"] {
            let path = dir.path().join(name);
            write_scene(&path, &scene.with_sh_degree_at_most(0)).unwrap();
            let whole = read_scene_with(&path, ReadOptions::default()).unwrap().scene;
            let slices: Vec<Scene> = Slices::of(&path, ReadOptions::default(), 16)
                .unwrap()
                .map(|slice| slice.unwrap().scene)
                .collect();
            assert_eq!(slices.iter().map(Scene::len).collect::<Vec<_>>(), [16, 16, 5], "{name}");
            let means: Vec<_> = slices.iter().flat_map(|slice| &slice.means).copied().collect();
            let scales: Vec<_> = slices.iter().flat_map(|slice| &slice.scales).copied().collect();
            assert_eq!((means, scales), (whole.means, whole.scales), "{name}");
        }
    }

    #[test]
    fn other_files_are_read_as_a_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.spz");
        write_scene(&path, &many(30)).unwrap();
        let mut slices = Slices::open(&path, ReadOptions::default()).unwrap();
        assert_eq!(slices.next().unwrap().unwrap().scene.len(), 30);
        assert!(slices.next().is_none());
        let mut none = Slices::open(&dir.path().join("none.ply"), ReadOptions::default()).unwrap();
        assert!(none.next().unwrap().is_err());
        // A file that was cut gets the error of its reader.
        let path = dir.path().join("cut.ply");
        write_scene(&path, &many(30)).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        let mut slices = Slices::of(&path, ReadOptions::default(), 16).unwrap();
        let error = slices.next().unwrap().unwrap_err().to_string();
        assert!(error.contains("cut.ply") && error.contains("bytes after the header"), "{error}");
        assert!(slices.next().is_none());
    }
}
