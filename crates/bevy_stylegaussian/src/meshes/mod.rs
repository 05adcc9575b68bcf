//! Meshes and skies in the same paint as captures: [`StyledMesh`], [`StyledSky`].

// Before a frame's systems, `want::want_paint` looks which meshes are to be painted, and from what: the style
// that a capture shows (`style::Brushwork`), or one of their own. A job (`job`) splits the mesh, has its
// vertices painted as Gaussians are, and makes another mesh with the words of strokes (`geometry`). Its
// material (`material`) is Bevy's own, whose base color is the paint. A sky (`sky`) becomes another cube map.

use bevy::{
    pbr::{MaterialPlugin, PbrPlugin},
    prelude::*,
    render::RenderApp,
};

mod colors;
mod component;
mod geometry;
mod job;
mod material;
mod sky;
mod textures;
mod want;

pub use component::StyledMesh;
pub use sky::StyledSky;

/// Paints meshes, in games that have Bevy's standard material.
pub(crate) struct MeshesPlugin;

impl Plugin for MeshesPlugin {
    fn build(&self, app: &mut App) {
        app.register_type::<StyledMesh>()
            .register_type::<StyledSky>()
            .init_resource::<want::Paints>()
            .add_systems(
                PreUpdate,
                // Before Bevy looks which meshes and materials have changed, so that both come in one frame.
                (want::forget_changed, want::want_paint, want::show_paint)
                    .chain()
                    .run_if(resource_exists::<Assets<StandardMaterial>>)
                    .run_if(resource_exists::<Assets<Mesh>>),
            );
        app.add_systems(PreUpdate, sky::paint_skies);
        if app.is_plugin_added::<PbrPlugin>() && app.get_sub_app(RenderApp).is_some() {
            material::add_shader(app);
            app.add_plugins(MaterialPlugin::<material::PaintedMaterial>::default());
        } else {
            app.init_asset::<material::PaintedMaterial>();
        }
    }
}
