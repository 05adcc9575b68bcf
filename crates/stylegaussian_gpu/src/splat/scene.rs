//! The geometry and captured colors of a scene on the GPU, for the splat pass.
//!
//! Projecting reads each Gaussian once and gathers nothing. A scene that would exceed the largest binding of
//! the device is therefore cut into *chunks* of consecutive Gaussians.

use std::ops::Range;

use bytemuck::Zeroable;
use glam::Vec3;
use half::f16;
use stylegaussian::{
    Scene,
    scene::{ScreenFilter, Sh},
    sh,
    slices::SLICE,
    work::{Canceled, Work},
};
use stylegaussian_shaders::{layers::MIX_BLOCK, splat::PackedGaussian};
use wgpu::util::DeviceExt;

use super::memory::{record_bytes, record_limit};
use crate::buffers::TooLarge;

/// N Gaussians on the GPU: means, rotations, scales, opacities and spherical harmonics. It never changes.
/// Splats are drawn with the scene's [`ScreenFilter`].
#[derive(Debug)]
pub struct GpuScene {
    chunks: Vec<Chunk>,
    n_gaussians: usize,
    sh_degree: Option<u8>,
    scale_unit: f32,
    filter: ScreenFilter,
}

/// Consecutive Gaussians of a scene.
#[derive(Debug)]
pub(crate) struct Chunk {
    /// Index of the first Gaussian.
    pub first: u32,
    /// The number of Gaussians.
    pub n_gaussians: u32,
    /// `[n]` of `PackedGaussian`.
    pub gaussians: wgpu::Buffer,
    /// f16 coefficients as planes of words `[word, n]`; `None` if the scene has none.
    pub sh: Option<wgpu::Buffer>,
    /// Balls around the means of each block of consecutive Gaussians.
    pub blocks: Vec<Ball>,
}

/// A ball around means, in scene space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball {
    pub center: Vec3,
    pub radius: f32,
}

impl Ball {
    /// A ball around points. Those that are not finite are never drawn and do not count.
    fn around(points: &[Vec3]) -> Self {
        let finite = || points.iter().copied().filter(|point| point.is_finite());
        let (min, max) = finite()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), point| (min.min(point), max.max(point)));
        // Halved before they are added: coordinates may be as large as f32 allows.
        let center = if min.is_finite() { 0.5 * min + 0.5 * max } else { Vec3::ZERO };
        let radius = finite().map(|point| point.distance(center)).fold(0.0, f32::max);
        Self { center, radius }
    }
}

/// Bytes of a packed Gaussian.
const GAUSSIAN_BYTES: u64 = size_of::<PackedGaussian>() as u64;

impl GpuScene {
    /// Uploads the geometry and the spherical harmonics of `scene`.
    ///
    /// Gaussians that are not finite are kept, so that indices stay the same, and are never drawn.
    ///
    /// # Errors
    /// If no view could hold the scene's splats on this device.
    pub fn new(device: &wgpu::Device, scene: &Scene) -> Result<Self, TooLarge> {
        let made = Self::new_if_wanted(device, scene, &Work::default());
        made.expect("nobody else has the work, so nobody cancels it")
    }

    /// As [`new`](Self::new).
    ///
    /// # Errors
    /// If `work` is canceled; inside, as those of [`new`](Self::new).
    pub fn new_if_wanted(
        device: &wgpu::Device,
        scene: &Scene,
        work: &Work,
    ) -> Result<Result<Self, TooLarge>, Canceled> {
        let n = scene.len();
        let limit = record_limit(device);
        let sh_bytes = 4 * scene.sh.as_ref().map_or(0, |sh| sh_words(sh.degree)) as u64;
        // The records of a view cannot be cut, and a chunk holds one Gaussian at least.
        let found = [record_bytes(n), GAUSSIAN_BYTES, sh_bytes].into_iter().max().unwrap_or(0);
        if let Err(error) = TooLarge::check("splats of the scene", found, limit) {
            return Ok(Err(error));
        }
        let per_chunk = (limit / GAUSSIAN_BYTES.max(sh_bytes)) as usize;
        Self::in_chunks_if_wanted(device, scene, per_chunk, work).map(Ok)
    }

    /// [`new`](Self::new) with at most `per_chunk` Gaussians in a chunk.
    #[cfg(test)]
    pub(crate) fn in_chunks(device: &wgpu::Device, scene: &Scene, per_chunk: usize) -> Self {
        Self::in_chunks_if_wanted(device, scene, per_chunk, &Work::default()).unwrap()
    }

