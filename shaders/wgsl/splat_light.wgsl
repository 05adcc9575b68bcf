// Changes the colors of records by light and air: the tints of their cloud and of volumes, shadows on them, and
// the air before them. One invocation per record of one cloud, after `splat_project` and `splat_strokes`. CPU
// twin: `stylegaussian::light::Lit`, which has the equation.

/// A directional light in fog.
struct FogSun {
    /// Unit direction to it, in view space.
    direction: vec3<f32>,
    padding_0: f32,
    /// The light that it adds to the fog's color where the eye looks into it, linear.
    glow: vec3<f32>,
    padding_1: f32,
}

/// A tint within a region.
struct TintVolume {
    /// Rows of the shape's space from view.
    shape_from_view_x: vec4<f32>,
    shape_from_view_y: vec4<f32>,
    shape_from_view_z: vec4<f32>,
    /// Sizes of the shape, in the order of their names in `Shape`.
    sizes: vec4<f32>,
    /// Rows of the difference that it makes to linear colors; the fourth number is not used.
    red: vec4<f32>,
    green: vec4<f32>,
    blue: vec4<f32>,
    /// One of the `SHAPE_` constants.
    shape: u32,
    softness: f32,
    /// 1 / softness, or 0 for a hard edge.
    inverse_softness: f32,
    padding: u32,
}

