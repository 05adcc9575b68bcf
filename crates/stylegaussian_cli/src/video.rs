//! Films for `--video`: MP4 and WebM by the program `ffmpeg`, animated WebP by ourselves.

use std::{
    ffi::OsString,
    io::{self, Read, Write},
    path::Path,
    process::{Child, Command, ExitStatus, Stdio},
    sync::atomic::{AtomicBool, Ordering},
    thread,
};

use anyhow::{Context, Result, anyhow, bail};
use glam::UVec2;
use stylegaussian_files::{WebpAnimation, write_by_name};
use stylegaussian_train::picture::{Background, Picture};

use crate::{scenes::extension, terminal::usage_error};

/// The program that encodes.
const FFMPEG: &str = "ffmpeg";

/// The format of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Mp4,
    Webm,
    Webp,
}

impl Format {
    /// The format that the extension of a name asks for. Checks that there is what writes it.
    ///
    /// # Errors
    /// If the extension is another (a usage error), or `ffmpeg` is wanted and is not installed.
    pub fn of(path: &Path) -> Result<Self> {
        let format = match &*extension(path) {
            "mp4" => Self::Mp4,
            "webm" => Self::Webm,
            "webp" => return Ok(Self::Webp),
            _ => {
                let expected = "expected an extension of .mp4, .webm, .webp";
                return Err(usage_error(format!("{}: {expected}", path.display())));
            }
        };
        let mut asked = Command::new(FFMPEG);
        asked.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        asked.status().map_err(|error| not_started(path, &error))?;
        Ok(format)
    }

    /// The background of a film's pictures: MP4 has no transparency, and shows black in its stead.
    pub fn background(self, wanted: Background) -> Background {
        match (self, wanted) {
            (Self::Mp4, Background::Transparent) => Background::Color([0; 3]),
            _ => wanted,
        }
    }

    /// Arguments with which `ffmpeg` writes the format.
    fn arguments(self, is_transparent: bool) -> Vec<String> {
        let pixels = if is_transparent { "yuva420p" } else { "yuv420p" };
        // Colors of every second pixel need even sides: one row and one column may be cut off. The matrix of
        // high definition is told, since players guess.
        let filter = format!(
            "crop=trunc(iw/2)*2:trunc(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv,format={pixels},\
             setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709"
        );
        // Qualities at which strokes stay crisp. An encoder that is not the usual one ignores them.
        let more = match self {
            Self::Mp4 => "-crf 18 -movflags +faststart -f mp4",
            _ if is_transparent => "-crf 24 -b:v 0 -auto-alt-ref 0 -f webm",
            _ => "-crf 24 -b:v 0 -f webm",
        };
        ["-vf".into(), filter].into_iter().chain(more.split(' ').map(String::from)).collect()
    }
}

/// A film that is to be written.
#[derive(Clone, Copy, Debug)]
pub struct Film<'a> {
    pub path: &'a Path,
    pub format: Format,
    /// Width and height of its pictures, in pixels.
    pub size: UVec2,
    pub frames_per_second: f64,
    pub n_frames: usize,
    /// Whether pictures have alpha.
    pub is_transparent: bool,
}

