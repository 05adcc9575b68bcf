//! Tints of parts of space, over those of clouds.

use glam::{Mat3, Vec3};

use super::Tint;
use crate::layers::Region;

/// Volumes that tint a cloud at most; before more, the first ones are left out.
pub const MAX_TINT_VOLUMES: usize = 16;

/// A tint within a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TintVolume {
    /// The part of space. Its map is from the space of the points that are asked for.
    pub region: Region,
    /// The tint where the region has its full weight.
    pub tint: Tint,
}

impl TintVolume {
    /// The difference that the tint makes to linear colors, at the region's full weight; `None` if it makes
    /// none.
    pub fn change(&self) -> Option<Mat3> {
        Some(self.tint.matrix()? - Mat3::IDENTITY)
    }
}

/// The map of linear colors at a point: the `tint` of the cloud, then those of the volumes one after another,
/// each as far as its region reaches: M + w (V - 1) M.
pub fn tint_at(tint: Mat3, volumes: &[TintVolume], point: Vec3) -> Mat3 {
    let last = &volumes[volumes.len().saturating_sub(MAX_TINT_VOLUMES)..];
    let changes = last.iter().filter_map(|volume| Some((volume.region.weight(point), volume.change()?)));
    changes.fold(tint, |below, (weight, change)| below + (change * below) * weight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::Shape;

    /// A soft edge has a part of the tint, in linear light, and volumes multiply.
    #[test]
    fn volumes_tint_as_far_as_they_reach() {
        let shape = Shape::HalfSpace;
        let region = Region { shape, softness: 2.0, ..Region::EVERYWHERE };
        let dark = Tint { exposure: -1.0, ..Tint::IDENTITY };
        let red = Tint { color: Vec3::new(1.0, 0.5, 0.0), ..Tint::IDENTITY };
        let volumes = [TintVolume { region, tint: dark }, TintVolume { region, tint: red }];
        let at = |volumes: &[TintVolume], y: f32| tint_at(Mat3::IDENTITY, volumes, Vec3::Y * y) * Vec3::ONE;
        assert_eq!(at(&volumes[..1], -2.0), Vec3::splat(0.5));
        assert_eq!(at(&volumes[..1], 0.0), Vec3::splat(0.75));
        assert_eq!(at(&volumes[..1], 2.0), Vec3::ONE);
        assert_eq!(at(&volumes, -2.0), Vec3::new(0.5, 0.25, 0.0));
        let twice = tint_at(dark.matrix().unwrap(), &volumes, Vec3::NEG_Y) * Vec3::ONE;
        assert_eq!(twice, Vec3::new(0.25, 0.125, 0.0));
        // What is no number tints nothing, and the last of too many count.
        let none = TintVolume { region, tint: Tint { exposure: f32::NAN, ..dark } };
        assert_eq!(at(&[none], -2.0), Vec3::ONE);
        let many = [vec![volumes[1]], vec![none; MAX_TINT_VOLUMES - 1], vec![volumes[0]]].concat();
        assert_eq!(at(&many, -2.0), Vec3::splat(0.5));
    }
}
