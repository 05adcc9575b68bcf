//! The scene: N Gaussians, and the features, neighbors and decoder that come with them.

use std::borrow::Cow;

use glam::{DVec3, Quat, Vec3};

use crate::{
    camera::Camera, decoder::Decoder, encoder_id::EncoderId, frame::Frame, mask::weights::Mask, morton,
    neighbors::Neighbors, sh,
};

mod append;

/// N Gaussians in structure-of-arrays form, with optional features, neighbors and decoder.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Means `[N]`, in scene units.
    pub means: Vec<Vec3>,
    /// The way from the source's origin to the scene's: a Gaussian's position in the source is `offset` + its
    /// mean. 0 unless the source lies so far from its origin that f32 would round it visibly. Cameras and all
    /// other parts of the scene count from the scene's origin.
    pub offset: DVec3,
    /// Rotations `[N]`, unit quaternions (x, y, z, w), world from Gaussian.
    pub rotations: Vec<Quat>,
    /// Standard deviations along the three local axes `[N]`, linear, in scene units.
    pub scales: Vec<Vec3>,
    /// Opacities `[N]`, 0..1.
    pub opacities: Vec<f32>,
    /// Captured colors. `None` if the file keeps none, as checkpoints; the scene is then mid-gray until styled.
    pub sh: Option<Sh>,
    /// Index of each Gaussian in the source file `[N]`. Gaussians with equal indices are parts of one that was
    /// [split](crate::split).
    pub order: Vec<u32>,
    /// Number of Gaussians in the source file, including those dropped at loading.
    pub n_source: usize,
    /// Features, which embedding adds. A scene without them cannot be stylized.
    pub features: Option<Features>,
    /// The K nearest neighbors of every Gaussian, or `None` if they are not searched yet.
    pub neighbors: Option<Neighbors>,
    /// A decoder trained for this scene. It takes precedence over the default decoder.
    pub decoder: Option<Decoder>,
    /// Painted weights `[N]`.
    pub mask: Option<Mask>,
    /// The scene's up direction, or `None` if the file does not give it. The loader never rotates a scene.
    pub up: Option<Vec3>,
    /// Cameras through which the scene was captured, spread over the capture; empty if they are not known.
    /// Bakes look through them.
    pub cameras: Vec<Camera>,
    /// The ball that chosen cameras are to frame, or `None` for the dense part. No file keeps it.
    pub frame: Option<Frame>,
    /// The filter against holes and aliasing that the scene was trained with, and that it must be drawn with.
    pub filter: ScreenFilter,
    /// Origin of the scene, for people.
    pub source: Option<String>,
    /// The license of the capture.
    pub license: Option<String>,
}

/// How a splat is kept from getting smaller than a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ScreenFilter {
    /// 3DGS: every footprint is widened by a low-pass of 0.3 square pixels. Small splats get too bright (Kerbl
    /// et al. 2023).
    #[default]
    Classic,
    /// Mip-splatting's 2D filter: the widened footprint's opacity is scaled so that its sum stays (Yu et al.
    /// 2024). Called `antialiased` by gsplat and SPZ, `mip` by .ply tags.
    Antialiased,
}

/// Spherical harmonics of N Gaussians.
#[derive(Clone, Debug)]
pub struct Sh {
    /// Degree, 0..=3.
    pub degree: u8,
    /// Coefficients `[N, (degree + 1)^2, 3]`, flattened: coefficient-major within a Gaussian, RGB innermost.
    pub coefficients: Vec<f32>,
}

/// Latent features f' and the affine map to the encoder's D channels: f = A f' + b.
#[derive(Clone, Debug)]
pub struct Features {
    /// f' of every Gaussian `[N, L]`, row-major.
    pub values: Vec<f32>,
    /// L, the number of stored channels.
    pub n_latent: usize,
    /// A `[D, L]`, row-major.
    pub basis: Vec<f32>,
    /// b `[D]`.
    pub offset: Vec<f32>,
    /// Decoder inputs that the style transfer leaves alone `[N, E]`, row-major; empty if E = 0.
    pub extra: Vec<f32>,
    /// E, the number of extra inputs.
    pub n_extra: usize,
    /// The encoder of the D channels, or `None` if the file does not name it.
    pub encoder: Option<EncoderId>,
}

