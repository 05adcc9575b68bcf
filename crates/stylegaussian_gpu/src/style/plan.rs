//! The dispatches that decode a scene: by block, by layer, by chunk of rows, and also by output buffer and
//! input buffer if these are split. Pure arithmetic.

use stylegaussian_shaders::style::{
    COLOR_WORKGROUP_SIZE, COLUMNS_PER_WORKGROUP, KnnLayer, ROWS_PER_WORKGROUP,
};

use super::{
    blocks::BlockShape,
    options::Precision,
    planes::{PlaneGroup, groups, n_planes, planes_per_buffer},
    shape::StyleShape,
    weights::stride,
};
use crate::buffers::TooLarge;

/// The most rows of one dispatch. 65,536 rows of the paper's widest layer are 34 GFLOP, under 0.1 s on an
/// integrated GPU, so that no driver takes a large scene for a hang; and 512 workgroups, of which 65,535 are
/// allowed.
pub(super) const CHUNK_ROWS: usize = 65_536;

/// The split of buffers by the largest binding.
#[derive(Clone, Copy, Debug)]
pub(super) struct Split {
    /// Rows of the scratch activations.
    pub capacity: usize,
    /// Planes in a buffer of the scene's inputs.
    pub inputs: usize,
    /// Planes in a buffer of each of the two scratch activations.
    pub scratch: [usize; 2],
    /// Rows of a dispatch.
    pub chunk_rows: usize,
}

impl Split {
    /// Splits planes of a scene's Gaussians and of a block's rows, and chunks of rows with neighbor lists and
    /// sums, so that each piece can be bound.
    ///
    /// # Errors
    /// If a single plane, or the lists of a few rows, are larger than `limit`.
    pub fn of(
        shape: &StyleShape,
        capacity: usize,
        precision: Precision,
        limit: u64,
    ) -> Result<Self, TooLarge> {
        // Neighbor lists are bound from any chunk on: 64 rows are a multiple of 256 bytes, the coarsest
        // alignment of a binding.
        const ROW_MULTIPLE: usize = 64;
        let inputs = planes_per_buffer(shape.widths[0], shape.n_gaussians, precision.input_format(), limit)?;
        let scratch = |which| {
            planes_per_buffer(shape.scratch_width(which), capacity, precision.activation_format(), limit)
        };
        let scratch = [scratch(0)?, scratch(1)?];
        let mut split = Self { capacity, inputs, scratch, chunk_rows: CHUNK_ROWS };
        let row_bytes = 4 * shape.k.max(sum_columns(shape, &split)) as u64;
        TooLarge::check("neighbor lists of 64 rows", ROW_MULTIPLE as u64 * row_bytes, limit)?;
        let rows = usize::try_from(limit / row_bytes).unwrap_or(usize::MAX).min(CHUNK_ROWS);
        split.chunk_rows = rows / ROW_MULTIPLE * ROW_MULTIPLE;
        Ok(split)
    }
}

/// The kernel that computes a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StepKind {
    /// `style_knn_conv` with this index in [`COLUMNS_PER_WORKGROUP`].
    KnnConv(usize),
    /// `style_color`.
    Color,
    /// `style_smoothing_pass`.
    SmoothingPass,
}

/// One dispatch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub kind: StepKind,
    /// The layer; smoothing passes count on from the last one.
    pub layer: usize,
    pub block: usize,
    /// The uniforms, without those of the decoder: activation, slope, residual.
    pub parameters: KnnLayer,
    /// Index of the buffer of the layer's input.
    pub input: usize,
    /// Index of the buffer of the layer's output.
    pub output: usize,
    pub workgroups: [u32; 2],
}

impl Step {
    /// Multiplications and additions, padding included.
    pub fn operations(&self) -> u64 {
        self.parameters.n_rows as u64 * self.operations_of_row()
    }

    /// [`operations`](Self::operations) of one row.
    pub fn operations_of_row(&self) -> u64 {
        let KnnLayer { k, n_group_planes, n_columns, .. } = self.parameters;
        2 * u64::from(k) * 8 * u64::from(n_group_planes) * u64::from(n_columns)
    }

    /// Whether other dispatches add to the sums of the same rows.
    pub fn is_partial(&self) -> bool {
        self.parameters.continues + self.parameters.is_continued > 0
    }

