//! A painting cut into patches, with which pictures are painted over (image quilting: Efros and Freeman 2001, and the
//! coherence of Ashikhmin 2001).
//!
//! A picture's patches are replaced by those of the painting that resemble them most in color and in how much detail of
//! each size they have. Neighbors that can continue one another do, so that strokes run over many patches.

use glam::{IVec2, Vec3};
use rayon::prelude::*;

use super::{
    bands::{energies, softened},
    painting::Paint,
};
use crate::{
    decoder::product::{Matrix, dot, product},
    palette::LUMINANCE,
    principal::leading_axes,
};

/// Half the side of a patch, in pixels. A patch of 20 pixels holds a stroke, and about what a cell of relu3_1 sees.
const HALF: i32 = 10;

/// Distance of a picture's patches, in pixels.
const STEP: i32 = 10;

/// Distance of the painting's patches, in pixels.
const STRIDE: i32 = 4;

/// Samples along each side of a patch, and their distance in pixels.
const N_SAMPLES: i32 = 7;
const SAMPLE: i32 = 3;

/// Bands of detail that are compared.
const N_BANDS: usize = 3;

/// Numbers of a descriptor, by which patches are compared.
const WIDTH: usize = (N_SAMPLES * N_SAMPLES) as usize * 3 + N_BANDS;

/// Weight of a band's deviation beside that of colors. Without it the nearest would be patches of little detail, which are near
/// to all others.
const DETAIL: f32 = 3.0;

/// Factor of a patch's squared distance for each neighbor that it continues.
const CONTINUED: f32 = 0.5;

/// Rounds in which places spread. A place spreads along rows and columns within a round.
const ROUNDS: usize = 3;

/// Directions in which descriptors are compared: those in which the painting's vary most.
const N_DIRECTIONS: usize = 32;

/// Numbers of a key: its coordinates, and half of its squared length, which makes products distances.
const KEY: usize = N_DIRECTIONS + 1;

/// Deviation of a patch's weight around its center, in pixels: so narrow that little is averaged.
const SEAM: f32 = 3.5;

/// Cells per product: 64 rows of 15,000 similarities take 4 MB.
const BLOCK: usize = 64;

/// A painting's patches.
pub(super) struct Patches {
    size: [usize; 2],
    pixels: Vec<Vec3>,
    /// Columns and rows of patches.
    grid: [i32; 2],
    /// Unit vectors along the directions `[N_DIRECTIONS, WIDTH]`.
    axes: Vec<f32>,
    /// Coordinates of the patches' descriptors, and half of their squared length, negative `[P, KEY]`.
    keys: Vec<f32>,
}

/// A cell of a picture, and its place in the painting.
struct Cell {
    /// Coordinates of its descriptor.
    row: [f32; N_DIRECTIONS],
    /// Center of the patch that it takes.
    at: IVec2,
    /// Squared distance of the descriptors.
    distance: f32,
}

impl Patches {
    /// Cuts a painting. Returns `None` if it is smaller than a patch.
    pub fn new(paint: &Paint) -> Option<Self> {
        let size = [paint.width, paint.height];
        if size.into_iter().any(|side| (side as i32) < 2 * HALF) {
            return None;
        }
        let pixels = paint.colors();
        let grid = size.map(|side| (side as i32 - 2 * HALF) / STRIDE + 1);
        let looks = Looks::new(&pixels, size);
        let center = |i: i32| IVec2::new(i % grid[0], i / grid[0]) * STRIDE + HALF;
        let descriptors: Vec<f32> =
            (0..grid[0] * grid[1]).into_par_iter().flat_map_iter(|i| looks.at(center(i))).collect();
        let axes = leading_axes(&descriptors, WIDTH, N_DIRECTIONS);
        let mut keys = coordinates(&descriptors, &axes);
        for key in keys.as_chunks_mut::<KEY>().0 {
            key[N_DIRECTIONS] = -0.5 * dot(&key[..N_DIRECTIONS], &key[..N_DIRECTIONS]);
        }
        Some(Self { size, pixels, grid, axes, keys })
    }

