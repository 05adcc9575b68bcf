//! From primitives to one scene: each in its places.

use glam::{DAffine3, DVec3};
use stylegaussian::{
    scene::{Scene, ScreenFilter},
    work::Work,
};

use crate::{
    distant::{Sample, offset, stride},
    error::Mismatch,
    place::place,
};

/// The Gaussians of a primitive, in the axes of its mesh.
pub(super) struct Part {
    /// The Gaussians.
    pub scene: Scene,
    /// The transforms to the world, one for each time that they are shown.
    pub places: Vec<DAffine3>,
}

/// All Gaussians in all their places, from a common offset on.
pub(super) fn placed(parts: Vec<Part>, warnings: &mut Vec<String>, work: &Work) -> Result<Scene, Mismatch> {
    let offset = common_offset(&parts);
    let mut scenes = Vec::with_capacity(parts.iter().map(|part| part.places.len()).sum());
    for Part { scene, mut places } in parts {
        let Some(last) = places.pop() else { continue };
        let mut put = |mut scene: Scene, mut to: DAffine3| {
            work.check()?;
            // In f64, so that nothing is lost that the file holds.
            to.translation -= offset;
            place(&mut scene, to, warnings).map(|()| scenes.push(scene))
        };
        places.into_iter().try_for_each(|to| put(scene.clone(), to))?;
        put(scene, last)?;
    }
    let is_antialiased = scenes.iter().any(|scene| scene.filter == ScreenFilter::Antialiased);
    let has_sh = scenes.iter().any(|scene| scene.sh.is_some());
    let mut scenes = scenes.into_iter();
    let mut merged = scenes.next().unwrap_or_default();
    scenes.for_each(|scene| merged.append(&scene));
    merged.filter = if is_antialiased { ScreenFilter::Antialiased } else { ScreenFilter::Classic };
    merged.sh = merged.sh.filter(|_| has_sh);
    Ok(Scene { offset, ..merged })
}

/// The offset of a scene of these parts: the place of all, if there is one and the scene is near it. Positions
/// that no node moves are f32 already and stay as they are.
fn common_offset(parts: &[Part]) -> DVec3 {
    let mut places = parts.iter().flat_map(|part| &part.places);
    let Some(first) = places.next().map(|place| place.translation) else { return DVec3::ZERO };
    let is_one = places.all(|place| place.translation == first);
    if is_one && first == DVec3::ZERO {
        return DVec3::ZERO;
    }
    offset(&samples(parts), is_one.then_some(first))
}

/// Every so many Gaussians, counted through all places.
fn samples(parts: &[Part]) -> Vec<Sample> {
    let n: usize = parts.iter().map(|part| part.scene.len() * part.places.len()).sum();
    let stride = stride(n);
    let mut samples = Vec::with_capacity(n.div_ceil(stride));
    let mut next = 0;
    for Part { scene, places } in parts {
        for place in places {
            // One scale for all axes: volumes grow by its cube.
            let scale = place.matrix3.determinant().abs().cbrt();
            while let Some(mean) = scene.means.get(next) {
                let size = f64::from(scene.scales[next].max_element()) * scale;
                samples.push((place.transform_point3(mean.as_dvec3()), size));
                next += stride;
            }
            next -= scene.len();
        }
    }
    samples
}
