//! An artist's choices beside the paintings: `--collection`, `--style-crop`, `--palette`,
//! `--palette-strength`, `--stroke-direction` and `--pins`.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use glam::Vec3;
use stylegaussian::{
    Scene,
    paint::{Canvas, Direction, Hand, Paint, Pin, Tints},
};
use stylegaussian_encoder::{Image, paint_of};
use stylegaussian_files::{read_paint, read_pins};

use crate::{
    arguments::{FRACTIONS, area, numbers, rgb, within},
    choose::open_painting,
    terminal::usage_error,
};

/// Options of paint beside those of strokes.
#[derive(Args, Debug)]
pub struct HandArgs {
    /// Let the styles act as one: each spot of the scene shows the painting that has a place like it. Without
    /// this, the colors of several styles are mixed. Weights above 0 count alike.
    #[arg(long, requires = "styles")]
    collection: bool,
    /// Use only this part of each style image: left edge, top edge, width and height as shares of the sides.
    #[arg(long, value_name = "X,Y,W,H", value_parser = area, requires = "styles", allow_hyphen_values = true)]
    style_crop: Option<[f32; 4]>,
    /// Colors in the paintings' stead, for their strokes: an image, a *.style.safetensors, or 2 to 256 colors
    /// as RRGGBB,RRGGBB,...
    #[arg(long, value_name = "FILE|COLORS", requires = "styles")]
    palette: Option<String>,
    /// How much the scene's hues are pulled to those of the palette: 0 leaves hues that it does not have, 1
    /// leaves no others.
    #[arg(
        long,
        value_name = "0..1",
        value_parser = within(FRACTIONS),
        requires = "styles",
        allow_negative_numbers = true,
    )]
    palette_strength: Option<f64>,
    /// Direction of the strokes on the scene: x to the right, y down, z forward, as in 3DGS .ply files. Several
    /// points, separated by spaces, are a curve that they follow, closed if the last is the first; a file has
    /// one on each line. Default: along the edges of the scene's colors.
    #[arg(long, value_name = "X,Y,Z[ X,Y,Z...]|FILE", requires = "styles", allow_hyphen_values = true)]
    stroke_direction: Option<String>,
    /// Pinned places, *.pins.json: spots of the scene that are painted from given spots of the paintings.
    #[arg(long, value_name = "FILE", requires = "styles")]
    pins: Option<PathBuf>,
}

/// The choices, with their files read.
pub struct Decided {
    is_collection: bool,
    tints: Option<Tints>,
    palette: f32,
    /// One point is a direction, and several are a curve.
    direction: Option<Vec<Vec3>>,
    pins: Vec<Pin>,
}

impl Decided {
    /// The same for painting.
    pub fn hand(&self) -> Hand<'_> {
        Hand {
            is_collection: self.is_collection,
            tints: self.tints.as_ref(),
            palette: self.palette,
            direction: self.direction.as_deref().map(direction_of),
            pins: &self.pins,
        }
    }
}

impl HandArgs {
    /// Reads what the options name.
    ///
    /// # Errors
    /// If a file cannot be read or belongs to another scene, or if the palette or the direction is none.
    pub fn read(&self, scene: &Scene) -> Result<Decided> {
        let pins = match &self.pins {
            Some(path) => {
                let stored = read_pins(path)?;
                stored.pins_for(scene).with_context(|| path.display().to_string())?.to_vec()
            }
            None => Vec::new(),
        };
        Ok(Decided {
            is_collection: self.collection,
            tints: self.palette.as_deref().map(tints).transpose()?,
            palette: self.palette_strength.map_or(Hand::PALETTE, |share| share as f32),
            direction: self.stroke_direction.as_deref().map(stroke_direction).transpose()?,
            pins,
        })
    }

    /// Refuses what a decoder cannot do.
    ///
    /// # Errors
    /// If an option of paint is given.
    pub fn expect_none(&self) -> Result<()> {
        let given = [
            ("--collection", self.collection),
            ("--palette", self.palette.is_some()),
            ("--palette-strength", self.palette_strength.is_some()),
            ("--stroke-direction", self.stroke_direction.is_some()),
            ("--pins", self.pins.is_some()),
        ];
        match given.iter().find(|(_, is_given)| *is_given) {
            Some((name, _)) => bail!("{name} is for paint, and a decoder chooses the colors of this scene"),
            None => Ok(()),
        }
    }

    /// The part of a style image that is used.
    ///
    /// # Errors
    /// If the image cannot be read, is too small, or the part is no part of it.
    pub fn open_image(&self, path: &Path) -> Result<Image> {
        let image = open_painting(path)?;
        let part = self.style_crop.map(|area| image.cropped(area));
        Ok(part.transpose().with_context(|| path.display().to_string())?.unwrap_or(image))
    }

    /// The part of a style's paint that is used.
    ///
    /// # Errors
    /// If the part is no part of it, or nothing of it may be used.
    pub fn part_of(&self, paint: Paint, path: &Path) -> Result<Paint> {
        let part = self.style_crop.map(|area| paint.cropped(area));
        let part = part.transpose().with_context(|| path.display().to_string())?.unwrap_or(paint);
        expect_usable(part, path)
    }
}

