//! Folders of images, and which of them are held out of training.

use std::{
    fs,
    path::{Path, PathBuf},
};

use stylegaussian_encoder::image::extensions;

use crate::error::{Context, TrainError, ensure};

/// Files in `folder` with the extension of an image, sorted by name.
///
/// # Errors
/// If the folder cannot be read or holds no image.
pub fn list_images(folder: &Path) -> Result<Vec<PathBuf>, TrainError> {
    let what = || format!("{}: cannot list the folder", folder.display());
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).context(what)? {
        let path = entry.context(what)?.path();
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        if extension.is_some_and(|extension| extensions().any(|known| known == extension)) {
            paths.push(path);
        }
    }
    ensure!(
        !paths.is_empty(),
        "{}: found no painting; expected images (.{}) in the folder",
        folder.display(),
        extensions().collect::<Vec<_>>().join(", .")
    );
    // The order of a folder differs between systems, and seeds choose by position.
    paths.sort();
    Ok(paths)
}

/// Splits images into those to train on and `n` to hold out, spread evenly over the list.
///
/// # Errors
/// If `n` leaves none to train on.
pub fn hold_out(paths: Vec<PathBuf>, n: usize) -> Result<(Vec<PathBuf>, Vec<PathBuf>), TrainError> {
    ensure!(n < paths.len(), "found {} paintings, expected more than the {n} to hold out", paths.len());
    // No index has the remainder MAX / 2, so n = 0 holds out nothing.
    let stride = paths.len().checked_div(n).unwrap_or(usize::MAX);
    // The middle of each stretch. If n does not divide the number, a last short stretch could give one too
    // many.
    Ok(split(paths, |i| i % stride == stride / 2 && i / stride < n))
}

/// Splits images into those to train on and every `stride`-th to hold out; at least one of each.
///
/// # Errors
/// If there are fewer than two images.
pub fn hold_out_every(
    paths: Vec<PathBuf>,
    stride: usize,
) -> Result<(Vec<PathBuf>, Vec<PathBuf>), TrainError> {
    let n = paths.len();
    ensure!(n > 1, "found {n} image, expected at least one to learn on and one to hold out");
    let stride = stride.min(n);
    Ok(split(paths, |i| i % stride == stride - 1))
}

fn split(paths: Vec<PathBuf>, is_held_out: impl Fn(usize) -> bool) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let (held_out, training): (Vec<_>, Vec<_>) =
        paths.into_iter().enumerate().partition(|(i, _)| is_held_out(*i));
    let without_index = |list: Vec<(usize, PathBuf)>| list.into_iter().map(|(_, path)| path).collect();
    (without_index(training), without_index(held_out))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(n: usize) -> Vec<PathBuf> {
        (0..n).map(|i| PathBuf::from(i.to_string())).collect()
    }

    #[test]
    fn held_out_images_are_spread_over_the_list() {
        let (training, held_out) = hold_out(numbered(10), 2).unwrap();
        assert_eq!(held_out, ["2", "7"].map(PathBuf::from));
        assert_eq!(training.len(), 8);
        assert_eq!(hold_out(numbered(3), 0).unwrap().1, Vec::<PathBuf>::new());
        assert!(hold_out(numbered(2), 2).is_err());
    }

    #[test]
    fn one_of_each_stride_is_held_out() {
        assert_eq!(hold_out_every(numbered(5), 2).unwrap().1, ["1", "3"].map(PathBuf::from));
        assert_eq!(hold_out_every(numbered(2), 16).unwrap().1, ["1"].map(PathBuf::from));
        assert!(hold_out_every(numbered(1), 16).is_err());
    }
}
