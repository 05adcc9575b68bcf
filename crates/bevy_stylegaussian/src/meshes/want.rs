//! Which meshes are painted, and from what.

use std::sync::{Arc, Weak};

use bevy::{
    asset::UntypedAssetId,
    ecs::system::SystemParam,
    platform::{
        collections::{HashMap, HashSet},
        time::Instant,
    },
    prelude::*,
    window::RequestRedraw,
};

use super::{
    component::StyledMesh,
    job::{Collections, Given, Key, SharedPaint},
    material::{Factors, PaintedMaterial},
    textures::PaintingImages,
};
use crate::{
    style::{
        Brushwork, SharedStyle, StyleError, StyleEvents, StyleInputs, StyleJobs, StyleSource,
        decoder::StyleBackend,
    },
    work::Workers,
};

/// What is painted, and what is known for it.
#[derive(Resource, Default)]
pub(super) struct Paints {
    shared: Vec<Arc<SharedPaint>>,
    /// The paint of styles that captures show.
    of_styles: Vec<(Weak<SharedStyle>, Arc<Brushwork>)>,
    /// The paint of sources without a capture.
    alone: Vec<Arc<Brushwork>>,
    /// How often meshes and materials that were painted have changed.
    versions: HashMap<UntypedAssetId, u64>,
    /// Copies of textures, while jobs read them.
    images: HashMap<AssetId<Image>, Weak<Image>>,
    paintings: PaintingImages,
}

/// A mesh that is painted, or about to be.
#[derive(Component)]
pub(super) struct MeshPainting {
    /// The parts of the entity before.
    mesh: Handle<Mesh>,
    material: Handle<StandardMaterial>,
    since: Instant,
    /// How the paint is shown.
    factors: Factors,
    /// The paint that is wanted.
    wanted: Option<Arc<SharedPaint>>,
    /// The paint that is shown.
    shown: Option<Arc<SharedPaint>>,
    /// The last failure, so that it is told once.
    failure: Option<String>,
}

/// The components of a mesh.
type MeshEntity = (
    &'static Mesh3d,
    Option<&'static MeshMaterial3d<StandardMaterial>>,
    Option<&'static mut MeshPainting>,
    &'static GlobalTransform,
);

/// The paint that a mesh is to show.
enum Wish {
    /// What it had.
    Plain,
    /// What it shows, until its style is there.
    Same,
    /// This paint.
    Paint(Arc<Brushwork>),
    /// Its style cannot be had.
    Failed(Arc<StyleError>),
}

/// A root of meshes that are painted alike.
struct Wanted {
    wish: Wish,
    /// The entity of the source, and the capture's size.
    source: Entity,
    size: f32,
    factors: Factors,
    stroke_scale: f32,
}

/// Counts the changes of meshes and materials.
pub(super) fn forget_changed(
    mut meshes: MessageReader<AssetEvent<Mesh>>,
    mut materials: MessageReader<AssetEvent<StandardMaterial>>,
    mut paints: ResMut<Paints>,
) {
    fn changed<A: Asset>(event: &AssetEvent<A>) -> Option<(UntypedAssetId, bool)> {
        match event {
            AssetEvent::Modified { id } => Some((id.untyped(), true)),
            AssetEvent::Removed { id } => Some((id.untyped(), false)),
            _ => None,
        }
    }
    let changes = meshes.read().filter_map(changed).chain(materials.read().filter_map(changed));
    for (id, is_there) in changes.collect::<Vec<_>>() {
        let is_painted = paints
            .shared
            .iter()
            .any(|shared| shared.key.mesh.id().untyped() == id || shared.key.material.id().untyped() == id);
        if is_there && is_painted {
            *paints.versions.entry(id).or_default() += 1;
        } else if !is_there {
            paints.versions.remove(&id);
        }
    }
}

/// The sources of meshes' paint.
#[derive(SystemParam)]
pub(super) struct Originals<'w> {
    meshes: Res<'w, Assets<Mesh>>,
    materials: Res<'w, Assets<StandardMaterial>>,
    images: Res<'w, Assets<Image>>,
}

/// What paint is made into.
#[derive(SystemParam)]
pub(super) struct PaintedAssets<'w> {
    meshes: ResMut<'w, Assets<Mesh>>,
    materials: ResMut<'w, Assets<PaintedMaterial>>,
    images: ResMut<'w, Assets<Image>>,
}

