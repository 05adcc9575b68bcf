//! The two engines behind a network, and the types that both share.

#[cfg(target_family = "wasm")]
mod constructors;
#[cfg_attr(target_family = "wasm", path = "engine/no_onnx_runtime.rs")]
pub(crate) mod onnx_runtime;
pub(crate) mod tract;

/// Most values that a graph may take, or a step of it make, for an image of [`PROBE_SIDE`]: 2^28, 1 GiB. VGG's
/// largest step makes 2^18, its 64 channels of 64x64 pixels.
pub(crate) const MAX_VALUES: usize = 1 << 28;

/// Width and height of the image on which a graph is tried if it takes any size.
pub(crate) const PROBE_SIDE: usize = 64;

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
    /// The shape with its batch of one: `[1, channels, height, width]`.
    pub(crate) fn shape(&self) -> [usize; 4] {
        [1, self.channels, self.height, self.width]
    }
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
