//! Puts images side by side into one PNG, to look at them together: `paintings_sheet OUT.png COLUMNS IMAGE...`.

use std::env;

use anyhow::{Context, Result};
use image::{GenericImage, RgbImage};

const USAGE: &str = "usage: paintings_sheet OUT.png COLUMNS IMAGE...";

fn main() -> Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [out, columns, images @ ..] = arguments.as_slice() else { anyhow::bail!(USAGE) };
    let columns: usize = columns.parse().context(USAGE)?;
    let size = demo_paintings::SIZE as u32;
    let rows = images.len().div_ceil(columns.max(1)) as u32;
    let mut sheet = RgbImage::new(size * columns as u32, size * rows);
    for (i, path) in images.iter().enumerate() {
        let picture = image::open(path).with_context(|| format!("cannot read {path}"))?.to_rgb8();
        let (column, row) = ((i % columns) as u32, (i / columns) as u32);
        sheet
            .copy_from(&picture, column * size, row * size)
            .with_context(|| format!("{path} is too large"))?;
    }
    sheet.save(out).with_context(|| format!("cannot write {out}"))
}