/// The entities that say what is painted.
#[derive(SystemParam)]
pub(super) struct Roots<'w, 's> {
    roots: Query<'w, 's, (Entity, &'static StyledMesh)>,
    children: Query<'w, 's, &'static Children>,
    sources: Query<'w, 's, (&'static StyleSource, Option<&'static StyleJobs>)>,
    places: Query<'w, 's, &'static GlobalTransform>,
}

/// Has meshes painted, and gives back what others had.
#[expect(clippy::too_many_arguments, reason = "the parameters of a system")]
pub(super) fn want_paint(
    mut commands: Commands,
    roots: Roots,
    mut entities: Query<MeshEntity>,
    painted: Query<Entity, With<MeshPainting>>,
    mut styles: StyleInputs,
    mut paints: ResMut<Paints>,
    originals: Originals,
    mut events: StyleEvents,
    mut redraw: MessageWriter<RequestRedraw>,
) {
    if roots.roots.is_empty() && painted.is_empty() {
        return;
    }
    let paints = paints.bypass_change_detection();
    let mut seen: HashSet<Entity> = HashSet::default();
    let mut is_awaited = false;
    for (root, styled) in &roots.roots {
        let wanted = roots.wanted(root, styled, &mut styles, paints);
        if matches!(wanted.wish, Wish::Plain) {
            continue;
        }
        // A capture asks for frames itself.
        is_awaited |= matches!(wanted.wish, Wish::Same) && styled.like.is_none();
        for entity in roots.of_root(root) {
            let Ok((mesh, material, painting, place)) = entities.get_mut(entity) else { continue };
            let Some(mut painting) = painting else {
                if let Some(material) = material {
                    let begun = MeshPainting::new(mesh, material, wanted.factors);
                    commands.entity(entity).try_insert(begun);
                    is_awaited = true;
                }
                continue;
            };
            seen.insert(entity);
            painting.factors = wanted.factors;
            painting.follow(&mut commands, entity, mesh, material);
            match &wanted.wish {
                Wish::Paint(brushwork) => {
                    painting.want(brushwork, &wanted, place, (&mut *paints, &originals, &*styles.workers));
                }
                Wish::Failed(error) => painting.fail(entity, error, &mut events),
                Wish::Plain | Wish::Same => {}
            }
            is_awaited |= matches!(wanted.wish, Wish::Paint(_)) && painting.is_awaited();
        }
    }
    for entity in painted.iter().filter(|entity| !seen.contains(entity)) {
        let Ok((_, _, Some(painting), _)) = entities.get(entity) else { continue };
        let mut entity = commands.entity(entity);
        entity.try_remove::<MeshPainting>();
        if painting.shown.is_some() {
            entity
                .try_remove::<MeshMaterial3d<PaintedMaterial>>()
                .try_insert((Mesh3d(painting.mesh.clone()), MeshMaterial3d(painting.material.clone())));
        }
    }
    paints.forget_unused();
    if is_awaited {
        redraw.write(RequestRedraw);
    }
}

/// Shows what is painted.
pub(super) fn show_paint(
    mut commands: Commands,
    mut entities: Query<(Entity, &mut Mesh3d, &mut MeshPainting)>,
    mut paints: ResMut<Paints>,
    mut assets: PaintedAssets,
    mut events: StyleEvents,
) {
    let paints = paints.bypass_change_detection();
    for (entity, mut mesh, mut painting) in &mut entities {
        if let Some(shared) = painting.wanted.clone() {
            let mut into = Collections {
                meshes: &mut assets.meshes,
                materials: &mut assets.materials,
                images: &mut assets.images,
                paintings: &mut paints.paintings,
            };
            match shared.poll(painting.factors, &mut into) {
                None => {}
                Some(Ok(result)) => {
                    mesh.0 = result.mesh;
                    commands
                        .entity(entity)
                        .try_remove::<MeshMaterial3d<StandardMaterial>>()
                        .try_insert(MeshMaterial3d(result.material));
                    painting.shown = painting.wanted.take();
                    painting.failure = None;
                    events.sent(entity, StyleBackend::Cpu, painting.since);
                }
                Some(Err(error)) => painting.fail(entity, &error, &mut events),
            }
        }
        if let Some(shown) = &painting.shown {
            shown.set(painting.factors, &mut assets.materials);
        }
    }
}

impl Roots<'_, '_> {
    /// The meshes of a root: itself and its descendants, without those of roots among them.
    fn of_root(&self, root: Entity) -> Vec<Entity> {
        let (mut found, mut next) = (Vec::new(), vec![root]);
        while let Some(entity) = next.pop() {
            found.push(entity);
            let children = self.children.get(entity).into_iter().flatten();
            next.extend(children.copied().filter(|child| !self.roots.contains(*child)));
        }
        found
    }

