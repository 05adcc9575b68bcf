// The strokes of each splat: its affine map from the screen to a painting. One invocation per Gaussian of one
// chunk of one cloud with strokes, after `splat_project`. CPU twin: `stylegaussian::strokes::StrokeRecord`,
// which has the derivation.

/// A chunk, and what is changed without computing strokes anew.
struct StrokeChunk {
    chunk: SplatChunk,
    /// Factor of all gains.
    amount: f32,
    /// Factor of what stands out.
    protection: f32,
    /// Factor of the size of strokes.
    stroke_scale: f32,
    /// Motions that count.
    n_motions: u32,
    /// The unit direction to the light, in scene space.
    light: vec3<f32>,
    /// Factor of the thickness of paint.
    relief: f32,
    /// 1 if any paint of the view has relief, else 0.
    n_lights: u32,
    /// 1 if strokes keep their size on screen, else 0.
    is_stable: u32,
    /// Changes that count.
    n_changes: u32,
    padding: u32,
    /// The motions, each of other seeds.
    motions: array<StrokeMotion, MAX_MOTIONS>,
    /// The changes, the topmost first.
    changes: array<StrokeChange, MAX_CHANGES>,
}

/// A spot of a surface about a stroke wide, and its place in a painting.
struct StrokeSeed {
    /// Its position, in scene units.
    at: vec3<f32>,
    /// Texels in the painting's x direction to a scene unit.
    pitch: f32,
    /// The turn from the painting's axes to the scene's: two numbers of a quaternion without its largest.
    rotation_xy: u32,
    /// The third, and texels in y to one in x, as f16.
    rotation_z_aspect: u32,
    /// Its place in the painting, x and y: fractions of 16 bits of `PERIOD`.
    place: u32,
    /// Fine gain, wide gain and layer (a byte each), which number of the quaternion is left out (two bits), and
    /// the direction of strokes in the painting.
    look: u32,
}

@group(0) @binding(0) var<uniform> uniforms: StrokeChunk;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> stroke_records: array<vec4<u32>>;
/// The light on each record's paint, if there is any.
@group(0) @binding(3) var<storage, read_write> relief_records: array<vec4<u32>>;
@group(1) @binding(0) var<storage, read> gaussians: array<PackedGaussian>;
/// Seed, protection and share of each Gaussian of the scene.
@group(1) @binding(1) var<storage, read> words: array<u32>;
@group(1) @binding(2) var<storage, read> seeds: array<StrokeSeed>;

/// A number of the uniforms that branches depend on, as for `flags` of `splat_footprint`.
fn hidden(number: u32) -> u32 {
    return select(number, 0u, arrayLength(&gaussians) == 0u);
}

/// Larger numbers count as overflow.
const HUGE: f32 = 1e37;

/// The gradients of a splat's position on screen, in pixels per scene unit, in scene space.
struct Gradients {
    x: vec3<f32>,
    y: vec3<f32>,
}

/// Those at the mean itself, however far outside of the picture: across both is the true ray.
fn gradients(mean: vec3<f32>) -> Gradients {
    let x = uniforms.chunk.view_from_scene_x;
    let y = uniforms.chunk.view_from_scene_y;
    let z = uniforms.chunk.view_from_scene_z;
    let point = vec4(mean, 1.0);
    let view = vec4(dot(x, point), dot(y, point), dot(z, point), 1.0);
    let clip_x = uniforms.chunk.clip_from_view_x;
    let clip_y = uniforms.chunk.clip_from_view_y;
    let clip_w = uniforms.chunk.clip_from_view_w;
    let w = dot(clip_w, view);
    let at = vec2(dot(clip_x, view), dot(clip_y, view)) / w;
    let half_size = 0.5 * uniforms.chunk.viewport.zw;
    let j_x = half_size.x / w * (clip_x.xyz - at.x * clip_w.xyz);
    let j_y = -half_size.y / w * (clip_y.xyz - at.y * clip_w.xyz);
    return Gradients(in_scene(j_x, x, y, z), in_scene(j_y, x, y, z));
}

/// The turn from the painting's axes to the scene's, as a quaternion.
fn turn_of(seed: StrokeSeed) -> vec4<f32> {
    let stored = vec3(unpack2x16snorm(seed.rotation_xy), unpack2x16snorm(seed.rotation_z_aspect).x);
    let others = stored * inverseSqrt(2.0);
    let largest = sqrt(max(1.0 - dot(others, others), 0.0));
    // The numbers after the largest in a circle are the others.
    var turn = vec4(others, largest);
    switch (seed.look >> 24u) & 3u {
        case 0u: { turn = vec4(largest, others); }
        case 1u: { turn = vec4(others.z, largest, others.xy); }
        case 2u: { turn = vec4(others.yz, largest, others.x); }
        default: {}
    }
    return normalize(turn);
}

/// The vector that `rotation` makes of `v`.
fn rotated(rotation: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return unrotated(vec4(-rotation.xyz, rotation.w), v);
}

