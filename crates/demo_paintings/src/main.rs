//! Writes the eight paintings into a folder: `demo_paintings OUT_DIR [NAME...]`.

use std::{env, fs, path::Path};

use anyhow::{Context, Result};
use demo_paintings::{PAINTINGS, SIZE};
use image::{ExtendedColorType, codecs::jpeg::JpegEncoder};

/// The most that one file may take: eight of them then fit in 900 KB.
const MAX_BYTES: usize = 112_000;

fn main() -> Result<()> {
    let mut arguments = env::args().skip(1);
    let folder = arguments.next().context("usage: demo_paintings OUT_DIR [NAME...]")?;
    let names: Vec<String> = arguments.collect();
    fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {folder}"))?;
    for painting in PAINTINGS.iter().filter(|p| names.is_empty() || names.iter().any(|n| n == p.name)) {
        let path = Path::new(&folder).join(format!("{}.jpg", painting.name));
        let (bytes, quality) = jpeg(&(painting.paint)().to_rgb())?;
        fs::write(&path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
        println!("{}: {} bytes, quality {quality}", path.display(), bytes.len());
    }
    Ok(())
}

/// Encodes at quality 90, or the highest below it that keeps the file within [`MAX_BYTES`].
fn jpeg(rgb: &[u8]) -> Result<(Vec<u8>, u8)> {
    let mut quality = 90;
    loop {
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, quality).encode(
            rgb,
            SIZE as u32,
            SIZE as u32,
            ExtendedColorType::Rgb8,
        )?;
        if bytes.len() <= MAX_BYTES || quality <= 60 {
            return Ok((bytes, quality));
        }
        quality -= 2;
    }
}
