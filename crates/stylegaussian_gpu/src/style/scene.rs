//! A scene on the GPU, for the style pass.

use std::sync::{Arc, Mutex, PoisonError};

use stylegaussian::{Decoder, Scene, fold::StylizeError};

use super::{
    blocks::{Block, BlockShape},
    bytes::StyleBytes,
    content::ContentFold,
    error::StyleSceneError,
    inputs::StyleInputs,
    options::{Precision, StyleOptions},
    plan::{Split, Step, smoothing_steps, steps},
    planes::Planes,
    scratch::Scratch,
    shape::StyleShape,
};
use crate::buffers::{self, TooLarge};

/// A scene's inputs to the decoder, its neighbor lists, and the scratch memory of the decoder's layers. It
/// belongs to one scene and one decoder, and serves any number of styles.
///
/// The first change of style allocates scratch memory and keeps it, so that further changes allocate nothing.
/// [`release_scratch`](Self::release_scratch) gives it back until the next change.
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

/// A part of the scene that is decoded at once.
#[derive(Debug)]
pub(super) struct GpuBlock {
    shape: BlockShape,
    /// Neighbor lists of the rows of the first layer.
    pub neighbors: NeighborBuffers,
    /// The Gaussian of each row. A single number if the block is the whole scene.
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
    /// Packs and uploads the inputs of `decoder` on `scene`. To pack on another thread, see [`StyleInputs`].
    ///
    /// # Errors
    /// If the scene has no features, if the decoder does not fit them, or if the device's limits are too small.
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
    /// If the device's limits are too small for a single plane of 8 channels.
    pub fn upload(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        inputs: &StyleInputs,
    ) -> Result<Self, StyleSceneError> {
        let (shape, precision) = (inputs.shape.clone(), inputs.options.precision);
        let n = shape.n_gaussians;
        let limit = buffers::largest_binding(device);
        let split = Split::of(&shape, inputs.blocks.capacity, precision, limit)?;
        let format = precision.input_format();
        let planes = Planes::new(device, "style_inputs", shape.widths[0], n, format, split.inputs);
        planes.write(queue, inputs.planes.bytes());
        let blocks = inputs.blocks.list.iter();
        let blocks = blocks.map(|block| GpuBlock::new(device, queue, block, shape.k, &split));
        let blocks = blocks.collect::<Result<_, _>>()?;
        // Buffers cannot be empty: one color stays unread if there is no residual.
        let base_colors = buffers::storage(device, "style_base_colors", shape.base_color_bytes().max(8));
        queue.write_buffer(&base_colors, 0, bytemuck::cast_slice(&inputs.base_colors));
        let (scratch, content) = (Mutex::new(None), inputs.content.clone());
        Ok(Self { shape, precision, split, inputs: planes, blocks, base_colors, scratch, content })
    }

    /// Bytes of GPU memory that styling `scene` with `decoder` will take: inputs, neighbor lists and [scratch
    /// memory](Self::scratch_bytes). Colors, 8 bytes for each Gaussian and style, are not counted. If planes
    /// must be split, the sums of one chunk of Gaussians come on top.
    ///
    /// # Errors
    /// If the scene has no features, or if the decoder does not fit them.
    pub fn bytes(scene: &Scene, decoder: &Decoder) -> Result<u64, StylizeError> {
        Ok(StyleBytes::of(scene, decoder, &StyleOptions::default())?.total())
    }

    /// The part of [`bytes`](Self::bytes) that only a change of style needs: the activations of hidden layers,
    /// and the decoder's weights.
    ///
    /// # Errors
    /// As [`bytes`](Self::bytes).
    pub fn scratch_bytes(scene: &Scene, decoder: &Decoder) -> Result<u64, StylizeError> {
        let bytes = StyleBytes::of(scene, decoder, &StyleOptions::default())?;
        Ok(bytes.activations + bytes.weights)
    }

