//! Writes the eight paintings into a folder: `demo_paintings OUT_DIR [NAME...]`.

use std::{env, fs, path::Path};

use anyhow::{Context, Result};
use demo_paintings::{PAINTINGS, SIZE};
use image::ExtendedColorType::Rgb8;
use image::ImageEncoder;
use image::codecs::{jpeg, png};

/// Largest PNG file, in bytes. With this limit and the next the eight paintings take less than 900 KB together.
const MAX_PNG: usize = 120_000;
/// Largest JPEG file, in bytes.
const MAX_JPEG: usize = 110_000;

fn main() -> Result<()> {
    let mut arguments = env::args().skip(1);
    let folder = arguments.next().context("usage: demo_paintings OUT_DIR [NAME...]")?;
    let names: Vec<String> = arguments.collect();
    if let Some(unknown) = names.iter().find(|name| PAINTINGS.iter().all(|p| p.name != name.as_str())) {
        anyhow::bail!("no painting is named {unknown}; there are {}", PAINTINGS.map(|p| p.name).join(", "));
    }
    fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {folder}"))?;
    for painting in PAINTINGS.iter().filter(|p| names.is_empty() || names.iter().any(|n| n == p.name)) {
        let (extension, bytes) = smallest(&(painting.paint)().to_rgb())?;
        let path = Path::new(&folder).join(format!("{}.{extension}", painting.name));
        fs::write(&path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
        println!("{}: {} bytes", path.display(), bytes.len());
    }
    Ok(())
}

/// The file's extension and bytes: PNG if that fits, as it does for flat art, otherwise JPEG at the highest
/// quality that fits, from 90 down to 60, which is taken in any case.
fn smallest(rgb: &[u8]) -> Result<(&'static str, Vec<u8>)> {
    let size = SIZE as u32;
    let mut bytes = Vec::new();
    png::PngEncoder::new_with_quality(&mut bytes, png::CompressionType::Best, png::FilterType::Adaptive)
        .write_image(rgb, size, size, Rgb8)?;
    let mut quality = 92;
    if bytes.len() <= MAX_PNG {
        return Ok(("png", bytes));
    }
    loop {
        quality -= 2;
        bytes.clear();
        jpeg::JpegEncoder::new_with_quality(&mut bytes, quality).write_image(rgb, size, size, Rgb8)?;
        if bytes.len() <= MAX_JPEG || quality <= 60 {
            return Ok(("jpg", bytes));
        }
    }
}
