//! From Gaussians to the bytes of an SPZ file, version 3 or 4.

use std::{
    borrow::Cow,
    f32::consts::FRAC_1_SQRT_2,
    io::{self, Write},
};

use flate2::{Compression, write::GzEncoder};
use glam::Vec3;
use rayon::prelude::*;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use stylegaussian::{
    axes::{Axes, sh_signs},
    scene::{Scene, ScreenFilter},
    sh,
};

use super::{
    container::FRAMES_HEADER_BYTES,
    decode::{COLOR_SCALE, MAX_MAGNITUDE, SIGN},
    extension,
    header::{ANTIALIASED, HAS_EXTENSIONS, Header},
};
use crate::{
    distant,
    error::{Mismatch, mismatch},
    format::{Unwritten, WriteOptions},
    upright::upright,
};

/// Bits after the binary point as all known programs write them: a quarter of a millimeter if units are meters.
const FRACTIONAL_BITS: u8 = 12;

/// The most that are written, of 24 with the sign.
const MAX_FRACTIONAL_BITS: u8 = 23;

/// The largest integer of a coordinate: 24 bits with a sign.
const MAX_INTEGER: f64 = 8_388_607.0;

/// Writes a scene upright, in axes RUB and in the source's order. Features, neighbors and decoder have no place
/// in the file.
pub(super) fn write(
    out: &mut dyn Write,
    scene: &Scene,
    options: &WriteOptions,
) -> Result<Vec<String>, Unwritten> {
    let version = match options.spz_version {
        version @ (3 | 4) => u32::from(version),
        other => return Err(mismatch(format_args!("SPZ version {other}"), "3 or 4").into()),
    };
    if i32::try_from(scene.len()).is_err() {
        return Err(mismatch(format_args!("{} Gaussians", scene.len()), "fewer than 2^31").into());
    }
    let left_out = distant::left_out(scene);
    // Also that of scenes that are upright already: readers of the format know no other way to tell it.
    let is_direction = |up: &Vec3| up.try_normalize().is_some();
    let extensions = scene.up.filter(is_direction).map(extension::up_record).unwrap_or_default();
    let (scene, _) = upright(Cow::Borrowed(scene))?;
    let captured = scene.sh.as_ref().map_or(0, |sh| sh.degree);
    let header = Header {
        version,
        n: scene.len(),
        degree: captured.min(options.sh_degree),
        fractional_bits: fractional_bits(&scene)?,
        flags: if scene.filter == ScreenFilter::Antialiased { ANTIALIASED } else { 0 }
            | if extensions.is_empty() { 0 } else { HAS_EXTENSIONS },
    };
    let arrays = arrays(&scene, header);
    match version {
        3 => write_gzip(out, header, &arrays, &extensions)?,
        _ => write_frames(out, header, &arrays, &extensions)?,
    }
    Ok(left_out.into_iter().chain(clamped(&scene, header)).collect())
}

/// Warnings of the values that a byte cannot hold.
fn clamped(scene: &Scene, header: Header) -> Vec<String> {
    // Half a step beyond the ends is rounded and not clamped.
    let is_beyond = |code: f32| !(-0.5..=255.5).contains(&code);
    let width = scene.sh.as_ref().map_or(0, |sh| 3 * sh::n_coefficients(sh.degree));
    let n_kept = 3 + header.sh_bytes();
    let count = |is_clamped: &(dyn Fn(usize) -> bool + Sync)| {
        (0..scene.len()).into_par_iter().filter(|&i| is_clamped(i)).count()
    };
    let coefficients =
        |i: usize| scene.sh.as_ref().map_or(&[][..], |sh| &sh.coefficients[i * width..][..n_kept]);
    // A thinner Gaussian gets the smallest size, which is invisible.
    let sizes = count(&|i| is_beyond(scale_code(scene.scales[i].max_element())));
    let colors = count(&|i| coefficients(i).iter().take(3).any(|&value| is_beyond(color_code(value))));
    let harmonics = count(&|i| coefficients(i).iter().skip(3).any(|&value| is_beyond(harmonic_code(value))));
    [(sizes, "sizes"), (colors, "colors"), (harmonics, "spherical harmonics beyond degree 0")]
        .into_iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, what)| format!("{n} Gaussians have {what} that SPZ cannot hold, which were clamped"))
        .collect()
}

