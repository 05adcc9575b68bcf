// Views with meshes, which hide the splats behind them.

@group(0) @binding(7) var depths: texture_depth_2d;

/// The depth of the meshes at a pixel, reverse z.
fn depth_at(pixel: vec2<u32>) -> f32 {
    return textureLoad(depths, pixel, 0);
}