    fn in_chunks_if_wanted(
        device: &wgpu::Device,
        scene: &Scene,
        per_chunk: usize,
        work: &Work,
    ) -> Result<Self, Canceled> {
        work.check()?;
        let n = scene.len();
        let scale_unit = scale_unit(&scene.scales);
        let chunks = (0..n).step_by(per_chunk.max(1)).map(|first| {
            let range = first..(first + per_chunk).min(n);
            let work = work.part(range.start as f32 / n as f32, range.end as f32 / n as f32);
            Chunk::new(device, scene, range, scale_unit, &work)
        });
        let chunks = chunks.collect::<Result<_, _>>()?;
        let sh_degree = scene.sh.as_ref().map(|sh| sh.degree);
        Ok(Self { chunks, n_gaussians: n, sh_degree, scale_unit, filter: scene.filter })
    }

    /// N, the number of Gaussians.
    pub fn n_gaussians(&self) -> usize {
        self.n_gaussians
    }

    /// Bytes of GPU memory that `scene` will take.
    pub fn bytes(scene: &Scene) -> u64 {
        let sh_bytes = 4 * scene.sh.as_ref().map_or(0, |sh| sh_words(sh.degree)) as u64;
        scene.len() as u64 * (GAUSSIAN_BYTES + sh_bytes)
    }

    pub(crate) fn chunks(&self) -> &[Chunk] {
        &self.chunks
    }

    /// Degree of the spherical harmonics; `None` if the scene has none.
    pub(crate) fn sh_degree(&self) -> Option<u8> {
        self.sh_degree
    }

    /// The filter that splats are drawn with.
    pub(crate) fn filter(&self) -> ScreenFilter {
        self.filter
    }

    /// The unit of stored scales, in scene units.
    pub(crate) fn scale_unit(&self) -> f32 {
        self.scale_unit
    }
}

impl Chunk {
    fn new(
        device: &wgpu::Device,
        scene: &Scene,
        range: Range<usize>,
        scale_unit: f32,
        work: &Work,
    ) -> Result<Self, Canceled> {
        let [of_gaussians, of_sh] = [work.part(0.0, 0.3), work.part(0.3, 0.9)];
        let gaussians = packed_gaussians(scene, range.clone(), scale_unit, &of_gaussians)?;
        let sh = scene.sh.as_ref().map(|sh| packed_sh(sh, range.clone(), &of_sh)).transpose()?;
        work.at(0.9)?;
        let buffer = |label, contents: &[u8]| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents,
                usage: wgpu::BufferUsages::STORAGE,
            })
        };
        Ok(Self {
            blocks: scene.means[range.clone()].chunks(MIX_BLOCK as usize).map(Ball::around).collect(),
            first: range.start as u32,
            n_gaussians: range.len() as u32,
            gaussians: buffer("splat_gaussians", bytemuck::cast_slice(&gaussians)),
            sh: sh.map(|words| buffer("splat_sh", bytemuck::cast_slice(&words))),
        })
    }
}

/// A power of two, in which the largest scale is about 2^14. f16 (up to 65504, down to 6e-8) then still holds
/// scales that are a billion times smaller.
fn scale_unit(scales: &[Vec3]) -> f32 {
    let largest = scales.iter().map(|s| s.max_element()).filter(|s| s.is_finite()).fold(0.0, f32::max);
    if largest > 0.0 { (largest.log2().floor() - 14.0).max(-120.0).exp2() } else { 1.0 }
}

/// The Gaussians in `range`.
fn packed_gaussians(
    scene: &Scene,
    range: Range<usize>,
    scale_unit: f32,
    work: &Work,
) -> Result<Vec<PackedGaussian>, Canceled> {
    let mut packed = Vec::with_capacity(range.len());
    for first in range.clone().step_by(SLICE) {
        work.at((first - range.start) as f32 / range.len() as f32)?;
        let slice = first..(first + SLICE).min(range.end);
        packed.extend(slice.map(|i| packed_gaussian(scene, i, scale_unit)));
    }
    Ok(packed)
}

/// Gaussian `i`. A Gaussian that is not finite becomes one of opacity 0, which is never drawn.
fn packed_gaussian(scene: &Scene, i: usize, scale_unit: f32) -> PackedGaussian {
    let (mean, rotation, scales) = (scene.means[i], scene.rotations[i], scene.scales[i]);
    let opacity = scene.opacities[i];
    let finite = mean.is_finite() && rotation.is_finite() && scales.is_finite() && opacity.is_finite();
    if !(finite && rotation.length_squared() > 0.0) {
        return PackedGaussian::zeroed();
    }
    let pair = |low: u16, high: u16| u32::from(low) | u32::from(high) << 16;
    // The inverse of WGSL's unpack2x16snorm, which divides by 32767.
    let snorm = |x: f32| ((x.clamp(-1.0, 1.0) * 32767.0).round() as i16).cast_unsigned();
    let half = |x: f32| f16::from_f32(x / scale_unit).to_bits();
    let [x, y, z, w] = rotation.normalize().to_array();
    PackedGaussian {
        mean: mean.to_array(),
        opacity: opacity.clamp(0.0, 1.0),
        rotation: [pair(snorm(x), snorm(y)), pair(snorm(z), snorm(w))],
        scales: [pair(half(scales.x), half(scales.y)), pair(half(scales.z), 0)],
    }
}

