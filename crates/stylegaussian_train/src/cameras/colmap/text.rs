//! cameras.txt and images.txt.

use std::{path::Path, str::FromStr};

use super::{CamerasError, Image, Lens, Lenses, MODELS, invalid};
use crate::cameras::posed::{read, utf8};

/// The lenses of cameras.txt, one line each: CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS...
pub(super) fn cameras(path: &Path) -> Result<Lenses, CamerasError> {
    let mut lenses = Lenses::new();
    for (number, line) in lines(path)? {
        if line.is_empty() {
            continue;
        }
        let mut line = Line::new(path, number, &line);
        let id = line.number("a camera number")?;
        let name = line.word("a camera model")?;
        let Some(model) = MODELS.iter().find(|model| model.name == name) else {
            return Err(invalid(path, &line.what, format!("camera model {name}"), "a model of COLMAP's"));
        };
        let (width, height) = (line.side("a width")?, line.side("a height")?);
        let parameters: Vec<f64> = line.rest("a camera parameter")?;
        if parameters.len() != model.n_parameters {
            let found = format!("{} parameters for {name}", parameters.len());
            return Err(invalid(path, &line.what, found, "as many as the model has"));
        }
        lenses.insert(id, Lens { model, width, height, parameters });
    }
    Ok(lenses)
}

/// The images of images.txt, two lines each: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then the image's
/// points, which may be an empty line. Some programs leave out the lines of images without points.
pub(super) fn images(path: &Path) -> Result<Vec<Image>, CamerasError> {
    let mut images = Vec::new();
    let mut lines = lines(path)?.into_iter().peekable();
    while let Some((number, line)) = lines.next() {
        if line.is_empty() {
            continue;
        }
        let mut line = Line::new(path, number, &line);
        let _id: u32 = line.number("an image number")?;
        let mut numbers = [0.0; 7];
        for x in &mut numbers {
            *x = line.number("a number of the pose")?;
        }
        let [qw, qx, qy, qz, tx, ty, tz] = numbers;
        let camera_id = line.number("a camera number")?;
        // The rest of the line: names may hold spaces.
        let name = line.words.collect::<Vec<_>>().join(" ");
        if name.is_empty() {
            return Err(invalid(path, &line.what, "the end of the line", "the photo's name"));
        }
        images.push(Image { name, rotation: [qw, qx, qy, qz], translation: [tx, ty, tz], camera_id });
        lines.next_if(|(_, line)| !is_image(line)); // the points
    }
    Ok(images)
}

/// Whether a line that may hold points is the next image: its numbers are an image's, a name follows, and it is
/// no list of points, each x, y and the number of a 3D point.
fn is_image(line: &str) -> bool {
    let words: Vec<&str> = line.split_whitespace().collect();
    let is_number = |word: &&str| word.parse::<f64>().is_ok();
    let is_id = |word: &str| word.parse::<u32>().is_ok();
    let has_pose = words.len() > 9 && is_id(words[0]) && words[1..8].iter().all(is_number) && is_id(words[8]);
    has_pose && !(words.len().is_multiple_of(3) && words.iter().all(is_number))
}

/// The trimmed lines that are not comments, with their numbers from 1.
fn lines(path: &Path) -> Result<Vec<(usize, String)>, CamerasError> {
    let bytes = read(path)?;
    let bytes = utf8(&bytes);
    let text = String::from_utf8_lossy(&bytes);
    // Empty lines stay, because an image without points has one.
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim().to_owned()));
    Ok(numbered.filter(|(_, line)| !line.starts_with('#')).collect())
}

/// A line, read word by word.
struct Line<'a> {
    path: &'a Path,
    what: String,
    words: std::str::SplitWhitespace<'a>,
}

impl<'a> Line<'a> {
    fn new(path: &'a Path, number: usize, line: &'a str) -> Self {
        Self { path, what: format!("line {number}"), words: line.split_whitespace() }
    }

    fn word(&mut self, expected: &'static str) -> Result<&'a str, CamerasError> {
        self.words.next().ok_or_else(|| invalid(self.path, &self.what, "the end of the line", expected))
    }

    fn number<T: FromStr>(&mut self, expected: &'static str) -> Result<T, CamerasError> {
        let word = self.word(expected)?;
        word.parse().map_err(|_| invalid(self.path, &self.what, format!("`{word}`"), expected))
    }

    /// A side of a picture in pixels, also as `640.0`.
    fn side(&mut self, expected: &'static str) -> Result<u64, CamerasError> {
        let word = self.word(expected)?;
        let whole = || word.parse().ok().filter(|x: &f64| x.fract() == 0.0 && (0.0..1e15).contains(x));
        let side = word.parse().ok().or_else(|| whole().map(|x| x as u64));
        side.ok_or_else(|| invalid(self.path, &self.what, format!("`{word}`"), expected))
    }

    fn rest<T: FromStr>(&mut self, expected: &'static str) -> Result<Vec<T>, CamerasError> {
        let mut numbers = Vec::new();
        while self.words.clone().next().is_some() {
            numbers.push(self.number(expected)?);
        }
        Ok(numbers)
    }
}
