//! Values on the command line: weighted files, fractions, sizes, backgrounds, backends, names of outputs.

use std::{
    fmt::Display,
    ops::RangeInclusive,
    path::{Path, PathBuf},
    str::FromStr,
};

use anyhow::{Result, bail};
use clap::ValueEnum;
use glam::{UVec2, Vec3};
use stylegaussian::Frame;
use stylegaussian_train::picture::Background;

/// Longest side of a picture, in pixels.
pub const MAX_SIDE: u32 = 16_384;
/// Most pixels of a picture: 8192 x 8192. Drawing keeps color, alpha and depth in f32, the picture as bytes and
/// its PNG file, 32 bytes a pixel: 2 GiB.
pub const MAX_PIXELS: u64 = 1 << 26;

/// Whether pictures of this size can be drawn.
pub fn is_drawable(size: UVec2) -> bool {
    let n_pixels = u64::from(size.x) * u64::from(size.y);
    n_pixels > 0 && n_pixels <= MAX_PIXELS && size.max_element() <= MAX_SIDE
}

/// A file and its weight in a mix: `path` or `path:weight`.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightedPath {
    /// The file.
    pub path: PathBuf,
    /// The weight, 0 or more. 1 if none is given.
    pub weight: f64,
}

impl FromStr for WeightedPath {
    type Err = String;

    /// Splits at the last colon, but only if a number follows: `C:\paintings\a.png` is a path.
    fn from_str(text: &str) -> Result<Self, String> {
        let (path, weight) = match text.rsplit_once(':') {
            Some((path, number)) if is_number(number) => {
                (path, number.parse().map_err(|_| not_a_weight(number))?)
            }
            _ => (text, 1.0),
        };
        if path.is_empty() {
            return Err("the path is missing".into());
        }
        // Also false for infinity, which `1e999` parses to. Sums of a few such weights stay finite in f64.
        if !(0.0..=f64::from(f32::MAX)).contains(&weight) {
            return Err(not_a_weight(&weight.to_string()));
        }
        Ok(Self { path: path.into(), weight })
    }
}

/// Whether the name is that of a `kind` of file: look, mask, style or decoder.
pub fn is_named(path: &Path, kind: &str) -> bool {
    path.to_string_lossy().to_lowercase().ends_with(&format!(".{kind}.safetensors"))
}

/// Whether `text` is meant as a number. Rust also parses `inf` and `nan`, but these are more likely names.
fn is_number(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) && text.parse::<f64>().is_ok()
}

fn not_a_weight(found: &str) -> String {
    format!("weight {found}: expected a finite number, 0 or more")
}

/// Numbers from 0 to 1.
pub const FRACTIONS: RangeInclusive<f64> = 0.0..=1.0;
/// Factors from 0 to 10.
pub const FACTORS: RangeInclusive<f32> = 0.0..=10.0;
/// Factors by which splitting may multiply Gaussians.
pub const SPLITS: RangeInclusive<f64> = 1.0..=16.0;

/// A parser of numbers in a range.
pub fn within<T>(range: RangeInclusive<T>) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync
where
    T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static,
{
    move |text: &str| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| format!("expected a number from {} to {}", range.start(), range.end()))
    }
}

/// Numbers with commas between them.
pub fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// A direction as in `0,-1,0`, of any length but 0.
pub fn direction(text: &str) -> Result<Vec3, String> {
    let direction = numbers(text).map(Vec3::from_array).filter(|v| v.try_normalize().is_some());
    direction.ok_or_else(|| "expected X,Y,Z in the scene's space, not all 0, as in 0,-1,0".into())
}

/// A number from 0 to 1, without 1.
pub fn less_than_1(text: &str) -> Result<f32, String> {
    let number = text.parse().ok().filter(|number| (0.0..1.0).contains(number));
    number.ok_or_else(|| "expected a number of at least 0 and less than 1".into())
}

/// Width and height of a picture, as in `640x480`.
pub fn picture_size(text: &str) -> Result<UVec2, String> {
    let side = |text: &str| text.parse().ok();
    text.split_once('x')
        .and_then(|(width, height)| Some(UVec2::new(side(width)?, side(height)?)))
        .filter(|&size| is_drawable(size))
        .ok_or_else(|| {
            format!(
                "expected WIDTHxHEIGHT in pixels, as in 640x480: 1 to {MAX_SIDE} each, and at most \
                 {MAX_PIXELS} together, which take 2 GiB to draw"
            )
        })
}

