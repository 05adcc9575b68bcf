//! Sorting the Gaussians into blocks.

use std::{
    borrow::Cow,
    fs::{self, File, OpenOptions},
    io::{BufWriter, Read, Write},
    path::{Path, PathBuf},
};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use stylegaussian::{
    morton,
    scene::{Scene, ScreenFilter},
    work::Work,
};

use super::{
    PARTIAL, TileError, TileOptions, is_complete,
    records::{self, mean, width},
    writer::expect_empty,
};
use crate::{
    atomic::write_atomically,
    distant,
    error::{FileError, Loaded, mismatch},
    json,
    upright::upright,
    world::FILE,
};

/// The name of the plan. It is written when all blocks are there.
const PLAN: &str = "plan.json";

/// The name of all Gaussians as they were read.
const ALL: &str = "all.raw";

/// Most means of the sample that sets the borders of blocks. Of a block of a world of 200 blocks it has 2600 at
/// least, so that three standard errors of the block's size are 6 %.
const SAMPLE: usize = 1 << 20;

/// The part of a chunk that a block aims at, so that few exceed it.
const FULL: f64 = 0.875;

/// The share of the sample that may lie outside of the curve's cells along an axis, on each side: skies are far
/// away and would take all cells.
const OUTSIDE: f64 = 0.001;

/// Records that are read at a time.
const AT_A_TIME: usize = 1 << 16;

/// Numbers of records that wait for their files, in all blocks together: 64 MB.
const WAITING: usize = 1 << 24;

/// Blocks into which Gaussians were sorted.
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Plan {
    /// The caller's key and the options.
    key: String,
    is_antialiased: bool,
    /// The degree of all spherical harmonics: the highest of the scenes, as far as it is kept.
    pub degree: u8,
    /// Gaussians of each block.
    pub counts: Vec<usize>,
    pub warnings: Vec<String>,
}

impl Plan {
    /// The filter of all chunks.
    pub fn filter(&self) -> ScreenFilter {
        if self.is_antialiased { ScreenFilter::Antialiased } else { ScreenFilter::Classic }
    }

    /// The plan of an interrupted call, or a new one, for which all slices are read and sorted.
    pub fn open(
        slices: impl Iterator<Item = Result<Loaded, FileError>>,
        key: &str,
        folder: &Path,
        options: &TileOptions,
        work: &Work,
    ) -> Result<Self, TileError> {
        let partial = folder.join(PARTIAL);
        let (path, key) = (partial.join(PLAN), format!("{key} {options:?}"));
        if path.is_file() {
            let bytes = fs::read(&path).map_err(|source| FileError::Io { path: path.clone(), source })?;
            let plan: Self =
                json::parse(&bytes, "the plan of an interrupted tiling").map_err(|error| error.at(&path))?;
            if plan.key != key || plan.degree > options.sh_degree {
                let expected = "those of this one: call it as before, or remove the folder";
                return Err(mismatch("scenes or options of another call", expected).at(&partial).into());
            }
            return Ok(plan);
        }
        if is_complete(folder) {
            return Err(mismatch("a complete world", "a new folder").at(&folder.join(FILE)).into());
        }
        expect_empty(folder, PARTIAL)?;
        let at = |source| FileError::Io { path: partial.clone(), source };
        if partial.exists() {
            // Half of a sort is none.
            fs::remove_dir_all(&partial).map_err(at)?;
        }
        fs::create_dir(&partial).map_err(at)?;
        let all = partial.join(ALL);
        let read = Everything::read(slices, &all, options.sh_degree, &work.part(0.0, 0.5))?;
        if read.n == 0 {
            return Err(mismatch("no Gaussian", "at least one").at(folder).into());
        }
        let curve = Curve::new(read.sample, read.n, options.chunk);
        let degree = read.runs.iter().map(|run| run.degree).max().unwrap_or(0);
        let counts = curve.sort(&all, (&read.runs[..], degree), &partial, &work.part(0.5, 1.0))?;
        fs::remove_file(&all).map_err(|source| FileError::Io { path: all.clone(), source })?;
        let is_antialiased = read.filter == Some(ScreenFilter::Antialiased);
        let plan = Self { key, is_antialiased, degree, counts, warnings: read.warnings };
        let bytes = serde_json::to_vec(&plan).expect("texts and numbers, which JSON holds");
        write_atomically(&path, |out| out.write_all(&bytes))?;
        Ok(plan)
    }
}