    /// A picture `[H * W]` of `size` (width and height), painted over where `wanted` `[H * W]`. Elsewhere it stays as it
    /// is.
    pub fn painted_over(&self, picture: &[Vec3], size: [usize; 2], wanted: &[bool]) -> Vec<Vec3> {
        let grid = size.map(|side| side.div_ceil(STEP as usize) + 1);
        let center = |i: usize| IVec2::new((i % grid[0]) as i32, (i / grid[0]) as i32) * STEP;
        let mut used = vec![false; grid[0] * grid[1]];
        for (i, _) in wanted.iter().enumerate().filter(|(_, wanted)| **wanted) {
            // The four cells around a pixel: others are too far away to be seen.
            let corner = i / size[0] / STEP as usize * grid[0] + i % size[0] / STEP as usize;
            for next in [0, 1, grid[0], grid[0] + 1] {
                used[corner + next] = true;
            }
        }
        let looks = Looks::new(picture, size);
        let of_cells: Vec<usize> = (0..used.len()).filter(|&i| used[i]).collect();
        let found: Vec<Vec<Cell>> = of_cells
            .par_chunks(BLOCK)
            .map(|cells| {
                let rows: Vec<f32> = cells.iter().flat_map(|&i| looks.at(center(i))).collect();
                self.nearest(&rows)
            })
            .collect();
        let mut cells: Vec<Option<Cell>> = used.iter().map(|_| None).collect();
        of_cells.iter().zip(found.into_iter().flatten()).for_each(|(&i, cell)| cells[i] = Some(cell));
        for _ in 0..ROUNDS {
            self.spread(&mut cells, grid);
        }
        let seam: [f32; STEP as usize + 1] =
            std::array::from_fn(|offset| (-0.5 * (offset as f32 / SEAM).powi(2)).exp());
        let color = |i: usize| {
            let at = IVec2::new((i % size[0]) as i32, (i / size[0]) as i32);
            if wanted[i] { self.blended(&cells, grid, &seam, at).unwrap_or(picture[i]) } else { picture[i] }
        };
        (0..picture.len()).into_par_iter().map(color).collect()
    }

    /// A cell with the nearest patch for each of the `descriptors` `[Q, WIDTH]`.
    fn nearest(&self, descriptors: &[f32]) -> Vec<Cell> {
        let rows = coordinates(descriptors, &self.axes);
        let (n, n_keys) = (rows.len() / KEY, self.keys.len() / KEY);
        let mut similarities = vec![0.0; n * n_keys];
        let keys = Matrix::dense(&self.keys, n_keys, KEY).transposed();
        product(&mut similarities, false, Matrix::dense(&rows, n, KEY), keys);
        let cell = |(row, similarities): (&[f32; KEY], &[f32])| {
            // |a - b|^2 = |a|^2 + |b|^2 - 2 a b.
            let best = largest(similarities) as i32;
            let at = IVec2::new(best % self.grid[0], best / self.grid[0]) * STRIDE + HALF;
            let row = std::array::from_fn(|i| row[i]);
            Cell { row, at, distance: self.distance(&row, at) }
        };
        rows.as_chunks::<KEY>().0.iter().zip(similarities.chunks_exact(n_keys)).map(cell).collect()
    }

    /// Squared distance of a descriptor's coordinates from the patch nearest to `at`.
    fn distance(&self, row: &[f32; N_DIRECTIONS], at: IVec2) -> f32 {
        let place = ((at - HALF) / STRIDE).min(IVec2::from(self.grid) - 1);
        let key = &self.keys[(place.y * self.grid[0] + place.x) as usize * KEY..][..N_DIRECTIONS];
        row.iter().zip(key).map(|(a, b)| (a - b) * (a - b)).sum()
    }