impl Film<'_> {
    /// Draws the pictures one after another by `draw`, and writes the film, as a whole or not at all.
    ///
    /// # Errors
    /// If `draw` fails, the encoder fails, the file cannot be written, or once `interrupted` is set.
    pub fn write(
        &self,
        interrupted: &AtomicBool,
        mut draw: impl FnMut(usize) -> Result<Picture>,
    ) -> Result<()> {
        let mut picture = |i: usize| {
            self.check(i, interrupted)?;
            draw(i)
        };
        if self.format == Format::Webp {
            let mut film = WebpAnimation::new(self.path, self.size, self.frames_per_second)?;
            for i in 0..self.n_frames {
                film.push(&picture(i)?.rgba)?;
            }
            return Ok(film.write()?);
        }
        write_by_name(self.path, |name| {
            let mut encoder = self.encoder(name)?;
            for i in 0..self.n_frames {
                if encoder.push(&picture(i)?).is_err() {
                    // It has ended, and its own message says why.
                    self.check(i, interrupted)?;
                    break;
                }
            }
            let (status, message) = encoder.finish()?;
            self.check(self.n_frames, interrupted)?;
            if !status.success() {
                bail!("{}: {FFMPEG} failed ({status}): {message}", self.path.display());
            }
            Ok(())
        })
    }

    fn check(&self, done: usize, interrupted: &AtomicBool) -> Result<()> {
        if interrupted.load(Ordering::Relaxed) {
            bail!(
                "interrupted after {done} of {} pictures: there is no {}",
                self.n_frames,
                self.path.display()
            );
        }
        Ok(())
    }

    /// Starts the program, which writes to the file `name`.
    fn encoder(&self, name: &Path) -> Result<Encoder> {
        let UVec2 { x: width, y: height } = self.size;
        let mut command = Command::new(FFMPEG);
        command.args(["-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgba"]);
        command.args(["-video_size", &format!("{width}x{height}")]);
        command.args(["-framerate", &self.frames_per_second.to_string(), "-i", "pipe:0"]);
        command.args(self.format.arguments(self.is_transparent));
        // A name with a colon would else be an address.
        let mut file = OsString::from("file:");
        file.push(name);
        command.arg(file).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| not_started(self.path, &error))?;
        let errors = child.stderr.take().map(|mut errors| {
            // Beside the pictures, since a full pipe of messages would stop both programs.
            thread::spawn(move || {
                let mut bytes = Vec::new();
                // What was read before a failure is told.
                let _ = errors.read_to_end(&mut bytes);
                last_line(&bytes)
            })
        });
        Ok(Encoder { child, errors })
    }
}

/// The running program. It is ended if it is dropped before it has finished.
struct Encoder {
    child: Child,
    /// Reads its messages, and gives the last one.
    errors: Option<thread::JoinHandle<String>>,
}

impl Encoder {
    /// Hands a picture over.
    fn push(&mut self, picture: &Picture) -> io::Result<()> {
        let input = self.child.stdin.as_mut().ok_or(io::ErrorKind::BrokenPipe)?;
        input.write_all(picture.rgba.as_flattened())
    }

    /// Waits until the program has written its file. Returns how it ended, and its last message.
    fn finish(mut self) -> Result<(ExitStatus, String)> {
        // The end of its input is the end of the film.
        drop(self.child.stdin.take());
        let status = self.child.wait().context(FFMPEG)?;
        let message = self.errors.take().and_then(|errors| errors.join().ok()).unwrap_or_default();
        Ok((status, if message.is_empty() { "without a message".into() } else { message }))
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // Both fail if it has ended, and then there is nothing to do.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The error of a program that cannot be started.
fn not_started(path: &Path, error: &io::Error) -> anyhow::Error {
    let path = path.display();
    match error.kind() {
        io::ErrorKind::NotFound => anyhow!(
            "{path}: found no program `{FFMPEG}`, expected one to encode the film; install it, or name \
             a .webp, for which none is needed"
        ),
        _ => anyhow!("{path}: cannot start `{FFMPEG}`: {error}"),
    }
}

/// The last line that is not empty.
fn last_line(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    let last = text.lines().map(str::trim).rfind(|line| !line.is_empty());
    last.unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_name_formats() {
        assert_eq!(Format::of(Path::new("a/b.WebP")).unwrap(), Format::Webp);
        let message = Format::of(Path::new("b.avi")).unwrap_err().to_string();
        assert!(message.contains("b.avi: expected an extension of .mp4, .webm, .webp"), "{message}");
    }

    #[test]
    fn the_last_message_counts() {
        assert_eq!(last_line(b"one\n two \n\n"), "two");
        assert_eq!(last_line(b""), "");
    }
}
