//! Presets: paintings that were prepared before. Their canvases are made by the first style that needs them,
//! and kept as long as the preset. No encoder takes part.

use std::sync::Arc;

use bevy::{
    platform::collections::{HashMap, HashSet},
    prelude::*,
};
use stylegaussian::{ChannelStatistics, paint::Paint, work::Work};

use crate::style::{
    make::later::{Crop, Encoded, Later, Stretched, later, name, stretched},
    wish::{asset::StyleStatistics, error::StyleError},
};

/// Canvases and statistics of the presets that were used as styles.
#[derive(Resource, Default)]
pub(crate) struct Presets {
    canvases: HashMap<(AssetId<StyleStatistics>, Option<Crop>), Later<Stretched>>,
    /// Statistics, which are there already.
    statistics: HashMap<AssetId<StyleStatistics>, (Arc<ChannelStatistics>, Later<Encoded>)>,
    /// Presets of which it was said that they carry no paint.
    bare: HashSet<AssetId<StyleStatistics>>,
}

impl Presets {
    /// The canvas of a preset's paint, or of a part of it.
    pub(crate) fn canvas(
        &mut self,
        handle: &Handle<StyleStatistics>,
        crop: Option<Crop>,
        paint: &Arc<Paint>,
    ) -> Later<Stretched> {
        let stretch = || {
            let (name, paint) = (preset_name(handle), Arc::clone(paint));
            later(move |work: &Work| {
                let Some(crop) = crop else { return stretched(&name, &paint, work) };
                match paint.cropped(crop.area()) {
                    Ok(part) => stretched(&name, &part, work),
                    Err(source) => Err(StyleError::Crop { image: name.clone(), source }.into()),
                }
            })
        };
        Arc::clone(self.canvases.entry((handle.id(), crop)).or_insert_with(stretch))
    }

    /// The statistics of a preset: the same place in memory each time.
    pub(crate) fn statistics(
        &mut self,
        handle: &Handle<StyleStatistics>,
        statistics: Arc<ChannelStatistics>,
    ) -> Later<Encoded> {
        let begin = || {
            let known = Arc::clone(&statistics);
            (Arc::clone(&statistics), later(move |_: &Work| Ok(Arc::clone(&known))))
        };
        let (of, known) = self.statistics.entry(handle.id()).or_insert_with(begin);
        if !Arc::ptr_eq(of, &statistics) {
            (*of, *known) = begin();
        }
        Arc::clone(known)
    }

    /// Says once of a preset that it carries no paint.
    pub(crate) fn warn_of_bare(&mut self, handle: &Handle<StyleStatistics>) {
        if self.bare.insert(handle.id()) {
            warn!("{}: {BARE}; it is decoded instead", preset_name(handle));
        }
    }
}

/// The error of a preset without paint.
const BARE: &str = "the preset carries no paint (`stylegaussian style IMAGE` makes one that does)";

/// The name of a preset for messages.
pub(crate) fn preset_name(handle: &Handle<StyleStatistics>) -> String {
    name(handle, "a style preset")
}

/// Forgets presets that changed or went.
pub(crate) fn forget_changed_presets(
    mut events: MessageReader<AssetEvent<StyleStatistics>>,
    mut presets: ResMut<Presets>,
) {
    // `Added` is left out: nothing is known of a preset before it exists.
    for event in events.read() {
        if let AssetEvent::Modified { id } | AssetEvent::Removed { id } = event {
            presets.canvases.retain(|(preset, _), _| preset != id);
            presets.bare.remove(id);
        }
        // Those of a changed preset are compared with what it carries.
        if let AssetEvent::Removed { id } = event {
            presets.statistics.remove(id);
        }
    }
}