/// The file of a block's Gaussians.
pub(super) fn block_file(partial: &Path, block: usize) -> PathBuf {
    partial.join(format!("block_{block}.raw"))
}

/// Records of one degree that follow one another.
struct DegreeRun {
    degree: u8,
    n: usize,
}

/// All Gaussians in one file, in the order in which they came.
#[derive(Default)]
struct Everything {
    n: usize,
    /// Each with the coefficients of its scene, whose degree is known once its first slice is there.
    runs: Vec<DegreeRun>,
    /// Means of every so many Gaussians.
    sample: Vec<Vec3>,
    filter: Option<ScreenFilter>,
    warnings: Vec<String>,
}

impl Everything {
    fn read(
        slices: impl Iterator<Item = Result<Loaded, FileError>>,
        path: &Path,
        most_degree: u8,
        work: &Work,
    ) -> Result<Self, TileError> {
        let at = |source| FileError::Io { path: path.into(), source };
        let mut out = BufWriter::with_capacity(1 << 20, File::create(path).map_err(at)?);
        let (mut read, mut stride) = (Self::default(), 1);
        let mut origin: Option<DVec3> = None;
        for slice in slices {
            work.check()?;
            let Loaded { scene, warnings, .. } = slice?;
            warnings.into_iter().for_each(|warning| read.warn(warning));
            // Until `world::UP` is up.
            let (scene, up_before) = upright(Cow::Owned(scene)).map_err(|mismatch| mismatch.at(path))?;
            if let Some(up) = up_before {
                read.warn(format!(
                    "a scene whose up direction is {up} was turned until -y was up, as in all worlds: its \
                     cameras no longer fit"
                ));
            }
            read.note(&scene);
            // Chunks have one origin: the first scene's.
            let offset = scene.offset - *origin.get_or_insert(scene.offset);
            let degree = records::degree(&scene).min(most_degree);
            match read.runs.last_mut().filter(|run| run.degree == degree) {
                Some(run) => run.n += scene.len(),
                None => read.runs.push(DegreeRun { degree, n: scene.len() }),
            }
            let mut record = vec![0.0; width(degree)];
            for i in 0..scene.len() {
                records::fill(&mut record, &scene, i, offset.as_vec3());
                out.write_all(bytemuck::cast_slice(&record)).map_err(at)?;
                if read.n.is_multiple_of(stride) {
                    read.sample.push(mean(&record));
                }
                read.n += 1;
                if read.sample.len() == SAMPLE {
                    stride *= 2;
                    // Those at multiples of the new stride.
                    read.sample = read.sample.iter().step_by(2).copied().collect();
                }
            }
        }
        out.flush().map_err(at)?;
        Ok(read)
    }

    /// Warns once.
    fn warn(&mut self, warning: String) {
        if !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }

    /// Keeps the filter, and warns of what chunks cannot hold.
    fn note(&mut self, scene: &Scene) {
        if self.filter.is_some_and(|filter| filter != scene.filter) {
            self.warn(
                "only some scenes are tagged as antialiased: all are written as those that are not".into(),
            );
            self.filter = Some(ScreenFilter::Classic);
        }
        self.filter.get_or_insert(scene.filter);
        if scene.features.is_some() {
            self.warn("chunks keep no features, neighbors or decoder: they are left out".into());
        }
        if scene.mask.is_some() {
            self.warn("chunks keep no mask: it is left out".into());
        }
        if let Some(warning) = distant::left_out(scene) {
            self.warn(warning);
        }
    }
}

/// The Morton curve through most of a scene, in pieces of about as many Gaussians each.
struct Curve {
    low: DVec3,
    cells_per_unit: f64,
    /// The first code of each block but the first.
    borders: Vec<u64>,
}

