// Draws a painted mesh: Bevy's standard material, whose base color is the paint. The functions `mesh_*` follow
// this text. The vertex stage is Bevy's own, so that vertices are where the prepass and shadows have them. It
// passes the paint on as well, by positions at rest.

#import "embedded://bevy_pbr/render/mesh.wgsl" as bevy_mesh
#import bevy_pbr::{
    decal::clustered::apply_decals,
    forward_io::{FragmentOutput, Vertex, VertexOutput},
    pbr_fragment::pbr_input_from_standard_material,
    pbr_functions::{alpha_discard, apply_pbr_lighting, main_pass_post_lighting_processing},
    pbr_types,
}

#ifdef VISIBILITY_RANGE_DITHER
// By another name than that of the field, which the import would rename.
#import bevy_pbr::pbr_functions::visibility_range_dither as dither_by_range
#endif

#ifdef OIT_ENABLED
#import bevy_core_pipeline::oit::oit_draw
#endif

struct MeshFactors {
    /// Of gains, of protection, of the size of strokes; and the share of finer strokes from near.
    strokes: vec4<f32>,
    /// The share of the paint, and the factor of its thickness.
    shown: vec4<f32>,
}

@group(#{MATERIAL_BIND_GROUP}) @binding(100) var<uniform> mesh_factors: MeshFactors;
@group(#{MATERIAL_BIND_GROUP}) @binding(101) var fine_detail: texture_2d_array<f32>;
@group(#{MATERIAL_BIND_GROUP}) @binding(102) var mirrored: sampler;
@group(#{MATERIAL_BIND_GROUP}) @binding(103) var wide_detail: texture_2d_array<f32>;
@group(#{MATERIAL_BIND_GROUP}) @binding(104) var seeds: texture_2d<f32>;

struct PaintedVertex {
    /// The words of the triangle's corners, and which of them this vertex is.
    @location(8) words: vec4<u32>,
    /// The color under strokes, and that of the mesh without its finest detail, both display-referred.
    @location(9) painted: vec3<f32>,
    @location(10) own: vec3<f32>,
}

// Locations are those of `forward_io`, and further ones.
struct PaintedVertexOutput {
    @builtin(position) position: vec4<f32>,
    @location(0) world_position: vec4<f32>,
    @location(1) world_normal: vec3<f32>,
#ifdef VERTEX_UVS_A
    @location(2) uv: vec2<f32>,
#endif
#ifdef VERTEX_UVS_B
    @location(3) uv_b: vec2<f32>,
#endif
#ifdef VERTEX_TANGENTS
    @location(4) world_tangent: vec4<f32>,
#endif
#ifdef VERTEX_COLORS
    @location(5) color: vec4<f32>,
#endif
#ifdef VERTEX_OUTPUT_INSTANCE_INDEX
    @location(6) @interpolate(flat) instance_index: u32,
#endif
#ifdef VISIBILITY_RANGE_DITHER
    @location(7) @interpolate(flat) visibility_range_dither: i32,
#endif
    @location(8) places: vec4<f32>,
    @location(9) last_place_and_shares: vec4<f32>,
    @location(10) painted_and_protection: vec4<f32>,
    @location(11) own_and_share: vec4<f32>,
    @location(12) @interpolate(flat) seeds: vec4<u32>,
    @location(13) @interpolate(flat) layers: vec3<u32>,
}

/// The paint of a fragment.
struct Paint {
    /// Places in the painting by the seeds of the first and of the second corner.
    @location(8) places: vec4<f32>,
    /// That of the third, and shares of the second and of the third corner.
    @location(9) last_place_and_shares: vec4<f32>,
    @location(10) painted_and_protection: vec4<f32>,
    @location(11) own_and_share: vec4<f32>,
    /// Gains of each corner's seed, fractions of 16 bits of `MAX_GAIN`, and in the last number which corners
    /// have one seed: a bit for the first two, one for the last two, and one for the last and the first.
    @location(12) @interpolate(flat) seeds: vec4<u32>,
    @location(13) @interpolate(flat) layers: vec3<u32>,
}

@vertex
fn vertex(at_rest: Vertex, paint: PaintedVertex) -> PaintedVertexOutput {
    // HLSL counts instances and vertices from the first one of a draw. Naga adds its number where an entry
    // point reads them, and not in functions that it calls.
    var bevy_vertex = at_rest;
    bevy_vertex.instance_index = at_rest.instance_index;
#ifdef MORPH_TARGETS
    bevy_vertex.index = at_rest.index;
#endif
    let moved = bevy_mesh::vertex(bevy_vertex);

    var out: PaintedVertexOutput;
    out.position = moved.position;
    out.world_position = moved.world_position;
    out.world_normal = moved.world_normal;
#ifdef VERTEX_UVS_A
    out.uv = moved.uv;
#endif
#ifdef VERTEX_UVS_B
    out.uv_b = moved.uv_b;
#endif
#ifdef VERTEX_TANGENTS
    out.world_tangent = moved.world_tangent;
#endif
#ifdef VERTEX_COLORS
    out.color = moved.color;
#endif
#ifdef VERTEX_OUTPUT_INSTANCE_INDEX
    out.instance_index = moved.instance_index;
#endif
#ifdef VISIBILITY_RANGE_DITHER
    out.visibility_range_dither = moved.visibility_range_dither;
#endif

    let numbers = vec3(
        mesh_seed_of(paint.words.x), mesh_seed_of(paint.words.y), mesh_seed_of(paint.words.z),
    );
    let stroke_scale = mesh_factors.strokes.z;
    let a = mesh_seed(seeds, numbers.x);
    let b = mesh_seed(seeds, numbers.y);
    let c = mesh_seed(seeds, numbers.z);
    let corner = paint.words.w;
    let own_word = select(select(paint.words.x, paint.words.y, corner == 1u), paint.words.z, corner == 2u);
    let shown = mesh_shown(own_word);
    out.places = vec4(
        mesh_place(a, at_rest.position, stroke_scale), mesh_place(b, at_rest.position, stroke_scale),
    );
    out.last_place_and_shares =
        vec4(mesh_place(c, at_rest.position, stroke_scale), f32(corner == 1u), f32(corner == 2u));
    out.painted_and_protection = vec4(paint.painted, shown.x);
    out.own_and_share = vec4(paint.own, shown.y);
    let same = vec3<u32>(numbers == numbers.yzx);
    out.seeds = vec4(
        pack2x16unorm(a.gains / MAX_GAIN), pack2x16unorm(b.gains / MAX_GAIN), pack2x16unorm(c.gains / MAX_GAIN),
        same.x | (same.y << 1u) | (same.z << 2u),
    );
    out.layers = vec3(a.layer, b.layer, c.layer);
    return out;
}

/// The detail of the painting in a fragment, and what its height rises by for a pixel to the right and down.
struct Strokes {
    detail: vec3<f32>,
    rise: vec2<f32>,
}

/// The strokes of one of the seeds of a triangle.
fn strokes_of_seed(
    place: vec2<f32>,
    step_x: vec2<f32>,
    step_y: vec2<f32>,
    layer: u32,
    gains: vec2<f32>,
    world_area: f32,
) -> Strokes {
    if max(gains.x, gains.y) <= 0.0 {
        return Strokes(vec3(0.0), vec2(0.0));
    }
    let level = mesh_level(step_x, step_y);
    let near = mesh_factors.strokes.w;
    let detail = mesh_detail(fine_detail, wide_detail, mirrored, place, layer, level, gains, near);
    var rise = vec2(0.0);
    if mesh_factors.shown.y > 0.0 {
        let gradient = mesh_gradient(fine_detail, mirrored, place, layer, level);
        let area = abs(step_x.x * step_y.y - step_x.y * step_y.x);
        // The painting's side in world units.
        let side = sqrt(world_area / max(area, 1e-20));
        let strength = mesh_factors.shown.y * gains.x * side;
        rise = strength * vec2(dot(gradient, step_x), dot(gradient, step_y));
    }
    return Strokes(detail, rise);
}

fn strokes_of(paint: Paint, world_x: vec3<f32>, world_y: vec3<f32>) -> Strokes {
    // Derivatives are taken where all fragments of a quad are.
    let places_x = dpdx(paint.places);
    let places_y = dpdy(paint.places);
    let last_x = dpdx(paint.last_place_and_shares.xy);
    let last_y = dpdy(paint.last_place_and_shares.xy);
    let last_shares = paint.last_place_and_shares.zw;
    let shares = vec3(1.0 - last_shares.x - last_shares.y, last_shares);
    let same = vec3<f32>((vec3(paint.seeds.w) >> vec3(0u, 1u, 2u)) & vec3(1u));
    let weights = mesh_weights(shares, same);
    let open = mesh_open(paint.painted_and_protection.w, mesh_factors.strokes.y);
    let factor = MAX_GAIN * mesh_factors.strokes.x * paint.own_and_share.w * open;
    let world_area = length(cross(world_x, world_y));
    let a = strokes_of_seed(
        paint.places.xy, places_x.xy, places_y.xy, paint.layers.x,
        weights.x * factor * unpack2x16unorm(paint.seeds.x), world_area,
    );
    let b = strokes_of_seed(
        paint.places.zw, places_x.zw, places_y.zw, paint.layers.y,
        weights.y * factor * unpack2x16unorm(paint.seeds.y), world_area,
    );
    let c = strokes_of_seed(
        paint.last_place_and_shares.xy, last_x, last_y, paint.layers.z,
        weights.z * factor * unpack2x16unorm(paint.seeds.z), world_area,
    );
    return Strokes(a.detail + b.detail + c.detail, a.rise + b.rise + c.rise);
}

@fragment
fn fragment(
    vertex_output: VertexOutput,
    paint: Paint,
    @builtin(front_facing) is_front: bool,
) -> FragmentOutput {
    let world_x = dpdx(vertex_output.world_position.xyz);
    let world_y = dpdy(vertex_output.world_position.xyz);
    let strokes = strokes_of(paint, world_x, world_y);

#ifdef VISIBILITY_RANGE_DITHER
    dither_by_range(vertex_output.position, vertex_output.visibility_range_dither);
#endif

    var pbr_input = pbr_input_from_standard_material(vertex_output, is_front);

    // What stands out keeps detail that is finer than the vertices.
    let own = mesh_displayed(pbr_input.material.base_color.rgb);
    let protection = paint.painted_and_protection.w;
    let kept = protection * (own - paint.own_and_share.rgb);
    let painted = paint.painted_and_protection.rgb + kept + strokes.detail;
    let color = mix(own, painted, mesh_factors.shown.x);
    pbr_input.material.base_color = vec4(mesh_linear(color), pbr_input.material.base_color.a);
    if mesh_factors.shown.y > 0.0 {
        pbr_input.N = mesh_normal(pbr_input.N, world_x, world_y, mesh_factors.shown.x * strokes.rise);
    }

    pbr_input.material.base_color = alpha_discard(pbr_input.material, pbr_input.material.base_color);
    apply_decals(&pbr_input);

    var out: FragmentOutput;
    if (pbr_input.material.flags & pbr_types::STANDARD_MATERIAL_FLAGS_UNLIT_BIT) == 0u {
        out.color = apply_pbr_lighting(pbr_input);
    } else {
        out.color = pbr_input.material.base_color;
    }
    out.color = main_pass_post_lighting_processing(pbr_input, out.color);

#ifdef OIT_ENABLED
    let alpha_mode = pbr_input.material.flags & pbr_types::STANDARD_MATERIAL_FLAGS_ALPHA_MODE_RESERVED_BITS;
    if alpha_mode != pbr_types::STANDARD_MATERIAL_FLAGS_ALPHA_MODE_OPAQUE {
        oit_draw(vertex_output.position, out.color);
        discard;
    }
#endif

    return out;
}