    /// The part of the step that computes its rows `first .. first + n`.
    pub fn part(mut self, first: u32, n: u32) -> Self {
        self.parameters.first_row += first;
        self.parameters.n_rows = n;
        self.workgroups = workgroups(self.kind, &self.parameters);
        self
    }
}

/// The dispatches of a block, in order. Each may read the output of earlier ones.
pub(super) fn steps(shape: &StyleShape, split: &Split, block: usize, rows: &BlockShape) -> Vec<Step> {
    let mut steps = Vec::new();
    for (layer, &n_rows) in rows.rows.iter().enumerate() {
        let n_inputs = n_planes(shape.widths[layer]);
        let input_groups = groups(n_inputs, input_split(layer, split));
        for first_row in (0..n_rows).step_by(split.chunk_rows) {
            let n_rows = split.chunk_rows.min(n_rows - first_row);
            for output in output_groups(shape, layer, split) {
                // Innermost, because the dispatches that share sums must follow one another: the next chunk
                // overwrites them.
                for input in input_groups.clone() {
                    let mut step = step(shape, split, layer, input, output);
                    step.block = block;
                    step.parameters.first_row = first_row as u32;
                    step.parameters.n_rows = n_rows as u32;
                    step.parameters.continues = u32::from(input.first > 0);
                    step.parameters.is_continued = u32::from(input.first + input.n < n_inputs);
                    // Rows of a block that is the whole scene are its Gaussians already.
                    step.parameters.input_is_scene &= u32::from(rows.is_part);
                    step.parameters.output_is_scene &= u32::from(rows.is_part);
                    step.workgroups = workgroups(step.kind, &step.parameters);
                    steps.push(step);
                }
            }
        }
    }
    steps
}

/// The dispatches of smoothing pass `index` on the Gaussians of a block. They read colors of other blocks, so
/// the layers and earlier passes of all blocks come before.
pub(super) fn smoothing_steps(
    shape: &StyleShape,
    split: &Split,
    block: usize,
    rows: &BlockShape,
    index: usize,
) -> Vec<Step> {
    let n_rows = rows.n_own();
    let step = |first_row: usize| {
        let parameters = KnnLayer {
            first_row: first_row as u32,
            n_rows: split.chunk_rows.min(n_rows - first_row) as u32,
            input_is_scene: u32::from(rows.is_part),
            output_is_scene: u32::from(rows.is_part),
            k: shape.k as u32,
            // For `operations`: a neighbor contributes one vector of four.
            n_group_planes: 1,
            n_columns: 4,
            ..KnnLayer::default()
        };
        let (kind, layer) = (StepKind::SmoothingPass, shape.n_layers() + index);
        let workgroups = workgroups(kind, &parameters);
        Step { kind, layer, block, parameters, input: 0, output: 0, workgroups }
    };
    (0..n_rows).step_by(split.chunk_rows).map(step).collect()
}

/// The columns of the sums that are kept between dispatches; 0 if the input of every layer fits one binding.
pub(super) fn sum_columns(shape: &StyleShape, split: &Split) -> usize {
    let is_split = |layer: &usize| n_planes(shape.widths[*layer]) > input_split(*layer, split);
    let columns = |layer| output_groups(shape, layer, split).iter().map(|g| n_columns(shape, layer, g)).max();
    (0..shape.n_layers()).filter(is_split).filter_map(columns).max().unwrap_or(0)
}

/// Planes in a buffer of a layer's input: the scene's inputs for the first layer, then the scratch buffers in
/// turns.
fn input_split(layer: usize, split: &Split) -> usize {
    if layer == 0 { split.inputs } else { split.scratch[(layer - 1) % 2] }
}

/// The output buffers of a layer. The last layer writes colors, which are one buffer.
fn output_groups(shape: &StyleShape, layer: usize, split: &Split) -> Vec<PlaneGroup> {
    if is_last(shape, layer) {
        return vec![PlaneGroup { buffer: 0, first: 0, n: 1 }];
    }
    groups(n_planes(shape.widths[layer + 1]), split.scratch[layer % 2]).collect()
}

fn n_columns(shape: &StyleShape, layer: usize, output: &PlaneGroup) -> usize {
    if is_last(shape, layer) { 4 } else { 8 * output.n }
}

fn is_last(shape: &StyleShape, layer: usize) -> bool {
    layer + 1 == shape.n_layers()
}

