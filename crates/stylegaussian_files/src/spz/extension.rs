//! Extension records of SPZ files: `[type u32][length u32][bytes]`, one after another.

use glam::Vec3;
use stylegaussian::axes::Axes;

/// `SPZ_ADOBE_coordinate_system`: a u32 of Niantic's `CoordinateSystem`.
pub(super) const COORDINATE_SYSTEM: u32 = 0xADBE_0003;

/// `SPZ_ADOBE_safe_orbit_camera`: limits of a viewer's camera, of no use here.
const ORBIT_CAMERA: u32 = 0xADBE_0002;

/// Our own: the up direction of a scene, as it was before it was set upright, three f32 in axes RDF. Niantic's
/// library skips types that it does not know. The upper half of a type names its vendor; ours is `SG` in ASCII.
const UP_BEFORE: u32 = 0x5347_0001;

/// Values of extension records.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Extensions {
    /// The coordinate system, 1 to 16.
    pub coordinate_system: Option<u32>,
    /// The up direction that the scene had before it was set upright.
    pub up_before: Option<Vec3>,
}

/// Reads extension records. Unknown ones are ignored, and a warning says so.
pub(super) fn read(records: &[u8], warnings: &mut Vec<String>) -> Extensions {
    let mut found = Extensions::default();
    let mut rest = records;
    while !rest.is_empty() {
        let Some((kind, payload, after)) = split_record(rest) else {
            warnings.push("ignored extension records that are cut short".into());
            break;
        };
        rest = after;
        match (kind, payload) {
            (ORBIT_CAMERA, _) => {}
            (COORDINATE_SYSTEM, &[number @ 1..=16, 0, 0, 0]) => {
                found.coordinate_system = Some(u32::from(number))
            }
            (UP_BEFORE, payload) => match up_from_bytes(payload) {
                Some(up) => found.up_before = Some(up),
                None => warnings.push("ignored an up direction that is none".into()),
            },
            (COORDINATE_SYSTEM, _) => warnings.push("ignored a coordinate system that is none".into()),
            _ => warnings.push(format!("ignored unknown extension {kind:#010X}")),
        }
    }
    found
}

/// The record of an up direction.
pub(super) fn up_record(up: Vec3) -> Vec<u8> {
    let payload = up.to_array().map(f32::to_le_bytes);
    let head = [UP_BEFORE, payload.as_flattened().len() as u32].map(u32::to_le_bytes);
    [head.as_flattened(), payload.as_flattened()].concat()
}

fn up_from_bytes(payload: &[u8]) -> Option<Vec3> {
    let ([x, y, z], []) = payload.as_chunks::<4>() else { return None };
    let up = Vec3::from_array([x, y, z].map(|bytes| f32::from_le_bytes(*bytes)));
    up.try_normalize().and(Some(up))
}

/// The first record's type and bytes, and the bytes that follow it.
fn split_record(records: &[u8]) -> Option<(u32, &[u8], &[u8])> {
    let (kind, rest) = records.split_first_chunk()?;
    let (n_bytes, rest) = rest.split_first_chunk()?;
    let (payload, rest) = rest.split_at_checked(u32::from_le_bytes(*n_bytes) as usize)?;
    Some((u32::from_le_bytes(*kind), payload, rest))
}

/// The axes of a coordinate system 1 to 16, and whether they are those after a quarter turn about x, (x, z,
/// -y), which makes the second axis point up or down as [`Axes`] has it.
///
/// Bits 0 to 2 of the number less one say right, up, front. With bit 3, front or back comes before up or down.
pub(super) fn axes(system: u32) -> (Axes, bool) {
    let bit = |i: u32| ((system - 1) >> i) & 1 != 0;
    // After the turn the third axis is the old second one the other way around.
    let is_back = bit(2) == bit(3);
    (Axes::from_flipped([!bit(0), bit(1), is_back]), bit(3))
}
