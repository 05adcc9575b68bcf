// The picture in tiles: squares of `TILE_SIZE` by `TILE_SIZE` pixels, each with a list of the splats whose footprints reach into it,
// front to back. On adapters that are a CPU, which draw faster from such lists than by quads (see `splat_tiles_blend`).

/// The tiles of a view.
struct SplatTiles {
    /// Left, top, width and height of the viewport, in pixels of the target.
    viewport: vec4<f32>,
    /// Columns and rows of tiles.
    n_tiles: vec2<u32>,
    /// How many entries all lists together have room for.
    capacity: u32,
    padding: u32,
}

/// Columns and rows of the tiles that a footprint may reach into, `last` included.
struct Reach {
    first: vec2<u32>,
    last: vec2<u32>,
}

fn reach(splat: Splat) -> Reach {
    let k = cutoff(splat.opacity);
    // The extents of an ellipse go with the square roots of its variances.
    let variance_y = 1.0 / splat.y_precision;
    let variance_x = 1.0 / splat.row_precision + splat.slope * splat.slope * variance_y;
    let extent = sqrt(k * vec2(variance_x, variance_y));
    // Pixels are seen at their middles.
    let center = splat.center - tiles.viewport.xy - 0.5;
    let end = vec2<f32>(tiles.n_tiles) - 1.0;
    let side = f32(TILE_SIZE);
    return Reach(
        vec2<u32>(clamp(floor(ceil(center - extent) / side), vec2(0.0), end)),
        vec2<u32>(clamp(floor(floor(center + extent) / side), vec2(0.0), end)),
    );
}

/// The first of the sorted splats of a run; runs are of equal length, so that several processors share the work.
fn first_of_run(run: u32, n_visible: u32) -> u32 {
    return min(run * ((n_visible + N_RUNS - 1u) / N_RUNS), n_visible);
}

/// How far a run has come.
struct RunProgress {
    /// Splats that are done.
    n_splats: u32,
    /// Tiles of the next one that are done.
    n_tiles: u32,
}
