//! Writing a file as a whole or not at all.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use super::error::FileError;

mod partial;

use partial::Partial;
pub use partial::abandon_partial_files;

/// Links that are followed to a file, as many as Linux follows.
const MAX_LINKS: usize = 40;

/// Writes a file beside `path`, syncs it to disk and gives it the name `path`, replacing an older file.
///
/// On failure the partial file is removed and an older file stays as it was. The new file has the permissions
/// of the older one. If `path` is a symbolic link, the file that it leads to is replaced and the link stays. If
/// it is a device or a pipe (`/dev/full`), it is written to directly, since a file must not replace it.
///
/// # Errors
/// If `write` fails or the operating system refuses.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), FileError> {
    let at = |source| FileError::Io { path: path.into(), source };
    let found = fs::metadata(path).ok();
    if found.as_ref().is_some_and(|found| !found.is_file() && !found.is_dir()) {
        let mut out = BufWriter::with_capacity(1 << 18, File::create(path).map_err(at)?);
        return write(&mut out).and_then(|()| out.flush()).map_err(at);
    }
    let target = followed(path).map_err(at)?;
    let partial = Partial::beside(&target).map_err(at)?;
    let mut out = BufWriter::with_capacity(1 << 18, &partial.file);
    write(&mut out).and_then(|()| out.flush()).map_err(at)?;
    drop(out);
    if let Some(found) = found.filter(fs::Metadata::is_file) {
        partial.file.set_permissions(found.permissions()).map_err(at)?;
    }
    // Without this a power failure may leave the new name with none of the data.
    partial.file.sync_all().map_err(at)?;
    partial.publish(&target).map_err(at)
}

/// As [`write_atomically`], for another program, which wants a name. `write` gets the name of an empty file
/// that may be written over. It is hidden until the file is complete, and [`abandon_partial_files`] removes it.
///
/// # Errors
/// If `write` fails or the operating system refuses.
pub fn write_by_name<E: From<FileError>>(
    path: &Path,
    write: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let at = |source| FileError::Io { path: path.into(), source };
    let found = fs::metadata(path).ok();
    if found.as_ref().is_some_and(|found| !found.is_file() && !found.is_dir()) {
        return write(path);
    }
    let target = followed(path).map_err(at)?;
    let partial = Partial::with_hidden_name(&target).map_err(at)?;
    write(partial.name().unwrap_or(path))?;
    if let Some(found) = found.filter(fs::Metadata::is_file) {
        partial.file.set_permissions(found.permissions()).map_err(at)?;
    }
    partial.file.sync_all().map_err(at)?;
    Ok(partial.publish(&target).map_err(at)?)
}

/// Checks that [`write_atomically`] can write a file at `path`, without leaving one. Minutes of work can then
/// be spared whose result would be lost. A full disk is not noticed.
///
/// # Errors
/// If its directory does not exist or takes no files, if it is a directory itself, or if its name is too long.
pub fn expect_writable(path: &Path) -> Result<(), FileError> {
    let at = |source| FileError::Io { path: path.into(), source };
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => return Err(at(io::ErrorKind::IsADirectory.into())),
        // A device, which is written to directly.
        Ok(found) if !found.is_file() => return Ok(()),
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(at(error)),
        _ => {}
    }
    followed(path).and_then(|target| Partial::beside(&target)).map_err(at).map(drop)
}

/// The path behind symbolic links. The file there need not exist.
fn followed(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        if !fs::symlink_metadata(&path).is_ok_and(|found| found.is_symlink()) {
            return Ok(path);
        }
        // Relative to the directory of the link.
        let target = fs::read_link(&path)?;
        path = path.parent().unwrap_or(Path::new("")).join(target);
    }
    Err(io::Error::other("too many symbolic links"))
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
    fn another_program_writes_as_a_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mp4");
        let write = |name: &Path, contents: &str| {
            assert_eq!((name.parent(), name == path), (path.parent(), false));
            // As a program does that knows no open files of ours.
            fs::write(name, contents).map_err(|source| FileError::Io { path: name.into(), source })
        };
        write_by_name(&path, |name| write(name, "first")).unwrap();
        let failed: Result<(), FileError> = write_by_name(&path, |name| {
            write(name, "second")?;
            Err(FileError::Io { path: "ffmpeg".into(), source: io::Error::other("failed") })
        });
        assert_eq!(failed.unwrap_err().to_string(), "ffmpeg: failed");
        assert_eq!(fs::read(&path).unwrap(), b"first");
        write_by_name(&path, |name| write(name, "third")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"third");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "no partial file is left");
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

    #[test]
    #[cfg(unix)]
    fn a_replaced_file_keeps_its_permissions() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        write_atomically(&path, |out| out.write_all(b"first")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        write_atomically(&path, |out| out.write_all(b"second")).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
    }

    #[test]
    #[cfg(unix)]
    fn a_link_stays_and_its_file_is_replaced() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().unwrap();
        let (file, link, other) =
            (dir.path().join("far/a.bin"), dir.path().join("link"), dir.path().join("other"));
        fs::create_dir(dir.path().join("far")).unwrap();
        symlink("far/a.bin", &link).unwrap();
        symlink("link", &other).unwrap();
        // The first time there is no file yet.
        for contents in [b"first", b"again"] {
            write_atomically(&other, |out| out.write_all(contents)).unwrap();
            assert_eq!(fs::read(&file).unwrap(), contents);
            assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        }
        let circle = dir.path().join("circle");
        symlink("circle", &circle).unwrap();
        assert!(write_atomically(&circle, |_| Ok(())).is_err());
    }

    #[test]
    fn a_name_as_long_as_names_can_be() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a".repeat(250));
        expect_writable(&path).unwrap();
        write_atomically(&path, |out| out.write_all(b"x")).unwrap();
        assert!(expect_writable(&dir.path().join("a".repeat(300))).is_err());
        assert!(expect_writable(dir.path()).is_err());
        let error = expect_writable(&dir.path().join("missing/a")).unwrap_err().to_string();
        assert!(error.contains("missing/a: No such file"), "{error}");
        expect_writable(&path).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"x");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
