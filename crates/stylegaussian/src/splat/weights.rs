//! Blend weights: rendering as a sparse matrix.

use glam::UVec2;
use rayon::prelude::*;

use super::bands::Bands;
use super::composite::{GROUP, TILE};
use super::project::Splat;

/// The blend weights w of one view: a sparse `[H * W, N]` matrix in compressed rows, one row per pixel.
///
/// A picture of any per-Gaussian values v is w v ([`apply`](Self::apply)). The gradient of a loss with respect
/// to v is w^T times its gradient with respect to the picture ([`apply_transposed`](Self::apply_transposed)).
#[derive(Clone, Debug, PartialEq)]
pub struct BlendWeights {
    /// Width and height, in pixels.
    pub size: UVec2,
    /// N, the number of Gaussians in the scene.
    pub n_gaussians: usize,
    /// Position of each pixel's first entry `[H * W + 1]`, row-major from the top left. The last is the number
    /// of entries.
    pub starts: Vec<u32>,
    /// The Gaussian of each entry, front to back within a pixel.
    pub indices: Vec<u32>,
    /// The weight of each entry, above 0. Those of a pixel sum to its alpha.
    pub weights: Vec<f32>,
}

/// The entries of one band.
struct BandEntries {
    /// Pixel, Gaussian and weight. Those of a pixel are front to back among the others.
    entries: Vec<(u32, u32, f32)>,
    /// Number of entries of each pixel.
    counts: Vec<u32>,
}

impl BlendWeights {
    /// Collects the weights of `least` or more with which `splats` blend.
    pub(super) fn gather(splats: &[Splat], bands: &Bands, least: f32, n_gaussians: usize) -> Self {
        let of_bands: Vec<BandEntries> = (0..bands.splats.len())
            .into_par_iter()
            .map(|band| BandEntries::collect(band, splats, bands, least))
            .collect();

        let n_entries: usize = of_bands.iter().map(|band| band.entries.len()).sum();
        // 32 bits halve the memory of `starts`, and 2^32 entries would take 32 GiB.
        assert!(u32::try_from(n_entries).is_ok(), "{n_entries} blend weights: more than 32 bits can count");
        let n_pixels = bands.size.x as usize * bands.size.y as usize;
        let mut starts = Vec::with_capacity(n_pixels + 1);
        let mut start = 0;
        starts.push(start);
        for count in of_bands.iter().flat_map(|band| &band.counts) {
            start += count;
            starts.push(start);
        }
        let (mut indices, mut weights) = (vec![0; n_entries], vec![0.0; n_entries]);
        // The entries of a band follow one another, so each has slices of its own.
        let (mut rest, mut places) = ((&mut indices[..], &mut weights[..]), Vec::new());
        for band in of_bands {
            let (indices, after) = rest.0.split_at_mut(band.entries.len());
            let (weights, weights_after) = rest.1.split_at_mut(band.entries.len());
            rest = (after, weights_after);
            places.push((band, indices, weights));
        }
        places.into_par_iter().for_each(|(band, indices, weights)| band.sort_into(indices, weights));
        Self { size: bands.size, n_gaussians, starts, indices, weights }
    }

    /// The weights of a part of the picture, `size` pixels from `corner` on.
    ///
    /// # Panics
    /// If the part reaches beyond the picture.
    pub fn crop(&self, corner: UVec2, size: UVec2) -> Self {
        assert!(
            (corner + size).cmple(self.size).all(),
            "{size} pixels from {corner} on exceed {}",
            self.size
        );
        let mut crop = Self { size, starts: vec![0], indices: Vec::new(), weights: Vec::new(), ..*self };
        for y in corner.y..corner.y + size.y {
            let first = (y * self.size.x + corner.x) as usize;
            let row = &self.starts[first..=first + size.x as usize];
            // Entries of pixels side by side follow one another, so each row of the part is one copy.
            let (start, end) = (row[0], row[size.x as usize]);
            let offset = crop.indices.len() as u32;
            crop.indices.extend_from_slice(&self.indices[start as usize..end as usize]);
            crop.weights.extend_from_slice(&self.weights[start as usize..end as usize]);
            crop.starts.extend(row[1..].iter().map(|pixel| pixel - start + offset));
        }
        crop
    }

