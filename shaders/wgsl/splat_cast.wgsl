// Draws the cores of splats into a shadow map: the pixels in which a splat's alpha is at least the threshold of
// its cloud, at the depth of the core's far end. One quad for each Gaussian of a chunk, whose vertices project
// it, so a shadow map needs no records. CPU twin: `stylegaussian::splat::cast`.

struct Core {
    @builtin(position) position: vec4<f32>,
    /// A place in the quad, in which the core is the disc of radius 1.
    @location(0) square: vec2<f32>,
}

@vertex
fn splat_cast_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) index: u32) -> Core {
    var gaussian = gaussians[index];
    gaussian.opacity = shown_opacity(gaussian.opacity, index);
    let projected = project(gaussian);
    if !projected.visible {
        // A quad without area.
        return Core(vec4(0.0, 0.0, 0.0, 1.0), vec2(0.0));
    }
    // A core ends where alpha, opacity exp(-q / 2), falls to the threshold. Of less opacity, none is visible.
    let reach = sqrt(max(2.0 * log(projected.splat.opacity / chunk.least_opacity), 0.0));
    let square = square_corner(corner);
    var position = corner_within(projected.splat, square, reach, chunk.viewport);
    // In space, the core is an ellipsoid of as many standard deviations. Nothing in it is in its shadow.
    let mean = vec4(gaussian.mean, 1.0);
    let deviation = length(footprint_axis(gaussian, vec3(0.0, 0.0, 1.0)));
    let end = vec4(
        dot(chunk.view_from_scene_x, mean),
        dot(chunk.view_from_scene_y, mean),
        dot(chunk.view_from_scene_z, mean) - reach * deviation,
        1.0,
    );
    let depth = dot(chunk.clip_from_view_z, end) / dot(chunk.clip_from_view_w, end);
    // What ends before the map casts its shadow into all of it.
    position.z = clamp(depth, 0.0, 1.0);
    return Core(position, square);
}

@fragment
fn splat_cast_fragment(core: Core) {
    if dot(core.square, core.square) > 1.0 {
        discard;
    }
}
