// The strokes of a painted mesh, pixel by pixel. No bindings and no entry points: an engine's shader of
// materials calls it. CPU twin: `stylegaussian::mesh::detail_at`.

/// A seed in plain numbers.
struct MeshSeed {
    /// Its position on the mesh at rest.
    at: vec3<f32>,
    /// Its texture.
    layer: u32,
    /// The painting's axes on the mesh, as long as shares of the painting's sides to a unit.
    right: vec3<f32>,
    down: vec3<f32>,
    /// Its place in the painting, which is the unit square.
    place: vec2<f32>,
    /// Gains of fine and of wide detail.
    gains: vec2<f32>,
}

/// The seed of this number. Each takes four texels of a row: see `stylegaussian_shaders::mesh::seed_texels`.
fn mesh_seed(seeds: texture_2d<f32>, number: u32) -> MeshSeed {
    let first = vec2(4u * (number % SEEDS_TO_A_ROW), number / SEEDS_TO_A_ROW);
    let a = textureLoad(seeds, first, 0);
    let b = textureLoad(seeds, first + vec2(1u, 0u), 0);
    let c = textureLoad(seeds, first + vec2(2u, 0u), 0);
    let d = textureLoad(seeds, first + vec2(3u, 0u), 0);
    return MeshSeed(a.xyz, u32(a.w), b.xyz, c.xyz, vec2(b.w, c.w), d.xy);
}

/// The seed that a word names.
fn mesh_seed_of(word: u32) -> u32 {
    return word & ((1u << SEED_BITS) - 1u);
}

/// Protection and share of a word.
fn mesh_shown(word: u32) -> vec2<f32> {
    return vec2(f32((word >> SEED_BITS) & SEVEN_BITS), f32(word >> (SEED_BITS + 7u))) / f32(SEVEN_BITS);
}

/// The place in the painting of a position on the mesh at rest.
fn mesh_place(seed: MeshSeed, at: vec3<f32>, stroke_scale: f32) -> vec2<f32> {
    let local = (at - seed.at) / stroke_scale;
    return seed.place + vec2(dot(seed.right, local), dot(seed.down, local));
}

/// Weights of the strokes of a triangle's corners where a fragment has these shares of them. `same` is 1 for
/// corners of one seed and else 0: of the first two, the last two, and the last and the first.
fn mesh_weights(all_shares: vec3<f32>, same: vec3<f32>) -> vec3<f32> {
    let shares = max(all_shares, vec3(0.0));
    let products = dot(shares, shares) + 2.0 * dot(shares * shares.yzx, same);
    return shares * inverseSqrt(max(products, 1e-6));
}

/// Factors of fine and of wide detail where this much is protected: see `StrokeWord::protection_by`.
fn mesh_open(protection: f32, factor: f32) -> vec2<f32> {
    let squared = factor * factor * protection;
    let by_factor = squared / max(1.0 - protection + squared, 1e-6);
    return 1.0 - vec2(PROTECTED, 1.0) * by_factor;
}

/// The level of detail: the binary logarithm of the texels to a pixel, from the change of a place for a pixel
/// to the right and for one down. Slanted, up to three times as many as from the front: a texture cannot be
/// blurred in one direction.
fn mesh_level(step_x: vec2<f32>, step_y: vec2<f32>) -> f32 {
    let facing = FINE_SIDE * min(length(step_x), length(step_y));
    let area = FINE_SIDE * sqrt(abs(step_x.x * step_y.y - step_x.y * step_y.x));
    let texels = clamp(area, facing, 3.0 * facing);
    return clamp(log2(max(texels, 1e-6)) + SHARPER, LEAST_LEVEL, MOST_LEVEL);
}

/// Fine and wide detail at a place, by their gains, and finer strokes from near.
fn mesh_detail(
    fine_detail: texture_2d_array<f32>,
    wide_detail: texture_2d_array<f32>,
    mirrored: sampler,
    at: vec2<f32>,
    layer: u32,
    level: f32,
    gains: vec2<f32>,
    near: f32,
) -> vec3<f32> {
    var fine = textureSampleLevel(fine_detail, mirrored, at, layer, max(level, 0.0)).rgb;
    for (var octave = 1.0; octave <= MOST_OCTAVES; octave += 1.0) {
        // An octave comes in from 0.4 octaves before its own distance to 0.2 after it.
        let share = clamp((0.6 - level - octave) / 0.8, 0.0, 1.0) * pow(max(near, 1e-6), octave);
        if share <= 1e-3 {
            break;
        }
        let finer = textureSampleLevel(
            fine_detail, mirrored, at * exp2(octave), layer, max(level + octave, 0.0),
        );
        fine += share * finer.rgb;
    }
    let wide = textureSampleLevel(wide_detail, mirrored, at, layer, max(level - WIDE_LEVEL, 0.0)).rgb;
    return gains.x * fine + gains.y * wide;
}

/// The gradient of the height of fine detail at a place, in texels to a texel: see `splat_stroke_relief`.
fn mesh_gradient(
    fine_detail: texture_2d_array<f32>,
    mirrored: sampler,
    at: vec2<f32>,
    layer: u32,
    level_of_color: f32,
) -> vec2<f32> {
    let level = max(level_of_color, 0.0) + BLURRIER;
    let texel = exp2(level) / FINE_SIDE;
    let first = at - texel / 3.0;
    let here = textureSampleLevel(fine_detail, mirrored, first, layer, level).rgb;
    let right = textureSampleLevel(fine_detail, mirrored, first + vec2(texel, 0.0), layer, level).rgb;
    let below = textureSampleLevel(fine_detail, mirrored, first + vec2(0.0, texel), layer, level).rgb;
    return THICKNESS * vec2(dot(right - here, LUMINANCE), dot(below - here, LUMINANCE)) / exp2(level);
}

/// A unit normal tilted by paint whose height changes by `rise`, in world units, for a pixel to the right and
/// for one down. `world_x` and `world_y` are the changes of the position (Mikkelsen, "Bump Mapping
/// Unparametrized Surfaces on the GPU", 2010).
fn mesh_normal(normal: vec3<f32>, world_x: vec3<f32>, world_y: vec3<f32>, rise: vec2<f32>) -> vec3<f32> {
    let across_x = cross(world_y, normal);
    let across_y = cross(normal, world_x);
    let area = dot(world_x, across_x);
    if abs(area) < 1e-20 {
        return normal;
    }
    let steep = (rise.x * across_x + rise.y * across_y) / area;
    let slope = steep * inverseSqrt(1.0 + dot(steep, steep) / (STEEPEST * STEEPEST));
    return normalize(normal - slope);
}

/// Display-referred sRGB of linear RGB.
fn mesh_displayed(linear: vec3<f32>) -> vec3<f32> {
    let color = clamp(linear, vec3(0.0), vec3(1.0));
    return select(1.055 * pow(color, vec3(1.0 / 2.4)) - 0.055, 12.92 * color, color <= vec3(0.0031308));
}

/// Linear RGB of display-referred sRGB.
fn mesh_linear(displayed: vec3<f32>) -> vec3<f32> {
    let color = clamp(displayed, vec3(0.0), vec3(1.0));
    return select(pow((color + 0.055) / 1.055, vec3(2.4)), color / 12.92, color <= vec3(0.04045));
}