    /// Lets each cell continue a neighbor's place, if the painting goes on as the picture does.
    fn spread(&self, cells: &mut [Option<Cell>], grid: [usize; 2]) {
        const AROUND: [IVec2; 4] = [IVec2::NEG_X, IVec2::NEG_Y, IVec2::X, IVec2::Y];
        let last = IVec2::new(self.size[0] as i32, self.size[1] as i32) - HALF;
        for i in 0..cells.len() {
            let Some(cell) = &cells[i] else { continue };
            let here = IVec2::new((i % grid[0]) as i32, (i / grid[0]) as i32);
            // Where the painting would be in this cell if a neighbor went on.
            let continuing: Vec<IVec2> = (AROUND.iter())
                .filter_map(|&way| {
                    let there = here + way;
                    let is_inside = there.cmpge(IVec2::ZERO).all()
                        && there.x < grid[0] as i32
                        && there.y < grid[1] as i32;
                    let other = is_inside.then(|| &cells[there.y as usize * grid[0] + there.x as usize]);
                    other.and_then(Option::as_ref).map(|other| other.at - way * STEP)
                })
                .collect();
            let cost = |at: IVec2, distance: f32| {
                let n_continued = continuing.iter().filter(|other| **other == at).count();
                distance * CONTINUED.powi(n_continued as i32)
            };
            let mut best = (cost(cell.at, cell.distance), cell.at, cell.distance);
            for &at in &continuing {
                if at.cmpge(IVec2::splat(HALF)).all() && at.cmple(last).all() {
                    let distance = self.distance(&cell.row, at);
                    let cost = cost(at, distance);
                    if cost < best.0 {
                        best = (cost, at, distance);
                    }
                }
            }
            if let Some(cell) = &mut cells[i] {
                (cell.at, cell.distance) = (best.1, best.2);
            }
        }
    }

    /// The color that the cells around a pixel of the picture give it, weighted along each axis by `seam` at their distance.
    fn blended(
        &self,
        cells: &[Option<Cell>],
        grid: [usize; 2],
        seam: &[f32; STEP as usize + 1],
        at: IVec2,
    ) -> Option<Vec3> {
        let corner = at / STEP;
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for next in [IVec2::ZERO, IVec2::X, IVec2::Y, IVec2::ONE] {
            let place = corner + next;
            let Some(cell) = &cells[place.y as usize * grid[0] + place.x as usize] else { continue };
            let offset = at - place * STEP;
            let weight = seam[offset.x.unsigned_abs() as usize] * seam[offset.y.unsigned_abs() as usize];
            let from = (cell.at + offset).max(IVec2::ZERO);
            let (x, y) = ((from.x as usize).min(self.size[0] - 1), (from.y as usize).min(self.size[1] - 1));
            sum += weight * self.pixels[y * self.size[0] + x];
            total += weight;
        }
        (total > 0.0).then(|| sum / total)
    }
}

/// Coordinates of `descriptors` `[Q, WIDTH]` along `axes`, and 1 `[Q, KEY]`.
fn coordinates(descriptors: &[f32], axes: &[f32]) -> Vec<f32> {
    let n = descriptors.len() / WIDTH;
    let mut along = vec![0.0; n * N_DIRECTIONS];
    let axes = Matrix::dense(axes, N_DIRECTIONS, WIDTH).transposed();
    product(&mut along, false, Matrix::dense(descriptors, n, WIDTH), axes);
    along.chunks_exact(N_DIRECTIONS).flat_map(|row| row.iter().copied().chain([1.0])).collect()
}

/// The position of the largest value, the first if there are several.
fn largest(values: &[f32]) -> usize {
    // Blocks first, whose largest values are found in the lanes of vectors.
    const BLOCK: usize = 64;
    const LANES: usize = 16;
    let greater = |a: f32, b: f32| if a > b { a } else { b };
    let of_block = |block: &[f32]| {
        let (lanes, rest) = block.as_chunks::<LANES>();
        let most = lanes.iter().fold([f32::NEG_INFINITY; LANES], |most, lanes| {
            std::array::from_fn(|i| greater(lanes[i], most[i]))
        });
        most.iter().chain(rest).copied().fold(f32::NEG_INFINITY, greater)
    };
    let mut best = (f32::NEG_INFINITY, 0);
    for (i, block) in values.chunks(BLOCK).enumerate() {
        let most = of_block(block);
        if most > best.0 {
            best = (most, i * BLOCK);
        }
    }
    let within = values[best.1.min(values.len())..].iter().position(|value| *value == best.0);
    best.1 + within.unwrap_or(0)
}

/// A picture prepared for comparing its patches.
struct Looks {
    size: [usize; 2],
    soft: [Vec<f32>; 3],
    energies: [Vec<f32>; N_BANDS],
}

impl Looks {
    fn new(pixels: &[Vec3], size: [usize; 2]) -> Self {
        let luminance: Vec<f32> = pixels.iter().map(|pixel| pixel.dot(LUMINANCE)).collect();
        let channel = |c: usize| -> Vec<f32> { pixels.iter().map(|pixel| pixel[c]).collect() };
        let soft = softened([0, 1, 2].map(channel), size, &[1]);
        Self { size, soft, energies: energies(&luminance, size) }
    }

