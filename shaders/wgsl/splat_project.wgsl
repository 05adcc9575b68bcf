// Turns Gaussians into splats: culls, projects (`splat_footprint`) and colors them. One invocation per Gaussian
// of one chunk of one cloud; the records of all clouds go into one array.

@group(0) @binding(1) var<storage, read_write> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> geometry_halves: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> color_halves: array<vec4<u32>>;
@group(1) @binding(2) var<storage, read> colors: array<vec2<u32>>;

/// The largest color that a record holds, the largest f16.
const MAX_COLOR: f32 = 65504.0;

/// The captured color as seen from the camera; mid-gray if the scene has none.
fn captured_color(index: u32, mean: vec3<f32>) -> vec3<f32> {
    // As for `flags`.
    let degree = select(chunk.sh_degree, NO_SH, arrayLength(&sh_words) == 0u);
    if degree == NO_SH {
        return vec3(0.5);
    }
    // Works for both kinds of `eye`: mean - eye, or the direction of parallel rays.
    let ray = mean * chunk.eye.w - chunk.eye.xyz;
    let squared = dot(ray, ray);
    // A Gaussian at the eye has no direction. `select` drops the NaN of 0 times infinity.
    let direction = select(vec3(0.0), ray * inverseSqrt(squared), squared > 0.0);
    return sh_color(index, chunk.n_gaussians, degree, direction);
}

fn unpacked_color(words: vec2<u32>) -> vec4<f32> {
    return vec4(unpack2x16float(words.x), unpack2x16float(words.y));
}

/// The color. Those that are read are premultiplied: the rest of the fourth number to 1 is the share of the
/// captured color.
fn color(index: u32, mean: vec3<f32>) -> vec3<f32> {
    var own = vec4(0.0);
    if (flags() & CAPTURED_COLORS) == 0u {
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
    gaussian.opacity = drawn_opacity(gaussian.opacity, index);
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