/// The code of a standard deviation, before it is rounded and clamped.
fn scale_code(scale: f32) -> f32 {
    (scale.ln() + 10.0) * 16.0
}

/// The code of a coefficient of degree 0.
fn color_code(value: f32) -> f32 {
    (value * COLOR_SCALE + 0.5) * 255.0
}

/// The code of any other coefficient.
fn harmonic_code(value: f32) -> f32 {
    value * 128.0 + 128.0
}

/// Version 3: everything in one gzip stream.
fn write_gzip(
    out: &mut dyn Write,
    header: Header,
    arrays: &[Vec<u8>; 6],
    extensions: &[u8],
) -> io::Result<()> {
    let mut encoder = GzEncoder::new(out, Compression::default());
    encoder.write_all(&header.to_bytes())?;
    arrays.iter().try_for_each(|array| encoder.write_all(array))?;
    encoder.write_all(extensions)?;
    encoder.finish()?;
    Ok(())
}

/// Version 4: the header, extensions and the table of lengths in plain, and a zstd frame for each array that is
/// not empty.
fn write_frames(
    out: &mut dyn Write,
    header: Header,
    arrays: &[Vec<u8>; 6],
    extensions: &[u8],
) -> io::Result<()> {
    let filled: Vec<&Vec<u8>> = arrays.iter().filter(|array| !array.is_empty()).collect();
    let frames: Vec<Vec<u8>> =
        filled.par_iter().map(|array| compress_to_vec(&array[..], CompressionLevel::Fastest)).collect();
    let mut first = [0; FRAMES_HEADER_BYTES];
    first[..16].copy_from_slice(&header.to_bytes());
    // At most six, and the table follows at once.
    first[15] = frames.len() as u8;
    let at_table = (FRAMES_HEADER_BYTES + extensions.len()) as u32;
    first[16..20].copy_from_slice(&at_table.to_le_bytes());
    out.write_all(&first)?;
    out.write_all(extensions)?;
    for (frame, array) in frames.iter().zip(filled) {
        out.write_all(&(frame.len() as u64).to_le_bytes())?;
        out.write_all(&(array.len() as u64).to_le_bytes())?;
    }
    frames.iter().try_for_each(|frame| out.write_all(frame))
}

/// Bits after the binary point for a scene's means: 12, more if Gaussians are so small that it would show,
/// fewer if the scene is larger than 24 bits hold.
fn fractional_bits(scene: &Scene) -> Result<u8, Mismatch> {
    let largest = scene.means.iter().fold(0.0_f32, |largest, mean| largest.max(mean.abs().max_element()));
    let mut sizes: Vec<f32> = scene.scales.iter().map(|scale| scale.max_element()).collect();
    let middle = sizes.len() / 2;
    let (_, &mut median, _) = sizes.select_nth_unstable_by(middle, f32::total_cmp);
    let unit = |bits: u8| 0.5_f64.powi(i32::from(bits));
    // Steps of an eighth of a standard deviation move a Gaussian by a sixteenth at most, which changes its
    // value anywhere by less than 4 % of its peak: the steepest slope of exp(-t^2 / 2) is 0.61.
    let is_fine = |bits: &u8| 8.0 * unit(*bits) <= f64::from(median);
    let wanted = (FRACTIONAL_BITS..=MAX_FRACTIONAL_BITS).find(is_fine).unwrap_or(MAX_FRACTIONAL_BITS);
    let fits = |bits: &u8| (f64::from(largest) / unit(*bits)).round() <= MAX_INTEGER;
    (0..=wanted).rev().find(fits).ok_or_else(|| {
        mismatch(
            format_args!("a Gaussian at coordinate {largest}"),
            format_args!("{MAX_INTEGER} at most in SPZ"),
        )
    })
}

