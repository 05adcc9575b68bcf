// Turns Gaussians into splats: culls, projects and colors them. One invocation per Gaussian of one chunk of one
// cloud; the records of all clouds go into one array. CPU twin: `stylegaussian::splat`, module `project`.
//
// A Gaussian with covariance S is drawn as its first-order projection J W S W^T J^T (Zwicker et al., "EWA
// Volume Splatting", 2001) plus `LOW_PASS` on the diagonal. J is written for any projection matrix P: with clip
// = P p, a pixel coordinate is clip.x / clip.w up to scale, and its gradient is (P_x - (clip.x / clip.w) P_w) /
// clip.w. Perspective, off-axis and orthographic cameras differ in P only.

@group(0) @binding(1) var<storage, read_write> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> geometry_halves: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> color_halves: array<vec4<u32>>;
@group(1) @binding(0) var<storage, read> gaussians: array<PackedGaussian>;
@group(1) @binding(2) var<storage, read> colors: array<vec2<u32>>;

/// Variance added to the diagonal of every 2D covariance, in px^2, so that no splat is thinner than about a
/// pixel.
const LOW_PASS: f32 = 0.3;
/// Distance from the image axis, in half pictures, up to which the projection is linearized at the mean itself.
/// Beyond, the linearization at the mean stretches splats without bound; that of this distance is used instead
/// (as in the original).
const LINEARIZED_WITHIN: f32 = 1.3;
/// Larger numbers count as overflow, because their squares would be infinite.
const HUGE: f32 = 1e18;
/// The largest color that a record holds, the largest f16.
const MAX_COLOR: f32 = 65504.0;

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
    let in_front = -view.z > chunk.near && w > 0.0 && clip.z >= 0.0 && clip.z <= w;
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
    if (chunk.flags & ANTIALIASED) != 0u {
        // The sum of a splat is proportional to its opacity and the root of its determinant, and stays as it
        // was before the low-pass (Yu et al., "Mip-Splatting", 2024).
        opacity *= sqrt(det_before / det);
        if !(opacity >= least_opacity) {
            return out;
        }
    }

    // Culled by the footprint and not by its center, so that nothing pops at the picture's edge.
    let reach = sqrt(cutoff(opacity) * vec2(a, c));
    let offset = abs(center - (chunk.viewport.xy + half_size));
    let inside = all(offset <= half_size + reach);
    let is_large = variances.x + variances.y >= chunk.least_variance;
    out.visible = inside && is_large && det < HUGE && all(abs(center) < vec2(HUGE));
    out.splat.center = center;
    out.splat.slope = b / c;
    out.splat.row_precision = c / det;
    out.splat.y_precision = 1.0 / c;
    out.splat.depth = clip.z / w;
    out.splat.opacity = opacity;
    out.distance = select(-view.z, length(view.xyz), (chunk.flags & BY_DISTANCE) != 0u);
    return out;
}

/// The captured color as seen from the camera; mid-gray if the scene has none.
fn captured_color(index: u32, mean: vec3<f32>) -> vec3<f32> {
    if chunk.sh_degree == NO_SH {
        return vec3(0.5);
    }
    // Works for both kinds of `eye`: mean - eye, or the direction of parallel rays.
    let ray = mean * chunk.eye.w - chunk.eye.xyz;
    let squared = dot(ray, ray);
    // A Gaussian at the eye has no direction. `select` drops the NaN of 0 times infinity.
    let direction = select(vec3(0.0), ray * inverseSqrt(squared), squared > 0.0);
    return sh_color(index, chunk.n_gaussians, chunk.sh_degree, direction);
}

fn unpacked_color(words: vec2<u32>) -> vec4<f32> {
    return vec4(unpack2x16float(words.x), unpack2x16float(words.y));
}

/// The color. Those that are read are premultiplied: the rest of the fourth number to 1 is the share of the
/// captured color.
fn color(index: u32, mean: vec3<f32>) -> vec3<f32> {
    var own = vec4(0.0);
    if (chunk.flags & CAPTURED_COLORS) == 0u {
        own = unpacked_color(colors[chunk.first_gaussian + index]);
    }
    var rgb = own.rgb;
    // Most clouds have one color from all sides, and skip the reads of the spherical harmonics.
    if own.a < 1.0 {
        rgb += (1.0 - own.a) * captured_color(index, mean);
    }
    // WGSL leaves packing of larger numbers to f16 undefined.
    return clamp(rgb, vec3(-MAX_COLOR), vec3(MAX_COLOR));
}

/// A key that sorts like `distance`. The bits of floats compare like integers if the sign bit of positive
/// floats is set and all bits of negative floats are inverted.
fn sort_key(distance: f32) -> u32 {
    let bits = bitcast<u32>(distance);
    return bits ^ select(0x80000000u, 0xffffffffu, (bits >> 31u) != 0u);
}

@compute @workgroup_size(WORKGROUP)
fn splat_project(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) n_workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    begin();
    // Large chunks take two dimensions of workgroups: one is limited to 65,535.
    let index = (workgroup.y * n_workgroups.x + workgroup.x) * WORKGROUP + lane;
    if index >= chunk.n_gaussians {
        return;
    }
    let record = chunk.first_record + index;
    var gaussian = gaussians[index];
    // Of a cloud that is not fading, the factor is 1.
    let faded = f32(chunk.flags >> FADED_SHIFT) / f32(MAX_FADED);
    gaussian.opacity = shown_opacity(gaussian.opacity, index) * (1.0 - faded);
    var projected = seen(gaussian);
    if !projected.visible {
        keys[record] = INVISIBLE;
        return;
    }
    projected.splat.color = color(index, gaussian.mean);
    keys[record] = sort_key(projected.distance);
    geometry_halves[record] = packed_geometry(projected.splat);
    color_halves[record] = packed_color(projected.splat);
    write_other_eye(record, projected.splat.color);
}