    /// A picture of per-Gaussian `values` `[N, C]`: sum_i w_i v_i for each pixel `[H * W, C]`, row-major.
    ///
    /// # Panics
    /// If `values` does not hold N x `c` numbers.
    pub fn apply(&self, values: &[f32], c: usize) -> Vec<f32> {
        assert_eq!(values.len(), self.n_gaussians * c, "values must be [N, C]");
        match c {
            // The usual widths, whose sums stay in registers.
            1 => self.apply_width::<1>(values),
            3 => self.apply_width::<3>(values),
            4 => self.apply_width::<4>(values),
            _ => {
                let mut pixels = vec![0.0; (self.starts.len() - 1) * c];
                pixels.par_chunks_mut(c.max(1)).enumerate().for_each(|(pixel, sums)| {
                    for (gaussian, weight) in self.pixel(pixel) {
                        add_scaled(sums, weight, &values[gaussian * c..(gaussian + 1) * c]);
                    }
                });
                pixels
            }
        }
    }

    /// [`apply`](Self::apply) for C known when compiled.
    fn apply_width<const C: usize>(&self, values: &[f32]) -> Vec<f32> {
        let (values, _) = values.as_chunks::<C>();
        let mut pixels = vec![[0.0; C]; self.starts.len() - 1];
        pixels.par_iter_mut().enumerate().for_each(|(pixel, sums)| {
            for (gaussian, weight) in self.pixel(pixel) {
                add_scaled(sums, weight, &values[gaussian]);
            }
        });
        pixels.into_flattened()
    }

    /// The adjoint of [`apply`](Self::apply) for a per-pixel `gradient` `[H * W, C]`: sum_p w_{p,i} g_p for
    /// each Gaussian `[N, C]`.
    ///
    /// The result does not depend on the number of threads, since every Gaussian sums its pixels in picture
    /// order.
    ///
    /// # Panics
    /// If `gradient` does not hold H x W x `c` numbers.
    pub fn apply_transposed(&self, gradient: &[f32], c: usize) -> Vec<f32> {
        assert_eq!(gradient.len(), (self.starts.len() - 1) * c, "gradient must be [H * W, C]");
        match c {
            1 => self.transposed_width::<1>(gradient),
            3 => self.transposed_width::<3>(gradient),
            4 => self.transposed_width::<4>(gradient),
            _ => {
                let mut sums = vec![0.0; self.n_gaussians * c];
                self.transposed_rows(&mut sums, c, |sums, row, pixel, weight| {
                    let of_pixel = &gradient[pixel * c..(pixel + 1) * c];
                    add_scaled(&mut sums[row * c..(row + 1) * c], weight, of_pixel);
                });
                sums
            }
        }
    }

    /// [`apply_transposed`](Self::apply_transposed) for C known when compiled.
    fn transposed_width<const C: usize>(&self, gradient: &[f32]) -> Vec<f32> {
        let (gradient, _) = gradient.as_chunks::<C>();
        let mut sums = vec![[0.0; C]; self.n_gaussians];
        self.transposed_rows(&mut sums, 1, |sums, row, pixel, weight| {
            add_scaled(&mut sums[row], weight, &gradient[pixel]);
        });
        sums.into_flattened()
    }

