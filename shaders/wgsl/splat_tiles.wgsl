// The picture in tiles: squares of `TILE_SIZE` by `TILE_SIZE` pixels, each with a list of the splats whose
// footprints reach into it, front to back. For software adapters, which draw faster from such lists than by
// quads (see `splat_tiles_blend`).

/// The tiles of a view.
struct SplatTiles {
    /// Left, top, width and height of the viewport, in pixels of the target.
    viewport: vec4<f32>,
    /// Columns and rows of tiles.
    n_tiles: vec2<u32>,
    /// Entries that all lists together have room for.
    capacity: u32,
    padding: u32,
}

/// Columns and rows of the tiles that a footprint may reach into, `last` included.
struct Reach {
    first: vec2<u32>,
    last: vec2<u32>,
}

fn reach(splat: Splat) -> Reach {
    if splat.opacity < MIN_ALPHA {
        // Into none.
        return Reach(vec2(1u, 0u), vec2(0u));
    }
    let k = cutoff(splat.opacity);
    // Half the width of an ellipse's bounding box is the square root of cutoff times variance.
    let variance_y = 1.0 / splat.y_precision;
    let variance_x = 1.0 / splat.row_precision + splat.slope * splat.slope * variance_y;
    let extent = sqrt(k * vec2(variance_x, variance_y));
    // A pixel is sampled at its middle.
    let center = splat.center - tiles.viewport.xy - 0.5;
    let end = vec2<f32>(tiles.n_tiles) - 1.0;
    let side = f32(TILE_SIZE);
    return Reach(
        vec2<u32>(clamp(floor(ceil(center - extent) / side), vec2(0.0), end)),
        vec2<u32>(clamp(floor(floor(center + extent) / side), vec2(0.0), end)),
    );
}

/// The first splat of a run. Runs are consecutive parts of the sorted splats, of equal length, so that several
/// threads share the work.
fn first_of_run(run: u32, n_visible: u32) -> u32 {
    return min(run * ((n_visible + N_RUNS - 1u) / N_RUNS), n_visible);
}

/// Progress of a run, which may take several dispatches.
struct RunProgress {
    /// Splats that are finished.
    n_splats: u32,
    /// Finished tiles of the next splat.
    n_tiles: u32,
}
