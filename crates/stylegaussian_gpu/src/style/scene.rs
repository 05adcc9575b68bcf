//! What the style pass keeps of a scene on the GPU.

use std::sync::{Arc, Mutex, PoisonError};

use stylegaussian::{Decoder, Scene, fold::StylizeError};

use super::{
    blocks::{Block, BlockShape},
    content::{ContentFold, StyleShape},
    features::{self, StyleInputs},
    options::{Precision, StyleOptions, activation_bytes},
    plan::{CHUNK_ROWS, Split, Step, average, steps, sum_columns},
    planes::{Planes, largest_binding, planes_per_buffer},
    scratch::{Scratch, color_bytes},
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
    pub(super) precision: Precision,
    split: Split,
    pub(super) inputs: Planes,
    pub(super) blocks: Vec<GpuBlock>,
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

/// A part of the scene that is decoded at once.
#[derive(Debug)]
pub(super) struct GpuBlock {
    shape: BlockShape,
    /// Of the rows of the first layer.
    pub neighbors: NeighborBuffers,
    /// The Gaussian of each row; a single number where the block is the whole scene.
    pub gaussians: wgpu::Buffer,
}

/// Neighbor lists `[rows, K]`, split by row.
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
        let (shape, precision) = (inputs.shape.clone(), inputs.options.precision);
        let n = shape.n_gaussians;
        let limit = largest_binding(&device.limits());
        let split = Split::of(&shape, inputs.blocks.capacity, precision, limit)?;
        let kept_as = precision.of_inputs();
        let planes = Planes::new(device, "style_inputs", shape.widths[0], n, kept_as, split.inputs);
        planes.write(queue, inputs.planes.bytes());
        let blocks = inputs.blocks.blocks.iter();
        let blocks = blocks.map(|block| GpuBlock::new(device, queue, block, shape.k, &split));
        let blocks = blocks.collect::<Result<_, _>>()?;
        let base_colors = storage(device, "style_base_colors", base_color_bytes(&shape).max(8));
        queue.write_buffer(&base_colors, 0, bytemuck::cast_slice(&inputs.base_colors));
        let (scratch, content) = (Mutex::new(None), inputs.content.clone());
        Ok(Self { shape, precision, split, inputs: planes, blocks, base_colors, scratch, content })
    }

    /// Bytes on the GPU that styling `scene` with `decoder` takes, before they are spent: its inputs, neighbor lists and
    /// [scratch memory](Self::scratch_bytes). Colors, 8 bytes for each Gaussian and style, are not counted; nor are
    /// the sums of at most one chunk of Gaussians that a scene takes whose planes must be split.
    ///
    /// # Errors
    /// No features, or a decoder that does not fit them.
    pub fn bytes(scene: &Scene, decoder: &Decoder) -> Result<u64, StylizeError> {
        Ok(StyleBytes::of(scene, decoder, &StyleOptions::default())?.total())
    }

    /// The part of [`bytes`](Self::bytes) that only a change of style needs: the activations that hidden layers write
    /// and read in turns, and the decoder's weights.
    ///
    /// # Errors
    /// As [`bytes`](Self::bytes).
    pub fn scratch_bytes(scene: &Scene, decoder: &Decoder) -> Result<u64, StylizeError> {
        let bytes = StyleBytes::of(scene, decoder, &StyleOptions::default())?;
        Ok(bytes.activations + bytes.weights)
    }

    /// Gives back the memory that only a change of style needs, for scenes that will keep their style for a while. Work
    /// that was submitted still ends; the next change takes the memory again.
    pub fn release_scratch(&self) {
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).take();
    }

    /// The memory of a change of style, made where there is none.
    pub(super) fn scratch(&self, device: &wgpu::Device) -> Scratch {
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let kept_as = self.precision.of_activations();
        scratch.get_or_insert_with(|| Scratch::new(device, &self.shape, &self.split, kept_as)).clone()
    }

    /// The dispatches of a change of style, in order.
    pub(super) fn steps(&self) -> Vec<Step> {
        let blocks = || self.blocks.iter().enumerate();
        let layers = blocks().flat_map(|(i, block)| steps(&self.shape, &self.split, i, &block.shape));
        let averages = (0..self.shape.smoothing_passes).flat_map(|index| {
            blocks().flat_map(move |(i, block)| average(&self.shape, &self.split, i, &block.shape, index))
        });
        layers.chain(averages).collect()
    }

    /// Multiplications and additions of a change of style, those of padding and of halos included, layer by layer, and average
    /// by average behind them, of one block after another `[blocks * (layers + averages)]`: what [`encode_some`](super::StylePass::encode_some) takes for each.
    pub fn operations(&self) -> Vec<u64> {
        let of_block = self.shape.n_layers() + self.shape.smoothing_passes;
        let mut operations = vec![0; self.blocks.len() * of_block];
        for step in self.steps() {
            operations[step.block * of_block + step.layer] += step.operations();
        }
        operations
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

/// What a scene and a decoder take on the GPU, in bytes, before they are spent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StyleBytes {
    /// What the first layer takes of every Gaussian, and the Gaussians' own colors where they are added in the end.
    pub features: u64,
    /// Neighbor lists.
    pub neighbors: u64,
    /// Activations between layers and colors between averages, and nothing once the change is over.
    pub activations: u64,
    /// The decoder.
    pub weights: u64,
}

