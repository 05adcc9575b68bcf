// Targets with as many samples as the meshes' depth. The first instance covers the samples on the farther sides
// of edges, the second one those on the nearer sides. Masks of samples are cheaper than a shader that runs once
// for each sample.

struct Side {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) is_nearer: u32,
}

struct Covered {
    @location(0) color: vec4<f32>,
    @builtin(sample_mask) samples: u32,
}

@vertex
fn splat_composite_vertex(
    @builtin(vertex_index) corner: u32,
    @builtin(instance_index) instance: u32,
) -> Side {
    return Side(covering(corner), instance);
}

@fragment
fn splat_composite_fragment(side: Side) -> Covered {
    let pixel = vec2<i32>(side.position.xy);
    let nearer = textureLoad(nearer_samples, pixel, 0).r;
    if side.is_nearer == 0u {
        return Covered(composited(textureLoad(layer, pixel, 0)), ~nearer);
    }
    if nearer == 0u {
        discard;
    }
    return Covered(composited(textureLoad(nearer_layer, pixel, 0)), nearer);
}