/// The arrays in the order of the file.
fn arrays(scene: &Scene, header: Header) -> [Vec<u8>; 6] {
    let order = scene.by_source();
    let width = scene.sh.as_ref().map_or(0, |sh| 3 * sh::n_coefficients(sh.degree));
    let coefficients = |i: u32| match &scene.sh {
        Some(sh) => &sh.coefficients[i as usize * width..(i as usize + 1) * width],
        None => &[0.0; 3][..],
    };
    let (signs, sh_signs) = (Axes::RUB.signs(), sh_signs(Axes::RUB));
    let units = (f32::from(header.fractional_bits)).exp2();
    let positions = |&i: &u32| position(scene.means[i as usize] * signs * units);
    let rotations = |&i: &u32| {
        let rotation = scene.rotations[i as usize];
        // RUB is half a turn about x away, which turns the axis as a vector.
        rotation_to_smallest_three((rotation.xyz() * signs).extend(rotation.w).into())
    };
    let opacities = |&i: &u32| byte(scene.opacities[i as usize] * 255.0);
    let colors = |&i: &u32| [0, 1, 2].map(|c| byte(color_code(coefficients(i)[c])));
    let scales = |&i: &u32| scene.scales[i as usize].to_array().map(|scale| byte(scale_code(scale)));
    let n_rest = header.sh_bytes();
    let mut rest = vec![0; n_rest * order.len()];
    if n_rest > 0 {
        rest.par_chunks_exact_mut(n_rest).zip(&order).for_each(|(row, &i)| {
            let values = &coefficients(i)[3..];
            for (k, (byte_of, value)) in row.iter_mut().zip(values).enumerate() {
                *byte_of = byte(harmonic_code(value * sh_signs[1 + k / 3]));
            }
        });
    }
    [
        order.par_iter().map(positions).collect::<Vec<_>>().into_flattened(),
        order.par_iter().map(opacities).collect(),
        order.par_iter().map(colors).collect::<Vec<_>>().into_flattened(),
        order.par_iter().map(scales).collect::<Vec<_>>().into_flattened(),
        order.par_iter().map(rotations).collect::<Vec<_>>().into_flattened(),
        rest,
    ]
}

/// The nearest byte. The thickness 0 of a flat Gaussian, whose logarithm is -infinity, becomes 0.
fn byte(value: f32) -> u8 {
    // `as` clamps to 0..=255.
    value.round() as u8
}

/// Three 24-bit integers.
fn position(coordinates: Vec3) -> [u8; 9] {
    let words = coordinates.to_array().map(|value| (value.round() as i32).to_le_bytes());
    std::array::from_fn(|i| words[i / 3][i % 3])
}

/// The word that `rotation_from_smallest_three` reads, of a unit quaternion x, y, z, w.
fn rotation_to_smallest_three(xyzw: [f32; 4]) -> [u8; 4] {
    let largest = (1..4).fold(0, |largest, i| if xyzw[i].abs() > xyzw[largest].abs() { i } else { largest });
    let mut word = largest as u32;
    // The largest is not stored and taken for positive: q and -q are the same rotation.
    let is_turned = xyzw[largest] < 0.0;
    for (_, &value) in xyzw.iter().enumerate().filter(|&(i, _)| i != largest) {
        let magnitude = (value.abs() / FRAC_1_SQRT_2 * MAX_MAGNITUDE as f32).round() as u32;
        let sign = if (value < 0.0) == is_turned { 0 } else { SIGN };
        word = (word << 10) | sign | magnitude.min(MAX_MAGNITUDE);
    }
    word.to_le_bytes()
}
