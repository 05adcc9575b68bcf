//! Masks: weights that are painted on a scene's Gaussians at run time.
//!
//! [`StyleMask`] is the component that holds them. It may begin as a [`SavedMask`], and the entity gets a
//! [`StyleMaskFailed`] if that does not fit. [`MaskVisibility`] hides what is painted. [`lasso_in_view`] makes
//! a selection of what a player draws on the screen. A [`WorldMask`] is a mask of all parts of a world.

// An entity's `StyleMask` is fitted to its scene (`fit`), painted by the game, and its changes are uploaded
// (`gpu`). Drawing and mixing read it there. This room knows scenes and nothing else.

use bevy::{
    prelude::*,
    render::{ExtractSchedule, GpuResourceAppExt, RenderApp},
};

use crate::{loader::FileLoader, scene::device_serves, systems::StyleGaussianSystems};

mod asset;
mod component;
mod fit;
mod gpu;
mod hidden;
mod lasso;
mod parts;
mod weights;

pub use asset::SavedMask;
pub use component::{MaskVisibility, StyleMask};
pub use fit::{StyleMaskError, StyleMaskFailed};
pub use lasso::lasso_in_view;
pub use parts::{MaskEdit, WorldMask};

pub(crate) use gpu::RenderMasks;
pub(crate) use hidden::HiddenFromRays;

/// Fits masks to scenes and uploads them.
pub(crate) struct MaskPlugin;

impl Plugin for MaskPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<SavedMask>()
            .init_asset_loader::<FileLoader<SavedMask>>()
            .add_message::<StyleMaskFailed>()
            .register_type::<SavedMask>()
            .register_type::<StyleMask>()
            .register_type::<MaskVisibility>()
            .register_type::<StyleMaskFailed>()
            // A mask is fitted to the attached scene.
            .add_systems(
                PostUpdate,
                (parts::give_masks, fit::fit_masks, parts::take_over_edits, hidden::hide_from_rays)
                    .chain()
                    .after(StyleGaussianSystems::Scenes),
            );
        if let Some(render_app) = app.get_sub_app_mut(RenderApp) {
            render_app
                // Rebuilt from the components after a lost device.
                .init_gpu_resource::<RenderMasks>()
                .add_systems(ExtractSchedule, gpu::extract_masks.run_if(device_serves));
        }
    }
}
