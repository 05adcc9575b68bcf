//! What the style pass keeps of a scene on the GPU.

use std::sync::{Arc, Mutex, PoisonError};

use stylegaussian::{Decoder, Scene, fold::StylizeError};

use super::{
    content::{ContentFold, StyleShape},
    features::StyleInputs,
    plan::{CHUNK_ROWS, Split, sum_columns},
    planes::{Planes, largest_binding, planes_per_buffer},
    scratch::Scratch,
};
use crate::colors::GaussianColorsError;

/// A scene's inputs to the decoder, its neighbor lists, and the scratch memory of the decoder's layers. It belongs to a
/// scene and a decoder, and serves any number of styles.
///
/// Scratch memory is made by the first change of style and kept, so that further ones allocate nothing;
/// [`release_scratch`](Self::release_scratch) gives it back until the next.
#[derive(Debug)]
pub struct StyleScene {
    pub(super) shape: StyleShape,
    pub(super) split: Split,
    pub(super) inputs: Planes,
    pub(super) neighbors: NeighborBuffers,
    pub(super) base_colors: wgpu::Buffer,
    scratch: Mutex<Option<Scratch>>,
    content: Arc<ContentFold>,
}

/// A scene could not be brought to the GPU, or not be decoded there.
#[derive(Debug, thiserror::Error)]
pub enum StyleSceneError {
    /// The decoder does not fit the scene.
    #[error(transparent)]
    Stylize(#[from] StylizeError),
    /// The device's limits are too small.
    #[error("{what} takes {found} bytes in one piece, the device binds at most {limit}")]
    TooLarge {
        /// Label of the buffer.
        what: &'static str,
        /// Bytes of the smallest piece that it could be split into.
        found: u64,
        /// Bytes of the largest storage binding and buffer.
        limit: u64,
    },
    /// The colors do not fit the device.
    #[error(transparent)]
    Colors(#[from] GaussianColorsError),
    /// Weights or colors of another scene or decoder.
    #[error("the style pass was given {what} of {found}, the scene has {expected}")]
    Mismatch {
        /// What was given.
        what: &'static str,
        /// Its shape.
        found: String,
        /// The scene's.
        expected: String,
    },
}

/// Neighbor lists `[N, K]`, split by Gaussian.
#[derive(Debug)]
pub(super) struct NeighborBuffers {
    buffers: Vec<wgpu::Buffer>,
    rows_per_buffer: usize,
    row_bytes: u64,
}

impl StyleScene {
    /// Packs and uploads what `decoder` takes of `scene`; see [`StyleInputs`] to pack elsewhere than here.
    ///
    /// # Errors
    /// No features, a decoder that does not fit them, or a device whose limits are too small.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        scene: &Scene,
        decoder: &Decoder,
    ) -> Result<Self, StyleSceneError> {
        Self::upload(device, queue, &StyleInputs::new(scene, decoder)?)
    }

    /// Uploads packed inputs.
    ///
    /// # Errors
    /// When the device's limits are too small for a single plane of 8 channels.
    pub fn upload(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        inputs: &StyleInputs,
    ) -> Result<Self, StyleSceneError> {
        let shape = inputs.shape.clone();
        let n = shape.n_gaussians;
        let split = Split::of(&shape, largest_binding(&device.limits()))?;
        let planes = Planes::new(device, "style_inputs", shape.widths[0], n, split.inputs);
        let neighbors = NeighborBuffers::new(device, &shape, &split);
        planes.write(queue, &inputs.planes);
        neighbors.write(queue, &inputs.neighbors);
        let base_colors = storage(device, "style_base_colors", base_color_bytes(&shape).max(8));
        queue.write_buffer(&base_colors, 0, bytemuck::cast_slice(&inputs.base_colors));
        let (scratch, content) = (Mutex::new(None), inputs.content.clone());
        Ok(Self { shape, split, inputs: planes, neighbors, base_colors, scratch, content })
    }

    /// Bytes on the GPU that styling `scene` with `decoder` takes, before they are spent: its inputs, neighbor lists and
    /// [scratch memory](Self::scratch_bytes). Colors, 8 bytes for each Gaussian and style, are not counted; nor are
    /// the sums of at most one chunk of Gaussians that a scene takes whose planes must be split.
    ///
    /// # Errors
    /// No features, or a decoder that does not fit them.
    pub fn bytes(scene: &Scene, decoder: &Decoder) -> Result<u64, StylizeError> {
        let shape = StyleShape::of(scene, decoder)?;
        let n = shape.n_gaussians;
        let neighbors = 4 * shape.k as u64 * n as u64;
        Ok(Planes::bytes(shape.widths[0], n) + neighbors + base_color_bytes(&shape) + scratch_bytes(&shape))
    }

    /// The part of [`bytes`](Self::bytes) that only a change of style needs: the activations that hidden layers write
    /// and read in turns, and the decoder's weights.
    ///
    /// # Errors
    /// As [`bytes`](Self::bytes).
    pub fn scratch_bytes(scene: &Scene, decoder: &Decoder) -> Result<u64, StylizeError> {
        Ok(scratch_bytes(&StyleShape::of(scene, decoder)?))
    }

    /// Gives back the memory that only a change of style needs, for scenes that will keep their style for a while. Work
    /// that was submitted still ends; the next change takes the memory again.
    pub fn release_scratch(&self) {
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).take();
    }

