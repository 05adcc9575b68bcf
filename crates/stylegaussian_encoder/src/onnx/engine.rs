//! Types of both engines: values, and descriptions of a graph.

use crate::{FeatureMap, Image};

/// Most values that a graph may take, or a step of it make, for an image of
/// [`PROBE_SIDE`](crate::image::PROBE_SIDE): 2^28, 1 GiB. VGG's
/// largest step makes 2^18, its 64 channels of 64x64 pixels.
pub(crate) const MAX_VALUES: usize = 1 << 28;

/// Values `[1, channels, height, width]`, row-major: the input and output of a graph.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// Number of planes.
    pub channels: usize,
    /// Rows of each plane.
    pub height: usize,
    /// Columns of each plane.
    pub width: usize,
    /// `[channels, height, width]`.
    pub values: Vec<f32>,
}

impl Planes {
    /// An image's red, green and blue.
    pub(crate) fn of(image: &Image) -> Self {
        let (width, height) = (image.width as usize, image.height as usize);
        Self { channels: 3, height, width, values: transposed(&image.rgb, width * height, 3) }
    }

    /// The shape with its batch of one: `[1, channels, height, width]`.
    pub(crate) fn shape(&self) -> [usize; 4] {
        [1, self.channels, self.height, self.width]
    }
}

impl From<&Planes> for FeatureMap {
    fn from(planes: &Planes) -> Self {
        Self {
            width: planes.width as u32,
            height: planes.height as u32,
            n_channels: planes.channels,
            values: transposed(&planes.values, planes.channels, planes.height * planes.width),
        }
    }
}

/// Transposes `[rows, columns]` to `[columns, rows]`, by blocks that stay in the first-level cache (2 x 4 KiB).
pub(crate) fn transposed(values: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    // 32 x 32 values of 4 bytes are 4 KiB, once to read and once to write.
    const BLOCK: usize = 32;
    let mut out = vec![0.0; values.len()];
    for row_start in (0..rows).step_by(BLOCK) {
        for column_start in (0..columns).step_by(BLOCK) {
            for row in row_start..(row_start + BLOCK).min(rows) {
                for column in column_start..(column_start + BLOCK).min(columns) {
                    out[column * rows + row] = values[row * columns + column];
                }
            }
        }
    }
    out
}

/// A graph's inputs and outputs.
pub(crate) struct Signature {
    pub inputs: Vec<Outlet>,
    pub outputs: Vec<Outlet>,
}

/// An input or output of a graph.
pub(crate) struct Outlet {
    pub is_f32: bool,
    /// Size of each dimension, or `None` if the graph leaves it open.
    pub shape: Vec<Option<usize>>,
    /// Element type and shape, for messages.
    pub description: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_become_cells() {
        // Larger than a block in both directions, and a multiple in neither.
        let values: Vec<f32> = (0..70 * 33).map(|i| i as f32).collect();
        let planes = Planes { channels: 70, height: 3, width: 11, values };
        let features = FeatureMap::from(&planes);
        assert_eq!(features.values[5 * 70 + 69], planes.values[69 * 33 + 5]);
    }
}