    /// Calls `add(block of sums, row in the block, pixel, weight)` for each entry. `sums` has `c` values for
    /// each Gaussian.
    fn transposed_rows<T: Send>(
        &self,
        sums: &mut [T],
        c: usize,
        add: impl Fn(&mut [T], usize, usize, f32) + Sync,
    ) {
        if sums.is_empty() {
            return;
        }
        // Each thread owns every n-th block of Gaussians, reads all entries, and adds up those of its own
        // blocks. No sum is atomic, so the order of additions never changes.
        let n_shares = rayon::current_num_threads();
        let mut shares: Vec<Vec<&mut [T]>> = (0..n_shares).map(|_| Vec::new()).collect();
        for (block, rows) in sums.chunks_mut(BLOCK * c).enumerate() {
            shares[block % n_shares].push(rows);
        }
        let n_blocks = self.n_gaussians.div_ceil(BLOCK);
        shares.into_par_iter().enumerate().for_each(|(share, mut blocks)| {
            // The place of each block in this share: a division for each entry would take as long as its sum.
            let place = |block| if block % n_shares == share { (block / n_shares) as u32 } else { OTHER };
            let places: Vec<u32> = (0..n_blocks).map(place).collect();
            for pixel in 0..self.starts.len() - 1 {
                for (gaussian, weight) in self.pixel(pixel) {
                    let place = places[gaussian / BLOCK];
                    if place != OTHER {
                        add(blocks[place as usize], gaussian % BLOCK, pixel, weight);
                    }
                }
            }
        });
    }

    /// Coverage of each pixel `[H * W]`: the sum of its weights.
    pub fn alpha(&self) -> Vec<f32> {
        self.starts
            .windows(2)
            .map(|row| self.weights[row[0] as usize..row[1] as usize].iter().sum())
            .collect()
    }

    /// The (Gaussian, weight) entries of one pixel, front to back.
    pub fn pixel(&self, pixel: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let entries = self.starts[pixel] as usize..self.starts[pixel + 1] as usize;
        let gaussians = self.indices[entries.clone()].iter().map(|&i| i as usize);
        gaussians.zip(self.weights[entries].iter().copied())
    }
}

/// Gaussians per block in [`BlendWeights::apply_transposed`]. Blocks are so small that those of a busy corner
/// of the scene spread over all threads.
const BLOCK: usize = 64;

/// The place of a block in a share that does not have it.
const OTHER: u32 = u32::MAX;

fn add_scaled(sums: &mut [f32], weight: f32, values: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += weight * value;
    }
}

impl BandEntries {
    fn collect(band: usize, splats: &[Splat], bands: &Bands, least: f32) -> Self {
        let width = bands.size.x as usize;
        let height = TILE.min(bands.size.y as usize - band * TILE);
        let mut counts = vec![0u32; width * height];
        // In the order of tiles and splats. A pixel gets its entries from one tile. Reserve 24 entries per
        // pixel, since untouched pages are free.
        let (mut entries, mut n) = (vec![(0, 0, 0.0); 24 * width * height], 0);
        for (tile, in_tile) in bands.tiles(band, splats) {
            tile.composite(splats, &in_tile, least, |group, splat, weights, _| {
                if entries.len() < n + GROUP {
                    entries.resize(2 * n + GROUP, (0, 0, 0.0));
                }
                let (row, column) = (group * GROUP / TILE, group * GROUP % TILE);
                let first = (row * width + tile.x + column) as u32;
                let gaussian = splats[splat].gaussian;
                // All are written, and the next one over those of weight 0. No processor foretells which these
                // are, so branches would cost more.
                let (free, mut n_kept) = (&mut entries[n..n + GROUP], 0);
                for (pixel, &weight) in (first..).zip(weights) {
                    free[n_kept] = (pixel, gaussian, weight);
                    n_kept += usize::from(weight > 0.0);
                }
                n += n_kept;
            });
        }
        entries.truncate(n);
        for (pixel, ..) in &entries {
            counts[*pixel as usize] += 1;
        }
        Self { entries, counts }
    }

    /// Writes Gaussians and weights in the order of pixels.
    fn sort_into(self, indices: &mut [u32], weights: &mut [f32]) {
        // A counting sort. It is stable, so each pixel's entries stay front to back.
        let mut next = self.counts;
        let mut start = 0;
        for next in &mut next {
            start += std::mem::replace(next, start);
        }
        for (pixel, gaussian, weight) in self.entries {
            let position = &mut next[pixel as usize];
            indices[*position as usize] = gaussian;
            weights[*position as usize] = weight;
            *position += 1;
        }
    }
}