impl Curve {
    /// The curve of `n` Gaussians with this sample of means, for chunks of `chunk`.
    fn new(sample: Vec<Vec3>, n: usize, chunk: usize) -> Self {
        let mut corners = [DVec3::ZERO; 2];
        for axis in 0..3 {
            let mut along: Vec<f32> = sample.iter().map(|mean| mean[axis]).collect();
            along.par_sort_unstable_by(f32::total_cmp);
            let outside = (along.len() as f64 * OUTSIDE) as usize;
            corners[0][axis] = f64::from(along[outside]);
            corners[1][axis] = f64::from(along[along.len() - 1 - outside]);
        }
        let extent = (corners[1] - corners[0]).max_element();
        let cells_per_unit = if extent > 0.0 { LAST_CELL / extent } else { 0.0 };
        let mut curve = Self { low: corners[0], cells_per_unit, borders: Vec::new() };
        let mut codes: Vec<u64> = sample.par_iter().map(|&mean| curve.code(mean)).collect();
        codes.par_sort_unstable();
        let n_blocks = (n as f64 / (FULL * chunk as f64)).ceil() as usize;
        curve.borders = (1..n_blocks).map(|block| codes[block * codes.len() / n_blocks]).collect();
        curve
    }

    fn code(&self, mean: Vec3) -> u64 {
        // Casts saturate at 0, and what is beyond the last cell is in it.
        let cell = ((mean.as_dvec3() - self.low) * self.cells_per_unit).min(DVec3::splat(LAST_CELL));
        morton::code(cell.x as u32, cell.y as u32, cell.z as u32)
    }

    /// Writes each Gaussian in the file `all`, which has these runs, to its block's, with coefficients of this
    /// degree. Returns the size of each block.
    fn sort(
        &self,
        all: &Path,
        (runs, degree): (&[DegreeRun], u8),
        partial: &Path,
        work: &Work,
    ) -> Result<Vec<usize>, TileError> {
        let at = |source| FileError::Io { path: all.into(), source };
        let mut file = File::open(all).map_err(at)?;
        let n_blocks = self.borders.len() + 1;
        let mut blocks: Vec<Block> =
            (0..n_blocks).map(|block| Block::new(block_file(partial, block))).collect();
        let most = (WAITING / n_blocks).max(64 * width(degree));
        let n: usize = runs.iter().map(|run| run.n).sum();
        let (mut chunk, mut done): (Vec<f32>, usize) = (Vec::new(), 0);
        for run in runs {
            let lacking = width(degree) - width(run.degree);
            for begin in (0..run.n).step_by(AT_A_TIME) {
                work.at(done as f32 / n as f32)?;
                let n_read = AT_A_TIME.min(run.n - begin);
                chunk.resize(n_read * width(run.degree), 0.0);
                file.read_exact(bytemuck::cast_slice_mut(&mut chunk)).map_err(at)?;
                let block_of = |record: &[f32]| {
                    self.borders.partition_point(|&border| border <= self.code(mean(record)))
                };
                let found: Vec<usize> = chunk.par_chunks_exact(width(run.degree)).map(block_of).collect();
                for (record, block) in chunk.chunks_exact(width(run.degree)).zip(found) {
                    let block = &mut blocks[block];
                    block.waiting.extend_from_slice(record);
                    block.waiting.resize(block.waiting.len() + lacking, 0.0);
                    block.n += 1;
                    if block.waiting.len() >= most {
                        block.append(false)?;
                    }
                }
                done += n_read;
            }
        }
        blocks.iter_mut().try_for_each(|block| block.append(true))?;
        Ok(blocks.iter().map(|block| block.n).collect())
    }
}

/// The largest coordinate of a cell: codes have 21 bits along each axis.
const LAST_CELL: f64 = ((1_u32 << 21) - 1) as f64;

/// A block while it is sorted.
struct Block {
    path: PathBuf,
    n: usize,
    /// Records that are not written yet.
    waiting: Vec<f32>,
}

impl Block {
    fn new(path: PathBuf) -> Self {
        Self { path, n: 0, waiting: Vec::new() }
    }

    /// Appends what waits to the file, which is open for that long alone: there may be thousands. `is_last`
    /// syncs it, so that it is there whenever the plan is.
    fn append(&mut self, is_last: bool) -> Result<(), FileError> {
        let append = |path: &Path, waiting: &[f32]| {
            let mut file = OpenOptions::new().append(true).create(true).open(path)?;
            file.write_all(bytemuck::cast_slice(waiting))?;
            if is_last { file.sync_all() } else { Ok(()) }
        };
        let appended = append(&self.path, &self.waiting);
        appended.map_err(|source| FileError::Io { path: self.path.clone(), source })?;
        self.waiting.clear();
        Ok(())
    }
}
