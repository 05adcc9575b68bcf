//! A view into the room for tests: the objects that it holds.

use bevy::{prelude::*, render::view::ExtractedView};

use super::{depth::SplatDepths, pipelines::SplatPipelines, view::SplatViews};

/// Objects that frames without changes must not create.
#[derive(Debug, PartialEq)]
pub(crate) struct Held {
    /// Number of pipelines and tables requested so far.
    pub(crate) n_pipelines: usize,
    /// Addresses of the views' layers.
    pub(crate) layers: Vec<usize>,
    /// Number of views with depths.
    pub(crate) n_depths: usize,
    /// Number of draws of casters requested, and of shadow maps that have casters.
    #[cfg(feature = "pbr")]
    pub(crate) n_casts: usize,
    /// How often casters were projected into the shadow maps that have any.
    #[cfg(feature = "pbr")]
    pub(crate) n_projections: u64,
}

impl Held {
    /// The objects in the render world.
    pub(crate) fn of(world: &mut World) -> Self {
        let n_pipelines = world.resource::<SplatPipelines>().n_requested();
        let views: Vec<_> =
            world.query::<&ExtractedView>().iter(world).map(|view| view.retained_view_entity).collect();
        let views = views.iter().filter_map(|view| world.resource::<SplatViews>().get(view));
        // Addresses tell a kept layer from a new one of the same size.
        let layers = views.filter_map(|view| Some(std::ptr::from_ref(view.layer()?.0).addr())).collect();
        let n_depths = world.resource::<SplatDepths>().n_views();
        Self {
            n_pipelines,
            layers,
            n_depths,
            #[cfg(feature = "pbr")]
            n_casts: world.resource::<super::cast::SplatCasts>().n(),
            #[cfg(feature = "pbr")]
            n_projections: world.resource::<super::cast::SplatCasts>().n_projections(),
        }
    }
}