impl Features {
    /// The largest L and D. The paper has 32 and 256. Statistics are matrices `[L, L]`, and the identity basis
    /// of a full-rank scene is `[D, D]`: 64 MiB of f32 at this size.
    pub const MAX_CHANNELS: usize = 4096;

    /// D, the number of channels of the encoder.
    pub fn n_channels(&self) -> usize {
        self.offset.len()
    }

    /// The features of the Gaussians at `indices`.
    fn subset(&self, indices: &[u32]) -> Self {
        Self {
            values: gather(&self.values, self.n_latent, indices),
            n_latent: self.n_latent,
            basis: self.basis.clone(),
            offset: self.offset.clone(),
            extra: gather(&self.extra, self.n_extra, indices),
            n_extra: self.n_extra,
            encoder: self.encoder.clone(),
        }
    }
}

/// Parts of a [`Scene`] do not fit together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("scene of {n_gaussians} Gaussians: found {found}, expected {expected}")]
pub struct SceneError {
    n_gaussians: usize,
    found: String,
    expected: String,
}

impl Scene {
    /// N, the number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether the scene has no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// The smallest and the largest corner of the box around the means, or `None` if the scene is empty.
    /// [`splat_bounds`](Self::splat_bounds) has the box around all that is drawn.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let first = *self.means.first()?;
        Some(self.means.iter().fold((first, first), |(min, max), &mean| (min.min(mean), max.max(mean))))
    }

    /// The Gaussians at `indices`, in that order, with everything that belongs to them.
    ///
    /// `order` keeps pointing into the source file. Neighbors are renumbered. If a kept Gaussian has a neighbor
    /// that is not kept, its list would be wrong, and the new scene has no neighbor lists at all.
    ///
    /// # Panics
    /// If an index is not below N.
    pub fn subset(&self, indices: &[u32]) -> Self {
        Self {
            means: gather(&self.means, 1, indices),
            offset: self.offset,
            rotations: gather(&self.rotations, 1, indices),
            scales: gather(&self.scales, 1, indices),
            opacities: gather(&self.opacities, 1, indices),
            sh: self.sh.as_ref().map(|sh| Sh {
                degree: sh.degree,
                coefficients: gather(&sh.coefficients, 3 * sh::n_coefficients(sh.degree), indices),
            }),
            order: gather(&self.order, 1, indices),
            n_source: self.n_source,
            features: self.features.as_ref().map(|features| features.subset(indices)),
            neighbors: self.neighbors.as_ref().and_then(|n| relabeled(n, self.len(), indices)),
            decoder: self.decoder.clone(),
            mask: self.mask.as_ref().map(|mask| mask.subset(indices)),
            up: self.up,
            cameras: self.cameras.clone(),
            frame: self.frame,
            filter: self.filter,
            source: self.source.clone(),
            license: self.license.clone(),
        }
    }

    /// Reorders the Gaussians along the Morton curve, which puts neighbors in space close together in memory.
    pub fn sort_by_morton(&mut self) {
        *self = self.subset(&morton::order(&self.means));
    }

    /// Replaces the captured colors by `rgb` `[N]`, display-referred. They become spherical harmonics of degree
    /// 0, the same from every direction.
    ///
    /// # Panics
    /// If `rgb` does not hold one color per Gaussian.
    pub fn set_colors(&mut self, rgb: &[[f32; 3]]) {
        assert_eq!(rgb.len(), self.len(), "one color per Gaussian");
        let coefficients = rgb.iter().flat_map(|&color| sh::dc_from_color(color)).collect();
        self.sh = Some(Sh { degree: 0, coefficients });
    }

    /// The scene without spherical harmonics beyond `degree`. It is copied only if it has some.
    pub fn with_sh_degree_at_most(&self, degree: u8) -> Cow<'_, Self> {
        let Some(sh) = self.sh.as_ref().filter(|sh| sh.degree > degree) else { return Cow::Borrowed(self) };
        let [stored, kept] = [sh.degree, degree].map(|degree| 3 * sh::n_coefficients(degree));
        let rows = sh.coefficients.chunks_exact(stored);
        let coefficients = rows.flat_map(|row| &row[..kept]).copied().collect();
        Cow::Owned(Self { sh: Some(Sh { degree, coefficients }), ..self.clone() })
    }

    /// The Gaussians in the order of the source `[N]`. Parts of one source Gaussian keep their order in the
    /// scene, which is the same in every file, because files are in Morton order.
    ///
    /// # Panics
    /// If `order` has fewer than N entries.
    pub fn by_source(&self) -> Vec<u32> {
        let order = &self.order[..self.len()];
        let mut indices: Vec<u32> = (0..self.len() as u32).collect();
        let n_rows = order.iter().max().map_or(0, |&last| last as usize + 1);
        // If almost all rows of the source are gone, counting them all would take more memory than the scene.
        if n_rows > 16 * self.len() {
            indices.sort_by_key(|&i| order[i as usize]);
            return indices;
        }
        // The place of the next Gaussian of each row.
        let mut places = vec![0_u32; n_rows + 1];
        for &row in order {
            places[row as usize + 1] += 1;
        }
        for row in 0..n_rows {
            places[row + 1] += places[row];
        }
        for (i, &row) in (0..).zip(order) {
            let place = &mut places[row as usize];
            indices[*place as usize] = i;
            *place += 1;
        }
        indices
    }

    /// The base colors `[N]`: the view-independent part (SH 0) of the captured colors, unclamped. Mid-gray if
    /// the scene keeps none.
    pub fn base_colors(&self) -> Vec<[f32; 3]> {
        match &self.sh {
            Some(sh) => sh
                .coefficients
                .chunks_exact(3 * sh::n_coefficients(sh.degree))
                .map(|c| sh::color_from_dc([c[0], c[1], c[2]]))
                .collect(),
            None => vec![[0.5; 3]; self.len()],
        }
    }

    /// The deviation of each Gaussian seen from its broad side `[N]`, in scene units: the geometric mean of the
    /// two larger scales.
    pub fn broad_sides(&self) -> Vec<f32> {
        self.scales.iter().copied().map(broad_side).collect()
    }

    /// Checks that all arrays have the lengths their documented shapes demand and all indices are in range.
    ///
    /// # Errors
    /// If a part does not fit. The message names the first one.
    pub fn validate(&self) -> Result<(), SceneError> {
        let n = self.len();
        self.expect_len("rotations", self.rotations.len(), n)?;
        self.expect_len("scales", self.scales.len(), n)?;
        self.expect_len("opacities", self.opacities.len(), n)?;
        self.expect_len("order entries", self.order.len(), n)?;
        if !self.offset.is_finite() {
            return Err(self.error(format!("offset {}", self.offset), "finite numbers".into()));
        }
        if let Some(sh) = &self.sh {
            if sh.degree > sh::MAX_DEGREE {
                return Err(self.error(format!("SH degree {}", sh.degree), "0 to 3".into()));
            }
            let per_gaussian = 3 * sh::n_coefficients(sh.degree);
            self.expect_len("SH coefficients", sh.coefficients.len(), n * per_gaussian)?;
        }
        if let Some(features) = &self.features {
            let (d, l) = (features.n_channels(), features.n_latent);
            if d.max(l) > Features::MAX_CHANNELS {
                let found = format!("features of {l} latent and {d} channels");
                return Err(self.error(found, format!("at most {}", Features::MAX_CHANNELS)));
            }
            self.expect_len("feature values", features.values.len(), n * features.n_latent)?;
            self.expect_len("basis values", features.basis.len(), features.n_channels() * features.n_latent)?;
            self.expect_len("extra values", features.extra.len(), n * features.n_extra)?;
        }
        if let Some(mask) = &self.mask {
            self.expect_len("mask weights", mask.len(), n)?;
        }
        if let Some(neighbors) = &self.neighbors {
            if neighbors.k > Decoder::MAX_K {
                let found = format!("{} neighbors of each", neighbors.k);
                return Err(self.error(found, format!("at most {}", Decoder::MAX_K)));
            }
            self.expect_len("neighbor indices", neighbors.indices.len(), n * neighbors.k)?;
            if let Some(index) = neighbors.indices.iter().find(|&&index| index as usize >= n) {
                return Err(self.error(format!("neighbor {index}"), "indices below N".into()));
            }
        }
        self.validate_order()
    }

    /// Checks that `order` holds indices into the source. Colors are written there by these indices.
    fn validate_order(&self) -> Result<(), SceneError> {
        match self.order.iter().max() {
            Some(&last) if last as usize >= self.n_source => Err(self.error(
                format!("source index {last} in `order`"),
                format!("indices below the source's {} Gaussians", self.n_source),
            )),
            _ => Ok(()),
        }
    }

    fn expect_len(&self, what: &str, found: usize, expected: usize) -> Result<(), SceneError> {
        if found == expected {
            return Ok(());
        }
        Err(self.error(format!("{found} {what}"), expected.to_string()))
    }

    fn error(&self, found: String, expected: String) -> SceneError {
        SceneError { n_gaussians: self.len(), found, expected }
    }
}