    /// The paint that the meshes of a root are to show.
    fn wanted(
        &self,
        root: Entity,
        styled: &StyledMesh,
        styles: &mut StyleInputs,
        paints: &mut Paints,
    ) -> Wanted {
        let source = styled.like.unwrap_or(root);
        let of_capture = self.sources.get(source).ok().filter(|(of, _)| !of.is_none());
        let wish = match of_capture {
            None => Wish::Plain,
            Some((of, None)) => Self::alone(of, styles, paints),
            Some((of, Some(_))) if styled.like.is_none() => Self::alone(of, styles, paints),
            Some((_, Some(jobs))) => match jobs.shown() {
                None => Wish::Same,
                Some(style) => paints.of_style(style).map_or_else(
                    || {
                        let found =
                            "a mesh is painted like a capture in paint, and found one in a look or decoded";
                        Wish::Failed(Arc::new(StyleError::Source(found.into())))
                    },
                    Wish::Paint,
                ),
            },
        };
        let (knobs, strength) =
            of_capture.map(|(of, _)| (of.knobs(), of.usual_strength())).unwrap_or_default();
        // Beside a capture, the mesh is painted in strokes of this size. Alone, they are drawn in it.
        let stroke_scale = styled.usual_scale();
        let drawn_scale = if styled.like.is_some() { 1.0 } else { stroke_scale };
        Wanted {
            wish,
            source,
            size: self.places.get(source).map_or(1.0, size_of),
            factors: Factors::new(&knobs, strength, drawn_scale),
            stroke_scale,
        }
    }

    /// The wish for a source without a capture.
    fn alone(source: &StyleSource, styles: &mut StyleInputs, paints: &mut Paints) -> Wish {
        match styles.brushwork(source) {
            Ok(None) => Wish::Same,
            Ok(Some(brushwork)) => Wish::Paint(paints.of_source(brushwork)),
            Err(error) => Wish::Failed(error),
        }
    }
}

/// Size of a unit of an entity's space in the world; 1 if it is flat.
fn size_of(place: &GlobalTransform) -> f32 {
    let size = place.affine().matrix3.determinant().abs().cbrt();
    if size > 0.0 && size.is_finite() { size } else { 1.0 }
}

impl MeshPainting {
    fn new(mesh: &Mesh3d, material: &MeshMaterial3d<StandardMaterial>, factors: Factors) -> Self {
        Self {
            mesh: mesh.0.clone(),
            material: material.0.clone(),
            since: Instant::now(),
            factors,
            wanted: None,
            shown: None,
            failure: None,
        }
    }

    /// Whether paint is on its way.
    fn is_awaited(&self) -> bool {
        self.failure.is_none() && (self.wanted.is_some() || self.shown.is_none())
    }

    /// Follows the game if it gave the entity another mesh or material.
    fn follow(
        &mut self,
        commands: &mut Commands,
        entity: Entity,
        mesh: &Mesh3d,
        material: Option<&MeshMaterial3d<StandardMaterial>>,
    ) {
        let is_ours = self.shown.as_ref().is_some_and(|shown| shown.is_mesh(&mesh.0));
        if !is_ours {
            self.mesh = mesh.0.clone();
        }
        if let Some(material) = material {
            self.material = material.0.clone();
        }
        if self.shown.is_some() && (!is_ours || material.is_some()) {
            self.shown = None;
            commands
                .entity(entity)
                .try_remove::<MeshMaterial3d<PaintedMaterial>>()
                .try_insert((Mesh3d(self.mesh.clone()), MeshMaterial3d(self.material.clone())));
        }
    }

