//! Strokes of N Gaussians on the GPU, and the paintings' textures that they show. CPU twin:
//! [`stylegaussian::strokes`].
//!
//! Layers mix strokes, and the splat pass draws them. All strokes of a device share one [`StrokeStore`] of
//! textures, so that clouds in different styles are drawn together.

use std::{
    ops::Range,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use stylegaussian::strokes::{MAX_SEEDS, StrokeFactors, StrokeMotion, StrokeSeed, Strokes};

use crate::buffers::{self, ReadBackError, TooLarge};

mod plan;
mod redraw;
mod store;
#[cfg(test)]
mod tests;

pub use redraw::{ImageError, LEAST_SIDE, PaintImage, PaintReadBack, RedrawError, StrokeRedrawer};
pub(crate) use store::{StoredTexture, TextureArrays};
pub use store::{StrokeLayer, StrokeStore};

/// Strokes cannot be on the GPU.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StrokesError {
    /// There are too many Gaussians for the device.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    /// A word has no room for the number of a seed.
    #[error("strokes with {found} seeds, at most {limit} are drawn")]
    TooManySeeds {
        /// Seeds of the strokes.
        found: usize,
        /// The most that a table holds.
        limit: usize,
    },
    /// The store is full.
    #[error(
        "strokes with {found} new textures, the GPU has room for {free} of {limit}; show fewer styles at once"
    )]
    TooManyTextures {
        /// Textures of the strokes that are not in the store.
        found: usize,
        /// Unused layers.
        free: usize,
        /// Layers that the store has at most.
        limit: usize,
    },
    /// A seed names a texture that is not there.
    #[error("strokes: a seed is of texture {found}, and there are {expected}")]
    NoTexture {
        /// The number of the seed's texture.
        found: usize,
        /// Textures of the strokes.
        expected: usize,
    },
}

/// Strokes of N Gaussians on the GPU, for layers and for the splat pass. Clones are the same strokes. Their
/// textures stay in the store until the last clone is dropped.
#[derive(Clone, Debug)]
pub struct GaussianStrokes {
    words: wgpu::Buffer,
    seeds: wgpu::Buffer,
    n_gaussians: u32,
    n_seeds: u32,
    version: Arc<AtomicU64>,
    /// Keeps the textures in the store.
    textures: Vec<Arc<StoredTexture>>,
    /// Seeds whose strokes move.
    motions: Vec<(Range<u32>, StrokeMotion)>,
    /// What is added to the numbers of changed seeds, and the changes, the topmost first.
    changes: Vec<(u32, StrokeFactors)>,
}

/// Usages of both buffers.
const USAGES: wgpu::BufferUsages =
    wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST).union(wgpu::BufferUsages::COPY_SRC);

impl GaussianStrokes {
    /// Bytes that the strokes of `n_gaussians` with `n_seeds` take, without their textures.
    pub fn bytes(n_gaussians: usize, n_seeds: usize) -> u64 {
        word_bytes(n_gaussians) + seed_bytes(n_seeds)
    }

    /// Strokes of `n_gaussians` that show nothing, with room for `n_seeds`.
    pub(crate) fn empty(device: &wgpu::Device, n_gaussians: usize, n_seeds: usize) -> Result<Self, TooLarge> {
        let limit = buffers::largest_binding(device);
        let (words, seeds) = (word_bytes(n_gaussians), seed_bytes(n_seeds));
        TooLarge::check("strokes", words, limit)?;
        TooLarge::check("seeds of strokes", seeds, limit)?;
        Ok(Self {
            words: buffers::create(device, "stroke_words", words, USAGES),
            seeds: buffers::create(device, "stroke_seeds", seeds, USAGES),
            n_gaussians: n_gaussians as u32,
            n_seeds: n_seeds as u32,
            version: Arc::default(),
            textures: Vec::new(),
            motions: Vec::new(),
            changes: Vec::new(),
        })
    }

    /// The same strokes, moving. They share words, seeds and textures with the others, which move as before.
    ///
    /// Motions are applied where strokes are drawn, at the time of
    /// [`PaintedColors`](crate::splat::PaintedColors), and mixes keep those of their layers.
    #[must_use]
    pub fn moving(&self, motion: StrokeMotion) -> Self {
        let motions = if motion.is_still() { Vec::new() } else { vec![(0..self.n_seeds, motion)] };
        Self { motions, ..self.clone() }
    }

    /// Seeds whose strokes move, and how.
    pub fn motions(&self) -> &[(Range<u32>, StrokeMotion)] {
        &self.motions
    }

    /// Replaces the motions.
    pub(crate) fn set_motions(&mut self, motions: Vec<(Range<u32>, StrokeMotion)>) {
        self.motions = motions;
    }