/// An area of an image as in `0,0.25,1,0.5`: left edge, top edge, width and height as shares of the sides. Its
/// left, top, right and bottom edges.
pub fn area(text: &str) -> Result<[f32; 4], String> {
    let is_within = |&[x, y, width, height]: &[f32; 4]| {
        let starts_within = [x, y].iter().all(|at| (0.0..1.0).contains(at));
        starts_within && width > 0.0 && height > 0.0 && x + width <= 1.0 && y + height <= 1.0
    };
    let area = numbers(text).filter(is_within).map(|[x, y, width, height]| [x, y, x + width, y + height]);
    area.ok_or_else(|| {
        "expected X,Y,WIDTH,HEIGHT as shares of the sides, within 0 to 1, as in 0,0.25,1,0.5".into()
    })
}

/// A ball as in `1.5,0,-2,3`: its center and its radius, in scene units.
pub fn frame(text: &str) -> Result<Frame, String> {
    let frame = numbers(text).map(|[x, y, z, radius]| Frame { center: Vec3::new(x, y, z), radius });
    let is_ball = |ball: &Frame| ball.center.is_finite() && ball.radius.is_finite() && ball.radius > 0.0;
    frame.filter(is_ball).ok_or_else(|| {
        "expected X,Y,Z,RADIUS in the scene's units, the radius above 0, as in 1.5,0,-2,3".into()
    })
}

/// A color as `RRGGBB` or `#RRGGBB`.
pub fn rgb(text: &str) -> Option<[u8; 3]> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    // `from_str_radix` takes a sign, which would pass as a digit.
    let is_color = digits.len() == 6 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    let [_, r, g, b] = u32::from_str_radix(digits, 16).ok().filter(|_| is_color)?.to_be_bytes();
    Some([r, g, b])
}

/// `transparent`, or a color as [`rgb`] takes it.
pub fn background(text: &str) -> Result<Background, String> {
    match rgb(text) {
        Some(rgb) => Ok(Background::Color(rgb)),
        None if text == "transparent" => Ok(Background::Transparent),
        None => Err("expected `transparent` or six hexadecimal digits RRGGBB".into()),
    }
}

/// The device that computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// A hardware GPU if there is one, otherwise the CPU.
    Auto,
    /// The CPU.
    Cpu,
    /// The GPU, or an error.
    Gpu,
}

impl Backend {
    /// Refuses the GPU for `what`, which only the CPU can do. Falling back silently would hide that.
    ///
    /// # Errors
    /// If the GPU is asked for.
    pub fn expect_cpu(self, what: &str) -> Result<()> {
        if self == Self::Gpu {
            bail!("--backend gpu: {what} has no GPU backend; use --backend cpu or auto");
        }
        Ok(())
    }
}