    /// Wants this paint, and begins to compute it if nobody has.
    fn want(
        &mut self,
        brushwork: &Arc<Brushwork>,
        wanted: &Wanted,
        place: &GlobalTransform,
        (paints, originals, workers): (&mut Paints, &Originals, &Workers),
    ) {
        let known = self.wanted.as_ref().or(self.shown.as_ref());
        let is_alike = |key: &&Key| {
            Arc::ptr_eq(&key.brushwork, brushwork)
                && key.mesh == self.mesh
                && key.stroke_scale == wanted.stroke_scale
        };
        // A mesh that grows while it is shown keeps its strokes.
        let scale = known
            .map(|shared| &shared.key)
            .filter(is_alike)
            .map_or_else(|| quantized(wanted.stroke_scale * wanted.size / size_of(place)), |key| key.scale);
        let version = paints.version(self.mesh.id().untyped()) + paints.version(self.material.id().untyped());
        let key = Key {
            mesh: self.mesh.clone(),
            material: self.material.clone(),
            version,
            brushwork: Arc::clone(brushwork),
            scale,
            source: wanted.source,
            stroke_scale: wanted.stroke_scale,
        };
        if known.is_some_and(|shared| shared.key == key) {
            return;
        }
        let shared = match paints.shared.iter().find(|shared| shared.key == key) {
            Some(shared) => Arc::clone(shared),
            None => {
                let Some(given) = paints.given(&key, originals) else { return };
                let shared = Arc::new(SharedPaint::start(key, given, workers));
                paints.shared.push(Arc::clone(&shared));
                shared
            }
        };
        self.wanted = Some(shared);
        self.since = Instant::now();
        self.failure = None;
    }

    /// Tells a failure once.
    fn fail(&mut self, entity: Entity, error: &Arc<StyleError>, events: &mut StyleEvents) {
        let failure = Some(error.to_string());
        if self.failure != failure {
            events.failed(entity, Arc::clone(error));
        }
        self.failure = failure;
    }
}

/// A scale in steps of a quarter of an octave, so that copies of a mesh in about one size share their paint.
fn quantized(scale: f32) -> f32 {
    let step = (4.0 * scale.log2()).round() / 4.0;
    if step.is_finite() { step.exp2() } else { 1.0 }
}

impl Paints {
    /// The paint of a style that a capture shows, or `None` if it has none.
    pub(super) fn of_style(&mut self, style: &Arc<SharedStyle>) -> Option<Arc<Brushwork>> {
        let known = self.of_styles.iter().find(|(of, _)| of.as_ptr() == Arc::as_ptr(style));
        if let Some((_, brushwork)) = known {
            return Some(Arc::clone(brushwork));
        }
        let brushwork = Arc::new(style.brushwork()?);
        self.of_styles.push((Arc::downgrade(style), Arc::clone(&brushwork)));
        Some(brushwork)
    }

    /// The paint of a source: the same for equal ones.
    fn of_source(&mut self, brushwork: Brushwork) -> Arc<Brushwork> {
        if let Some(known) = self.alone.iter().find(|known| ***known == brushwork) {
            return Arc::clone(known);
        }
        let brushwork = Arc::new(brushwork);
        self.alone.push(Arc::clone(&brushwork));
        brushwork
    }

    fn version(&self, id: UntypedAssetId) -> u64 {
        self.versions.get(&id).copied().unwrap_or(0)
    }

    /// What a mesh is painted from, or `None` until all of it is loaded.
    fn given(&mut self, key: &Key, originals: &Originals) -> Option<Given> {
        let base = originals.materials.get(&key.material)?.clone();
        let mesh = originals.meshes.get(&key.mesh)?;
        let image = match &base.base_color_texture {
            None => None,
            Some(handle) => Some(self.copy_of(handle.id(), originals.images.get(handle)?)),
        };
        let name = key.mesh.path().map_or_else(|| "a mesh".into(), ToString::to_string);
        Some(Given { mesh: mesh.clone(), base, image, name })
    }

    /// A copy of an image for a job: one for all that need it at a time.
    fn copy_of(&mut self, id: AssetId<Image>, image: &Image) -> Arc<Image> {
        if let Some(copy) = self.images.get(&id).and_then(Weak::upgrade) {
            return copy;
        }
        let copy = Arc::new(image.clone());
        self.images.insert(id, Arc::downgrade(&copy));
        copy
    }

    /// Drops what no mesh shows or waits for.
    fn forget_unused(&mut self) {
        self.shared.retain(|shared| Arc::strong_count(shared) > 1);
        self.of_styles.retain(|(style, _)| style.strong_count() > 0);
        self.alone.retain(|brushwork| Arc::strong_count(brushwork) > 1);
        self.images.retain(|_, image| image.strong_count() > 0);
    }
}
