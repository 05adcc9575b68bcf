//! Surfaces of scenes, which paint is laid on: computed once for each scene.

use std::sync::Arc;

use bevy::{prelude::*, window::RequestRedraw};
use stylegaussian::work::Canceled;

use crate::{
    scene::{LoadedScene, PerScene},
    style::{
        make::{
            beside::Beside,
            later::Input,
            worker::{self, Ground},
        },
        wish::error::StyleError,
    },
    work::{Running, Workers},
};

/// The surfaces of the scenes that are painted, as long as the scenes are shown.
#[derive(Resource, Default)]
pub(crate) struct Surfaces(pub(crate) PerScene<Wanted>);

/// The surface of a scene.
pub(crate) struct Wanted {
    pub(crate) surface: Running<Arc<Ground>>,
    /// Whether somebody asked for it in this frame.
    is_wanted: bool,
    /// Whether somebody did, and it was not there.
    is_awaited: bool,
}

impl Surfaces {
    /// The surface of a scene, or `Ok(None)` until it is there. The first call begins; the scene may be a part
    /// of one that is painted. Whoever waits asks in each frame: a surface that nobody asks for is computed no
    /// further.
    pub(crate) fn get(
        &mut self,
        loaded: &LoadedScene,
        beside: Option<&Beside>,
        workers: &Workers,
    ) -> Input<Arc<Ground>> {
        let begin = || {
            let surface = worker::ground(loaded.scene(), beside.map(|beside| &beside.surface), workers);
            Wanted { surface, is_wanted: true, is_awaited: true }
        };
        let wanted = self.0.get_or_insert_with(loaded, begin);
        wanted.is_wanted = true;
        let found = wanted.surface.get();
        wanted.is_awaited |= found.is_none();
        // It is never canceled while somebody asks, so it has panicked.
        let surface = found.map(|surface| surface.clone().map_err(|Canceled| StyleError::Ended));
        Ok(surface.transpose()?)
    }

    /// Share of a scene's surface that is computed, 0..1.
    pub(crate) fn done(&self, loaded: &LoadedScene) -> f32 {
        self.0.get(loaded).map_or(0.0, |wanted| wanted.surface.done())
    }

    /// Number of surfaces that are there.
    #[cfg(test)]
    pub(crate) fn n_known(&self) -> usize {
        self.0.values().filter(|wanted| wanted.surface.get().is_some()).count()
    }
}

/// Forgets the surfaces of scenes that no entity shows, and stops those that nobody waits for any more. Asks
/// for another frame if somebody waits for one.
pub(crate) fn forget_unused_surfaces(
    mut surfaces: ResMut<Surfaces>,
    shown: Query<&LoadedScene>,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    let surfaces = &mut surfaces.bypass_change_detection().0;
    let mut is_awaited = false;
    surfaces.retain(shown.iter(), |wanted| {
        is_awaited |= std::mem::take(&mut wanted.is_awaited);
        std::mem::take(&mut wanted.is_wanted) || wanted.surface.get().is_some()
    });
    if is_awaited {
        redraw.write(RequestRedraw);
    }
}