    /// The descriptor of the patch around `center` `[WIDTH]`: its colors, so weighted that squared distances are mean
    /// squares over the patch, and the deviations of its finest bands.
    fn at(&self, center: IVec2) -> [f32; WIDTH] {
        let index = |at: IVec2| {
            let (x, y) = (at.x.clamp(0, self.size[0] as i32 - 1), at.y.clamp(0, self.size[1] as i32 - 1));
            y as usize * self.size[0] + x as usize
        };
        let mut row = [0.0; WIDTH];
        let (colors, detail) = row.split_at_mut(WIDTH - N_BANDS);
        for (i, color) in colors.chunks_exact_mut(3).enumerate() {
            let sample = IVec2::new(i as i32 % N_SAMPLES, i as i32 / N_SAMPLES) - N_SAMPLES / 2;
            let from = index(center + sample * SAMPLE);
            color.iter_mut().zip(&self.soft).for_each(|(to, soft)| *to = soft[from] / N_SAMPLES as f32);
        }
        detail.iter_mut().zip(&self.energies).for_each(|(to, band)| *to = DETAIL * band[index(center)]);
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// A painting of random dabs, 12 pixels wide: places that lie between two patches then still resemble one.
    fn dabs(width: usize, height: usize) -> Paint {
        let mut random = Random::new(7);
        let of_dabs: Vec<u8> = (0..width * height).map(|_| random.below(256) as u8).collect();
        let pixel = |i: usize| {
            let dab = i / width / 12 * width + i % width / 12;
            [of_dabs[dab], of_dabs[of_dabs.len() - 1 - dab], 90]
        };
        Paint { width, height, pixels: (0..width * height).flat_map(pixel).collect(), features: None }
    }

    #[test]
    fn the_largest_is_the_first_of_equals() {
        let mut random = Random::new(5);
        for n in [1, 15, 64, 65, 1000] {
            let values: Vec<f32> = (0..n).map(|_| random.below(20) as f32 - 30.0).collect();
            let most = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            assert_eq!(largest(&values), values.iter().position(|value| *value == most).unwrap());
        }
    }

    #[test]
    fn a_part_of_the_painting_stays_as_it_is() {
        let paint = dabs(192, 160);
        let whole = paint.colors();
        // 48 x 40 pixels from (62, 58) on.
        let part: Vec<Vec3> = (0..48 * 40).map(|i| whole[(i / 48 + 58) * 192 + i % 48 + 62]).collect();
        let over = Patches::new(&paint).unwrap().painted_over(&part, [48, 40], &vec![true; part.len()]);
        let off = |i: usize| over[i].distance(part[i]);
        // Patches at the border see what is not there, so the inner part counts. Two dabs differ by 0.4 on average.
        let inner = (0..part.len()).filter(|i| (10..38).contains(&(i % 48)) && (10..30).contains(&(i / 48)));
        let offs: Vec<f32> = inner.map(off).collect();
        let mean = offs.iter().sum::<f32>() / offs.len() as f32;
        assert!(mean < 0.05, "{mean}");
    }

    #[test]
    fn only_what_is_wanted_is_painted_over_in_the_paintings_colors() {
        let paint = dabs(64, 64);
        let picture: Vec<Vec3> = (0..50 * 30).map(|i| Vec3::splat((i % 50) as f32 / 50.0)).collect();
        let wanted: Vec<bool> = (0..picture.len()).map(|i| i % 50 < 20).collect();
        let over = Patches::new(&paint).unwrap().painted_over(&picture, [50, 30], &wanted);
        for ((over, picture), wanted) in over.iter().zip(&picture).zip(&wanted) {
            // All of the painting has this blue.
            assert!(if *wanted { (over.z - 90.0 / 255.0).abs() < 1e-5 } else { over == picture });
        }
    }

    #[test]
    fn a_painting_smaller_than_a_patch_has_none() {
        let picture = vec![Vec3::ONE; 12];
        for (width, height) in [(1, 1), (40, 3), (19, 19)] {
            assert!(Patches::new(&dabs(width, height)).is_none());
        }
        let least = Patches::new(&dabs(20, 20)).unwrap().painted_over(&picture, [4, 3], &[true; 12]);
        assert!(least.iter().all(|color| (color.z - 90.0 / 255.0).abs() < 1e-5));
    }
}
