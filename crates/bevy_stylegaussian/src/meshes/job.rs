//! The paint of a mesh, computed in the background once for all that show it.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use bevy::{material::OpaqueRendererMethod, prelude::*};
use stylegaussian::{
    mesh::{MeshPaint, SPACING, Split, Spots, spacing_alone},
    strokes::{FINE_SIDE, StrokeTexture, Strokes, WIDE_SIDE},
    work::{Canceled, Work},
};

use super::{
    colors::BaseColor,
    geometry::{normals, painted, triangles, with_vertices},
    material::{Factors, MeshStrokes, PaintedMaterial},
    textures::{PaintingImages, seeds_image},
};
use crate::{
    style::{Brushwork, Failure, StyleError, settled},
    work::{Lane, Running, Workers},
};

/// All that decides how a mesh is painted. Two that are equal share the result.
#[derive(Clone)]
pub(super) struct Key {
    pub(super) mesh: Handle<Mesh>,
    pub(super) material: Handle<StandardMaterial>,
    /// How often either has changed.
    pub(super) version: u64,
    pub(super) brushwork: Arc<Brushwork>,
    /// Size of a unit of the painted scene in units of the mesh, times the size of strokes.
    pub(super) scale: f32,
    /// The entity whose source says how the paint is shown, and how much larger strokes are.
    pub(super) source: Entity,
    pub(super) stroke_scale: f32,
}

impl PartialEq for Key {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.brushwork, &other.brushwork)
            && self.mesh == other.mesh
            && self.material == other.material
            && self.version == other.version
            && self.scale == other.scale
            && self.source == other.source
            && self.stroke_scale == other.stroke_scale
    }
}

/// The sources of a mesh's paint.
pub(super) struct Given {
    pub(super) mesh: Mesh,
    pub(super) base: StandardMaterial,
    /// Its base color texture.
    pub(super) image: Option<Arc<Image>>,
    pub(super) name: String,
}

/// A painted mesh, to be made into assets.
struct Made {
    mesh: Mesh,
    strokes: Strokes,
}

/// A mesh that is being painted, or is painted.
pub(super) struct SharedPaint {
    pub(super) key: Key,
    running: Running<Result<Mutex<Option<Made>>, Arc<StyleError>>>,
    base: StandardMaterial,
    assets: OnceLock<Painted>,
}

/// The assets of a painted mesh.
#[derive(Clone)]
pub(super) struct Painted {
    pub(super) mesh: Handle<Mesh>,
    pub(super) material: Handle<PaintedMaterial>,
}

/// Collections of the assets that paint is made into.
pub(super) struct Collections<'a> {
    pub(super) meshes: &'a mut Assets<Mesh>,
    pub(super) materials: &'a mut Assets<PaintedMaterial>,
    pub(super) images: &'a mut Assets<Image>,
    pub(super) paintings: &'a mut PaintingImages,
}

impl SharedPaint {
    /// Begins to paint a mesh.
    pub(super) fn start(key: Key, given: Given, workers: &Workers) -> Self {
        let (brushwork, scale) = (Arc::clone(&key.brushwork), key.scale);
        // Deferred rendering would draw the base color alone.
        let opaque_render_method = OpaqueRendererMethod::Forward;
        let base = StandardMaterial { opaque_render_method, ..given.base.clone() };
        let running = workers.start(Lane::Styles, move |work| {
            settled(compute(given, &brushwork, scale, work).map(|made| Mutex::new(Some(made))))
        });
        Self { key, running, base, assets: OnceLock::new() }
    }

    /// The painted mesh, or `None` until it is there. The first call makes its assets.
    pub(super) fn poll(
        &self,
        factors: Factors,
        into: &mut Collections,
    ) -> Option<Result<Painted, Arc<StyleError>>> {
        if let Some(assets) = self.assets.get() {
            return Some(Ok(assets.clone()));
        }
        let made = match self.running.get()? {
            Ok(Ok(made)) => made.lock().unwrap_or_else(PoisonError::into_inner).take()?,
            Ok(Err(error)) => return Some(Err(Arc::clone(error))),
            Err(Canceled) => return Some(Err(Arc::new(StyleError::Ended))),
        };
        let mut textures = made.strokes.textures;
        if textures.is_empty() {
            // Without strokes, no seed has a gain.
            textures.push(Arc::new(StrokeTexture::new(
                vec![Vec3::ZERO; FINE_SIDE * FINE_SIDE],
                vec![Vec3::ZERO; WIDE_SIDE * WIDE_SIDE],
            )));
        }
        let [fine, wide] = into.paintings.get(&textures, into.images);
        let seeds = into.images.add(seeds_image(&made.strokes.seeds));
        let Factors { strokes, shown } = factors;
        let extension = MeshStrokes { strokes, shown, fine, wide, seeds };
        let material = into.materials.add(PaintedMaterial { base: self.base.clone(), extension });
        let painted = Painted { mesh: into.meshes.add(made.mesh), material };
        Some(Ok(self.assets.get_or_init(|| painted).clone()))
    }

    /// Whether this is the painted mesh.
    pub(super) fn is_mesh(&self, mesh: &Handle<Mesh>) -> bool {
        self.assets.get().is_some_and(|painted| painted.mesh == *mesh)
    }

    /// Shows the paint by these factors, if it does not already.
    pub(super) fn set(&self, factors: Factors, materials: &mut Assets<PaintedMaterial>) {
        let Some(painted) = self.assets.get() else { return };
        let is_set = |material: &PaintedMaterial| {
            let MeshStrokes { strokes, shown, .. } = material.extension;
            factors == Factors { strokes, shown }
        };
        // Borrowed mutably, it would be uploaded anew.
        if materials.get(&painted.material).is_none_or(is_set) {
            return;
        }
        if let Some(mut material) = materials.get_mut(&painted.material) {
            material.extension.strokes = factors.strokes;
            material.extension.shown = factors.shown;
        }
    }
}

/// Paints a mesh.
fn compute(given: Given, brushwork: &Brushwork, scale: f32, work: &Work) -> Result<Made, Failure> {
    let Given { mesh, base, image, name } = given;
    let failed = |found: String| StyleError::Mesh { mesh: name.clone(), found };
    let (positions, corners) = triangles(&mesh).map_err(failed)?;
    let base = BaseColor::new(&base, image).map_err(failed)?;
    let spacing = match brushwork.pixel() {
        Some(pixel) => SPACING * pixel * scale,
        None => spacing_alone(&positions),
    };
    let split = Split::new(positions, corners, spacing, work)?;
    if split.triangles.is_empty() {
        return Err(failed("found no triangle, expected one at least".into()).into());
    }
    let mesh = with_vertices(mesh, &split.parents);
    let own = base.of_vertices(&mesh, (&split.positions, &split.triangles), spacing);
    work.at(0.1)?;
    let spots = Spots::new(&split, normals(&mesh).as_deref(), &own, spacing, Vec3::Y);
    let paint = brushwork.paint(&spots.scene, scale, &work.part(0.1, 0.9))?;
    let paint = MeshPaint::new(&split, &spots, paint);
    let color = |vertex: u32| paint.colors[spots.of_vertex[vertex as usize] as usize];
    let mesh = painted(mesh, &paint.corners, color, |vertex| own[vertex as usize]);
    Ok(Made { mesh, strokes: paint.strokes })
}
