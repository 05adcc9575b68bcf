//! From a wish to colors and strokes: the inputs, the computation, and what is shown meanwhile.

pub(crate) mod canvases;
pub(crate) mod first;
pub(crate) mod frames;
pub(crate) mod images;
pub(crate) mod inputs;
pub(crate) mod job;
pub(crate) mod packed;
pub(crate) mod prepare;
pub(crate) mod progress;
pub(crate) mod refine;
pub(crate) mod request;
pub(crate) mod shared;
pub(crate) mod surfaces;
pub(crate) mod want;
