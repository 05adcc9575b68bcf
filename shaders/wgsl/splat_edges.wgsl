// The edges of meshes in depth with several samples per pixel.
//
// Splats are drawn once per pixel and not once per sample. In most pixels all samples are on one surface, and
// their mean is its depth at the middle. Where a mesh ends, splats are drawn twice: before the farthest sample,
// and before the nearest one. Each sample then shows the one whose depth is closer to its own, which is exact
// for two surfaces in a pixel.

/// The uniforms.
struct SplatEdges {
    /// Depths of one pixel that differ by more than x d + y at depth d are an edge.
    limit: vec2<f32>,
}

@group(0) @binding(0) var<uniform> edges: SplatEdges;
@group(0) @binding(1) var depths: texture_depth_multisampled_2d;

/// The depth of pixels in which there is no nearer side: nothing is before the near plane.
const NO_EDGE: f32 = 1.0;
/// The largest depth below it, 1 - 2^-24.
const NEAREST: f32 = 0.99999994;

/// The samples of a pixel, reverse z.
struct Samples {
    nearest: f32,
    farthest: f32,
    mean: f32,
}

fn samples_at(pixel: vec2<i32>) -> Samples {
    let first = textureLoad(depths, pixel, 0);
    var samples = Samples(first, first, first);
    let n = i32(textureNumSamples(depths));
    for (var i = 1; i < n; i++) {
        let depth = textureLoad(depths, pixel, i);
        samples.nearest = max(samples.nearest, depth);
        samples.farthest = min(samples.farthest, depth);
        samples.mean += depth;
    }
    samples.mean /= f32(n);
    return samples;
}

/// Whether a mesh ends within the pixel.
fn is_edge(samples: Samples) -> bool {
    let limit = edges.limit.x * samples.nearest + edges.limit.y;
    return samples.nearest - samples.farthest > limit;
}

/// Corner 0, 1 or 2 of a triangle that covers the viewport: (-1, -1), (3, -1), (-1, 3).
fn covering(corner: u32) -> vec4<f32> {
    let at = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(at * 4.0 - 1.0, 0.0, 1.0);
}
