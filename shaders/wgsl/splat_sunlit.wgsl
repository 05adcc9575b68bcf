// Views in which splats receive the shadows of a directional light, for `splat_light`. CPU twin:
// `stylegaussian::light::ShadowCascade`.

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

/// The shadow maps of a view.
struct SplatShadows {
    /// From near to far.
    cascades: array<ShadowCascade, MAX_CASCADES>,
    /// Cascades that count.
    n_cascades: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

@group(0) @binding(8) var<uniform> shadows: SplatShadows;
@group(0) @binding(9) var shadow_maps: texture_depth_2d_array;
@group(0) @binding(10) var shadow_sampler: sampler_comparison;

/// The share of the sun's light that reaches a point of view space.
fn sunlight(point: vec3<f32>) -> f32 {
    var i = 0u;
    while i < shadows.n_cascades && -point.z >= shadows.cascades[i].far {
        i++;
    }
    if i >= shadows.n_cascades {
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