fn step(shape: &StyleShape, split: &Split, layer: usize, input: PlaneGroup, output: PlaneGroup) -> Step {
    let is_last = is_last(shape, layer);
    let n_columns = n_columns(shape, layer, &output) as u32;
    let kind = match n_columns {
        _ if is_last => StepKind::Color,
        // Wider workgroups gather fewer times; narrower ones waste fewer columns on layers of up to 32.
        n => StepKind::KnnConv(usize::from(n > COLUMNS_PER_WORKGROUP[0])),
    };
    let parameters = KnnLayer {
        input_rows: if layer == 0 { shape.n_gaussians } else { split.capacity } as u32,
        output_rows: split.capacity as u32,
        input_is_scene: u32::from(layer == 0),
        output_is_scene: u32::from(is_last),
        k: shape.k as u32,
        n_input_planes: n_planes(shape.widths[layer]) as u32,
        first_group_plane: input.first as u32,
        n_group_planes: input.n as u32,
        first_column: 8 * output.first as u32,
        n_columns,
        weight_stride: stride(shape.widths[layer + 1], is_last) as u32,
        ..KnnLayer::default()
    };
    let (input, output) = (input.buffer, output.buffer);
    Step { kind, layer, block: 0, parameters, input, output, workgroups: [0; 2] }
}

