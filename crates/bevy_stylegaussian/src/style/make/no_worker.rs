//! Takes the place of the browser's worker in a program, whose own threads compute.

use std::sync::Arc;

/// A painting that is prepared.
pub(crate) use stylegaussian::paint::Canvas as Painting;
/// A scene that is prepared to be painted.
pub(crate) use stylegaussian::paint::Surface as Ground;
use stylegaussian::{Scene, work::Work};
#[cfg(feature = "images")]
use stylegaussian::{paint::Paint, work::Canceled};

use crate::work::{Lane, Running, Workers};

/// Begins to prepare a scene, which may be a part of one that is painted.
pub(crate) fn ground(
    scene: &Arc<Scene>,
    beside: Option<&Arc<Ground>>,
    workers: &Workers,
) -> Running<Arc<Ground>> {
    let (scene, beside) = (Arc::clone(scene), beside.cloned());
    let ground = move |work: &Work| match &beside {
        None => Ground::new(&scene, work),
        Some(whole) => Ground::part_of(&scene, whole, work),
    };
    workers.start(Lane::Styles, move |work| Ok(Arc::new(ground(work)?)))
}

/// A painting that strokes follow.
///
/// # Errors
/// If `work` is canceled.
#[cfg(feature = "images")]
pub(crate) fn followed(paint: &Paint, work: &Work) -> Result<Painting, Canceled> {
    Painting::new_if_wanted(paint, work)
}

/// Whether scenes are prepared beside frames, and not between them.
pub(crate) fn is_beside_frames() -> bool {
    true
}
