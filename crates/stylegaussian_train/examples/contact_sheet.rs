//! Lays out folders of pictures on one page, each beside the painting it was styled with:
//! `contact_sheet OUT.png (PAINTING|-) FOLDER [(PAINTING|-) FOLDER]...`.

use std::{
    env, fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use glam::UVec2;
use stylegaussian_train::{contact_sheet::contact_sheet, picture::Picture};

/// One cell of the page, in pixels.
const CELL: UVec2 = UVec2::new(320, 240);

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = env::args_os().skip(1).map(PathBuf::from).collect();
    let (Some(out), rows) = (arguments.first(), arguments.get(1..).unwrap_or_default()) else {
        anyhow::bail!("usage: contact_sheet OUT.png (PAINTING|-) FOLDER [(PAINTING|-) FOLDER]...");
    };
    ensure!(rows.len() % 2 == 0, "every painting needs a folder of pictures");
    let rows = rows.chunks_exact(2).map(|pair| row(&pair[0], &pair[1])).collect::<Result<Vec<_>>>()?;
    Ok(contact_sheet(&rows, CELL).write_png(out)?)
}

/// The painting (or an empty cell) and then every PNG in `folder`, by name.
fn row(painting: &Path, folder: &Path) -> Result<Vec<Picture>> {
    let first = if painting == Path::new("-") { Picture::filled(CELL, [255; 4]) } else { open(painting)? };
    let entries = fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "png"));
    paths.sort();
    std::iter::once(Ok(first)).chain(paths.iter().map(|path| open(path))).collect()
}

fn open(path: &Path) -> Result<Picture> {
    let image = image::open(path).with_context(|| format!("cannot read {}", path.display()))?.into_rgba8();
    let size = UVec2::new(image.width(), image.height());
    Ok(Picture { size, rgba: image.pixels().map(|pixel| pixel.0).collect() })
}