    /// What is added to the numbers of seeds whose strokes are changed, and how they are, the topmost change
    /// first: those of the layers of a mix that change more than words carry.
    pub fn changes(&self) -> &[(u32, StrokeFactors)] {
        &self.changes
    }

    /// Replaces the changes.
    pub(crate) fn set_changes(&mut self, changes: Vec<(u32, StrokeFactors)>) {
        self.changes = changes;
    }

    /// The same words with an empty table for `n_seeds`, and no textures yet.
    pub(crate) fn with_table(&self, device: &wgpu::Device, n_seeds: usize) -> Result<Self, TooLarge> {
        let table = Self::empty(device, 0, n_seeds)?;
        let (words, version) = (self.words.clone(), Arc::clone(&self.version));
        Ok(Self { words, n_gaussians: self.n_gaussians, version, ..table })
    }

    /// Replaces the textures that are kept in the store.
    pub(crate) fn keep(&mut self, textures: Vec<Arc<StoredTexture>>) {
        self.textures = textures;
    }

    /// The textures that are kept in the store.
    pub(crate) fn textures(&self) -> &[Arc<StoredTexture>] {
        &self.textures
    }

    /// Replaces all words: seed, protection and share of each Gaussian, see
    /// [`StrokeWord`](stylegaussian::strokes::StrokeWord).
    ///
    /// # Panics
    /// If there is not one word per Gaussian.
    pub fn write_words(&self, queue: &wgpu::Queue, words: &[u32]) {
        assert_eq!(words.len(), self.n_gaussians(), "one word per Gaussian");
        queue.write_buffer(&self.words, 0, bytemuck::cast_slice(words));
        self.mark_changed();
    }

    /// Makes views draw the strokes anew, and layers mix them anew. Call it after every write to a buffer.
    pub fn mark_changed(&self) {
        // Only compared for equality, and submissions order the writes themselves.
        self.version.fetch_add(1, Ordering::Relaxed);
    }

    /// A number that differs after each change.
    pub fn version(&self) -> u64 {
        self.version.load(Ordering::Relaxed)
    }

    /// N.
    pub fn n_gaussians(&self) -> usize {
        self.n_gaussians as usize
    }

    /// Seeds that there is room for.
    pub fn n_seeds(&self) -> usize {
        self.n_seeds as usize
    }

    /// The words `[N]` of `u32`; usable as storage, and as source and destination of copies. Call
    /// [`mark_changed`](Self::mark_changed) after writing to it.
    pub fn words(&self) -> &wgpu::Buffer {
        &self.words
    }

    /// The seeds `[M]` of [`StrokeSeed`], likewise. Their textures are layers of the store.
    pub fn seeds(&self) -> &wgpu::Buffer {
        &self.seeds
    }

    /// Waits for all work submitted so far and reads the words `[N]`.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn read_words(&self, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Vec<u32>, ReadBackError> {
        let mut words = buffers::read(device, queue, &self.words, bytemuck::pod_collect_to_vec::<u8, u32>)?;
        // A buffer holds at least one.
        words.truncate(self.n_gaussians());
        Ok(words)
    }

    /// Waits for all work submitted so far and reads the seeds `[M]`.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn read_seeds(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
    ) -> Result<Vec<StrokeSeed>, ReadBackError> {
        let mut seeds =
            buffers::read(device, queue, &self.seeds, bytemuck::pod_collect_to_vec::<u8, StrokeSeed>)?;
        seeds.truncate(self.n_seeds());
        Ok(seeds)
    }
}

/// Bytes of words. Buffers cannot be empty.
fn word_bytes(n_gaussians: usize) -> u64 {
    4 * (n_gaussians as u64).max(1)
}

/// Bytes of seeds.
pub(crate) fn seed_bytes(n_seeds: usize) -> u64 {
    size_of::<StrokeSeed>() as u64 * (n_seeds as u64).max(1)
}

/// The number of a seed's texture.
fn texture_of(seed: &StrokeSeed) -> usize {
    (seed.look >> 16 & 0xff) as usize
}

/// Checks that a word can name each seed, and that there is a texture for each.
fn check(strokes: &Strokes) -> Result<(), StrokesError> {
    let (found, limit) = (strokes.seeds.len(), MAX_SEEDS);
    if found > limit {
        return Err(StrokesError::TooManySeeds { found, limit });
    }
    let expected = strokes.textures.len();
    match strokes.seeds.iter().map(texture_of).max() {
        Some(found) if found >= expected => Err(StrokesError::NoTexture { found, expected }),
        _ => Ok(()),
    }
}
