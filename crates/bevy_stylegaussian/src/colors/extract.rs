//! Extraction of layers: copies changes since the last frame to the render world.

use std::sync::Arc;

use bevy::{
    prelude::*,
    render::{
        Extract,
        sync_world::{MainEntity, MainEntityHashMap},
    },
};

use super::{layers::ColorLayers, styles::StyleColors};

/// Styles that should be on the GPU before they are shown. A resource of both worlds.
#[derive(Resource, Clone, Default)]
pub(crate) struct WantedColors {
    pub(crate) styles: Vec<Arc<StyleColors>>,
    /// Whether strokes are going to be drawn. Once they are, it stays: their pipelines are compiled while the
    /// first are computed.
    pub(crate) strokes: bool,
}

impl WantedColors {
    /// Notes that strokes are going to be drawn. Only the first call counts as a change.
    pub(crate) fn expect_strokes(wanted: &mut ResMut<Self>) {
        if !wanted.strokes {
            wanted.strokes = true;
        }
    }
}

/// The layers of all entities. GPU state is rebuilt from it after a lost device.
#[derive(Resource, Default)]
pub(crate) struct RenderColors(pub(crate) MainEntityHashMap<ColorLayers>);

/// Copies layers that came, changed or went. Marks the resource as changed only then.
pub(super) fn extract_layers(
    mut colors: ResMut<RenderColors>,
    changed: Extract<Query<(Entity, &ColorLayers), Changed<ColorLayers>>>,
    all: Extract<Query<(), With<ColorLayers>>>,
    mut removed: Extract<RemovedComponents<ColorLayers>>,
) {
    // A component that was removed and put back in the same frame is in `all`, and its entry is overwritten
    // below.
    for entity in removed.read().filter(|&entity| !all.contains(entity)) {
        colors.0.remove(&MainEntity::from(entity));
    }
    for (entity, layers) in &changed {
        colors.0.insert(entity.into(), layers.clone());
    }
}

/// Copies the styles that should be on the GPU.
pub(super) fn extract_wanted(mut wanted: ResMut<WantedColors>, main: Extract<Res<WantedColors>>) {
    if main.is_changed() {
        *wanted = main.clone();
    }
}