    /// The memory of a change of style, made where there is none.
    pub(super) fn scratch(&self, device: &wgpu::Device) -> Scratch {
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        scratch.get_or_insert_with(|| Scratch::new(device, &self.shape, &self.split)).clone()
    }

    /// What folding needs of the scene.
    pub fn content(&self) -> &Arc<ContentFold> {
        &self.content
    }

    /// N.
    pub fn n_gaussians(&self) -> usize {
        self.shape.n_gaussians
    }
}

fn scratch_bytes(shape: &StyleShape) -> u64 {
    let planes = |which| Planes::bytes(shape.scratch_width(which), shape.n_gaussians);
    planes(0) + planes(1) + super::weights::weight_bytes(&shape.widths, shape.k)
}

fn base_color_bytes(shape: &StyleShape) -> u64 {
    if shape.residual { 8 * shape.n_gaussians as u64 } else { 0 }
}

impl Split {
    /// The split of a scene by the largest buffer that can be bound: planes of a scene's Gaussians, and chunks of
    /// Gaussians whose neighbor lists and sums can be bound.
    fn of(shape: &StyleShape, limit: u64) -> Result<Self, StyleSceneError> {
        // Neighbor lists are bound at any chunk: 64 rows are a multiple of 256 bytes, the coarsest alignment of a binding.
        const ROW_MULTIPLE: usize = 64;
        let planes = |width| planes_per_buffer(width, shape.n_gaussians, limit);
        let scratch = [planes(shape.scratch_width(0))?, planes(shape.scratch_width(1))?];
        let mut split = Self { inputs: planes(shape.widths[0])?, scratch, chunk_rows: CHUNK_ROWS };
        let row_bytes = 4 * shape.k.max(sum_columns(shape, &split)) as u64;
        let rows = usize::try_from(limit / row_bytes).unwrap_or(usize::MAX).min(CHUNK_ROWS);
        split.chunk_rows = rows / ROW_MULTIPLE * ROW_MULTIPLE;
        if split.chunk_rows == 0 {
            let found = ROW_MULTIPLE as u64 * row_bytes;
            return Err(StyleSceneError::TooLarge { what: "style_neighbors", found, limit });
        }
        Ok(split)
    }
}

pub(super) fn storage(device: &wgpu::Device, label: &'static str, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

impl NeighborBuffers {
    fn new(device: &wgpu::Device, shape: &StyleShape, split: &Split) -> Self {
        let row_bytes = 4 * shape.k as u64;
        let limit = largest_binding(&device.limits());
        let rows = usize::try_from(limit / row_bytes).unwrap_or(usize::MAX).min(shape.n_gaussians);
        let rows_per_buffer = rows.max(split.chunk_rows) / split.chunk_rows * split.chunk_rows;
        let starts = (0..shape.n_gaussians).step_by(rows_per_buffer);
        let rows = starts.map(|start| rows_per_buffer.min(shape.n_gaussians - start) as u64);
        let buffers = rows.map(|rows| storage(device, "style_neighbors", rows * row_bytes)).collect();
        Self { buffers, rows_per_buffer, row_bytes }
    }

    fn write(&self, queue: &wgpu::Queue, indices: &[u32]) {
        let rows = indices.chunks(self.rows_per_buffer * self.row_bytes as usize / 4);
        for (buffer, rows) in self.buffers.iter().zip(rows) {
            queue.write_buffer(buffer, 0, bytemuck::cast_slice(rows));
        }
    }

    /// The lists of `n_rows` Gaussians from `first_row` on, which starts a chunk.
    pub fn binding(&self, first_row: u32, n_rows: u32) -> wgpu::BufferBinding<'_> {
        let (buffer, row) =
            (first_row as usize / self.rows_per_buffer, first_row as usize % self.rows_per_buffer);
        wgpu::BufferBinding {
            buffer: &self.buffers[buffer],
            offset: row as u64 * self.row_bytes,
            size: std::num::NonZero::new(u64::from(n_rows) * self.row_bytes),
        }
    }
}
