//! Reports of a training for people: a loss curve and a contact sheet.

use std::path::{Path, PathBuf};

use glam::UVec2;
use stylegaussian::{
    Camera, Decoder, Scene,
    fold::{stylize, transfer},
    splat::{Colors, render},
};
use stylegaussian_encoder::{Encoder, Image, StyleSize, style_statistics};
use stylegaussian_files::write_atomically;

use crate::{
    contact_sheet::contact_sheet,
    error::TrainError,
    picture::{Background, Picture},
};

/// Width and height of a loss curve, in pixels.
const CURVE: UVec2 = UVec2::new(800, 300);

/// Steps whose mean is one point of the curve.
const SMOOTHING: usize = 25;

/// Writes the content and style losses of every step as CSV, and a curve of them as PNG at `path`: the style
/// loss in red, the content loss in blue, each from zero to its largest mean over 25 steps.
///
/// # Errors
/// If a file cannot be written.
pub fn write_losses(path: &Path, losses: &[[f32; 2]]) -> Result<(), TrainError> {
    let mut text = String::from("step,content,style\n");
    for (step, [content, style]) in losses.iter().enumerate() {
        text.push_str(&format!("{},{content},{style}\n", step + 1));
    }
    write_atomically(&path.with_extension("csv"), |out| out.write_all(text.as_bytes()))?;
    let mut curve = Picture::filled(CURVE, [255; 4]);
    for (channel, color) in [(0, [40, 80, 200, 255]), (1, [200, 40, 40, 255])] {
        let means: Vec<f32> = losses
            .chunks(SMOOTHING)
            .map(|chunk| chunk.iter().map(|pair| pair[channel]).sum::<f32>() / chunk.len() as f32)
            .collect();
        // Above 0 even if all losses are 0.
        let largest = means.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
        for x in 0..CURVE.x {
            // Columns of the curve are spread over the means; there can be fewer or more of them.
            let Some(mean) = means.get(x as usize * means.len() / CURVE.x as usize) else { continue };
            let y = ((1.0 - mean / largest) * (CURVE.y - 3) as f32).clamp(0.0, (CURVE.y - 3) as f32) as u32;
            (y..y + 3).for_each(|y| curve.rgba[(y * CURVE.x + x) as usize] = color);
        }
    }
    curve.write_png(path)
}

/// Writes a page with a row for each painting: the painting, then every view in its style.
///
/// # Errors
/// If a painting cannot be read or does not fit the scene, or the page cannot be written.
pub fn write_contact_sheet(
    path: &Path,
    scenes: &[(&Scene, &[Camera])],
    decoder: &Decoder,
    paintings: &[PathBuf],
    encoder: &Encoder,
) -> Result<(), TrainError> {
    let mut rows = Vec::new();
    for painting in paintings {
        let image = Image::open_painting(painting)?;
        let style = style_statistics(encoder, &image, StyleSize::default())?;
        let mut row = vec![Picture::of_image(&image)];
        for (scene, cameras) in scenes {
            let Some(features) = &scene.features else { continue };
            let colors = stylize(scene, decoder, &transfer(features, &[(&style, 1.0)], 0.0)?)?;
            let views = cameras.iter().map(|camera| render(scene, Colors::Rgb(&colors), camera));
            row.extend(views.map(|view| Picture::of(&view, Background::Transparent)));
        }
        rows.push(row);
    }
    contact_sheet(&rows, UVec2::splat(256)).write_png(path)
}