/// Gains of fine and of wide detail.
fn gains_of(word: u32, seed: StrokeSeed) -> vec2<f32> {
    let own = f32((word >> SEED_BITS) & SEVEN_BITS) / f32(SEVEN_BITS);
    let share = f32(word >> (SEED_BITS + 7u)) / f32(SEVEN_BITS);
    // Of q^2 = p / (1 - p), by how much more than is usual it stands out, multiplied by the factor's square.
    let squared = uniforms.protection * uniforms.protection * own;
    let protection = squared / max(1.0 - own + squared, 1e-6);
    let gains = unpack4x8unorm(seed.look).xy * MAX_GAIN;
    return share * uniforms.amount * gains * (1.0 - vec2(PROTECTED, 1.0) * protection);
}

/// The seed that a word names, and what is changed of it.
fn changed_seed(word: u32) -> ChangedSeed {
    let number = word & ((1u << SEED_BITS) - 1u);
    var changed = ChangedSeed(number, OWN_MOTION, vec3(0.0), 1.0, 1.0, 1.0, 0.0, MAX_CHANGES);
    for (var i = 0u; i < hidden(uniforms.n_changes); i++) {
        if changed.number >= uniforms.changes[i].first {
            changed.number -= uniforms.changes[i].first;
            changed.gain *= uniforms.changes[i].gain;
            changed.stroke_scale *= uniforms.changes[i].stroke_scale;
            // The changes above have multiplied this one's, too.
            changed.added_relief += changed.relief * uniforms.changes[i].added_relief;
            changed.relief *= uniforms.changes[i].relief;
            if changed.motion == OWN_MOTION {
                changed.motion = uniforms.changes[i].motion;
            }
            if changed.curve == MAX_CHANGES && all(changed.direction == vec3(0.0)) {
                changed.direction = uniforms.changes[i].direction;
                changed.curve = select(MAX_CHANGES, i, uniforms.changes[i].n_points > 0u);
            }
        }
    }
    return changed;
}

/// The direction of a seed's strokes in the painting.
fn stroke_of(seed: StrokeSeed) -> vec2<f32> {
    let angle = f32(seed.look >> DIRECTION_SHIFT) * DIRECTION_STEP;
    return vec2(cos(angle), sin(angle));
}

/// A seed as its changes and its motion have it now.
fn seed_now(changed: ChangedSeed, seed: StrokeSeed) -> MovedSeed {
    let turn = turn_of(seed);
    let right = rotated(turn, vec3(1.0, 0.0, 0.0));
    let down = rotated(turn, vec3(0.0, 1.0, 0.0));
    var now = MovedSeed(right, down, vec2(0.0), 1.0);
    var toward = changed.direction;
    if changed.curve < MAX_CHANGES {
        toward = along_curve(changed.curve, seed.at);
    }
    if any(toward != vec3(0.0)) {
        now = turned(now, stroke_of(seed), toward);
    }
    // A loop that ends, because software adapters skip nothing but iterations, all but one of them.
    for (var i = 0u; i < hidden(uniforms.n_motions); i++) {
        let is_within =
            changed.number >= uniforms.motions[i].first && changed.number < uniforms.motions[i].end;
        if (changed.motion == OWN_MOTION && is_within) || changed.motion == i {
            let swapped = (seed.rotation_xy << 16u) | (seed.rotation_xy >> 16u);
            let aspect = unpack2x16float(seed.rotation_z_aspect).y;
            let own = hashed(seed.place ^ swapped);
            now = moved(now, uniforms.motions[i], own, stroke_of(seed), aspect);
            break;
        }
    }
    return now;
}

fn byte(x: f32) -> u32 {
    return u32(clamp(x, 0.0, 1.0) * 255.0 + 0.5);
}

/// A fraction of 16 bits, wrapped.
fn wrapped(x: f32) -> u32 {
    // 65,536 is 0 again.
    return u32(fract(x) * 65536.0) & 0xffffu;
}