/// The deviation of a Gaussian with these scales, seen from its broad side.
pub(crate) fn broad_side(scales: Vec3) -> f32 {
    // The two others' product is 0 if the smallest is, and not 0 / 0.
    let [a, b, c] = scales.to_array();
    (a * b).max(b * c).max(a * c).max(0.0).sqrt()
}

/// Rows `indices` of `values` `[N, width]`.
fn gather<T: Copy>(values: &[T], width: usize, indices: &[u32]) -> Vec<T> {
    let mut rows = Vec::with_capacity(indices.len() * width);
    for &index in indices {
        let start = index as usize * width;
        rows.extend_from_slice(&values[start..start + width]);
    }
    rows
}

/// The neighbor lists of the Gaussians at `indices`, renumbered, or `None` if a neighbor is not among them.
fn relabeled(neighbors: &Neighbors, n_gaussians: usize, indices: &[u32]) -> Option<Neighbors> {
    // u32::MAX marks Gaussians that are not kept. It is no index, as files hold fewer than 2^32 Gaussians.
    let mut new_from_old = vec![u32::MAX; n_gaussians];
    for (new, &old) in indices.iter().enumerate() {
        new_from_old[old as usize] = new as u32;
    }
    // Lists move with their Gaussians first, and their entries are renumbered after.
    let mut relabeled = gather(&neighbors.indices, neighbors.k, indices);
    for index in &mut relabeled {
        *index = new_from_old[*index as usize];
        if *index == u32::MAX {
            return None;
        }
    }
    Some(Neighbors { k: neighbors.k, indices: relabeled })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_order_of_the_source_is_a_stable_sort() {
        let mut random = Random::new(1);
        // Rows that are repeated, that are missing, and that are almost all missing.
        for (n, n_rows) in [(0, 1), (1, 1), (1, 1000), (200, 50), (200, 500), (200, 100_000)] {
            let order: Vec<u32> = (0..n).map(|_| (random.uniform() * n_rows as f32) as u32).collect();
            let scene = Scene { means: vec![Vec3::ZERO; n], order, ..Scene::default() };
            let mut expected: Vec<u32> = (0..n as u32).collect();
            expected.sort_by_key(|&i| scene.order[i as usize]);
            assert_eq!(scene.by_source(), expected, "{n} of {n_rows}");
        }
    }

    /// Four Gaussians on a line, x = 3, 0, 2, 1, with every optional part.
    fn line() -> Scene {
        let xs = [3.0, 0.0, 2.0, 1.0_f32];
        Scene {
            means: xs.map(|x| Vec3::new(x, 0.0, 0.0)).into(),
            rotations: vec![Quat::IDENTITY; 4],
            scales: xs.map(Vec3::splat).into(),
            opacities: xs.map(|x| x / 4.0).into(),
            sh: Some(Sh { degree: 0, coefficients: xs.iter().flat_map(|&x| [x, 0.0, -x]).collect() }),
            order: vec![10, 11, 12, 13],
            n_source: 14,
            features: Some(Features {
                values: xs.iter().flat_map(|&x| [x, 10.0 * x]).collect(),
                n_latent: 2,
                basis: vec![1.0; 6],
                offset: vec![0.0; 3],
                extra: xs.to_vec(),
                n_extra: 1,
                encoder: None,
            }),
            // Each one itself, then a Gaussian at distance 1.
            neighbors: Some(Neighbors { k: 2, indices: vec![0, 2, 1, 3, 2, 0, 3, 1] }),
            ..Scene::default()
        }
    }

    #[test]
    fn the_broad_side_leaves_the_smallest_scale_out() {
        let scales = [[1.0, 4.0, 9.0], [9.0, 1.0, 4.0], [4.0, 9.0, 1.0], [2.0, 0.0, 8.0], [0.0, 0.0, 8.0]];
        let scene = Scene { scales: scales.map(Vec3::from).to_vec(), ..Default::default() };
        assert_eq!(scene.broad_sides(), [6.0, 6.0, 6.0, 4.0, 0.0]);
    }

    #[test]
    fn sorting_moves_everything_along() {
        let mut scene = line();
        scene.validate().unwrap();
        scene.sort_by_morton();
        scene.validate().unwrap();
        assert_eq!(scene.means.iter().map(|m| m.x).collect::<Vec<_>>(), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(scene.order, [11, 13, 12, 10]);
        assert_eq!(scene.opacities, [0.0, 0.25, 0.5, 0.75]);
        assert_eq!(scene.scales[3], Vec3::splat(3.0));
        let features = scene.features.as_ref().unwrap();
        assert_eq!(features.values, [0.0, 0.0, 1.0, 10.0, 2.0, 20.0, 3.0, 30.0]);
        assert_eq!(features.extra, [0.0, 1.0, 2.0, 3.0]);
        // Old lists: x=3 -> x=2, x=0 -> x=1, x=2 -> x=3, x=1 -> x=0; the new number is x itself.
        assert_eq!(scene.neighbors.unwrap().indices, [0, 1, 1, 0, 2, 3, 3, 2]);
        assert_eq!(scene.sh.unwrap().coefficients[9..], [3.0, 0.0, -3.0]);
    }

    #[test]
    fn subset_drops_neighbor_lists_that_would_be_wrong() {
        let scene = line();
        let pair = Scene { offset: DVec3::new(5e6, 0.0, -1.0), ..scene.clone() }.subset(&[3, 1]);
        assert_eq!(pair.order, [13, 11]);
        assert_eq!(pair.offset, DVec3::new(5e6, 0.0, -1.0));
        assert_eq!(pair.neighbors.as_ref().unwrap().indices, [0, 1, 1, 0]);
        pair.validate().unwrap();
        assert!(scene.subset(&[0, 1]).neighbors.is_none());
        assert!(scene.subset(&[]).is_empty());
    }

    #[test]
    fn colors_round_trip_through_sh_0() {
        let mut scene = line();
        scene.set_colors(&[[0.5, 0.0, 1.0]; 4]);
        for color in scene.base_colors() {
            assert!((Vec3::from(color) - Vec3::new(0.5, 0.0, 1.0)).length() < 1e-6);
        }
        scene.sh = None;
        assert_eq!(scene.base_colors(), [[0.5; 3]; 4]);
    }

    #[test]
    fn bounds_are_tight() {
        assert_eq!(line().bounds(), Some((Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0))));
        assert_eq!(Scene::default().bounds(), None);
    }

    #[test]
    fn validate_names_the_part_that_does_not_fit() {
        let check = |change: fn(&mut Scene), part: &str| {
            let mut scene = line();
            change(&mut scene);
            let message = scene.validate().unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        };
        check(|s| s.scales.truncate(3), "3 scales, expected 4");
        check(|s| s.neighbors.as_mut().unwrap().indices[5] = 4, "neighbor 4");
        check(|s| s.order[0] = 14, "source index 14");
        check(|s| s.sh.as_mut().unwrap().degree = 4, "SH degree 4");
        check(|s| s.offset.y = f64::NAN, "offset [0, NaN, 0]");
        check(|s| s.features.as_mut().unwrap().n_latent = 3, "8 feature values, expected 12");
        // Statistics would take 4 L^2 bytes and neighbor lists 4 N K, whatever the size of the file.
        check(|s| s.features.as_mut().unwrap().n_latent = 300_000, "features of 300000 latent");
        check(|s| s.neighbors.as_mut().unwrap().k = 1_000_000, "1000000 neighbors");
    }
}
