//! The layout of the 3DGS reference implementation: one vertex per Gaussian, before the activations. And its
//! dialects, which have fewer properties or more.

use std::f32::consts::LN_2;

use glam::{DVec3, Vec3};
use ply_rs::ply::{ElementDef, Encoding, PropertyType, ScalarType};
use rayon::prelude::*;
use stylegaussian::{
    scene::Scene,
    sh::{self, n_coefficients},
    work::Work,
};

use super::{
    color::{BYTE, Color, MOST_OF_ONE, Stored, spherical_harmonics},
    columns::{Rows, check_end, read_columns},
    distant,
    header::Header,
};
use crate::{
    activate::{StoredGaussians, activate, drop_if},
    error::{Loaded, Mismatch, mismatch},
};

/// Properties that each vertex must have, in the order of the columns that are read. 2DGS, whose Gaussians are
/// flat, has no third scale.
const GEOMETRY: [&str; 11] =
    ["x", "y", "z", "opacity", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", THIRD_SCALE];
const THIRD_SCALE: &str = "scale_2";

/// Columns of the geometry.
const OPACITY: usize = 3;
const ROTATION: usize = 4;
const SCALE: usize = 8;

/// The property of mip-splatting's 3D filter: a standard deviation by which each Gaussian is widened.
const FILTER: &str = "filter_3D";

/// The properties of a 3DGS file, for messages.
const EXPECTED: &str = "3DGS properties x y z, opacity, scale_0..2, rot_0..3 of element `vertex`";

/// Reads a scene.
pub(super) fn read(header: &Header, bytes: Vec<u8>, work: &Work) -> Result<Loaded, Mismatch> {
    let vertex = header.element("vertex").ok_or_else(|| mismatch("no element `vertex`", EXPECTED))?;
    if u32::try_from(vertex.count).is_err() {
        return Err(mismatch(format_args!("{} Gaussians", vertex.count), "fewer than 2^32"));
    }
    let mut warnings = Vec::new();
    let mut names = geometry(vertex, &mut warnings)?;
    let n_scales = names.len() - SCALE;
    let filter = vertex.properties.contains_key(FILTER).then_some(names.len());
    if filter.is_some() {
        names.push(FILTER.to_owned());
        warnings.push(format!(
            "each Gaussian is widened, and its opacity lowered, by its {FILTER} (mip-splatting)"
        ));
    }
    let first_color = names.len();
    let mut color = Color::choose(vertex)?;
    if color == Color::None {
        warnings.push("no color (f_dc_0..2 or red green blue): every Gaussian is mid-gray".into());
    }
    if matches!(color, Color::SphericalHarmonics { degree, n_stored } if n_stored >= n_coefficients(degree)) {
        warnings.push(format!("dropped spherical harmonics beyond degree {}", sh::MAX_DEGREE));
    }
    warnings.extend(left_out_motion(vertex));
    names.extend(color.names());
    check_end(header, &bytes, work)?;
    let mut rows = read_columns(header, bytes.into(), "vertex", &names, &work.part(0.0, 0.3))?;
    work.at(0.3)?;
    decode_halves(header, vertex, &names, &mut color, &mut rows, &mut warnings)?;
    let (offset, means) = distant::means(&rows, header, n_scales).unzip();
    // Most of the file is spherical harmonics, and its memory is free after them.
    let sh = spherical_harmonics(&rows, &color, first_color, &mut warnings, work);
    work.at(0.6)?;
    rows.keep(first_color);
    work.at(0.7)?;
    let mut stored = stored_gaussians(&rows, n_scales);
    work.at(0.8)?;
    stored.sh = sh;
    if let Some(means) = means {
        stored.means = means;
    }
    warnings.extend(activated_hints(&stored));
    let filter = filter.map(|column| widths(&rows, column));
    drop(rows);
    work.at(0.9)?;
    let mut scene = Scene { offset: offset.unwrap_or(DVec3::ZERO), ..activate(stored, &mut warnings) };
    if let Some(widths) = filter {
        let fault = |scene: &Scene, i: usize| {
            (!widths[scene.order[i] as usize].is_finite()).then_some("a filter_3D that is not finite")
        };
        scene = drop_if(scene, fault, &mut warnings);
        widen(&mut scene, &widths);
    }
    Ok(Loaded::new(scene, warnings))
}

/// The names of the columns of the geometry that a vertex has.
fn geometry(vertex: &ElementDef, warnings: &mut Vec<String>) -> Result<Vec<String>, Mismatch> {
    let has = |name: &&str| vertex.properties.contains_key(*name);
    let (found, missing): (Vec<&str>, Vec<&str>) = GEOMETRY.into_iter().partition(has);
    if missing == [THIRD_SCALE] {
        warnings.push("two scales of each Gaussian instead of three: they are flat (2DGS)".into());
    } else if !missing.is_empty() {
        let found: Vec<&str> = vertex.properties.keys().map(String::as_str).take(20).collect();
        let found = format!("a vertex without {} (it has: {})", in_order(missing).join(" "), found.join(" "));
        return Err(mismatch(found, EXPECTED));
    }
    Ok(found.into_iter().map(Into::into).collect())
}

/// Names in the order of messages: scales before rotations.
fn in_order(mut names: Vec<&str>) -> Vec<&str> {
    names.sort_by_key(|name| name.starts_with("rot_"));
    names
}

/// The geometry in the columns of `rows`, of two scales or three.
fn stored_gaussians(rows: &Rows, n_scales: usize) -> StoredGaussians {
    let indices = || (0..rows.n_rows()).into_par_iter();
    StoredGaussians {
        means: indices().map(|i| Vec3::from_array(rows.array(i, 0))).collect(),
        opacity_logits: indices().map(|i| rows.array::<1>(i, OPACITY)[0]).collect(),
        log_scales: indices().map(|i| log_scales(rows, i, n_scales)).collect(),
        rotations_wxyz: indices().map(|i| rows.array(i, ROTATION)).collect(),
        sh: None,
        features: None,
    }
}

/// The logarithms of the sizes of Gaussian `i`, of two scales or three.
pub(super) fn log_scales(rows: &Rows, i: usize, n_scales: usize) -> Vec3 {
    // The logarithm of 0.
    let mut scales = [f32::NEG_INFINITY; 3];
    rows.read(i, SCALE, &mut scales[..n_scales]);
    Vec3::from_array(scales)
}

/// The largest opacities, sizes, rotations and coefficients that make sense, before the activations. Of all
/// 65,536 words, three in ten are the bits of larger numbers or of none.
const MOST_OF_HALVES: f32 = 128.0;

/// The least normal number of half floats. Small whole numbers are the bits of smaller ones.
const LEAST_OF_HALVES: f32 = 1.0 / 16_384.0;

/// The brightness that most colors have if all properties of 16 bits are colors, and half floats of 0 to 1. As
/// whole numbers, the same words would make a scene without contrast: most of 14 to 25 % of full brightness,
/// and none brighter.
const LEAST_OF_COLORS: f32 = 1.0 / 64.0;

/// Decodes half floats in properties of 16 bits, which PLY has no type for. Whole numbers stay what they are if
/// their bits make no sense as half floats.
///
/// # Errors
/// If they are no half floats, and are opacities or sizes: before their activations these are no whole numbers.
fn decode_halves(
    header: &Header,
    vertex: &ElementDef,
    names: &[String],
    color: &mut Color,
    rows: &mut Rows,
    warnings: &mut Vec<String>,
) -> Result<(), Mismatch> {
    // In text, numbers are what they say.
    if header.encoding() == Encoding::Ascii {
        return Ok(());
    }
    let is_color = |name: &str| matches!(color, Color::Rgb(_)) && ["red", "green", "blue"].contains(&name);
    let is_short = |name: &str| {
        let kind = vertex.properties.get(name).map(|property| &property.data_type);
        matches!(kind, Some(PropertyType::Scalar(ScalarType::Short | ScalarType::UShort)))
    };
    let (colors, mut columns): (Vec<usize>, Vec<usize>) =
        (0..names.len()).filter(|&i| is_short(&names[i])).partition(|&i| is_color(&names[i]));
    let listed = |columns: &[usize]| {
        let listed: Vec<&str> = columns.iter().take(14).map(|&i| names[i].as_str()).collect();
        listed.join(" ") + if columns.len() > listed.len() { " .." } else { "" }
    };
    let are_colors_alone = columns.is_empty();
    let range = |column: usize| match column {
        ..OPACITY => f32::MIN..=f32::MAX,
        _ => -MOST_OF_HALVES..=MOST_OF_HALVES,
    };
    if are_colors_alone || rows.take_for_halves(&columns, range, LEAST_OF_HALVES) {
        // Bright colors of 16 bits are the bits of numbers below 0.
        let (most, least) = match are_colors_alone {
            true => (MOST_OF_ONE, LEAST_OF_COLORS),
            false => (BYTE, LEAST_OF_HALVES),
        };
        if colors.len() == 3 && rows.take_for_halves(&colors, |_| 0.0..=most, least) {
            *color = Color::Rgb(Stored::Float);
            columns.extend(colors);
        }
        if !columns.is_empty() {
            warnings.push(format!("properties of 16 bits ({}) are read as half floats", listed(&columns)));
        }
        return Ok(());
    }
    let listed = listed(&columns);
    let is_logarithmic = |&i: &usize| names[i] == GEOMETRY[OPACITY] || names[i].starts_with("scale_");
    if columns.iter().any(is_logarithmic) {
        return Err(mismatch(
            format_args!("whole numbers of 16 bits in {listed}, whose bits are no half floats"),
            "floats before the activations",
        ));
    }
    warnings.push(format!("properties of 16 bits ({listed}) are read as whole numbers, not as half floats"));
    Ok(())
}

/// Beginnings of the names of properties that move Gaussians in time, and such names: SpacetimeGaussians, 4DGS,
/// FreeTimeGS.
const MOTION: [&str; 10] = [
    "motion_",
    "trbf_",
    "omega_",
    "velocity_",
    "scale_t",
    "scale_3",
    "scaling_t",
    "t_scale",
    "rot_r_",
    "f_t_",
];

/// A warning of properties that move Gaussians in time.
fn left_out_motion(vertex: &ElementDef) -> Option<String> {
    let moves = |name: &&str| *name == "t" || MOTION.iter().any(|start| name.starts_with(start));
    let names: Vec<&str> = vertex.properties.keys().map(String::as_str).filter(moves).collect();
    let (first, last) = (names.first()?, names.last()?);
    let listed = if names.len() == 1 { (*first).to_owned() } else { format!("{first} .. {last}") };
    Some(format!(
        "left out the motion of a 4D scene ({}, {listed}): all Gaussians stand still, at all times",
        if names.len() == 1 { "1 property".to_owned() } else { format!("{} properties", names.len()) }
    ))
}

/// Fewest Gaussians of which a habit of all can be told from chance.
const FEWEST_FOR_HINTS: usize = 16;

/// Share of a scene's size that the median Gaussian's standard deviation has if its file holds sizes instead of
/// their logarithms: these are below 1, and taken for logarithms make sizes above 1. Of captures it is a
/// hundredth and less.
const LARGE_SHARE: f32 = 0.1;

/// The opacity before the sigmoid from which on f32 rounds the one after it to 1: exp(-x) is 2^-25. Trained
/// ones are smaller, since nothing draws them there; of bytes of opacities, most are larger.
const OPAQUE: f32 = 25.0 * LN_2;

/// Warnings of values that look as if the activations had been applied already.
fn activated_hints(stored: &StoredGaussians) -> Vec<String> {
    let n = stored.means.len();
    let mut hints = Vec::new();
    if n < FEWEST_FOR_HINTS {
        return hints;
    }
    let middle = |mut values: Vec<f32>| *values.select_nth_unstable_by(n / 2, f32::total_cmp).1;
    let logits = &stored.opacity_logits;
    let are_within = |most: &f32| logits.iter().all(|value| (0.0..=*most).contains(value));
    // Of a scene whose opacities are all the same, any value is as likely.
    if let Some(most) = [1.0, BYTE].into_iter().find(are_within)
        && logits.iter().any(|value| *value != logits[0])
        && (most == 1.0 || middle(logits.clone()) > OPAQUE)
    {
        hints.push(format!(
            "all opacities are 0 to {most}: they look like opacities, and are read as what comes before the \
             sigmoid, as 3DGS stores them"
        ));
    }
    let is_size = |scales: &Vec3| scales.x >= 0.0 && scales.y >= 0.0 && (scales.z >= 0.0 || is_flat(scales));
    if stored.log_scales.iter().all(is_size) {
        let center = Vec3::from_array(
            [0, 1, 2].map(|axis| middle(stored.means.iter().map(|mean| mean[axis]).collect())),
        );
        let size = 2.0 * middle(stored.means.iter().map(|mean| mean.distance(center)).collect());
        let deviation = middle(stored.log_scales.iter().map(|scales| scales.x.max(scales.y)).collect()).exp();
        if deviation > LARGE_SHARE * size {
            hints.push(
                "no scale is below 0, and Gaussians would be as large as the scene: they look like sizes, and \
                 are read as logarithms, as 3DGS stores them"
                    .into(),
            );
        }
    }
    hints
}

/// Whether a Gaussian has no third size.
fn is_flat(log_scales: &Vec3) -> bool {
    log_scales.z == f32::NEG_INFINITY
}

/// The widths of the 3D filter `[N]`.
fn widths(rows: &Rows, column: usize) -> Vec<f32> {
    (0..rows.n_rows()).map(|i| rows.array::<1>(i, column)[0]).collect()
}

/// Applies the 3D filter (Yu et al. 2024, section 4.1; `get_scaling_with_3D_filter` and
/// `get_opacity_with_3D_filter` of its code): a Gaussian is convolved with one of standard deviation f, and
/// keeps its mass. `widths` `[n_source]` are by the index in the file.
///
/// s' = sqrt(s^2 + f^2) and opacity' = opacity sqrt(prod s^2 / prod s'^2).
fn widen(scene: &mut Scene, widths: &[f32]) {
    let gaussians = scene.scales.par_iter_mut().zip(&mut scene.opacities).zip(&scene.order);
    gaussians.for_each(|((scales, opacity), &index)| {
        let before = scales.as_dvec3();
        let width = f64::from(widths[index as usize]);
        let after = before.to_array().map(|scale| scale.hypot(width));
        let kept = before.to_array().into_iter().zip(after);
        // 0 / 0 of a flat Gaussian that is not widened.
        let kept: f64 = kept.map(|(before, after)| if after > 0.0 { before / after } else { 1.0 }).product();
        *scales = DVec3::from_array(after).as_vec3();
        *opacity = (f64::from(*opacity) * kept) as f32;
    });
}
