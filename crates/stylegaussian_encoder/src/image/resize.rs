//! Resizing in bands, on the threads of rayon's pool. It stops soon if nobody waits for the result.

use std::sync::atomic::{AtomicUsize, Ordering};

use fast_image_resize::{
    FilterType, PixelTrait, ResizeAlg, ResizeOptions, Resizer,
    images::{TypedImage, TypedImageRef},
};
use rayon::prelude::*;
use stylegaussian::work::{Canceled, Work};

/// Pixels that are shrunk or converted between two looks at whether they are still wanted: 3 MiB as f32 RGB.
pub(super) const BAND: usize = 1 << 18;

/// Pixels, or an opacity for each, as f32 `[height, width, channels of P]`, at another size (width, height).
/// Neither has a side of 0. Where an image shrinks, the filter covers as many old pixels more. Values beyond
/// those of the image may appear at edges.
///
/// # Errors
/// If `work` is canceled.
pub(super) fn resized<P: PixelTrait<Component = f32>>(
    values: &[f32],
    [width, height]: [u32; 2],
    to: [u32; 2],
    filter: FilterType,
    work: &Work,
) -> Result<Vec<f32>, Canceled> {
    let options = ResizeOptions::new().resize_alg(ResizeAlg::Convolution(filter)).use_alpha(false);
    let ratio = f64::from(height) / f64::from(to[1]);
    let n_rows = ((BAND as f64 / (f64::from(width) * ratio)) as usize).clamp(1, to[1] as usize);
    let line = P::count_of_components() * to[0] as usize;
    let mut resized = vec![0.0_f32; line * to[1] as usize];
    let n_done = AtomicUsize::new(0);
    resized.par_chunks_mut(line * n_rows).enumerate().try_for_each(|(i, band)| {
        work.check()?;
        let (first, n) = ((i * n_rows) as f64, band.len() / line);
        // The filter reaches over the edges of the part, as far as there are pixels.
        let top = first * ratio;
        let part_height = (n as f64 * ratio).min(f64::from(height) - top);
        let options = options.crop(0.0, top, f64::from(width), part_height);
        let old = TypedImageRef::<P>::from_buffer(width, height, bytemuck::cast_slice(values));
        let new = TypedImage::<P>::from_buffer(to[0], n as u32, bytemuck::cast_slice_mut(band));
        let (old, mut new) = old.ok().zip(new.ok()).expect("there are as many values as an image has");
        Resizer::new().resize_typed(&old, &mut new, &options).expect("the part lies within the image");
        work.at((n_done.fetch_add(n, Ordering::Relaxed) + n) as f32 / to[1] as f32)
    })?;
    Ok(resized)
}

#[cfg(test)]
mod tests {
    use fast_image_resize::pixels::F32x3;
    use image::{ImageBuffer, Rgb, imageops};
    use stylegaussian::random::Random;

    use super::*;

    #[test]
    fn bands_fit_together() {
        let mut random = Random::new(1);
        // The last one has several bands.
        for ([width, height], to) in [
            ([40, 23], [13, 30]),
            ([9, 8], [9, 3]),
            ([64, 2], [5, 1]),
            ([1, 7], [3, 2]),
            ([1030, 770], [64, 47]),
        ] {
            let values: Vec<f32> = (0..3 * width * height).map(|_| random.uniform()).collect();
            let whole = ImageBuffer::<Rgb<f32>, Vec<f32>>::from_raw(width, height, values.clone()).unwrap();
            for (filter, other) in [
                (FilterType::Lanczos3, imageops::FilterType::Lanczos3),
                (FilterType::Bilinear, imageops::FilterType::Triangle),
            ] {
                let expected = imageops::resize(&whole, to[0], to[1], other).into_raw();
                let found = resized::<F32x3>(&values, [width, height], to, filter, &Work::default()).unwrap();
                assert_eq!(found.len(), expected.len());
                for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
                    let (found, expected) = (found.clamp(0.0, 1.0), expected.clamp(0.0, 1.0));
                    assert!(
                        (found - expected).abs() < 1e-5,
                        "{filter:?} {to:?} [{i}]: {found} for {expected}"
                    );
                }
            }
        }
    }
}
