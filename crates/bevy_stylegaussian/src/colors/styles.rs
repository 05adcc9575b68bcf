//! Colors of a scene in one style, which any number of entities share.

use std::sync::{Arc, OnceLock};

use stylegaussian::strokes::Strokes;
use stylegaussian_gpu::style::{FoldedLayers, StyleInputs};

/// Colors of a scene's Gaussians in one style, or folded weights that give them, and the strokes over them. One
/// copy is on the GPU, however many entities and volumes show it, and it is freed with the last reference.
pub(crate) struct StyleColors {
    pub(crate) source: ColorSource,
    /// Strokes over the colors, if it is a painting. Styles with the same strokes share them on the GPU too.
    pub(crate) strokes: Option<Arc<Strokes>>,
    /// Number of Gaussians.
    pub(crate) n: usize,
    /// The GPU's answer once it has these colors: Ok, or the reason why it cannot take them.
    on_gpu: OnceLock<Result<(), String>>,
}

/// A source of colors.
pub(crate) enum ColorSource {
    /// Colors that were computed on the CPU `[N]`.
    Rgb(Arc<[[f32; 3]]>),
    /// A style that the style pass has to decode.
    Folded(Box<FoldedStyle>),
}

/// A style folded into the decoder's weights, ready for the GPU.
pub(crate) struct FoldedStyle {
    /// The scene's part.
    pub(crate) inputs: Arc<StyleInputs>,
    /// The style's part.
    pub(crate) layers: FoldedLayers,
}

impl StyleColors {
    /// Colors of `n` Gaussians, without strokes.
    pub(crate) fn new(source: ColorSource, n: usize) -> Arc<Self> {
        Arc::new(Self { source, strokes: None, n, on_gpu: OnceLock::new() })
    }

    /// Known colors `[N]`, and strokes over them if there are any.
    pub(crate) fn known(rgb: Arc<[[f32; 3]]>, strokes: Option<Arc<Strokes>>) -> Arc<Self> {
        let n = rgb.len();
        Arc::new(Self { source: ColorSource::Rgb(rgb), strokes, n, on_gpu: OnceLock::new() })
    }

    /// The answer of the GPU, or `None` if it has not come yet.
    pub(crate) fn on_gpu(&self) -> Option<&Result<(), String>> {
        self.on_gpu.get()
    }

    /// Sets the answer. A second one, after a lost device, changes nothing: colors that fitted once fit again.
    pub(crate) fn answer(&self, result: Result<(), String>) {
        let _ = self.on_gpu.set(result);
    }
}
