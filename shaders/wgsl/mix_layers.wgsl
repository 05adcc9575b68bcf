// Lays one look over the colors of a scene, within a region. One invocation per Gaussian of the given blocks, whose
// Gaussians lie near one another; the blocks that the region does not touch, and those whose colors stay as they are, are left out. CPU twin, for all layers
// together: `stylegaussian::layers::mix_layers`.

/// A look in a region.
struct MixLayer {
    /// Rows of the shape's space from the scene's.
    shape_from_scene_x: vec4<f32>,
    shape_from_scene_y: vec4<f32>,
    shape_from_scene_z: vec4<f32>,
    /// Sizes of the shape, in the order of their names in `Shape`.
    sizes: vec4<f32>,
    /// 1 if there is a look, 0 for the captured colors.
    has_look: u32,
    /// Channel of the mask, or `NO_MASK`.
    mask: u32,
    strength: f32,
    softness: f32,
    /// 1 / softness, or 0 for a hard edge.
    inverse_softness: f32,
    /// Gaussians in this chunk.
    n_gaussians: u32,
    /// Index of the chunk's first Gaussian in its scene.
    first_gaussian: u32,
    /// Index of the first of this dispatch's blocks, and their number.
    first_block: u32,
    n_blocks: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

/// The shape, one of the `SHAPE_` constants. `SHAPE_EVERYTHING` stands for the inside of any other.
override shape: u32;
/// 1 if the layer leaves nothing of the colors below: its look is copied.
override is_copy: u32;

@group(0) @binding(0) var<uniform> layer: MixLayer;
/// Colors `[N]`, 4 f16 each, premultiplied.
@group(0) @binding(1) var<storage, read_write> colors: array<vec2<u32>>;
/// The chunk's packed Gaussians, two words of 16 bytes each: the first holds the mean.
@group(0) @binding(2) var<storage, read> gaussians: array<vec4<f32>>;
/// Painted weights `[N]`, 4 bytes each.
@group(0) @binding(3) var<storage, read> masks: array<u32>;
@group(0) @binding(4) var<storage, read> look: array<vec2<u32>>;
/// Indices of blocks in the chunk. `STARTS` is added where the layer lies on the captured colors, and not on those that are
/// there, and `WITHIN` where the region's weight is 1.
@group(0) @binding(5) var<storage, read> blocks: array<u32>;

/// The largest number of a color, the largest f16.
const MAX_COLOR: f32 = 65504.0;

/// A random number of a whole point, 0..1: the first of pcg3d's three (Jarzynski and Olano, 2020).
fn lattice_hash(at: vec3<u32>) -> f32 {
    var v = at * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> vec3(16u);
    v.x += v.y * v.z;
    return f32(v.x >> 8u) / 16777216.0;
}

/// Value noise, 0..1.
fn lattice_noise(at: vec3<f32>) -> f32 {
    let cell = floor(at);
    let linear = at - cell;
    let t = linear * linear * (3.0 - 2.0 * linear);
    let base = bitcast<vec3<u32>>(vec3<i32>(cell));
    let x00 = mix(lattice_hash(base), lattice_hash(base + vec3(1u, 0u, 0u)), t.x);
    let x10 = mix(lattice_hash(base + vec3(0u, 1u, 0u)), lattice_hash(base + vec3(1u, 1u, 0u)), t.x);
    let x01 = mix(lattice_hash(base + vec3(0u, 0u, 1u)), lattice_hash(base + vec3(1u, 0u, 1u)), t.x);
    let x11 = mix(lattice_hash(base + vec3(0u, 1u, 1u)), lattice_hash(base + vec3(1u)), t.x);
    return mix(mix(x00, x10, t.y), mix(x01, x11, t.y), t.z);
}

/// The distance from an ellipsoid, to first order.
fn ellipsoid_distance(at: vec3<f32>, radii: vec3<f32>) -> f32 {
    let scaled = at / radii;
    let size = length(scaled);
    if size > 0.0 {
        return size * (size - 1.0) / length(scaled / radii);
    }
    return -min(radii.x, min(radii.y, radii.z));
}

/// The distance from a cone in the plane of its axis.
fn cone_distance(at: vec2<f32>, radius: f32, height: f32) -> f32 {
    let tip = vec2(0.0, 0.5 * height);
    let side = vec2(radius, -height);
    let from_tip = at - tip;
    let along = clamp(dot(from_tip, side) / dot(side, side), 0.0, 1.0);
    let to_side = length(from_tip - along * side);
    let to_bottom = length(vec2(max(at.x - radius, 0.0), at.y + 0.5 * height));
    let is_inside = dot(from_tip, vec2(height, radius)) < 0.0 && at.y > -0.5 * height;
    let nearest = min(to_side, to_bottom);
    return select(nearest, -nearest, is_inside);
}

/// The distance from the surface of the layer's shape, negative within it.
fn shape_distance(at: vec3<f32>) -> f32 {
    // The distance from the axis, and the place along it.
    let plane = vec2(length(at.xz), at.y);
    let sizes = layer.sizes;
    switch shape {
        case SHAPE_HALF_SPACE: { return at.y; }
        case SHAPE_ELLIPSOID: { return ellipsoid_distance(at, sizes.xyz); }
        case SHAPE_CUBOID: {
            let outside = abs(at) - sizes.xyz;
            return length(max(outside, vec3(0.0))) + min(max(outside.x, max(outside.y, outside.z)), 0.0);
        }
        case SHAPE_CYLINDER: {
            let outside = vec2(plane.x, abs(plane.y)) - sizes.xy;
            return length(max(outside, vec2(0.0))) + min(max(outside.x, outside.y), 0.0);
        }
        case SHAPE_CAPSULE: {
            let along = clamp(plane.y, -sizes.y, sizes.y);
            return length(vec2(plane.x, plane.y - along)) - sizes.x;
        }
        case SHAPE_CONE: { return cone_distance(plane, sizes.x, sizes.y); }
        case SHAPE_TORUS: { return length(vec2(plane.x - sizes.x, plane.y)) - sizes.y; }
        default: { return sizes.x * (lattice_noise(at / sizes.x) - sizes.y); }
    }
}

/// The weight of the layer's region: 1 within the shape, 0 outside, a smooth step across the edge.
fn region_weight(mean: vec3<f32>) -> f32 {
    let point = vec4(mean, 1.0);
    let at = vec3(
        dot(layer.shape_from_scene_x, point),
        dot(layer.shape_from_scene_y, point),
        dot(layer.shape_from_scene_z, point),
    );
    let distance = shape_distance(at);
    let half_width = 0.5 * layer.softness;
    // A comparison with NaN is false.
    if !(distance < half_width) {
        return 0.0;
    }
    if distance <= -half_width {
        return 1.0;
    }
    let t = 0.5 - distance * layer.inverse_softness;
    return t * t * (3.0 - 2.0 * t);
}

fn unpack_color(words: vec2<u32>) -> vec4<f32> {
    return vec4(unpack2x16float(words.x), unpack2x16float(words.y));
}

@compute @workgroup_size(MIX_WORKGROUP)
fn mix_layers(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) n_workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // Many blocks take two dimensions of workgroups: one is limited to 65,535.
    let first = (workgroup.y * n_workgroups.x + workgroup.x) * (MIX_WORKGROUP / MIX_BLOCK);
    let item = first + lane / MIX_BLOCK;
    if item >= layer.n_blocks {
        return;
    }
    let block = blocks[layer.first_block + item];
    let index = (block & ~(STARTS | WITHIN)) * MIX_BLOCK + lane % MIX_BLOCK;
    if index >= layer.n_gaussians {
        return;
    }
    let gaussian = layer.first_gaussian + index;
    if is_copy != 0u {
        colors[gaussian] = look[gaussian];
        return;
    }
    var share = layer.strength;
    if shape != SHAPE_EVERYTHING && (block & WITHIN) == 0u {
        share *= region_weight(gaussians[2u * index].xyz);
    }
    if layer.mask != NO_MASK {
        share *= unpack4x8unorm(masks[gaussian])[layer.mask];
    }
    var color = vec4(0.0);
    if (block & STARTS) == 0u {
        color = unpack_color(colors[gaussian]);
    }
    var above = vec4(0.0);
    if layer.has_look != 0u {
        above = unpack_color(look[gaussian]);
    }
    // WGSL leaves packing of larger numbers to f16 undefined.
    let limited = clamp(mix(color, above, share), vec4(-MAX_COLOR), vec4(MAX_COLOR));
    colors[gaussian] = vec2(pack2x16float(limited.xy), pack2x16float(limited.zw));
}
