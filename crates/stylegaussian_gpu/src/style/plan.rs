//! Which dispatches decode a scene: by layer, by chunk of Gaussians, and where buffers are split also by output and by
//! input buffer. Pure arithmetic.

use stylegaussian_shaders::style::{COLOR_WORKGROUP_SIZE, KnnLayer, TILE_COLUMNS, TILE_ROWS};

use super::{
    content::StyleShape,
    planes::{PlaneGroup, groups, n_planes},
    weights::stride,
};

/// Gaussians of one dispatch at most: 65,536 of the paper's widest layer are 34 GFLOP, under 0.1 s on an integrated GPU,
/// so that no driver takes a large scene for a hang, and 512 workgroups of the 65,535 that are allowed.
pub(super) const CHUNK_ROWS: usize = 65_536;

/// How buffers are split: planes in a buffer of the inputs and of the two scratch activations, Gaussians in a chunk.
#[derive(Clone, Copy, Debug)]
pub(super) struct Split {
    pub inputs: usize,
    pub scratch: [usize; 2],
    pub chunk_rows: usize,
}

/// Which kernel computes a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kernel {
    /// `style_knn_conv` with this index in [`TILE_COLUMNS`].
    KnnConv(usize),
    /// `style_color`.
    Color,
}

/// One dispatch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub kernel: Kernel,
    pub layer: usize,
    /// Without what the decoder says: activation, slope, residual.
    pub parameters: KnnLayer,
    /// Which buffer of the layer's input.
    pub input: usize,
    /// Which buffer of the layer's output.
    pub output: usize,
    pub workgroups: [u32; 2],
}

/// The dispatches, in order: each may read what those before it wrote.
pub(super) fn steps(shape: &StyleShape, split: &Split) -> Vec<Step> {
    let n_layers = shape.widths.len() - 1;
    let mut steps = Vec::new();
    for layer in 0..n_layers {
        let n_inputs = n_planes(shape.widths[layer]);
        let input_groups = groups(n_inputs, input_split(layer, split));
        for first_row in (0..shape.n_gaussians).step_by(split.chunk_rows) {
            let n_rows = split.chunk_rows.min(shape.n_gaussians - first_row);
            for output in output_groups(shape, layer, split) {
                for input in input_groups.clone() {
                    let mut step = step(shape, layer, input, output);
                    step.parameters.first_row = first_row as u32;
                    step.parameters.n_rows = n_rows as u32;
                    step.parameters.continues = u32::from(input.first > 0);
                    step.parameters.is_continued = u32::from(input.first + input.n < n_inputs);
                    step.workgroups = workgroups(step.kernel, &step.parameters);
                    steps.push(step);
                }
            }
        }
    }
    steps
}

/// The columns of the sums that must be kept between dispatches; 0 where every layer's input fits one binding.
pub(super) fn sum_columns(shape: &StyleShape, split: &Split) -> usize {
    let n_layers = shape.widths.len() - 1;
    let is_split = |layer: &usize| n_planes(shape.widths[*layer]) > input_split(*layer, split);
    let columns = |layer| output_groups(shape, layer, split).iter().map(|g| n_columns(shape, layer, g)).max();
    (0..n_layers).filter(is_split).filter_map(columns).max().unwrap_or(0)
}

/// Planes in a buffer of a layer's input: the scene's for the first, then the scratch buffers in turns.
fn input_split(layer: usize, split: &Split) -> usize {
    if layer == 0 { split.inputs } else { split.scratch[(layer - 1) % 2] }
}

/// The last layer writes colors: one buffer.
fn output_groups(shape: &StyleShape, layer: usize, split: &Split) -> Vec<PlaneGroup> {
    if layer + 2 == shape.widths.len() {
        return vec![PlaneGroup { buffer: 0, first: 0, n: 1 }];
    }
    groups(n_planes(shape.widths[layer + 1]), split.scratch[layer % 2]).collect()
}

fn n_columns(shape: &StyleShape, layer: usize, output: &PlaneGroup) -> usize {
    if layer + 2 == shape.widths.len() { 4 } else { 8 * output.n }
}

fn step(shape: &StyleShape, layer: usize, input: PlaneGroup, output: PlaneGroup) -> Step {
    let is_last = layer + 2 == shape.widths.len();
    let n_columns = n_columns(shape, layer, &output) as u32;
    let kernel = match n_columns {
        _ if is_last => Kernel::Color,
        // Wider tiles gather fewer times, narrower ones compute fewer columns that are not there.
        n => Kernel::KnnConv(usize::from(n > TILE_COLUMNS[0])),
    };
    let parameters = KnnLayer {
        n_gaussians: shape.n_gaussians as u32,
        k: shape.k as u32,
        n_input_planes: n_planes(shape.widths[layer]) as u32,
        first_group_plane: input.first as u32,
        n_group_planes: input.n as u32,
        first_column: 8 * output.first as u32,
        n_columns,
        weight_stride: stride(shape.widths[layer + 1], is_last) as u32,
        ..KnnLayer::default()
    };
    Step { kernel, layer, parameters, input: input.buffer, output: output.buffer, workgroups: [0; 2] }
}

fn workgroups(kernel: Kernel, parameters: &KnnLayer) -> [u32; 2] {
    match kernel {
        Kernel::KnnConv(tile) => {
            [parameters.n_rows.div_ceil(TILE_ROWS), parameters.n_columns.div_ceil(TILE_COLUMNS[tile])]
        }
        Kernel::Color => [parameters.n_rows.div_ceil(COLOR_WORKGROUP_SIZE), 1],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(n_gaussians: usize) -> StyleShape {
        StyleShape { n_gaussians, k: 8, widths: vec![39, 256, 128, 64, 32, 3], residual: false }
    }

    const WHOLE: Split = Split { inputs: 5, scratch: [32, 16], chunk_rows: CHUNK_ROWS };

    #[test]
    fn one_dispatch_for_each_layer_where_nothing_is_split() {
        let steps = steps(&shape(1000), &WHOLE);
        assert_eq!(steps.iter().map(|step| step.layer).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        assert_eq!(steps[0].workgroups, [8, 4]);
        assert_eq!(steps[3].kernel, Kernel::KnnConv(0));
        assert_eq!((steps[4].kernel, steps[4].workgroups), (Kernel::Color, [8, 1]));
        assert!(steps.iter().all(|step| step.parameters.continues + step.parameters.is_continued == 0));
        assert_eq!(sum_columns(&shape(1000), &WHOLE), 0);
    }

    #[test]
    fn no_gaussians_no_dispatch() {
        assert!(steps(&shape(0), &WHOLE).is_empty());
    }

    #[test]
    fn split_buffers_sum_over_their_planes() {
        let split = Split { inputs: 3, scratch: [8, 16], chunk_rows: 512 };
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
}
