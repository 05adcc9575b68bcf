//! Writing a file as a whole or not at all.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    process,
    sync::atomic::{AtomicU32, Ordering},
};

use super::error::FileError;

/// A partial file, removed on drop unless it was renamed. Drop runs on an error, and on a panic too.
struct Partial {
    path: PathBuf,
    renamed: bool,
}

impl Drop for Partial {
    fn drop(&mut self) {
        if !self.renamed {
            // A failure to remove it is not reported: the error that led here is the one worth reading.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Writes a file beside `path`, syncs it to disk and renames it to `path`, replacing an older file.
///
/// On failure the partial file is removed and an older file stays as it was. If `path` is a device or a pipe
/// (`/dev/full`), it is written to directly, since a file must not replace it.
///
/// # Errors
/// If `write` fails or the operating system refuses.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), FileError> {
    let at = |source| FileError::Io { path: path.into(), source };
    if fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
        let mut out = BufWriter::with_capacity(1 << 18, File::create(path).map_err(at)?);
        return write(&mut out).and_then(|()| out.flush()).map_err(at);
    }
    // `create_new` refuses a path that exists, so that no link there is followed.
    let mut partial = Partial { path: beside(path).map_err(at)?, renamed: false };
    let file = File::create_new(&partial.path).map_err(at)?;
    let mut out = BufWriter::with_capacity(1 << 18, file);
    write(&mut out).map_err(at)?;
    let file = out.into_inner().map_err(|error| at(error.into_error()))?;
    // Without this a power failure may leave the new name with none of the data.
    file.sync_all().map_err(at)?;
    drop(file);
    fs::rename(&partial.path, path).map_err(at)?;
    partial.renamed = true;
    Ok(())
}

/// A name in the same directory that no other writer uses.
fn beside(path: &Path) -> io::Result<PathBuf> {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let Some(name) = path.file_name() else {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "the path names no file"));
    };
    let count = COUNTER.fetch_add(1, Ordering::Relaxed);
    // In the same directory, since a rename is atomic within one file system only. Process and count keep writers
    // apart.
    let name = format!(".{}.{}-{count}.partial", name.to_string_lossy(), process::id());
    Ok(path.with_file_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_the_old_file_only_when_all_is_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        write_atomically(&path, |out| out.write_all(b"first")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"first");

        let error = write_atomically(&path, |out| {
            out.write_all(&[0; 1 << 20])?;
            Err(io::Error::other("no space left"))
        })
        .unwrap_err();
        assert!(error.to_string().ends_with("a.bin: no space left"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"first");

        write_atomically(&path, |out| out.write_all(b"second")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "no partial file is left");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_device_is_written_to_and_stays_a_device() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("full.ply");
        std::os::unix::fs::symlink("/dev/full", &path).unwrap();
        let error = write_atomically(&path, |out| out.write_all(b"x")).unwrap_err();
        assert!(error.to_string().contains("full.ply: No space left"), "{error}");
        assert!(fs::symlink_metadata(&path).unwrap().is_symlink());
    }

    #[test]
    fn names_the_file_that_cannot_be_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("missing/a.bin");
        let error = write_atomically(&path, |_| Ok(())).unwrap_err().to_string();
        assert!(error.contains("missing/a.bin"), "{error}");
        // A directory stands in the way of the rename.
        assert!(write_atomically(dir.path(), |_| Ok(())).is_err());
        assert!(write_atomically(Path::new("/"), |_| Ok(())).is_err());
    }

    #[test]
    fn a_panic_leaves_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        let result = std::panic::catch_unwind(|| write_atomically(&path, |_| panic!("writer")));
        assert!(result.is_err());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}