/// Words of 2 x f16 for the coefficients of one Gaussian: three for each pair of coefficients.
fn sh_words(degree: u8) -> usize {
    3 * sh::n_coefficients(degree).div_ceil(2)
}

/// Coefficients of the Gaussians in `range` as planes of words `[word, n]`.
fn packed_sh(sh: &Sh, range: Range<usize>, work: &Work) -> Result<Vec<u32>, Canceled> {
    let n_values = 3 * sh::n_coefficients(sh.degree);
    let n = range.len();
    let mut words = vec![0; n * sh_words(sh.degree)];
    for (column, i) in range.enumerate() {
        if column.is_multiple_of(SLICE) {
            work.at(column as f32 / n as f32)?;
        }
        let coefficients = &sh.coefficients[i * n_values..(i + 1) * n_values];
        for (k, &value) in coefficients.iter().enumerate() {
            // A coefficient that f16 cannot hold would turn into infinity and spoil the whole color.
            let value = if value.is_finite() { value.clamp(-65504.0, 65504.0) } else { 0.0 };
            words[k / 2 * n + column] |= u32::from(f16::from_f32(value).to_bits()) << (16 * (k % 2));
        }
    }
    Ok(words)
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;

    #[test]
    fn scales_keep_their_digits_over_a_billion() {
        let scales = [Vec3::new(1e-6, 3.0, 700.0), Vec3::new(f32::NAN, 1.0, f32::INFINITY)];
        let unit = scale_unit(&scales);
        assert_eq!(unit, 512.0 / 16384.0);
        for scale in scales[0].to_array() {
            let back = f16::from_f32(scale / unit).to_f32() * unit;
            assert!((back / scale - 1.0).abs() < 2e-3, "{scale} became {back}");
        }
        assert_eq!(scale_unit(&[]), 1.0);
        assert_eq!(scale_unit(&[Vec3::ZERO]), 1.0);
    }

    /// Degree 1 has 12 values in 6 words. The words of one Gaussian lie n apart.
    #[test]
    fn coefficients_lie_in_planes() {
        let coefficients = (0..24).map(|i| i as f32).collect();
        let words = packed_sh(&Sh { degree: 1, coefficients }, 0..2, &Work::default()).unwrap();
        let value = |word: usize, high: u32| f16::from_bits((words[word] >> (16 * high)) as u16).to_f32();
        assert_eq!(words.len(), 12);
        assert_eq!([value(0, 0), value(0, 1), value(2, 0), value(10, 1)], [0.0, 1.0, 2.0, 11.0]);
        assert_eq!([value(1, 0), value(11, 1)], [12.0, 23.0]);
    }

    #[test]
    fn a_scene_that_nobody_waits_for_is_packed_no_further() {
        let n = 3 * SLICE;
        let scene = Scene {
            means: vec![Vec3::ONE; n],
            rotations: vec![Quat::IDENTITY; n],
            scales: vec![Vec3::ONE; n],
            opacities: vec![0.5; n],
            ..Scene::default()
        };
        let sh = Sh { degree: 0, coefficients: vec![0.5; 3 * n] };
        // Canceled at the second of three slices.
        let stopping = || {
            let own = std::sync::Arc::new(std::sync::OnceLock::<Work>::new());
            let known = own.clone();
            let telling = Work::telling(move |_| known.get().unwrap().cancel());
            own.get_or_init(|| telling).clone()
        };
        let work = stopping();
        assert_eq!(packed_gaussians(&scene, 0..n, 1.0, &work).err(), Some(Canceled));
        assert!((work.done() - 1.0 / 3.0).abs() < 1e-3, "{}", work.done());
        let work = stopping();
        assert_eq!(packed_sh(&sh, 0..n, &work).err(), Some(Canceled));
        assert!((work.done() - 1.0 / 3.0).abs() < 1e-3, "{}", work.done());
        assert_eq!(packed_gaussians(&scene, 5..n, 1.0, &Work::default()).unwrap().len(), n - 5);
    }

    #[test]
    fn what_is_not_finite_is_never_drawn() {
        let mut scene = Scene {
            means: vec![Vec3::ONE; 2],
            rotations: vec![Quat::IDENTITY; 2],
            scales: vec![Vec3::ONE; 2],
            opacities: vec![0.5; 2],
            ..Scene::default()
        };
        scene.means[1].y = f32::NAN;
        assert_eq!(packed_gaussian(&scene, 0, 1.0).opacity, 0.5);
        assert_eq!(packed_gaussian(&scene, 1, 1.0).opacity, 0.0);
        scene.rotations[0] = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        assert_eq!(packed_gaussian(&scene, 0, 1.0).opacity, 0.0);
    }
}
