// Layers of looks, each within a region. One invocation per Gaussian of the given blocks, whose Gaussians lie
// near one another. Blocks whose values stay as they are, are left out, and each block names the layers that
// reach it. The values are colors (`mix_layers`) or strokes (`mix_strokes`).

/// A look in a region.
struct MixLayer {
    /// Rows of the shape's space from the scene's.
    shape_from_scene_x: vec4<f32>,
    shape_from_scene_y: vec4<f32>,
    shape_from_scene_z: vec4<f32>,
    /// Sizes of the shape, in the order of their names in `Shape`.
    sizes: vec4<f32>,
    /// Number of the look, `NO_LOOK` for the captured colors, which have no strokes, or `BELOW` for a change of
    /// the strokes below.
    look: u32,
    /// Channel of the mask, or `NO_MASK`.
    mask: u32,
    strength: f32,
    softness: f32,
    /// 1 / softness, or 0 for a hard edge.
    inverse_softness: f32,
    /// One of the `SHAPE_` constants.
    shape: u32,
    /// Added to the seeds of the look's strokes, or to those that are changed.
    first_seed: u32,
    /// Factors of a change as f16: of the share that is shown, and of protection.
    factors: u32,
}

/// Layers, the lowest first, and the part of a scene in which they are mixed.
struct MixStack {
    layers: array<MixLayer, MIX_LAYERS>,
    /// Gaussians in this chunk.
    n_gaussians: u32,
    /// Index of the chunk's first Gaussian in its scene.
    first_gaussian: u32,
    /// Index of the first of this dispatch's blocks, and their number.
    first_block: u32,
    n_blocks: u32,
}

/// A block of Gaussians.
struct MixBlock {
    /// Index in the chunk. `STARTS` is added if the lowest layer lies on the captured colors, and not on what
    /// is there.
    index: u32,
    /// A bit for each layer that reaches the block, the lowest layer in the lowest bit.
    touches: u32,
    /// A bit for each layer whose region has the weight 1 in all of the block.
    within: u32,
}

/// Whether any layer is noise. The others take about three quarters of the time without it: a processor that
/// masks lanes instead of branching evaluates every shape.
override has_noise: bool;

@group(0) @binding(0) var<uniform> stack: MixStack;
/// The chunk's packed Gaussians, two words of 16 bytes each: the first holds the mean.
@group(0) @binding(2) var<storage, read> gaussians: array<vec4<f32>>;
/// Painted weights `[N]`, 4 bytes each.
@group(0) @binding(3) var<storage, read> masks: array<u32>;
@group(0) @binding(4) var<storage, read> blocks: array<MixBlock>;

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

/// The distance from the surface of a shape, negative within it.
fn shape_distance(shape: u32, sizes: vec4<f32>, at: vec3<f32>) -> f32 {
    // The distance from the axis, and the place along it.
    let plane = vec2(length(at.xz), at.y);
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
        default: {
            if has_noise {
                return sizes.x * (lattice_noise(at / sizes.x) - sizes.y);
            }
            return 0.0;
        }
    }
}

/// The weight of a layer's region: 1 within the shape, 0 outside, a smooth step across the edge.
fn region_weight(layer: u32, mean: vec3<f32>) -> f32 {
    let point = vec4(mean, 1.0);
    let at = vec3(
        dot(stack.layers[layer].shape_from_scene_x, point),
        dot(stack.layers[layer].shape_from_scene_y, point),
        dot(stack.layers[layer].shape_from_scene_z, point),
    );
    let distance = shape_distance(stack.layers[layer].shape, stack.layers[layer].sizes, at);
    let half_width = 0.5 * stack.layers[layer].softness;
    // A comparison with NaN is false.
    if !(distance < half_width) {
        return 0.0;
    }
    if distance <= -half_width {
        return 1.0;
    }
    let t = 0.5 - distance * stack.layers[layer].inverse_softness;
    return t * t * (3.0 - 2.0 * t);
}

/// The Gaussian of an invocation.
struct MixItem {
    block: MixBlock,
    /// Its index in the chunk.
    index: u32,
    /// Its index in the scene.
    gaussian: u32,
    mean: vec3<f32>,
    /// Whether there is one.
    exists: bool,
}

/// The Gaussian of invocation `lane` in a workgroup.
fn item_of(workgroup: u32, lane: u32) -> MixItem {
    var item: MixItem;
    let place = workgroup * (MIX_WORKGROUP / MIX_BLOCK) + lane / MIX_BLOCK;
    if place >= stack.n_blocks {
        return item;
    }
    item.block = blocks[stack.first_block + place];
    item.index = (item.block.index & ~STARTS) * MIX_BLOCK + lane % MIX_BLOCK;
    if item.index >= stack.n_gaussians {
        return item;
    }
    item.gaussian = stack.first_gaussian + item.index;
    item.mean = gaussians[2u * item.index].xyz;
    item.exists = true;
    return item;
}

/// Whether the item's lowest layer lies on the captured colors.
fn starts(item: MixItem) -> bool {
    return (item.block.index & STARTS) != 0u;
}

/// Share of what is below that a layer replaces.
fn share_of(layer: u32, item: MixItem) -> f32 {
    var share = stack.layers[layer].strength;
    if (item.block.within & (1u << layer)) == 0u {
        share *= region_weight(layer, item.mean);
    }
    let mask = stack.layers[layer].mask;
    if mask != NO_MASK {
        share *= unpack4x8unorm(masks[item.gaussian])[mask];
    }
    return share;
}