fn workgroups(kind: StepKind, parameters: &KnnLayer) -> [u32; 2] {
    match kind {
        StepKind::KnnConv(variant) => [
            parameters.n_rows.div_ceil(ROWS_PER_WORKGROUP),
            parameters.n_columns.div_ceil(COLUMNS_PER_WORKGROUP[variant]),
        ],
        StepKind::Color | StepKind::SmoothingPass => [parameters.n_rows.div_ceil(COLOR_WORKGROUP_SIZE), 1],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(n_gaussians: usize) -> StyleShape {
        StyleShape {
            n_gaussians,
            k: 8,
            widths: vec![39, 256, 128, 64, 32, 3],
            residual: false,
            smoothing_passes: 0,
        }
    }

    const WHOLE: Split = Split { capacity: 1000, inputs: 5, scratch: [32, 16], chunk_rows: CHUNK_ROWS };

    /// The dispatches of a whole scene.
    fn steps(shape: &StyleShape, split: &Split) -> Vec<Step> {
        super::steps(shape, split, 0, &BlockShape::whole(shape))
    }

    #[test]
    fn one_dispatch_for_each_layer_if_nothing_is_split() {
        let steps = steps(&shape(1000), &WHOLE);
        assert_eq!(steps.iter().map(|step| step.layer).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        assert_eq!(steps[0].workgroups, [8, 4]);
        assert_eq!(steps[3].kind, StepKind::KnnConv(0));
        assert_eq!((steps[4].kind, steps[4].workgroups), (StepKind::Color, [8, 1]));
        assert!(steps.iter().all(|step| step.parameters.continues + step.parameters.is_continued == 0));
        assert_eq!(sum_columns(&shape(1000), &WHOLE), 0);
    }

    /// 10 million Gaussians, decoded whole with a plane (160 MB) in each buffer. Every layer computes each row
    /// once, all numbers of workgroups are allowed on every adapter, and all indices fit 32 bits.
    #[test]
    fn ten_million_gaussians_are_cut_into_chunks() {
        let n = 10_000_000;
        let shape = StyleShape { smoothing_passes: 6, ..shape(n) };
        let split = Split { capacity: n, inputs: 1, scratch: [1, 1], chunk_rows: CHUNK_ROWS };
        let whole = BlockShape::whole(&shape);
        let smoothing = (0..6).flat_map(|index| smoothing_steps(&shape, &split, 0, &whole, index));
        let steps: Vec<Step> = steps(&shape, &split).into_iter().chain(smoothing).collect();
        for layer in 0..shape.n_layers() + 6 {
            let of_layer = steps.iter().filter(|step| step.layer == layer);
            let of_layer: Vec<_> = of_layer.filter(|step| step.input + step.output == 0).collect();
            let mut next = 0;
            for step in &of_layer {
                assert_eq!(step.parameters.first_row, next, "layer {layer}");
                next += step.parameters.n_rows;
            }
            assert_eq!((of_layer.len(), next), (153, 10_000_000), "layer {layer}");
        }
        for step in &steps {
            assert!(step.workgroups.iter().all(|n| (1..=65_535).contains(n)), "{step:?}");
            let largest = |planes: u32, rows: u32| u64::from(planes) * u64::from(rows);
            assert!(largest(step.parameters.n_group_planes, step.parameters.input_rows) < 1 << 32);
            assert!(largest(step.parameters.k, step.parameters.n_rows) < 1 << 32);
        }
    }

    #[test]
    fn no_gaussians_no_dispatch() {
        assert!(steps(&shape(0), &WHOLE).is_empty());
    }

    #[test]
    fn split_buffers_sum_over_their_planes() {
        let split = Split { capacity: 1000, inputs: 3, scratch: [8, 16], chunk_rows: 512 };
        let steps = steps(&shape(1000), &split);
        // Layer 1: 2 chunks, 4 output and 2 input buffers; layer 2: 2 chunks, 4 input buffers.
        let of_layer = |layer: usize| steps.iter().filter(move |step| step.layer == layer);
        assert_eq!((of_layer(0).count(), of_layer(1).count(), of_layer(2).count()), (16, 8, 2));
        let second = of_layer(0).nth(1).unwrap();
        assert_eq!((second.parameters.first_group_plane, second.parameters.n_group_planes), (3, 2));
        assert_eq!((second.parameters.continues, second.parameters.is_continued), (1, 0));
        assert_eq!(of_layer(0).next_back().unwrap().parameters.first_column, 192);
        assert_eq!(of_layer(0).next_back().unwrap().parameters.n_rows, 488);
        assert_eq!(sum_columns(&shape(1000), &split), 128);
    }

    /// 300 own rows and a halo of 40 for each of five layers. Rows of hidden layers are numbered within the
    /// block.
    #[test]
    fn blocks_compute_fewer_rows_layer_by_layer() {
        let block = BlockShape { rows: vec![460, 420, 380, 340, 300], is_part: true };
        let split = Split { capacity: 500, ..WHOLE };
        let steps = super::steps(&shape(1000), &split, 7, &block);
        let all =
            |field: fn(&KnnLayer) -> u32| steps.iter().map(|s| field(&s.parameters)).collect::<Vec<_>>();
        assert!(steps.iter().all(|step| step.block == 7));
        assert_eq!(all(|layer| layer.n_rows), [460, 420, 380, 340, 300]);
        assert_eq!(all(|layer| layer.input_rows), [1000, 500, 500, 500, 500]);
        assert_eq!(all(|layer| layer.output_rows), [500; 5]);
        assert_eq!(all(|layer| layer.input_is_scene), [1, 0, 0, 0, 0]);
        assert_eq!(all(|layer| layer.output_is_scene), [0, 0, 0, 0, 1]);
        assert!(
            super::steps(&shape(1000), &split, 0, &BlockShape::whole(&shape(1000))).iter().all(|step| step
                .parameters
                .input_is_scene
                + step.parameters.output_is_scene
                == 0)
        );
    }

    /// Smoothing passes need no halo: they read and write colors of the scene, and follow the layers of all
    /// blocks.
    #[test]
    fn smoothing_passes_compute_the_own_rows() {
        let shape = StyleShape { smoothing_passes: 2, ..shape(1000) };
        let block = BlockShape { rows: vec![460, 420, 380, 340, 300], is_part: true };
        let split = Split { capacity: 500, chunk_rows: 128, ..WHOLE };
        let steps = smoothing_steps(&shape, &split, 7, &block, 1);
        let rows: Vec<_> =
            steps.iter().map(|step| (step.parameters.first_row, step.parameters.n_rows)).collect();
        assert_eq!(rows, [(0, 128), (128, 128), (256, 44)]);
        for Step { kind, layer, block, parameters, .. } in steps {
            assert_eq!((kind, layer, block), (StepKind::SmoothingPass, 6, 7));
            assert_eq!((parameters.input_is_scene, parameters.output_is_scene), (1, 1));
        }
    }

    #[test]
    fn steps_are_cut_by_rows() {
        let step = steps(&shape(1000), &WHOLE)[1];
        assert_eq!(step.operations(), 1000 * 2 * 8 * 256 * 128);
        let part = step.part(128, 256);
        assert_eq!((part.parameters.first_row, part.parameters.n_rows, part.workgroups), (128, 256, [2, 2]));
    }
}
