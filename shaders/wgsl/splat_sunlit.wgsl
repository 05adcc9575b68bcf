// Views in which splats receive the shadows of a directional light and of lamps, for `splat_light`. CPU twins:
// `stylegaussian::light::ShadowCascade` and `ShadowLamp`.

/// One shadow map, and the part of the view that it is for.
struct ShadowCascade {
    /// Columns of the map's clip space from view; reverse z.
    clip_from_view_x: vec4<f32>,
    clip_from_view_y: vec4<f32>,
    clip_from_view_z: vec4<f32>,
    clip_from_view_w: vec4<f32>,
    /// Step toward the light before the comparison, in view space.
    offset: vec3<f32>,
    /// View depth up to which the map counts.
    far: f32,
}

/// A spot light or a point light with shadow maps.
struct ShadowLamp {
    /// Rows of the lamp's space from view; rigid. A spot light shines along -z, and point lights have the axes
    /// of their maps.
    light_from_view_x: vec4<f32>,
    light_from_view_y: vec4<f32>,
    light_from_view_z: vec4<f32>,
    /// Distance at which its light ends.
    range: f32,
    /// Near plane of its maps.
    near: f32,
    /// Step toward the lamp before the comparison.
    depth_bias: f32,
    /// The same for each unit of the distance along the map's axis.
    normal_bias: f32,
    /// Scale and offset of the cosine of the angle from a spot light's axis.
    cone: vec2<f32>,
    /// Half the width of a spot light's map at distance 1; 0 of a point light.
    half_width: f32,
    /// Layer of a spot light's map, or number of a point light's cube.
    map: u32,
}

/// The shadow maps of a view.
struct SplatShadows {
    /// From near to far.
    cascades: array<ShadowCascade, MAX_CASCADES>,
    lamps: array<ShadowLamp, MAX_LAMPS>,
    /// Cascades that count.
    n_cascades: u32,
    /// Lamps that count.
    n_lamps: u32,
    padding_0: u32,
    padding_1: u32,
}

@group(0) @binding(SHADOW_BINDINGS) var<uniform> shadows: SplatShadows;
@group(0) @binding(SHADOW_BINDINGS + 1u) var shadow_maps: texture_depth_2d_array;
@group(0) @binding(SHADOW_BINDINGS + 2u) var shadow_sampler: sampler_comparison;
@group(0) @binding(SHADOW_BINDINGS + 3u) var shadow_cubes: texture_depth_cube_array;

/// The share of the sun's light that reaches a point of view space.
fn sunlight(point: vec3<f32>) -> f32 {
    let n_cascades = hidden(shadows.n_cascades);
    var i = 0u;
    while i < n_cascades && -point.z >= shadows.cascades[i].far {
        i++;
    }
    if i >= n_cascades {
        return 1.0;
    }
    let at = point + shadows.cascades[i].offset;
    let clip = shadows.cascades[i].clip_from_view_x * at.x + shadows.cascades[i].clip_from_view_y * at.y
        + shadows.cascades[i].clip_from_view_z * at.z + shadows.cascades[i].clip_from_view_w;
    let ndc = clip.xyz / clip.w;
    // Comparisons with NaN are false.
    let is_inside = all(abs(ndc.xy) <= vec2(1.0)) && ndc.z >= 0.0 && ndc.z <= 1.0;
    let uv = ndc.xy * vec2(0.5, -0.5) + 0.5;
    let seen = textureSampleCompareLevel(shadow_maps, shadow_sampler, uv, i, ndc.z);
    return select(1.0, seen, is_inside);
}

/// The share of its light that a splat at a point of view space loses in a lamp's shadow, if shadow takes all.
fn lost_to(lamp: ShadowLamp, point: vec3<f32>) -> f32 {
    let seen = vec4(point, 1.0);
    let at = vec3(
        dot(lamp.light_from_view_x, seen),
        dot(lamp.light_from_view_y, seen),
        dot(lamp.light_from_view_z, seen),
    );
    let distance = length(at);
    let share = distance / lamp.range;
    var reach = saturate(1.0 - share * share * share * share);
    let is_spot = lamp.half_width > 0.0;
    var along = max(abs(at.x), max(abs(at.y), abs(at.z)));
    if is_spot {
        along = -at.z;
        reach *= saturate(along / distance * lamp.cone.x + lamp.cone.y);
    }
    // Splats have no normal, so both biases lead to the lamp. The step does not leave the pixel of the map.
    let nearer = along * (1.0 - (lamp.depth_bias + lamp.normal_bias * along) / distance);
    // Before the near plane nothing is in shadow. Comparisons with NaN are false.
    if !(reach > 0.0 && nearer > lamp.near) {
        return 0.0;
    }
    let depth = lamp.near / nearer;
    var lit = 1.0;
    if is_spot {
        let uv = at.xy / (along * lamp.half_width) * vec2(0.5, -0.5) + 0.5;
        lit = textureSampleCompareLevel(shadow_maps, shadow_sampler, uv, lamp.map, depth);
    } else {
        // The axes of cubes are left-handed.
        let toward = at * vec3(1.0, 1.0, -1.0);
        lit = textureSampleCompareLevel(shadow_cubes, shadow_sampler, toward, lamp.map, depth);
    }
    return reach * reach * (1.0 - lit);
}

/// The share of its light that a splat at a point of view space keeps, which loses `amount` in shadow.
fn shade_at(point: vec3<f32>, amount: f32) -> f32 {
    var shade = 1.0 - amount * (1.0 - sunlight(point));
    for (var i = 0u; i < hidden(shadows.n_lamps); i++) {
        shade *= 1.0 - amount * lost_to(shadows.lamps[i], point);
    }
    return shade;
}