/// The record of a Gaussian, all zero if it shows no strokes.
fn record_of(gaussian: PackedGaussian, word: u32) -> vec4<u32> {
    let none = vec4(0u);
    let changed = changed_seed(word);
    let seed = seeds[changed.number];
    let now = seed_now(changed, seed);
    let gains = changed.gain * now.gain * gains_of(word, seed);
    let pixel = gradients(gaussian.mean);
    // Along the ray neither coordinate changes.
    let ray = cross(pixel.x, pixel.y);
    let squared = dot(ray, ray);
    let scales = scales_of(gaussian);
    let longest = max(scales.x, max(scales.y, scales.z));
    // Comparisons with NaN are false.
    let is_usable = squared > 0.0 && squared < HUGE && max(gains.x, gains.y) > 0.0 && longest > 0.0;
    if !is_usable {
        return none;
    }
    // Steps beside the ray that move by one pixel.
    let beside_x = cross(pixel.y, ray) / squared;
    let beside_y = cross(ray, pixel.x) / squared;
    let relative = max(scales / longest, vec3(FLATTEST));
    let rotation = rotation_of(gaussian);
    let across = rotated(rotation, unrotated(rotation, ray) / (relative * relative));
    let across_ray = dot(across, ray);
    let limit = EDGE_ON * longest * uniforms.chunk.scale_unit / sqrt(squared);
    let along_x = clamp(dot(across, beside_x) / across_ray, -limit, limit);
    let along_y = clamp(dot(across, beside_y) / across_ray, -limit, limit);

    // Strokes that are stable on screen have their size from their octave.
    let is_stable = hidden(uniforms.is_stable) > 0u;
    let stroke_scale = select(uniforms.stroke_scale * changed.stroke_scale, 1.0, is_stable);
    let pitch = seed.pitch / stroke_scale * vec2(1.0, unpack2x16float(seed.rotation_z_aspect).y);
    let right = pitch.x * now.right;
    let down = pitch.y * now.down;
    let on_plane_x = beside_x - ray * along_x;
    let on_plane_y = beside_y - ray * along_y;
    let whole_x = vec2(dot(right, on_plane_x), dot(down, on_plane_x));
    let whole_y = vec2(dot(right, on_plane_y), dot(down, on_plane_y));
    let step_x = limited(whole_x);
    let step_y = limited(whole_y);
    let local = gaussian.mean - seed.at;
    let place = vec2<f32>(vec2(seed.place & 0xffffu, seed.place >> 16u)) / 65536.0
        + vec2(dot(right, local), dot(down, local)) / PERIOD
        + now.shift;

    // As if it were seen from the front. Slanted, up to three times as much: a texture cannot be blurred in one
    // direction.
    let facing = sqrt(length(beside_x) * length(beside_y) * pitch.x * pitch.y);
    let area = abs(step_x.x * step_y.y - step_x.y * step_y.x);
    let texels = clamp(sqrt(area), facing, 3.0 * facing);
    let is_finite = all(abs(place) < vec2(HUGE)) && texels > 0.0 && texels < HUGE;
    if !is_finite {
        return none;
    }
    let level = log2(texels) + SHARPER;
    if is_stable {
        let octave = clamp(floor(-level - log2(uniforms.stroke_scale)), FARTHEST, NEAREST) - 1.0;
        let scale = exp2(octave);
        let steps = array(limited(whole_x * scale), limited(whole_y * scale));
        return packed_record(gains, seed, place * scale, steps, level + octave);
    }
    return packed_record(gains, seed, place, array(step_x, step_y), level);
}

/// A step in the painting for a pixel, no larger than is stored.
fn limited(texels: vec2<f32>) -> vec2<f32> {
    return clamp(texels, vec2(-MAX_STEP), vec2(MAX_STEP));
}

/// A record from its numbers. The place is in `PERIOD`.
fn packed_record(
    gains: vec2<f32>,
    seed: StrokeSeed,
    place: vec2<f32>,
    steps: array<vec2<f32>, 2>,
    whole_level: f32,
) -> vec4<u32> {
    let level = clamp(whole_level, LEAST_LEVEL, MOST_LEVEL);
    let look = byte(gains.x / MAX_GAIN) | (byte(gains.y / MAX_GAIN) << 8u) | (seed.look & 0xff0000u)
        | (byte((level - LEAST_LEVEL) / (MOST_LEVEL - LEAST_LEVEL)) << 24u);
    let packed_place = wrapped(place.x) | (wrapped(place.y) << 16u);
    return vec4(packed_place, pack2x16float(steps[0]), pack2x16float(steps[1]), look);
}

/// How light falls on a Gaussian's paint, all zero if its paint is flat.
fn relief_of(gaussian: PackedGaussian, word: u32) -> vec4<u32> {
    let changed = changed_seed(word);
    let seed = seeds[changed.number];
    let now = seed_now(changed, seed);
    let eye = uniforms.chunk.eye;
    let to_eye = normalize(eye.xyz - eye.w * gaussian.mean);
    let inward = cross(now.right, now.down);
    let outward = select(inward, -inward, dot(inward, to_eye) < 0.0);
    let between = uniforms.light + to_eye;
    let half_way = between * inverseSqrt(max(dot(between, between), 1e-12));
    let axes = mat3x3(now.right, now.down, outward);
    // A product from the left is that with the transpose.
    let light = uniforms.light * axes;
    let middle = half_way * axes;
    let strength = uniforms.relief * changed.relief + changed.added_relief;
    return vec4(
        pack2x16snorm(light.xy),
        pack2x16snorm(vec2(light.z, middle.z)),
        pack2x16snorm(middle.xy),
        pack2x16float(vec2(strength, unpack2x16float(seed.rotation_z_aspect).y)),
    );
}

@compute @workgroup_size(WORKGROUP)
fn splat_strokes(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) n_workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // Large chunks take two dimensions of workgroups: one is limited to 65,535.
    let index = (workgroup.y * n_workgroups.x + workgroup.x) * WORKGROUP + lane;
    if index >= uniforms.chunk.n_gaussians {
        return;
    }
    let record = uniforms.chunk.first_record + index;
    if keys[record] == INVISIBLE {
        return;
    }
    let word = words[uniforms.chunk.first_gaussian + index];
    stroke_records[record] = record_of(gaussians[index], word);
    if hidden(uniforms.n_lights) > 0u {
        relief_records[record] = relief_of(gaussians[index], word);
    }
}