impl StyleBytes {
    /// Of `scene`, decoded with `options`; finds neighbors where a scene that is decoded in blocks has none.
    ///
    /// # Errors
    /// No features, or a decoder that does not fit them.
    pub fn of(scene: &Scene, decoder: &Decoder, options: &StyleOptions) -> Result<Self, StylizeError> {
        let shape = StyleShape::of(scene, decoder)?;
        let n = shape.n_gaussians;
        let (capacity, neighbors) = if n <= options.max_rows(&shape) {
            (n, 4 * (shape.k * n) as u64)
        } else {
            let blocks = features::blocks(scene, &shape, options);
            (blocks.capacity, blocks.bytes(shape.k))
        };
        let inputs = Planes::bytes(shape.widths[0], n, options.precision.of_inputs());
        Ok(Self {
            features: inputs + base_color_bytes(&shape),
            neighbors,
            activations: activation_bytes(&shape, capacity, options.precision) + color_bytes(&shape),
            weights: super::weights::weight_bytes(&shape.widths, shape.k),
        })
    }

    /// All of them.
    pub fn total(&self) -> u64 {
        self.features + self.neighbors + self.activations + self.weights
    }
}

fn base_color_bytes(shape: &StyleShape) -> u64 {
    if shape.residual { 8 * shape.n_gaussians as u64 } else { 0 }
}

impl Split {
    /// The split of a scene by the largest buffer that can be bound: planes of a scene's Gaussians and of a block's rows,
    /// and chunks of rows whose neighbor lists and sums can be bound.
    fn of(
        shape: &StyleShape,
        capacity: usize,
        precision: Precision,
        limit: u64,
    ) -> Result<Self, StyleSceneError> {
        // Neighbor lists are bound at any chunk: 64 rows are a multiple of 256 bytes, the coarsest alignment of a binding.
        const ROW_MULTIPLE: usize = 64;
        let inputs = planes_per_buffer(shape.widths[0], shape.n_gaussians, precision.of_inputs(), limit)?;
        let scratch = |which| {
            planes_per_buffer(shape.scratch_width(which), capacity, precision.of_activations(), limit)
        };
        let scratch = [scratch(0)?, scratch(1)?];
        let mut split = Self { capacity, inputs, scratch, chunk_rows: CHUNK_ROWS };
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

impl GpuBlock {
    fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        block: &Block,
        k: usize,
        split: &Split,
    ) -> Result<Self, StyleSceneError> {
        let limit = largest_binding(&device.limits());
        let size = 4 * block.gaussians.len().max(1) as u64;
        if size > limit {
            return Err(StyleSceneError::TooLarge { what: "style_gaussians", found: size, limit });
        }
        let gaussians = storage(device, "style_gaussians", size);
        queue.write_buffer(&gaussians, 0, bytemuck::cast_slice(&block.gaussians));
        let neighbors = NeighborBuffers::new(device, block.shape.n_lists(), k, split.chunk_rows);
        neighbors.write(queue, &block.neighbors);
        Ok(Self { shape: block.shape.clone(), neighbors, gaussians })
    }
}

impl NeighborBuffers {
    fn new(device: &wgpu::Device, n_rows: usize, k: usize, chunk_rows: usize) -> Self {
        let row_bytes = 4 * k as u64;
        let limit = largest_binding(&device.limits());
        let rows = usize::try_from(limit / row_bytes).unwrap_or(usize::MAX).min(n_rows);
        let rows_per_buffer = rows.max(chunk_rows) / chunk_rows * chunk_rows;
        let starts = (0..n_rows).step_by(rows_per_buffer);
        let rows = starts.map(|start| rows_per_buffer.min(n_rows - start) as u64);
        let buffers = rows.map(|rows| storage(device, "style_neighbors", rows * row_bytes)).collect();
        Self { buffers, rows_per_buffer, row_bytes }
    }

    fn write(&self, queue: &wgpu::Queue, indices: &[u32]) {
        let rows = indices.chunks(self.rows_per_buffer * self.row_bytes as usize / 4);
        for (buffer, rows) in self.buffers.iter().zip(rows) {
            queue.write_buffer(buffer, 0, bytemuck::cast_slice(rows));
        }
    }

    /// The lists of `n_rows` rows from `first_row` on, which starts at a multiple of 64 and is of one chunk.
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
