// The layers of views with several samples per pixel: see `splat_edges`.

/// The splats before the farthest mesh of each pixel.
@group(0) @binding(1) var layer: texture_2d<f32>;
/// The splats before the nearest one, where `nearer_samples` has any.
@group(0) @binding(4) var nearer_layer: texture_2d<f32>;
/// A bit for each sample that is on the nearer side of an edge.
@group(0) @binding(5) var nearer_samples: texture_2d<u32>;
