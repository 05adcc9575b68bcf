//! The strokes of meshes, for the materials of an engine.

use stylegaussian::strokes::{FINE_SIDE, StrokeSeed};

use crate::{constants, splat::strokes::twin_constants};

/// Seeds to a row of the texture that holds them.
pub const SEEDS_TO_A_ROW: usize = 256;

/// Texels of a seed.
pub const TEXELS: usize = 4;

/// WGSL functions that draw the strokes of a mesh, behind their constants. They have no bindings, and an
/// engine's shader may be joined before them.
pub fn strokes() -> String {
    let own = constants(&[("SEEDS_TO_A_ROW", SEEDS_TO_A_ROW as u32)]);
    twin_constants() + &own + include_str!("../wgsl/mesh_strokes.wgsl")
}

/// Seeds as the functions read them from a texture of `[rows, 4 * SEEDS_TO_A_ROW]` texels of four f32. There is
/// one row at least.
pub fn seed_texels(seeds: &[StrokeSeed]) -> Vec<[f32; 4]> {
    let side = FINE_SIDE as f32;
    let mut texels = Vec::new();
    for seed in seeds.iter().map(StrokeSeed::plain) {
        let (right, down) = (seed.right * seed.pitch.x / side, seed.down * seed.pitch.y / side);
        let place = seed.place / side;
        texels.extend([
            seed.at.extend(f32::from(seed.texture)).to_array(),
            right.extend(place.x).to_array(),
            down.extend(place.y).to_array(),
            [seed.fine, seed.wide, 0.0, 0.0],
        ]);
    }
    let row = TEXELS * SEEDS_TO_A_ROW;
    texels.resize(texels.len().div_ceil(row).max(1) * row, [0.0; 4]);
    texels
}
