// Footprints of Gaussians: culls and projects them. CPU twin: `stylegaussian::splat`, module `project`.
//
// A Gaussian with covariance S is drawn as its first-order projection J W S W^T J^T (Zwicker et al., "EWA
// Volume Splatting", 2001) plus `LOW_PASS` on the diagonal. J is written for any projection matrix P: with clip
// = P p, a pixel coordinate is clip.x / clip.w up to scale, and its gradient is (P_x - (clip.x / clip.w) P_w) /
// clip.w. Perspective, off-axis and orthographic cameras differ in P only.

@group(1) @binding(0) var<storage, read> gaussians: array<PackedGaussian>;

/// The chunk's flags. Mesa's driver for CPUs specializes a kernel at each dispatch if branches depend on
/// uniforms alone, which takes longer than the kernel. To it, the length of an array is no uniform.
fn flags() -> u32 {
    return select(chunk.flags, 0u, arrayLength(&gaussians) == 0u);
}

/// The opacity of a chunk's Gaussian with its mask and its fade.
fn drawn_opacity(opacity: f32, index: u32) -> f32 {
    // Of a cloud that is not fading, the factor is 1.
    let faded = f32(chunk.flags >> FADED_SHIFT) / f32(MAX_FADED);
    return shown_opacity(opacity, index) * (1.0 - faded);
}

/// Variance added to the diagonal of every 2D covariance, in px^2, so that no splat is thinner than about a
/// pixel.
const LOW_PASS: f32 = 0.3;
/// The low-pass of pixels of half the size.
const HALF_LOW_PASS: f32 = 0.25 * LOW_PASS;
/// Distance from the image axis, in half pictures, up to which the projection is linearized at the mean itself.
/// Beyond, the linearization at the mean stretches splats without bound; that of this distance is used instead
/// (as in the original).
const LINEARIZED_WITHIN: f32 = 1.3;
/// Larger numbers count as overflow, because their squares would be infinite.
const HUGE: f32 = 1e18;

/// A splat, and its distance in the measure of the sort.
struct Projected {
    splat: Splat,
    distance: f32,
    visible: bool,
}

/// A row of J W R S, in pixels. The 2D covariance is the Gram matrix of the two rows. `j` is the gradient of a
/// pixel coordinate in view space.
fn footprint_axis(gaussian: PackedGaussian, j: vec3<f32>) -> vec3<f32> {
    let gradient = in_scene(j, chunk.view_from_scene_x, chunk.view_from_scene_y, chunk.view_from_scene_z);
    return unrotated(rotation_of(gaussian), gradient) * scales_of(gaussian) * chunk.scale_unit;
}

/// The footprint of `gaussian`, without its color.
fn project(gaussian: PackedGaussian) -> Projected {
    var out: Projected;
    let mean = vec4(gaussian.mean, 1.0);
    let view = vec4(
        dot(chunk.view_from_scene_x, mean),
        dot(chunk.view_from_scene_y, mean),
        dot(chunk.view_from_scene_z, mean),
        1.0,
    );
    let clip = vec3(
        dot(chunk.clip_from_view_x, view),
        dot(chunk.clip_from_view_y, view),
        dot(chunk.clip_from_view_z, view),
    );
    let w = dot(chunk.clip_from_view_w, view);
    // Comparisons with NaN are false, so these conditions also cull NaN.
    let is_clipped = (flags() & UNCLIPPED) == 0u && clip.z > w;
    let in_front = -view.z > chunk.near && w > 0.0 && clip.z >= 0.0 && !is_clipped;
    let least_opacity = max(MIN_ALPHA, chunk.least_opacity);
    if !(in_front && gaussian.opacity >= least_opacity) {
        return out;
    }
    let ndc = clip.xy / w;
    let half_size = 0.5 * chunk.viewport.zw;
    // Normalized device coordinates have y up, pixels y down.
    let center = chunk.viewport.xy + half_size + ndc * vec2(half_size.x, -half_size.y);

    // Around the image axis, which off-axis projections put beside the middle of the picture.
    let at = clamp(ndc, chunk.axis - LINEARIZED_WITHIN, chunk.axis + LINEARIZED_WITHIN);
    let j_x = half_size.x / w * (chunk.clip_from_view_x.xyz - at.x * chunk.clip_from_view_w.xyz);
    let j_y = -half_size.y / w * (chunk.clip_from_view_y.xyz - at.y * chunk.clip_from_view_w.xyz);
    let row_x = footprint_axis(gaussian, j_x);
    let row_y = footprint_axis(gaussian, j_y);
    let variances = vec2(dot(row_x, row_x), dot(row_y, row_y));
    let a = variances.x + LOW_PASS;
    let b = dot(row_x, row_y);
    let c = variances.y + LOW_PASS;
    // Lagrange's identity gives a c - b^2 as a sum of positive terms; the difference itself would cancel on
    // needles.
    let normal = cross(row_x, row_y);
    let det_before = dot(normal, normal);
    let det = det_before + LOW_PASS * (a + c - LOW_PASS);
    var opacity = gaussian.opacity;
    if (flags() & (ANTIALIASED | HALF_SIZE)) != 0u {
        // The sum of a splat is proportional to its opacity and the root of its determinant. It stays as it was
        // before the low-pass (Yu et al., "Mip-Splatting", 2024), or as it is in the whole picture.
        var kept = det_before;
        if (flags() & ANTIALIASED) == 0u {
            kept += HALF_LOW_PASS * (variances.x + variances.y + HALF_LOW_PASS);
        }
        opacity *= sqrt(kept / det);
        if !(opacity >= least_opacity) {
            return out;
        }
    }

    // Culled by the footprint and not by its center, so that nothing pops at the picture's edge.
    let reach = sqrt(cutoff(opacity) * vec2(a, c));
    let offset = abs(center - (chunk.viewport.xy + half_size));
    let inside = all(offset <= half_size + reach);
    let is_large = variances.x + variances.y >= chunk.least_variance;
    let from_axis = ndc - chunk.axis;
    let adds = opacity * sqrt(det) >= chunk.least_at_edge * dot(from_axis, from_axis);
    out.visible = inside && is_large && adds && det < HUGE && all(abs(center) < vec2(HUGE));
    out.splat.center = center;
    out.splat.slope = b / c;
    out.splat.row_precision = c / det;
    out.splat.y_precision = 1.0 / c;
    out.splat.depth = clip.z / w;
    out.splat.opacity = opacity;
    out.distance = select(-view.z, length(view.xyz), (flags() & BY_DISTANCE) != 0u);
    return out;
}