/// The light on one cloud as one camera sees it.
struct SplatLight {
    /// Columns of view from clip.
    view_from_clip_x: vec4<f32>,
    view_from_clip_y: vec4<f32>,
    view_from_clip_z: vec4<f32>,
    view_from_clip_w: vec4<f32>,
    /// Left, top, width and height of the viewport, in pixels of the target.
    viewport: vec4<f32>,
    /// Rows of the tint; the fourth number is not used.
    tint_red: vec4<f32>,
    tint_green: vec4<f32>,
    tint_blue: vec4<f32>,
    /// The fog's linear color.
    fog_color: vec3<f32>,
    /// Factor of all fog; 0 if there is none.
    fog_strength: f32,
    /// Density for the light behind; of linear fog its end, and its steepness.
    extinction: vec3<f32>,
    /// One of the `FALLOFF_` constants.
    falloff: u32,
    /// Density for the light that is added.
    inscattering: vec3<f32>,
    /// Exponent of the glow.
    exponent: f32,
    suns: array<FogSun, MAX_SUNS>,
    /// Volumes that tint the cloud, one after another.
    volumes: array<TintVolume, MAX_TINT_VOLUMES>,
    /// Suns that count.
    n_suns: u32,
    /// Index of the cloud's first record.
    first_record: u32,
    /// Records of the cloud.
    n_records: u32,
    /// 1 if the view has records of strokes, else 0.
    has_strokes: u32,
    /// The camera's factor on colors before tone mapping.
    exposure: f32,
    /// Share of its light that the cloud loses in shadow.
    shadow_amount: f32,
    /// Volumes that count.
    n_volumes: u32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> light: SplatLight;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> geometry_halves: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> color_halves: array<vec4<u32>>;
/// The strokes of each record, if `has_strokes` is 1.
@group(0) @binding(4) var<storage, read_write> stroke_records: array<vec4<u32>>;
@group(0) @binding(5) var inverse_table: texture_3d<f32>;
@group(0) @binding(6) var curve_table: texture_3d<f32>;
@group(0) @binding(7) var table_sampler: sampler;

/// A number of the uniforms that branches depend on, as for `flags` of `splat_footprint`.
fn hidden(number: u32) -> u32 {
    return select(number, 0u, arrayLength(&color_halves) == 0u);
}

/// One of the `MODE_` constants: how the tone mapping is undone.
override mode: u32;
/// One of the `CURVE_` constants: a tone mapping that takes a table to be undone.
override curve: u32;

/// The largest color that a record holds, the largest f16.
const MAX_COLOR: f32 = 65504.0;

/// The rows of the tint of the record at hand.
var<private> tint_red: vec3<f32>;
var<private> tint_green: vec3<f32>;
var<private> tint_blue: vec3<f32>;

/// The tint, shadow and air between the light, a splat and the eye.
struct Air {
    /// Share of the light that reaches the splat.
    shade: f32,
    transmission: vec3<f32>,
    light: vec3<f32>,
}

/// The mean of a splat, in view space.
fn seen_at(splat: Splat) -> vec3<f32> {
    // Pixels have y down, normalized device coordinates y up.
    let ndc = ((splat.center - light.viewport.xy) / light.viewport.zw * 2.0 - 1.0) * vec2(1.0, -1.0);
    let point = light.view_from_clip_x * ndc.x + light.view_from_clip_y * ndc.y
        + light.view_from_clip_z * splat.depth + light.view_from_clip_w;
    // 0 at infinity.
    return point.xyz / max(point.w, 1e-30);
}

/// The share of light that is lost along a distance.
fn lost(density: vec3<f32>, distance: f32) -> vec3<f32> {
    return 1.0 - exp(-distance * density);
}

/// The air between the eye and a point of view space.
fn air_along(ray: vec3<f32>) -> Air {
    let distance = length(ray);
    let direction = ray / max(distance, 1e-20);
    var color = light.fog_color;
    for (var i = 0u; i < hidden(light.n_suns); i++) {
        let cosine = dot(direction, light.suns[i].direction);
        // Powers of 0 are undefined.
        let share = select(0.0, pow(max(cosine, 1e-6), light.exponent), cosine > 0.0);
        color += share * light.suns[i].glow;
    }
    var behind = vec3(0.0);
    switch light.falloff {
        case FALLOFF_LINEAR: {
            behind = vec3(1.0 - saturate((light.extinction.x - distance) * light.extinction.y));
        }
        case FALLOFF_EXPONENTIAL_SQUARED: {
            behind = lost(light.extinction * light.extinction * distance, distance);
        }
        default: { behind = lost(light.extinction, distance); }
    }
    let added = select(behind, lost(light.inscattering, distance), light.falloff == FALLOFF_ATMOSPHERIC);
    let shade = shade_at(ray, light.shadow_amount);
    return Air(shade, 1.0 - light.fog_strength * behind, light.fog_strength * added * color);
}

/// sRGB's encoding (IEC 61966-2-1) of 0..1.
fn srgb_from_linear(c: vec3<f32>) -> vec3<f32> {
    return select(1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, c * 12.92, c <= vec3(0.0031308));
}

/// The linear light that is shown as a color.
fn scene(color: vec3<f32>) -> vec3<f32> {
    return exposed_color(saturate(color)) / light.exposure;
}

/// The color as which linear light is shown.
fn shown(linear: vec3<f32>) -> vec3<f32> {
    let exposed = linear * light.exposure;
    var mapped = exposed;
    switch mode {
        case MODE_REINHARD: { mapped = exposed / (1.0 + exposed); }
        case MODE_REINHARD_LUMINANCE: { mapped = exposed / (1.0 + dot(exposed, LINEAR_LUMINANCE)); }
        case MODE_TABLE: { mapped = tone_mapped(exposed); }
        default: {}
    }
    return srgb_from_linear(saturate(mapped));
}

/// The weight of a volume at a point of view space.
fn volume_weight(volume: u32, point: vec3<f32>) -> f32 {
    if light.volumes[volume].shape == SHAPE_EVERYTHING {
        return 1.0;
    }
    let seen = vec4(point, 1.0);
    let at = vec3(
        dot(light.volumes[volume].shape_from_view_x, seen),
        dot(light.volumes[volume].shape_from_view_y, seen),
        dot(light.volumes[volume].shape_from_view_z, seen),
    );
    let distance = shape_distance(light.volumes[volume].shape, light.volumes[volume].sizes, at);
    return weight_at(distance, light.volumes[volume].softness, light.volumes[volume].inverse_softness);
}

/// Finds the tint at a point of view space. CPU twin: `stylegaussian::light::tint_at`.
fn find_tint(point: vec3<f32>) {
    tint_red = light.tint_red.xyz;
    tint_green = light.tint_green.xyz;
    tint_blue = light.tint_blue.xyz;
    for (var i = 0u; i < hidden(light.n_volumes); i++) {
        let weight = volume_weight(i, point);
        let below = mat3x3(tint_red, tint_green, tint_blue);
        // Rows of a product are products of rows.
        tint_red += weight * (below * light.volumes[i].red.xyz);
        tint_green += weight * (below * light.volumes[i].green.xyz);
        tint_blue += weight * (below * light.volumes[i].blue.xyz);
    }
}

/// The tint of a linear color.
fn tinted(linear: vec3<f32>) -> vec3<f32> {
    return vec3(dot(tint_red, linear), dot(tint_green, linear), dot(tint_blue, linear));
}

/// The color of a splat of this one behind `air`.
fn lit(color: vec3<f32>, air: Air) -> vec3<f32> {
    let before = scene(color);
    let passed = air.shade * air.transmission;
    let after = max(passed * max(tinted(before), vec3(0.0)) + air.light, vec3(0.0));
    let kept = passed * saturate(tinted(vec3(1.0)));
    return shown(after) + kept * (color - shown(before));
}

/// The share of their contrast that strokes on a splat of this color keep.
fn contrast(color: vec3<f32>, air: Air) -> f32 {
    let change = lit(color + CONTRAST_STEP, air) - lit(color - CONTRAST_STEP, air);
    return max(dot(change, LINEAR_LUMINANCE) / (2.0 * CONTRAST_STEP), 0.0);
}

/// A record of strokes with this factor on both gains, the low two bytes of its last word.
fn with_gains(record: vec4<u32>, factor: f32) -> vec4<u32> {
    let gains = clamp(unpack4x8unorm(record.w).xy * factor, vec2(0.0), vec2(1.0));
    let bytes = vec2<u32>(gains * 255.0 + 0.5);
    return vec4(record.xyz, (record.w & 0xffff0000u) | bytes.x | (bytes.y << 8u));
}

@compute @workgroup_size(WORKGROUP)
fn splat_light(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) n_workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // Large clouds take two dimensions of workgroups: one is limited to 65,535.
    let index = (workgroup.y * n_workgroups.x + workgroup.x) * WORKGROUP + lane;
    if index >= light.n_records {
        return;
    }
    let record = light.first_record + index;
    if keys[record] == INVISIBLE {
        return;
    }
    var splat = unpacked(geometry_halves[record], color_halves[record]);
    let seen = seen_at(splat);
    find_tint(seen);
    let air = behind_atmosphere(air_along(seen), seen);
    let before = splat.color;
    // WGSL leaves packing of larger numbers to f16 undefined.
    splat.color = clamp(lit(before, air), vec3(-MAX_COLOR), vec3(MAX_COLOR));
    color_halves[record] = packed_color(splat);
    if hidden(light.has_strokes) > 0u {
        stroke_records[record] = with_gains(stroke_records[record], contrast(before, air));
    }
}
