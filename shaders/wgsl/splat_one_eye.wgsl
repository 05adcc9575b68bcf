// Views of their own, for `splat_project` and `splat_cores`.

@group(0) @binding(0) var<uniform> chunk: SplatChunk;

/// Comes before everything that reads `chunk`.
fn begin() {}

/// The splat of a Gaussian.
fn seen(gaussian: PackedGaussian) -> Projected {
    return project(gaussian);
}

/// Writes the record of another eye, if there is one.
fn write_other_eye(_record: u32, _color: vec3<f32>) {}
