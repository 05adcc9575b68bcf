//! Checks of outputs before the work whose result they take.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Result, bail};
use stylegaussian_files::expect_writable;

/// Checks that every file can be written. None is left behind.
///
/// # Errors
/// If one cannot. The message names it.
pub fn expect_files<'a>(files: impl IntoIterator<Item = &'a Path>) -> Result<()> {
    for file in files {
        expect_writable(file)?;
    }
    Ok(())
}

/// Checks that files can be written to a folder, which is made later if it does not exist.
///
/// # Errors
/// If it is a file, or cannot be made or written to. The message names it.
pub fn expect_folder(folder: &Path) -> Result<()> {
    // An empty path is the current folder, of which `exists` knows nothing.
    let mut existing = PathBuf::from(".").join(folder);
    while fs::symlink_metadata(&existing).is_err() && existing.pop() {}
    if !existing.is_dir() {
        bail!("{}: {} is no folder, expected one to write to", folder.display(), existing.display());
    }
    // A name that no picture has.
    expect_writable(&existing.join(".stylegaussian")).map_err(|error| {
        anyhow::Error::new(error).context(format!("{}: cannot write to the folder", folder.display()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_that_can_be_made_are_fine() {
        let dir = tempfile::tempdir().unwrap();
        for folder in ["", "new", "new/er"] {
            expect_folder(&dir.path().join(folder)).unwrap();
        }
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        expect_folder(Path::new("")).unwrap();
        fs::write(dir.path().join("file"), "").unwrap();
        for folder in ["file", "file/deeper"] {
            let error = expect_folder(&dir.path().join(folder)).unwrap_err().to_string();
            assert!(error.contains("is no folder"), "{error}");
        }
    }
}
