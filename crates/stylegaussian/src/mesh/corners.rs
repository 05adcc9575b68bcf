//! The paint of each triangle's corners.

use glam::{Vec2, Vec3};
use rustc_hash::FxHashMap;

use super::{split::Split, spots::Spots};
use crate::strokes::{FINE_SIDE, StrokeKnobs, StrokeSeed, StrokeTexture, StrokeWord};

/// A vertex of a painted mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Corner {
    /// The vertex of the split mesh.
    pub vertex: u32,
    /// The words of the three corners of its triangle, or its own three times if all have one seed.
    pub words: [u32; 3],
    /// Which corner it is; 0 if all have one seed.
    pub corner: u32,
}

/// The vertices and triangles of a painted mesh. Triangles within a seed share vertices, others do not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Corners {
    /// The vertices.
    pub corners: Vec<Corner>,
    /// The triangles.
    pub triangles: Vec<[u32; 3]>,
}

impl Corners {
    /// The corners of a split mesh whose spots have these `words` `[N]`.
    ///
    /// # Panics
    /// If there is not one word for each spot.
    pub fn new(split: &Split, spots: &Spots, words: &[u32]) -> Self {
        assert_eq!(words.len(), spots.scene.len(), "one word for each spot");
        let mut known: FxHashMap<u32, u32> = FxHashMap::default();
        let mut all = Self::default();
        for vertices in &split.triangles {
            let own = vertices.map(|vertex| words[spots.of_vertex[vertex as usize] as usize]);
            let seeds = own.map(|word| StrokeWord::unpacked(word).seed);
            let is_one = seeds[0] == seeds[1] && seeds[1] == seeds[2];
            let corner = |k: usize| match is_one {
                true => Corner { vertex: vertices[k], words: [own[k]; 3], corner: 0 },
                false => Corner { vertex: vertices[k], words: own, corner: k as u32 },
            };
            let numbers = [0, 1, 2].map(|k: usize| {
                let next = all.corners.len() as u32;
                // Where all have one seed, a vertex has one form.
                let number = if is_one { *known.entry(vertices[k]).or_insert(next) } else { next };
                if number == next {
                    all.corners.push(corner(k));
                }
                number
            });
            all.triangles.push(numbers);
        }
        all
    }
}

/// Weights of the strokes of three `seeds` where a fragment has these `shares` of a triangle's corners, which
/// sum to 1. Strokes of two seeds have nothing in common, so contrast would be lost where they meet: weights
/// are divided by the root of the sum of the seeds' squares.
pub fn blend_weights(seeds: [u32; 3], shares: Vec3) -> Vec3 {
    let shares = shares.max(Vec3::ZERO);
    let same = |a: usize, b: usize| f32::from(u8::from(seeds[a] == seeds[b]));
    let products = shares.length_squared()
        + 2.0
            * (shares.x * shares.y * same(0, 1)
                + shares.y * shares.z * same(1, 2)
                + shares.z * shares.x * same(2, 0));
    shares / products.max(1e-6).sqrt()
}

/// The detail of a painting at a point of a triangle, as display-referred RGB to add to its color. `words` are
/// those of the triangle's corners, `shares` the point's shares of them, `at` its position at rest, and `level`
/// the binary logarithm of the texels to a pixel. Octaves from near are left to the kernel.
///
/// # Panics
/// If `seeds` or `textures` do not have what the words name.
pub fn detail_at(
    (words, shares): ([u32; 3], Vec3),
    at: Vec3,
    (seeds, textures): (&[StrokeSeed], &[impl AsRef<StrokeTexture>]),
    knobs: &StrokeKnobs,
    level: f32,
) -> Vec3 {
    let words = words.map(StrokeWord::unpacked);
    let weights = blend_weights(words.map(|word| word.seed), shares).to_array();
    // How much is shown changes with the corners, and not with the seeds.
    let mean = |of: &dyn Fn(&StrokeWord) -> f32| -> f32 {
        words.iter().zip(shares.to_array()).map(|(word, share)| share * of(word)).sum()
    };
    let protection = mean(&|word| word.protection);
    let share = mean(&|word| word.share);
    let mut sum = Vec3::ZERO;
    for (word, weight) in words.iter().zip(weights).filter(|(_, weight)| *weight > 0.0) {
        let seed = seeds[word.seed as usize].plain();
        let local = at - seed.at;
        let along = Vec2::new(seed.right.dot(local), seed.down.dot(local));
        let place = (seed.place + seed.pitch / knobs.stroke_scale * along) / FINE_SIDE as f32;
        let shown = StrokeWord { protection, share, ..*word };
        let shown = StrokeWord { protection: shown.protection_by(knobs.protection), ..shown };
        let [fine, wide] = seed.gains(&shown).map(|gain| gain * weight * knobs.amount);
        let texture = textures[usize::from(seed.texture)].as_ref();
        sum += fine * texture.fine(place, level) + wide * texture.wide(place, level);
    }
    sum
}
