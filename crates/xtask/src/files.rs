//! Copies of files and folders, and the files that git knows.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result};

/// The files that `git ls-files` lists, or nothing where it lists none: an unpacked archive, a machine without
/// git.
pub fn listed(arguments: &[&str]) -> Option<Vec<String>> {
    let output = Command::new("git").args(["ls-files", "-z"]).args(arguments).output().ok()?;
    let list = String::from_utf8(output.stdout).ok()?;
    // A file stays listed until its removal is committed.
    let files = list.split_terminator('\0').filter(|file| Path::new(file).exists()).map(String::from);
    let files: Vec<String> = files.collect();
    (output.status.success() && !files.is_empty()).then_some(files)
}

/// Makes an empty folder, in place of whatever it held.
pub fn fresh_folder(folder: &Path) -> Result<()> {
    if folder.exists() {
        fs::remove_dir_all(folder).with_context(|| format!("cannot empty {}", folder.display()))?;
    }
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))
}

/// Copies a file, or a folder with all that it holds.
pub fn copy(from: &Path, to: &Path) -> Result<()> {
    if !from.is_dir() {
        let folder = to.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        fs::copy(from, to).with_context(|| format!("cannot copy {} to {}", from.display(), to.display()))?;
        return Ok(());
    }
    for entry in entries(from)? {
        copy(&entry, &to.join(entry.file_name().unwrap_or_default()))?;
    }
    Ok(())
}

/// Copies the files of a folder, without the folders in it.
pub fn copy_files(from: &Path, to: &Path) -> Result<()> {
    for entry in entries(from)?.iter().filter(|entry| entry.is_file()) {
        copy(entry, &to.join(entry.file_name().unwrap_or_default()))?;
    }
    Ok(())
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let context = || format!("cannot list {}", folder.display());
    let entries = fs::read_dir(folder).with_context(context)?;
    entries.map(|entry| Ok(entry.with_context(context)?.path())).collect()
}
