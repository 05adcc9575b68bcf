// Puts the layer of splats over the picture: a triangle over the whole viewport.

/// The uniforms of the composite.
struct SplatComposite {
    /// The camera's factor on colors before tone mapping: 2^exposure of its color grading.
    exposure: f32,
}

@group(0) @binding(0) var<uniform> composite: SplatComposite;
/// The result of `splat_inverse_table`.
@group(0) @binding(2) var inverse_table: texture_3d<f32>;
@group(0) @binding(3) var table_sampler: sampler;

/// One of the `MODE_` constants.
override mode: u32;

/// A texel of the layer in the target's space, premultiplied.
fn composited(texel: vec4<f32>) -> vec4<f32> {
    if texel.a <= 0.0 {
        discard;
    }
    if mode == MODE_ENCODED {
        return texel;
    }
    // sRGB's decoding is only defined for colors that a screen can show.
    let encoded = clamp(texel.rgb / texel.a, vec3(0.0), vec3(1.0));
    var color = exposed_color(encoded);
    if mode != MODE_LINEAR {
        color /= composite.exposure;
    }
    return vec4(color * texel.a, texel.a);
}

/// Corner 0, 1 or 2 of a triangle that covers the viewport: (-1, -1), (3, -1), (-1, 3).
fn covering(corner: u32) -> vec4<f32> {
    let at = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(at * 4.0 - 1.0, 0.0, 1.0);
}
