//! Extension records of SPZ files: `[type u32][length u32][bytes]`, one after another.

use crate::axes::Axes;

/// `SPZ_ADOBE_coordinate_system`: a u32 of Niantic's `CoordinateSystem`.
pub(super) const COORDINATE_SYSTEM: u32 = 0xADBE_0003;

/// `SPZ_ADOBE_safe_orbit_camera`: limits of a viewer's camera, of no use here.
const ORBIT_CAMERA: u32 = 0xADBE_0002;

/// The coordinate system that the records name, 1 to 16. Others are ignored, and a warning says so.
pub(super) fn coordinate_system(records: &[u8], warnings: &mut Vec<String>) -> Option<u32> {
    let mut found = None;
    let mut rest = records;
    while !rest.is_empty() {
        let Some((kind, payload, after)) = split_record(rest) else {
            warnings.push("ignored extension records that are cut short".into());
            break;
        };
        rest = after;
        match (kind, payload) {
            (ORBIT_CAMERA, _) => {}
            (COORDINATE_SYSTEM, &[number @ 1..=16, 0, 0, 0]) => found = Some(u32::from(number)),
            (COORDINATE_SYSTEM, _) => warnings.push("ignored a coordinate system that is none".into()),
            _ => warnings.push(format!("ignored unknown extension {kind:#010X}")),
        }
    }
    found
}

/// The first record's type and bytes, and what follows it.
fn split_record(records: &[u8]) -> Option<(u32, &[u8], &[u8])> {
    let (kind, rest) = records.split_first_chunk()?;
    let (n_bytes, rest) = rest.split_first_chunk()?;
    let (payload, rest) = rest.split_at_checked(u32::from_le_bytes(*n_bytes) as usize)?;
    Some((u32::from_le_bytes(*kind), payload, rest))
}

/// The axes of a coordinate system 1 to 16, and whether they are those after a quarter turn about x, (x, z, -y), which
/// makes the second axis point up or down as [`Axes`] has it.
///
/// Bits 0 to 2 of the number less one say right, up, front. With bit 3, front or back comes before up or down.
pub(super) fn axes(system: u32) -> (Axes, bool) {
    let bit = |i: u32| ((system - 1) >> i) & 1 != 0;
    // After the turn the third axis is the old second one the other way around.
    let is_back = bit(2) == bit(3);
    (Axes::from_flipped([!bit(0), bit(1), is_back]), bit(3))
}
