// Two eyes of one head, for `splat_project`. They share what is visible to either, colors, and the order by the
// distance from their middle. Only footprints differ.

@group(0) @binding(0) var<uniform> own_eye: SplatChunk;
@group(2) @binding(0) var<uniform> other_eye: SplatChunk;
@group(2) @binding(1) var<storage, read_write> other_geometry_halves: array<vec4<f32>>;
@group(2) @binding(2) var<storage, read_write> other_color_halves: array<vec4<u32>>;

/// The chunk as the eye sees it that is projected. `eye` is the middle of both.
var<private> chunk: SplatChunk;
/// The splat that the other eye sees.
var<private> other: Splat;

/// Comes before everything that reads `chunk`.
fn begin() {
    chunk = own_eye;
}

/// The record of a splat that one eye does not see: it has no size, and its alpha is drawn by no rasterizer.
fn unseen() -> Splat {
    return Splat(chunk.viewport.xy, 0.0, 1.0, 1.0, 0.0, vec3(0.0), 0.5 * MIN_ALPHA);
}

/// The splat of a Gaussian for the first eye, visible if it is to either.
fn seen(gaussian: PackedGaussian) -> Projected {
    var own = project(gaussian);
    if !own.visible {
        own.splat = unseen();
    }
    chunk = other_eye;
    let beside = project(gaussian);
    other = unseen();
    if beside.visible {
        other = beside.splat;
    }
    chunk = own_eye;
    own.visible = own.visible || beside.visible;
    // In world units: a cloud's transform may have a scale.
    let ray = gaussian.mean - chunk.eye.xyz;
    let x = dot(chunk.view_from_scene_x.xyz, ray);
    let y = dot(chunk.view_from_scene_y.xyz, ray);
    own.distance = length(vec3(x, y, dot(chunk.view_from_scene_z.xyz, ray)));
    return own;
}

/// Writes the record of the other eye.
fn write_other_eye(record: u32, color: vec3<f32>) {
    other.color = color;
    other_geometry_halves[record] = packed_geometry(other);
    other_color_halves[record] = packed_color(other);
}
