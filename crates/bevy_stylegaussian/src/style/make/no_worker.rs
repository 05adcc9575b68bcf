//! Takes the place of the browser's worker in a program, whose own threads compute.

use std::sync::Arc;

use stylegaussian::Scene;
/// A painting that is prepared.
pub(crate) use stylegaussian::paint::Canvas as Painting;
/// A scene that is prepared to be painted.
pub(crate) use stylegaussian::paint::Surface as Ground;

use crate::work::{Lane, Running, Workers};

/// Begins to prepare a scene.
pub(crate) fn ground(scene: &Arc<Scene>, workers: &Workers) -> Running<Arc<Ground>> {
    let scene = Arc::clone(scene);
    workers.start(Lane::Styles, move |work| Ok(Arc::new(Ground::new(&scene, work)?)))
}

/// A painting that strokes follow.
#[cfg(feature = "images")]
pub(crate) fn followed(paint: &stylegaussian::paint::Paint) -> Painting {
    Painting::new(paint)
}

/// Whether scenes are prepared beside frames, and not between them.
pub(crate) fn is_beside_frames() -> bool {
    true
}
