//! Reading scenes of every format, in turns with decompressing their bytes alone.
//!
//! Files are in memory, so no disk is measured. Formats that are not compressed are compared with a copy of
//! their bytes.

mod captured;
mod made;

use std::{hint::black_box, io::Cursor, io::Read};

use anyhow::{Context, Result, bail, ensure};
use flate2::bufread::GzDecoder;
use image_webp::WebPDecoder;
use rayon::prelude::*;
use ruzstd::decoding::FrameDecoder;
use stylegaussian::Scene;
use stylegaussian_files::{ReadOptions, Reading, SceneReader};

use crate::{
    measure::{Samples, wall_ms},
    memory::usage_of,
    plan::Plan,
    report::{FileRatios, Report, Row},
};

/// The files of a scene.
struct Files {
    /// The format.
    name: &'static str,
    /// The name of the first file.
    file_name: &'static str,
    main: Vec<u8>,
    /// The others, by their names.
    others: Vec<(String, Vec<u8>)>,
    packing: Packing,
}

/// The compression of a format.
#[derive(Clone, Copy)]
enum Packing {
    None,
    /// All of the file, by gzip.
    Gzip,
    /// The frames of SPZ 4.
    Zstd,
    /// All other files, as images.
    WebP,
}

/// Measures all formats.
pub fn run(plan: &Plan, report: &mut Report) -> Result<()> {
    let n = plan.file_size();
    for make in made::ALL {
        measure(&make(n)?, report)?;
    }
    match captured::sog(n)? {
        Some(files) => measure(&files, report),
        None => {
            report.not_run("read SOG", "the test data is not there");
            Ok(())
        }
    }
}

fn measure(files: &Files, report: &mut Report) -> Result<()> {
    let samples = Samples::in_turns(1, 5, &mut [&mut || wall_ms(|| files.unpack()), &mut || files.read()])?;
    let (scene, usage) = usage_of(|| files.scene());
    let scene = scene?;
    for (what, samples) in ["unpack", "read"].into_iter().zip(&samples) {
        let bytes = (what == "read").then_some(usage.peak as u64);
        report.add(Row { bytes, ..Row::new(format!("{what} {}", files.name), scene.len(), samples) });
    }
    report.files.push(FileRatios {
        name: files.name.into(),
        bytes_per_gaussian: files.n_bytes() as f64 / scene.len() as f64,
        // Of the fastest runs: other work on the machine only adds.
        read_over_unpack: samples[1].least() / samples[0].least(),
        peak_over_held: usage.peak as f64 / usage.held as f64,
    });
    Ok(())
}

impl Files {
    /// A single file.
    fn one(name: &'static str, file_name: &'static str, main: Vec<u8>, packing: Packing) -> Self {
        Self { name, file_name, main, others: Vec::new(), packing }
    }

    fn n_bytes(&self) -> usize {
        self.main.len() + self.others.iter().map(|(_, bytes)| bytes.len()).sum::<usize>()
    }

    /// The time of reading, in milliseconds. Copying the files, which readers keep, is left out.
    fn read(&self) -> Result<f64> {
        let mut reader = self.reader();
        // The scene is dropped after the clock stops.
        let mut outcome = None;
        let ms = wall_ms(|| {
            outcome = Some(reader.read()?);
            Ok(())
        })?;
        ensure!(matches!(outcome, Some(Reading::Scene(_))), "{} needs other files", self.name);
        Ok(ms)
    }

    fn reader(&self) -> SceneReader {
        let mut reader = SceneReader::new(self.main.clone(), self.file_name, ReadOptions::default());
        self.others.iter().for_each(|(name, bytes)| reader.add(name.clone(), bytes.clone()));
        reader
    }

    fn scene(&self) -> Result<Scene> {
        match self.reader().read()? {
            Reading::Scene(loaded) => Ok(loaded.scene),
            Reading::Needs(names) => bail!("{} needs {names:?}", self.name),
        }
    }

    /// Decompresses everything and drops it.
    fn unpack(&self) -> Result<()> {
        match self.packing {
            Packing::None => drop(black_box(self.main.clone())),
            Packing::Gzip => {
                let mut bytes = Vec::new();
                GzDecoder::new(&self.main[..]).read_to_end(&mut bytes)?;
                black_box(bytes);
            }
            Packing::Zstd => {
                let bytes: Result<Vec<Vec<u8>>> = frames(&self.main)?.into_par_iter().map(inflate).collect();
                black_box(bytes?);
            }
            Packing::WebP => {
                let images = self.others.par_iter().filter(|(name, _)| name.ends_with(".webp"));
                let images: Result<Vec<Vec<u8>>> = images.map(|(_, bytes)| pixels(bytes)).collect();
                black_box(images?);
            }
        }
        Ok(())
    }
}

/// The zstd frames of an SPZ 4 and the lengths that they unpack to. Their number is byte 15, and the position
/// of the table of their lengths is at 16.
fn frames(bytes: &[u8]) -> Result<Vec<(&[u8], usize)>> {
    let table = u32::from_le_bytes(*bytes[16..].first_chunk().context("no header")?) as usize;
    let lengths = bytes[table..].as_chunks::<16>().0.iter().take(usize::from(bytes[15]));
    let mut rest = &bytes[table + 16 * usize::from(bytes[15])..];
    let frame = |entry: &[u8; 16]| {
        let [packed, plain] =
            [0, 8].map(|at| u64::from_le_bytes(std::array::from_fn(|i| entry[at + i])) as usize);
        let (frame, after) = rest.split_at_checked(packed).context("a frame is cut")?;
        rest = after;
        Ok((frame, plain))
    };
    lengths.map(frame).collect()
}

fn inflate((frame, n_bytes): (&[u8], usize)) -> Result<Vec<u8>> {
    // No more than needed: the decoder fills all of the capacity with zeros first.
    let mut bytes = Vec::with_capacity(n_bytes);
    FrameDecoder::new().decode_all_to_vec(frame, &mut bytes)?;
    Ok(bytes)
}

fn pixels(image: &[u8]) -> Result<Vec<u8>> {
    let mut decoder = WebPDecoder::new(Cursor::new(image))?;
    let mut pixels = vec![0; decoder.output_buffer_size().context("an image without a size")?];
    decoder.read_image(&mut pixels)?;
    Ok(pixels)
}
