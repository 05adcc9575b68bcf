//! Styles that are computed once for all who want the same.

use std::sync::Arc;

use bevy::{prelude::*, render::renderer::RenderAdapterInfo};
use stylegaussian::work::Canceled;

use crate::{
    scene::GaussianScene,
    style::{
        make::{
            beside::Beside,
            request::{Computed, StyleRequest, StyleResult},
        },
        wish::error::StyleError,
    },
    work::{Running, Workers},
};

#[cfg(feature = "meshes")]
use crate::style::make::brushwork::Brushwork;
#[cfg(feature = "images")]
use crate::style::make::later::{Later, Stretched};

/// Styles that nobody wears and that are kept all the same, for the one who comes back to them.
const MAX_UNUSED: usize = 8;

/// The styles that are computed or wanted, those used last at the end.
#[derive(Resource, Default)]
pub(crate) struct SharedStyles(Vec<Known>);

/// A style that is computed or wanted.
struct Known {
    /// The address of its scene, so that a search among those of thousands of scenes touches no other memory.
    scene: usize,
    style: Arc<SharedStyle>,
}

/// A style of a scene that is being computed, or is there. The computation is canceled if the last reference
/// goes.
pub(crate) struct SharedStyle {
    request: Arc<StyleRequest>,
    computed: Running<Computed>,
}

impl SharedStyles {
    /// Number of styles that are computed or kept.
    #[cfg(all(test, feature = "images"))]
    pub(crate) fn n_known(&self) -> usize {
        self.0.len()
    }

    /// The style of a request: one that is there or on its way, or a new one whose computation begins.
    pub(crate) fn get(&mut self, request: StyleRequest, workers: &Workers) -> Arc<SharedStyle> {
        let scene = Arc::as_ptr(&request.scene.0) as usize;
        let is_asked = |known: &Known| known.scene == scene && *known.style.request == request;
        let known = match self.0.iter().position(is_asked) {
            Some(index) => self.0.remove(index),
            None => {
                // A pin on a style that is there needs no search, and no picture.
                let of_scene = self.0.iter().rev().filter(|known| known.scene == scene);
                let pinned = of_scene.filter(|known| known.style.request.pins_others(&request));
                let like = pinned.filter_map(|known| known.style.poll()?.ok()).next();
                let request = Arc::new(request);
                let computed = request.start(like, workers);
                Known { scene, style: Arc::new(SharedStyle { computed, request }) }
            }
        };
        let style = Arc::clone(&known.style);
        self.0.push(known);
        style
    }
}

/// Forgets styles that nobody uses, except the last few of scenes that are still loaded.
pub(crate) fn forget_unused_styles(
    mut shared: ResMut<SharedStyles>,
    scenes: Res<Assets<GaussianScene>>,
    // Bevy puts a copy into the main world. It is absent if the app does not render.
    renderer: Option<Res<RenderAdapterInfo>>,
) {
    let is_unused = |known: &Known| Arc::strong_count(&known.style) == 1;
    if !shared.0.iter().any(is_unused) {
        return;
    }
    let mut n_unused = 0;
    let mut kept: Vec<_> = std::mem::take(&mut shared.0)
        .into_iter()
        .rev()
        .filter(|known| {
            if !is_unused(known) {
                return true;
            }
            // Canceled ones are dropped, and push out none.
            let is_kept = n_unused < MAX_UNUSED && known.style.is_worth_keeping(&scenes, renderer.is_some());
            n_unused += usize::from(is_kept);
            is_kept
        })
        .collect();
    kept.reverse();
    shared.0 = kept;
}

impl SharedStyle {
    /// The style, or `None` while it is computed.
    pub(crate) fn poll(&self) -> Option<Computed> {
        Some(match self.computed.get()? {
            Ok(computed) => computed.clone(),
            Err(Canceled) => Err(Arc::new(StyleError::Ended)),
        })
    }

    /// Whether it is computed, or has failed.
    pub(crate) fn is_there(&self) -> bool {
        self.computed.get().is_some()
    }

    /// Share of the computation that is done, 0..1.
    pub(crate) fn done(&self) -> f32 {
        self.computed.done()
    }

    /// Whether it may have strokes.
    pub(crate) fn has_strokes(&self) -> bool {
        self.request.has_strokes()
    }

    /// Its paint, for meshes beside the scene, or `None` if it is not painted or not there yet.
    #[cfg(feature = "meshes")]
    pub(crate) fn brushwork(&self) -> Option<Brushwork> {
        self.request.brushwork(self.poll()?.ok()?.colors.strokes.clone()?)
    }

    /// Its painted scene, for others beside it, or `None` if it is not painted or not there yet.
    pub(crate) fn to_others(&self) -> Option<Beside> {
        self.request.to_others(self.poll()?.ok()?.colors.strokes.clone()?)
    }

    /// The same style in other colors of its images, or `None` if there are none. `colors` gives the canvas of
    /// the i-th image or preset in its present colors, if these are not the first.
    #[cfg(feature = "images")]
    pub(crate) fn following(
        &self,
        colors: &dyn Fn(usize) -> Option<Later<Stretched>>,
    ) -> Option<StyleRequest> {
        let strokes = self.poll()?.ok()?.colors.strokes.clone()?;
        self.request.following(strokes, colors)
    }

    /// Whether it is the style of a request.
    #[cfg(feature = "images")]
    pub(crate) fn is_of(&self, request: &StyleRequest) -> bool {
        *self.request == *request
    }

    /// Whether it was shown, and its scene is loaded.
    fn is_worth_keeping(&self, scenes: &Assets<GaussianScene>, renders: bool) -> bool {
        // Colors of a moment do not come back.
        if self.request.under.is_some() {
            return false;
        }
        let Some(Ok(StyleResult { colors, .. })) = self.poll() else { return false };
        // A style that nobody waits for is neither uploaded nor decoded to its end.
        let is_complete = colors.on_gpu().is_some() || !renders;
        is_complete && scenes.iter().any(|(_, loaded)| Arc::ptr_eq(loaded.scene(), &self.request.scene.0))
    }
}
