//! Positions finer than f32: of survey coordinates, which programs write as doubles.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{columns::Rows, header::Header, native::log_scales};
use crate::distant::{Sample, offset, stride};

/// The key of the comment that holds a scene's offset.
pub(super) const COMMENT: &str = "offset";

/// The offset of a scene that f32 would round, and its means from there on, or `None` if there is no need for
/// one. The columns are those of a native file, with so many scales.
pub(super) fn means(rows: &Rows, header: &Header, n_scales: usize) -> Option<(DVec3, Vec<Vec3>)> {
    // In numbers of f32 there is nothing to win.
    if !rows.are_wide(0..3) {
        return None;
    }
    let position = |i: usize| DVec3::from_array(rows.wide(i, 0));
    let sample =
        |i: usize| -> Sample { (position(i), f64::from(log_scales(rows, i, n_scales).max_element().exp())) };
    let samples: Vec<Sample> = (0..rows.n_rows()).step_by(stride(rows.n_rows())).map(sample).collect();
    let offset = offset(&samples, named(header));
    let mean = |i: usize| (position(i) - offset).as_vec3();
    (offset != DVec3::ZERO).then(|| (offset, (0..rows.n_rows()).into_par_iter().map(mean).collect()))
}

/// The offset that our writer left in a comment.
fn named(header: &Header) -> Option<DVec3> {
    header.comments().find_map(|comment| {
        let words: Vec<&str> = comment.iter().map(String::as_str).collect();
        match words[..] {
            [COMMENT, x, y, z] => Some(DVec3::new(x.parse().ok()?, y.parse().ok()?, z.parse().ok()?)),
            _ => None,
        }
    })
}
