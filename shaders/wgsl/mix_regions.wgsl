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

@group(0) @binding(0) var<uniform> stack: MixStack;
/// The chunk's packed Gaussians, two words of 16 bytes each: the first holds the mean.
@group(0) @binding(2) var<storage, read> gaussians: array<vec4<f32>>;
/// Painted weights `[N]`, 4 bytes each.
@group(0) @binding(3) var<storage, read> masks: array<u32>;
@group(0) @binding(4) var<storage, read> blocks: array<MixBlock>;

/// The weight of a layer's region: 1 within the shape, 0 outside, a smooth step across the edge.
fn region_weight(layer: u32, mean: vec3<f32>) -> f32 {
    let point = vec4(mean, 1.0);
    let at = vec3(
        dot(stack.layers[layer].shape_from_scene_x, point),
        dot(stack.layers[layer].shape_from_scene_y, point),
        dot(stack.layers[layer].shape_from_scene_z, point),
    );
    let distance = shape_distance(stack.layers[layer].shape, stack.layers[layer].sizes, at);
    return weight_at(distance, stack.layers[layer].softness, stack.layers[layer].inverse_softness);
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