/// The paint of an image at `path`.
///
/// # Errors
/// If nothing of it may be used.
pub fn usable_paint_of(image: &Image, path: &Path) -> Result<Paint> {
    expect_usable(paint_of(image), path)
}

fn expect_usable(paint: Paint, path: &Path) -> Result<Paint> {
    ensure!(
        paint.is_usable(),
        "{}: all of the painting is transparent, expected pixels to paint from",
        path.display()
    );
    Ok(paint)
}

/// A palette: a list of colors, or that of a file.
fn tints(text: &str) -> Result<Tints> {
    if let Some(colors) = text.split(',').map(color).collect::<Option<Vec<_>>>() {
        return Tints::of_colors(&colors).with_context(|| format!("--palette {text}"));
    }
    let path = Path::new(text);
    let paint = match path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("safetensors"))
    {
        true => read_paint(path)?.with_context(|| format!("{text}: the style file carries no paint"))?,
        false => usable_paint_of(&open_painting(path)?, path)?,
    };
    Ok(Canvas::new(&paint).tints().clone())
}

/// A vector alone, or the points of a curve.
fn direction_of(points: &[Vec3]) -> Direction<'_> {
    match points {
        [direction] => Direction::Along(*direction),
        _ => Direction::Curve(points),
    }
}

/// Points, or those of a file.
fn stroke_direction(text: &str) -> Result<Vec<Vec3>> {
    let named = format!("--stroke-direction {text}");
    let point = |text: &str| numbers(text).map(Vec3::from_array);
    let given = text.split_whitespace().map(point).collect::<Option<Vec<_>>>();
    let (points, name) = match given.filter(|points| !points.is_empty()) {
        Some(points) => (points, named),
        None if Path::new(text).is_file() => {
            let lines = fs::read_to_string(text).with_context(|| text.to_owned())?;
            let bad = |word: &str| format!("{text}: found `{word}`, expected points X,Y,Z");
            let points = lines.split_whitespace().map(|word| point(word).with_context(|| bad(word)));
            (points.collect::<Result<_>>()?, text.to_owned())
        }
        None => {
            let expected = "a direction X,Y,Z, several points X,Y,Z or a file of them";
            return Err(usage_error(format!("{named}: expected {expected}")));
        }
    };
    direction_of(&points).check().with_context(|| name)?;
    Ok(points)
}

/// A color as `RRGGBB` or `#RRGGBB`, with spaces around it or not.
fn color(text: &str) -> Option<[f32; 3]> {
    rgb(text.trim()).map(|rgb| rgb.map(|byte| f32::from(byte) / 255.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_follow_a_direction_a_curve_or_a_file() {
        assert_eq!(stroke_direction("-1,0,0.5").unwrap(), [Vec3::new(-1.0, 0.0, 0.5)]);
        let curve = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, -2.0, 0.0)];
        assert_eq!(stroke_direction(" 0,0,0 1,0,0  1,-2,0 ").unwrap(), curve);
        assert_eq!(direction_of(&curve[1..2]), Direction::Along(Vec3::X));
        assert_eq!(direction_of(&curve), Direction::Curve(&curve));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.txt");
        let of_file = |text: &str| {
            fs::write(&path, text).unwrap();
            stroke_direction(path.to_str().unwrap())
        };
        assert_eq!(of_file("0,0,0\n1,0,0\n1,-2,0\n").unwrap(), curve);
        let message = |found: Result<Vec<Vec3>>| format!("{:#}", found.unwrap_err());
        assert!(message(of_file("0,0,0\n1,0\n")).ends_with("curve.txt: found `1,0`, expected points X,Y,Z"));
        assert!(message(of_file("")).contains("expected at least 2"));
        for (bad, expected) in [
            ("0,0,0", "not all 0"),
            ("1,NaN,0", "not all 0"),
            ("1,1,1 1,1,1", "expected at least 2"),
            ("1,1,1 inf,1,1", "point 2"),
            ("nowhere.txt", "expected a direction"),
            ("", "expected a direction"),
        ] {
            let found = message(stroke_direction(bad));
            assert!(found.contains(expected), "{bad}: {found}");
        }
    }

    #[test]
    fn colors_are_hexadecimal() {
        assert_eq!(color("ff0033"), Some([1.0, 0.0, 0.2]));
        assert_eq!(color(" #00FF00 "), Some([0.0, 1.0, 0.0]));
        for text in ["", "ff00", "+f0033", "a.png", "gg0033"] {
            assert_eq!(color(text), None, "{text}");
        }
        assert!(tints("ff0000,00ff00").is_ok());
        let message = |text: &str| format!("{:#}", tints(text).err().unwrap());
        assert!(message("ff0000").contains("found 1 colors"), "{}", message("ff0000"));
        assert!(message("nowhere.png").contains("nowhere.png"));
    }
}
