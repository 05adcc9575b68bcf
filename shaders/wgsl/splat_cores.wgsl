// Finds the cores of splats in a shadow map: the pixels in which a splat's alpha is at least the threshold of
// its cloud, at the depth of the core's far end. One invocation per Gaussian of a piece of a chunk. Cores that
// cover no pixel are left out, and the others follow one another in any order. CPU twin:
// `stylegaussian::splat::cast`.

/// Arguments of the indirect draw of cores.
struct CoreCommand {
    /// Three for each core.
    n_vertices: atomic<u32>,
    n_instances: u32,
    first_vertex: u32,
    first_instance: u32,
}

@group(2) @binding(0) var<storage, read_write> cores: array<SplatCore>;
@group(2) @binding(1) var<storage, read_write> command: CoreCommand;

@compute @workgroup_size(WORKGROUP)
fn splat_cores(@builtin(global_invocation_id) invocation: vec3<u32>) {
    // Pieces are small enough for one dimension of workgroups.
    let index = invocation.x;
    if index >= chunk.n_gaussians {
        return;
    }
    var gaussian = gaussians[index];
    gaussian.opacity = drawn_opacity(gaussian.opacity, index);
    let projected = project(gaussian);
    if !projected.visible {
        return;
    }
    let splat = projected.splat;
    // A core ends where alpha, opacity exp(-q / 2), falls to the threshold. Of less opacity, none is visible.
    let reach = sqrt(max(2.0 * log(splat.opacity / chunk.least_opacity), 0.0));
    // The two terms that q squares are coordinates in which the core is a disc of radius `reach`.
    let width = reach * inverseSqrt(splat.row_precision);
    let height = reach * inverseSqrt(splat.y_precision);
    let slant = vec2(splat.slope, 1.0) * height;
    let half_size = vec2(length(vec2(width, slant.x)), height);
    // The first and the last pixel with a middle in the box around the core, in the viewport's pixels.
    let center = splat.center - chunk.viewport.xy;
    let first = max(ceil(center - half_size - 0.5), vec2(0.0));
    let last = min(floor(center + half_size - 0.5), chunk.viewport.zw - 1.0);
    if !all(first <= last) {
        return;
    }
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
    // Normalized device coordinates have y up, pixels y down.
    let ndc = vec2<f32>(2.0, -2.0) / chunk.viewport.zw;
    let core = atomicAdd(&command.n_vertices, 3u) / 3u;
    // What ends before the map casts its shadow into all of it.
    cores[core] =
        SplatCore(center * ndc + vec2(-1.0, 1.0), slant * ndc, width * ndc.x, clamp(depth, 0.0, 1.0));
}