    /// Releases the memory that only a change of style needs, for scenes that will keep their style for a
    /// while. Submitted work still completes. The next change allocates the memory again.
    pub fn release_scratch(&self) {
        // A thread that panicked left either buffers or none, and both are valid.
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).take();
    }

    /// The memory of a change of style, allocated if there is none.
    pub(super) fn scratch(&self, device: &wgpu::Device) -> Scratch {
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let format = self.precision.activation_format();
        scratch.get_or_insert_with(|| Scratch::new(device, &self.shape, &self.split, format)).clone()
    }

    /// The dispatches of a change of style, in order.
    pub(super) fn steps(&self) -> Vec<Step> {
        let blocks = || self.blocks.iter().enumerate();
        let layers = blocks().flat_map(|(i, block)| steps(&self.shape, &self.split, i, &block.shape));
        let smoothing = (0..self.shape.smoothing_passes).flat_map(|index| {
            blocks()
                .flat_map(move |(i, block)| smoothing_steps(&self.shape, &self.split, i, &block.shape, index))
        });
        layers.chain(smoothing).collect()
    }

    /// Multiplications and additions of a change of style, padding and halos included: one number for each
    /// layer and each smoothing pass of each block `[blocks * (layers + passes)]`.
    /// [`encode_some`](super::StylePass::encode_some) takes as many from its budget.
    pub fn operations(&self) -> Vec<u64> {
        let steps_per_block = self.shape.n_layers() + self.shape.smoothing_passes;
        let mut operations = vec![0; self.blocks.len() * steps_per_block];
        for step in self.steps() {
            operations[step.block * steps_per_block + step.layer] += step.operations();
        }
        operations
    }

    /// The part of the scene that folding needs.
    pub fn content(&self) -> &Arc<ContentFold> {
        &self.content
    }

    /// N.
    pub fn n_gaussians(&self) -> usize {
        self.shape.n_gaussians
    }
}

impl GpuBlock {
    fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        block: &Block,
        k: usize,
        split: &Split,
    ) -> Result<Self, TooLarge> {
        let size = 4 * block.gaussians.len().max(1) as u64;
        TooLarge::check("Gaussians of a block", size, buffers::largest_binding(device))?;
        let gaussians = buffers::storage(device, "style_gaussians", size);
        queue.write_buffer(&gaussians, 0, bytemuck::cast_slice(&block.gaussians));
        let neighbors = NeighborBuffers::new(device, block.shape.n_lists(), k, split.chunk_rows);
        neighbors.write(queue, &block.neighbors);
        Ok(Self { shape: block.shape.clone(), neighbors, gaussians })
    }
}

impl NeighborBuffers {
    fn new(device: &wgpu::Device, n_rows: usize, k: usize, chunk_rows: usize) -> Self {
        let row_bytes = 4 * k as u64;
        let limit = buffers::largest_binding(device);
        let rows = usize::try_from(limit / row_bytes).unwrap_or(usize::MAX).min(n_rows);
        // Whole chunks, so that no dispatch needs two buffers.
        let rows_per_buffer = rows.max(chunk_rows) / chunk_rows * chunk_rows;
        let starts = (0..n_rows).step_by(rows_per_buffer);
        let rows = starts.map(|start| rows_per_buffer.min(n_rows - start) as u64);
        let buffers =
            rows.map(|rows| buffers::storage(device, "style_neighbors", rows * row_bytes)).collect();
        Self { buffers, rows_per_buffer, row_bytes }
    }

    fn write(&self, queue: &wgpu::Queue, indices: &[u32]) {
        let rows = indices.chunks(self.rows_per_buffer * self.row_bytes as usize / 4);
        for (buffer, rows) in self.buffers.iter().zip(rows) {
            queue.write_buffer(buffer, 0, bytemuck::cast_slice(rows));
        }
    }

    /// The lists of `n_rows` rows of one chunk. `first_row` is a multiple of 64.
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
