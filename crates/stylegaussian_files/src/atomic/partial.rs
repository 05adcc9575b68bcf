//! A file that is not complete yet.
//!
//! On Linux it has no name until it is complete, so that nothing is left behind, whatever ends the process.
//! Elsewhere, and on file systems without such files, it has a hidden name, which [`abandon_partial_files`]
//! removes.

use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    process,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU32, Ordering},
    },
};

/// The hidden names of this process' files, for [`abandon_partial_files`].
static NAMES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn names() -> MutexGuard<'static, Vec<PathBuf>> {
    // A list of paths has no state that a panic could leave half done.
    NAMES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A partial file, removed on drop unless it was published. Drop runs on an error, and on a panic too.
pub(super) struct Partial {
    /// The file, open for writing.
    pub file: File,
    /// Its hidden name, if it has one.
    name: Option<PathBuf>,
}

impl Partial {
    /// Creates an empty file on the file system of `path`, in the same folder: files move at once within one
    /// file system only.
    pub fn beside(path: &Path) -> io::Result<Self> {
        expect_name(path)?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        match unnamed::create(folder.unwrap_or(Path::new("."))) {
            Some(file) => Ok(Self { file, name: None }),
            None => Self::with_hidden_name(path),
        }
    }

    /// As [`beside`](Self::beside), with a name for others to write to.
    pub fn with_hidden_name(path: &Path) -> io::Result<Self> {
        expect_name(path)?;
        let name = hidden_name(path);
        let mut names = names();
        // `create_new` refuses a path that exists, so that no link there is followed.
        let file = File::create_new(&name)?;
        names.push(name.clone());
        Ok(Self { file, name: Some(name) })
    }

    /// Its hidden name, if it has one.
    pub fn name(&self) -> Option<&Path> {
        self.name.as_deref()
    }

    /// Gives the file its name. An older file of this name is replaced.
    pub fn publish(mut self, path: &Path) -> io::Result<()> {
        // Under the lock, so that nobody removes the file meanwhile.
        let mut names = names();
        if self.name.is_none() {
            match unnamed::link(&self.file, path) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                done => return done,
            }
            // Only a rename replaces a file, and it needs a first name.
            let name = hidden_name(path);
            unnamed::link(&self.file, &name)?;
            names.push(name.clone());
            self.name = Some(name);
        }
        let Some(name) = &self.name else { return Ok(()) };
        let renamed = fs::rename(name, path);
        if renamed.is_ok() {
            names.retain(|other| other != name);
        }
        // Before `self` is dropped, which takes the lock again.
        drop(names);
        renamed
    }
}

/// # Errors
/// If the path ends in no name, as `/` does.
fn expect_name(path: &Path) -> io::Result<()> {
    let named = path.file_name().map(|_| ());
    named.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "the path names no file"))
}

impl Drop for Partial {
    fn drop(&mut self) {
        let Some(name) = &self.name else { return };
        let mut names = names();
        let n = names.len();
        names.retain(|other| other != name);
        // One that was renamed is not in the list any more.
        if names.len() < n {
            // A failure to remove it is not reported: the error that led here is the one worth reading.
            let _ = fs::remove_file(name);
        }
    }
}

/// Removes all partial files of this process, which is about to end by a signal. Threads that begin or finish a
/// file after this call wait forever.
pub fn abandon_partial_files() {
    let names = names();
    for name in names.iter() {
        // The process ends: there is nobody to tell.
        let _ = fs::remove_file(name);
    }
    std::mem::forget(names);
}

/// A name in the directory of `path` that no other writer uses.
fn hidden_name(path: &Path) -> PathBuf {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let count = COUNTER.fetch_add(1, Ordering::Relaxed);
    // Process and count keep writers apart. Without the file's own name, which may be as long as names can be.
    path.with_file_name(format!(".{}-{count}.partial", process::id()))
}

/// Files without a name: `O_TMPFILE` of Linux, see open(2).
#[cfg(target_os = "linux")]
mod unnamed {
    use std::{fs::File, io, os::fd::AsRawFd, path::Path};

    use rustix::fs::{AtFlags, CWD, Mode, OFlags, linkat, open};

    /// The folder of links to open files, by which an unnamed one gets its name.
    const OPEN_FILES: &str = "/proc/self/fd";

    /// A file in `folder`, or `None` if there cannot be one.
    pub fn create(folder: &Path) -> Option<File> {
        let flags = OFlags::TMPFILE | OFlags::WRONLY | OFlags::CLOEXEC;
        // As `File::create` does. The process' mask takes its bits off.
        let mode = Mode::from_raw_mode(0o666);
        // Errors that matter come again, with a hidden name.
        Path::new(OPEN_FILES).is_dir().then(|| open(folder, flags, mode).ok())?.map(File::from)
    }

    /// Gives `file` the name `path`, which must not exist.
    pub fn link(file: &File, path: &Path) -> io::Result<()> {
        let open = format!("{OPEN_FILES}/{}", file.as_raw_fd());
        Ok(linkat(CWD, open, CWD, path, AtFlags::SYMLINK_FOLLOW)?)
    }
}

/// Other systems have no such files.
#[cfg(not(target_os = "linux"))]
mod unnamed {
    use std::{fs::File, io, path::Path};

    pub fn create(_folder: &Path) -> Option<File> {
        None
    }

    pub fn link(_file: &File, _path: &Path) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    /// The names in a folder, sorted.
    fn names_in(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<String> = entries.map(|name| name.into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Either kind, whatever this system has.
    #[test]
    fn is_seen_when_it_is_complete() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        for (contents, kind) in [
            (b"first", Partial::beside as fn(&Path) -> io::Result<Partial>),
            (b"again", Partial::with_hidden_name),
            (b"third", Partial::beside),
        ] {
            let mut partial = kind(&path).unwrap();
            partial.file.write_all(contents).unwrap();
            assert_ne!(fs::read(&path).unwrap_or_default(), contents);
            partial.publish(&path).unwrap();
            assert_eq!(fs::read(&path).unwrap(), contents);
            assert_eq!(names_in(dir.path()), ["a.bin"]);
        }
        for kind in [Partial::beside, Partial::with_hidden_name] {
            drop(kind(&path).unwrap());
            // A folder stands in the way.
            assert!(kind(&path).unwrap().publish(dir.path()).is_err());
            assert_eq!(names_in(dir.path()), ["a.bin"]);
        }
        assert_eq!(fs::read(&path).unwrap(), b"third");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn has_no_name_that_a_killed_process_could_leave() {
        let dir = tempfile::tempdir().unwrap();
        let partial = Partial::beside(&dir.path().join("a.bin")).unwrap();
        if partial.name.is_some() {
            eprintln!("SKIPPED: no unnamed files in {}", dir.path().display());
            return;
        }
        assert!(names_in(dir.path()).is_empty());
    }
}