/// A file beside the output: OUT.decoder.safetensors -> OUT.`suffix`.
pub fn beside(output: &Path, suffix: &str) -> PathBuf {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    // Not `file_stem`, which would keep `.decoder`.
    let stem = name.trim_end_matches(".safetensors").trim_end_matches(".decoder");
    output.with_file_name(format!("{stem}.{suffix}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_style(text: &str, path: &str, weight: f64) {
        assert_eq!(text.parse(), Ok(WeightedPath { path: path.into(), weight }), "{text}");
    }

    #[test]
    fn a_style_splits_at_the_last_colon_if_a_number_follows() {
        check_style("a.png", "a.png", 1.0);
        check_style("a.png:0.3", "a.png", 0.3);
        check_style("a.png:2", "a.png", 2.0);
        check_style("a.png:.5", "a.png", 0.5);
        check_style("a.png:1e-3", "a.png", 1e-3);
        check_style("dir:1/a.png", "dir:1/a.png", 1.0);
        check_style("a:1:2", "a:1", 2.0);
        check_style("a:b", "a:b", 1.0);
        check_style("a.png:", "a.png:", 1.0);
        check_style("12:34.png", "12:34.png", 1.0);
        check_style("a:nan", "a:nan", 1.0);
        check_style("a:inf", "a:inf", 1.0);
        check_style("0.5", "0.5", 1.0);
    }

    #[test]
    fn windows_paths_keep_their_drive() {
        check_style(r"C:\paintings\a.png", r"C:\paintings\a.png", 1.0);
        check_style(r"C:\paintings\a.png:0.25", r"C:\paintings\a.png", 0.25);
        check_style("C:/paintings/a.png:1", "C:/paintings/a.png", 1.0);
    }

    #[test]
    fn impossible_weights_are_refused() {
        for text in ["a:-1", "a:1e999", ":0.5", ""] {
            assert!(text.parse::<WeightedPath>().is_err(), "{text}");
        }
    }

    #[test]
    fn fractions_end_at_0_and_1() {
        let fraction = within(FRACTIONS);
        assert_eq!(fraction("0"), Ok(0.0));
        assert_eq!(fraction("1.0"), Ok(1.0));
        for text in ["-0.1", "1.01", "nan", "NaN", "inf", "", "half"] {
            assert!(fraction(text).is_err(), "{text}");
        }
    }

    #[test]
    fn splits_end_at_1_and_16() {
        let split_factor = within(SPLITS);
        assert_eq!((split_factor("1"), split_factor("16")), (Ok(1.0), Ok(16.0)));
        assert_eq!(split_factor("17"), Err("expected a number from 1 to 16".into()));
        for text in ["0", "17", "nan", "a.ply", ""] {
            assert!(split_factor(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sizes() {
        assert_eq!(picture_size("640x480"), Ok(UVec2::new(640, 480)));
        assert_eq!(picture_size("16384x4096"), Ok(UVec2::new(16_384, 4096)));
        for text in [
            "16384x16384",
            "16385x1",
            "16384x4097",
            "640",
            "640x",
            "0x480",
            "640x-1",
            "100000x1",
            "640x480x3",
            "axb",
        ] {
            assert!(picture_size(text).is_err(), "{text}");
        }
    }

    #[test]
    fn frames() {
        let ball = |x, y, z, radius| Ok(Frame { center: Vec3::new(x, y, z), radius });
        assert_eq!(frame("1.5,0,-2,3"), ball(1.5, 0.0, -2.0, 3.0));
        assert_eq!(frame("-1e-4, 2e-4, 0, 1e-5"), ball(-1e-4, 2e-4, 0.0, 1e-5));
        for text in
            ["", "1,2,3", "1,2,3,0", "1,2,3,-1", "1,2,3,nan", "inf,2,3,1", "1,2,3,4,5", "1 2 3 4", "1,2,3,4,"]
        {
            assert!(frame(text).is_err(), "{text}");
        }
    }

    #[test]
    fn areas() {
        assert_eq!(area("0,0.25,1,0.5"), Ok([0.0, 0.25, 1.0, 0.75]));
        assert_eq!(area("0.5, 0.5, 0.5, 0.5"), Ok([0.5, 0.5, 1.0, 1.0]));
        for text in
            ["", "0,0,1", "0,0,0,1", "0.5,0,0.6,1", "-0.1,0,1,1", "nan,0,1,1", "0,0,inf,1", "0,0,1,1,1"]
        {
            assert!(area(text).is_err(), "{text}");
        }
    }

    #[test]
    fn directions_and_speeds() {
        assert_eq!(direction("0,-1.5, 2"), Ok(Vec3::new(0.0, -1.5, 2.0)));
        for text in ["", "1,2", "0,0,0", "nan,0,1", "1,inf,0", "1,2,3,4", "x"] {
            assert!(direction(text).is_err(), "{text}");
        }
        let rate = within(0.1_f64..=1000.0);
        assert_eq!(rate("23.976"), Ok(23.976));
        for text in ["", "0", "0.05", "-1", "nan", "inf", "1001"] {
            assert!(rate(text).is_err(), "{text}");
        }
    }

    #[test]
    fn backgrounds() {
        assert_eq!(background("transparent"), Ok(Background::Transparent));
        assert_eq!(background("ff8000"), Ok(Background::Color([255, 128, 0])));
        assert_eq!(background("#FF8000"), Ok(Background::Color([255, 128, 0])));
        for text in ["white", "fff", "ff80000", "gg0000", "+f8000", ""] {
            assert!(background(text).is_err(), "{text}");
        }
    }
}
