//! From a wish to colors and strokes: the inputs, the computation, and what is shown meanwhile.

pub(crate) mod first;
#[cfg(feature = "images")]
pub(crate) mod following;
pub(crate) mod frames;
#[cfg(feature = "images")]
pub(crate) mod images;
#[cfg(not(feature = "images"))]
#[path = "no_images.rs"]
pub(crate) mod images;
pub(crate) mod inputs;
pub(crate) mod job;
pub(crate) mod later;
pub(crate) mod packed;
pub(crate) mod prepare;
pub(crate) mod presets;
pub(crate) mod progress;
#[cfg(feature = "refine")]
pub(crate) mod refine;
#[cfg(not(feature = "refine"))]
#[path = "no_refine.rs"]
pub(crate) mod refine;
pub(crate) mod request;
pub(crate) mod shared;
pub(crate) mod surfaces;
pub(crate) mod want;
