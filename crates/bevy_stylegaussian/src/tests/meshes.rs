//! Meshes in the paint of captures.

use std::sync::Arc;

use bevy::{
    asset::RenderAssetUsages,
    camera::ScalingMode,
    core_pipeline::tonemapping::Tonemapping,
    light::Skybox,
    mesh::{Indices, VertexAttributeValues},
    platform::collections::HashSet,
    prelude::*,
    render::render_resource::PrimitiveTopology,
};
use stylegaussian::strokes::{FINE_SIDE, StrokeTexture};

use crate::{
    GaussianSplats, StyleApplied, StyleFailed, StyleSource, StyledMesh, StyledSky,
    style::{StyleStatistics, decoder::StyleBackend},
};

use super::{
    paint::{noise, paint, raw, set},
    styles::until_applied,
    world::{
        rendering::{app_with_rendering, read_back, render_target, target},
        *,
    },
};

/// An app without a renderer that has Bevy's meshes and materials.
pub(super) fn app() -> App {
    let mut app = app_without_rendering();
    app.init_asset::<Mesh>().init_asset::<StandardMaterial>();
    app
}

/// A painting of noise as a preset.
pub(super) fn preset(app: &mut App) -> Handle<StyleStatistics> {
    let paint = Some(Arc::new(paint(&noise(1, [250, 200, 30], [20, 40, 90]))));
    add(app, StyleStatistics { statistics: Arc::new(small_style(1)), paint })
}

/// A painted capture.
fn capture(app: &mut App) -> Entity {
    let splats = GaussianSplats(add_scene(app, raw(150)));
    let source = StyleSource::preset(preset(app));
    let entity = app.world_mut().spawn((splats, source)).id();
    until_applied(app);
    entity
}

/// A red cube.
fn cube(app: &mut App) -> (Mesh3d, MeshMaterial3d<StandardMaterial>) {
    let mesh = add(app, Cuboid::from_length(0.5).into());
    let material = add(app, StandardMaterial::from(Color::srgb(0.8, 0.2, 0.1)));
    (Mesh3d(mesh), MeshMaterial3d(material))
}

/// Updates until meshes have their paint, and returns their entities.
pub(super) fn until_painted(app: &mut App, n: usize) -> Vec<Entity> {
    let mut painted = Vec::new();
    update_until(app, "painted meshes", |world| {
        painted.extend(world.resource_mut::<Messages<StyleApplied>>().drain().map(|event| event.entity));
        painted.len() >= n
    });
    // The material is there with the commands of that frame.
    app.update();
    painted
}

pub(super) fn mesh_of(app: &App, entity: Entity) -> Handle<Mesh> {
    app.world().get::<Mesh3d>(entity).unwrap().0.clone()
}

fn is_plain(app: &App, entity: Entity) -> bool {
    app.world().get::<MeshMaterial3d<StandardMaterial>>(entity).is_some()
}

fn n_vertices(app: &App, entity: Entity) -> usize {
    app.world().resource::<Assets<Mesh>>().get(&mesh_of(app, entity)).unwrap().count_vertices()
}

#[test]
fn meshes_are_painted_like_a_capture_and_given_back() {
    let mut app = app();
    let like = StyledMesh::like(capture(&mut app));
    let (mesh, material) = cube(&mut app);
    let root = app.world_mut().spawn((Transform::default(), Visibility::default(), like)).id();
    let [a, b] = [0, 1].map(|_| {
        app.world_mut().spawn((mesh.clone(), material.clone(), Transform::default(), ChildOf(root))).id()
    });
    let other = app.world_mut().spawn((mesh.clone(), material.clone(), Transform::default())).id();
    let mut painted = until_painted(&mut app, 2);
    painted.sort();
    let mut expected = vec![a, b];
    expected.sort();
    assert_eq!(painted, expected);
    assert!(!is_plain(&app, a) && !is_plain(&app, b) && is_plain(&app, other));
    assert!(n_vertices(&app, a) > 24, "it was split");
    assert_eq!(mesh_of(&app, a), mesh_of(&app, b), "they share the result");
    assert_eq!(mesh_of(&app, other), mesh.0);

    // An app that is at rest computes nothing, and a new style is another mesh.
    let before = mesh_of(&app, a);
    (0..5).for_each(|_| app.update());
    assert_eq!(mesh_of(&app, a), before);
    let like = app.world().get::<StyledMesh>(root).unwrap().like.unwrap();
    let image = noise(7, [250, 10, 30], [240, 240, 220]);
    let image = add(&mut app, image);
    set(&mut app, like, StyleSource::image(image));
    until_painted(&mut app, 3);
    assert_ne!(mesh_of(&app, a), before);

    // Without a style, and without the component, all is as it was.
    set(&mut app, like, StyleSource::none());
    update_until(&mut app, "plain meshes", |world| {
        world.get::<MeshMaterial3d<StandardMaterial>>(a).is_some()
    });
    (0..3).for_each(|_| app.update());
    drain::<StyleApplied>(&mut app);
    assert_eq!(mesh_of(&app, a), mesh.0);
    let image = add(&mut app, noise(8, [250, 10, 30], [40, 40, 220]));
    set(&mut app, like, StyleSource::image(image));
    until_painted(&mut app, 3);
    assert!(!is_plain(&app, b));
    app.world_mut().entity_mut(root).remove::<StyledMesh>();
    app.update();
    for entity in [a, b] {
        assert_eq!(mesh_of(&app, entity), mesh.0);
        assert_eq!(app.world().get::<MeshMaterial3d<StandardMaterial>>(entity), Some(&material));
    }
}

/// 180 cubes of one mesh, and 20 squares of their own: 21 meshes are painted, and all show one copy of the
/// painting.
#[test]
fn two_hundred_meshes_share_what_they_can() {
    let mut app = app();
    let like = StyledMesh::like(capture(&mut app));
    let (cube, material) = cube(&mut app);
    let root = app.world_mut().spawn((Transform::default(), Visibility::default(), like)).id();
    let squares: Vec<Mesh3d> =
        (0..20).map(|i| Mesh3d(add(&mut app, Rectangle::new(0.3 + 0.01 * i as f32, 0.3).into()))).collect();
    let n_before = app.world().resource::<Assets<Image>>().len();
    let entities: Vec<Entity> = std::iter::repeat_n(&cube, 180)
        .chain(&squares)
        .map(|mesh| {
            let parts = (mesh.clone(), material.clone(), Transform::default(), ChildOf(root));
            app.world_mut().spawn(parts).id()
        })
        .collect();
    until_painted(&mut app, 200);
    assert!(entities.iter().all(|entity| !is_plain(&app, *entity)));
    let painted: HashSet<AssetId<Mesh>> = entities.iter().map(|entity| mesh_of(&app, *entity).id()).collect();
    assert_eq!(painted.len(), 21);
    // Fine and wide detail for all, and the seeds of each.
    assert_eq!(app.world().resource::<Assets<Image>>().len() - n_before, 2 + 21);
}

#[test]
fn a_mesh_alone_follows_the_game() {
    let mut app = app();
    let source = StyleSource::preset(preset(&mut app));
    let (mesh, material) = cube(&mut app);
    let bundle = (mesh.clone(), material, Transform::default(), source, StyledMesh::default());
    let entity = app.world_mut().spawn(bundle).id();
    until_painted(&mut app, 1);
    let first = mesh_of(&app, entity);
    // Another mesh, another material, and a changed one.
    let sphere = add(&mut app, Sphere::new(0.4).into());
    app.world_mut().entity_mut(entity).insert(Mesh3d(sphere.clone()));
    until_painted(&mut app, 1);
    let second = mesh_of(&app, entity);
    assert!(second != first && second != sphere);
    let (_, blue) = cube(&mut app);
    app.world_mut().entity_mut(entity).insert(blue.clone());
    until_painted(&mut app, 1);
    assert!(mesh_of(&app, entity) != second && !is_plain(&app, entity));
    let third = mesh_of(&app, entity);
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    materials.get_mut(&blue.0).unwrap().base_color = Color::srgb(0.1, 0.2, 0.9);
    until_painted(&mut app, 1);
    assert_ne!(mesh_of(&app, entity), third);
    // The paint of a vertex is in its attributes.
    let meshes = app.world().resource::<Assets<Mesh>>();
    let painted = meshes.get(&mesh_of(&app, entity)).unwrap();
    let words = painted.attributes().find_map(|(_, values)| match values {
        VertexAttributeValues::Uint32x4(words) => Some(words),
        _ => None,
    });
    assert!(words.unwrap().iter().all(|[.., corner]| *corner < 3));
    app.world_mut().despawn(entity);
    (0..3).for_each(|_| app.update());
}

#[test]
fn what_cannot_be_painted_says_so_once_and_stays() {
    let mut app = app();
    let source = StyleSource::preset(preset(&mut app));
    let (_, material) = cube(&mut app);
    let lines = Mesh::new(PrimitiveTopology::LineList, RenderAssetUsages::default());
    let lines = add(&mut app, lines);
    let bundle = (Mesh3d(lines.clone()), material, Transform::default(), source, StyledMesh::default());
    let entity = app.world_mut().spawn(bundle).id();
    let mut failures = Vec::new();
    update_until(&mut app, "a failure", |world| {
        failures.extend(world.resource_mut::<Messages<StyleFailed>>().drain());
        !failures.is_empty()
    });
    let error = failures[0].error.to_string();
    assert!(failures[0].entity == entity && error.contains("LineList") && !error.contains('\n'), "{error}");
    (0..5).for_each(|_| app.update());
    assert!(drain::<StyleFailed>(&mut app).is_empty());
    assert!(mesh_of(&app, entity) == lines && is_plain(&app, entity));
}

/// Triangles without normals or texture coordinates, one without an area, and one that is nowhere.
#[test]
fn odd_meshes_are_painted_or_say_why() {
    let mut app = app();
    let source = StyleSource::preset(preset(&mut app));
    let (_, material) = cube(&mut app);
    let spawn = |app: &mut App, positions: Vec<[f32; 3]>| {
        let mesh = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions);
        let mesh = Mesh3d(add(app, mesh));
        let parts = (mesh, material.clone(), Transform::default(), source.clone(), StyledMesh::default());
        app.world_mut().spawn(parts).id()
    };
    let [a, b, c, d] = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let entity = spawn(&mut app, vec![a, b, c, a, c, d, a, b, b, a, b, [f32::NAN; 3]]);
    until_painted(&mut app, 1);
    let meshes = app.world().resource::<Assets<Mesh>>();
    let painted = meshes.get(&mesh_of(&app, entity)).unwrap();
    let Some(VertexAttributeValues::Float32x3(positions)) = painted.attribute(Mesh::ATTRIBUTE_POSITION)
    else {
        panic!()
    };
    assert!(positions.len() > 1000 && positions.as_flattened().iter().all(|value| value.is_finite()));
    let nowhere = spawn(&mut app, vec![a, b, [f32::NAN; 3]]);
    let mut failures = Vec::new();
    update_until(&mut app, "a failure", |world| {
        failures.extend(world.resource_mut::<Messages<StyleFailed>>().drain());
        !failures.is_empty()
    });
    let error = failures[0].error.to_string();
    assert!(failures[0].entity == nowhere && error.contains("no triangle"), "{error}");
    assert!(is_plain(&app, nowhere) && !is_plain(&app, entity));
}

/// Two triangles beside one whose vertex is not there are painted. A mesh without a triangle, or whose values
/// are not one for each vertex, says so.
#[test]
fn meshes_whose_numbers_do_not_fit_are_painted_or_say_why() {
    let mut app = app();
    let source = StyleSource::preset(preset(&mut app));
    let (_, material) = cube(&mut app);
    let spawn = |app: &mut App, mesh: Mesh| {
        let mesh = Mesh3d(add(app, mesh));
        let parts = (mesh, material.clone(), Transform::default(), source.clone(), StyledMesh::default());
        app.world_mut().spawn(parts).id()
    };
    let square = || Mesh::from(Rectangle::new(1.0, 1.0));
    let numbers = Indices::U32(vec![0, 1, 2, 0, 2, 3, 0, 1, 99]);
    let entity = spawn(&mut app, square().with_inserted_indices(numbers));
    until_painted(&mut app, 1);
    let meshes = app.world().resource::<Assets<Mesh>>();
    let painted = meshes.get(&mesh_of(&app, entity)).unwrap();
    let Some(VertexAttributeValues::Float32x3(positions)) = painted.attribute(Mesh::ATTRIBUTE_POSITION)
    else {
        panic!()
    };
    assert!(positions.len() > 1000 && positions.as_flattened().iter().all(|value| value.abs() <= 0.5));
    let nothing = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, Vec::<[f32; 3]>::new());
    for (mesh, part) in [
        (nothing, "no triangle"),
        (square().with_inserted_indices(Indices::U16(Vec::new())), "no triangle"),
        (square().with_inserted_indices(Indices::U32(vec![7, 8, 9])), "no triangle"),
        (
            square().with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 0.0, 1.0]; 3]),
            "3 values of Vertex_Normal, expected 4",
        ),
        (
            square().with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, vec![[1.0; 4]; 9]),
            "9 values of Vertex_Color, expected 4",
        ),
    ] {
        let bad = spawn(&mut app, mesh);
        let mut failures = Vec::new();
        update_until(&mut app, "a failure", |world| {
            failures.extend(world.resource_mut::<Messages<StyleFailed>>().drain());
            !failures.is_empty()
        });
        let error = failures[0].error.to_string();
        assert!(failures[0].entity == bad && error.contains(part), "{error}");
        assert!(is_plain(&app, bad) && !is_plain(&app, entity));
    }
}

#[test]
fn a_sky_that_is_no_cube_map_says_so_once_and_stays() {
    let mut app = app();
    let garden = capture(&mut app);
    let image = add(&mut app, noise(3, [10, 20, 30], [200, 210, 220]));
    let sky = Skybox { image: Some(image.clone()), ..default() };
    let camera = app.world_mut().spawn((sky, StyledSky::like(garden))).id();
    let mut failures = Vec::new();
    update_until(&mut app, "a failure", |world| {
        failures.extend(world.resource_mut::<Messages<StyleFailed>>().drain());
        !failures.is_empty()
    });
    let error = failures[0].error.to_string();
    assert!(failures[0].entity == camera && error.contains("64 x 64 x 1 texels"), "{error}");
    (0..5).for_each(|_| app.update());
    assert!(drain::<StyleFailed>(&mut app).is_empty());
    app.world_mut().entity_mut(camera).remove::<StyledSky>();
    app.update();
    assert_eq!(app.world().get::<Skybox>(camera).unwrap().image, Some(image));
}

/// A square that fills the picture, painted: the picture has the painting's contrast, and the shader is valid.
#[test]
fn a_painted_square_shows_strokes_by_the_pixel() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    let texture: Arc<StrokeTexture> = {
        let image = noise(1, [250, 200, 30], [20, 40, 90]);
        Arc::clone(stylegaussian::paint::Canvas::new(&paint(&image)).texture())
    };
    let source = StyleSource::preset(preset(&mut app));
    let mesh = add(&mut app, Rectangle::new(2.0, 2.0).into());
    let gray = StandardMaterial { unlit: true, ..StandardMaterial::from(Color::srgb(0.5, 0.5, 0.5)) };
    let gray = add(&mut app, gray);
    let bundle = (Mesh3d(mesh), MeshMaterial3d(gray), Transform::default(), source.clone());
    let entity = app.world_mut().spawn((bundle, StyledMesh::default())).id();
    let image = render_target(&mut app, UVec2::splat(256));
    app.world_mut().spawn((
        Camera3d::default(),
        Projection::from(OrthographicProjection {
            scaling_mode: ScalingMode::Fixed { width: 2.0, height: 2.0 },
            ..OrthographicProjection::default_3d()
        }),
        target(&image),
        Tonemapping::None,
        Msaa::Off,
        Transform::from_xyz(0.0, 0.0, 2.0),
    ));
    until_painted(&mut app, 1);
    // Deviation of luminance between neighboring pixels.
    let grain = |app: &mut App| {
        (0..3).for_each(|_| app.update());
        let pixels = read_back(app, &image);
        let steps = pixels.windows(2).map(|pair| (pair[1][1] - pair[0][1]).powi(2));
        (steps.sum::<f32>() / pixels.len() as f32).sqrt()
    };
    let with = grain(&mut app);
    set(&mut app, entity, source.clone().with_paint(0.0));
    let without = grain(&mut app);
    let texel = |i: usize| f32::from(texture.fine[0][i][1]) / 127.0;
    let n = FINE_SIDE * FINE_SIDE;
    let in_painting: f32 = (1..n).map(|i| (texel(i) - texel(i - 1)).powi(2)).sum();
    assert!(with > 4.0 * without && with > 0.2 * (in_painting / n as f32).sqrt(), "{with} {without}");
    // At no strength it is gray.
    set(&mut app, entity, source.with_strength(0.0));
    (0..3).for_each(|_| app.update());
    let center = read_back(&app, &image)[128 * 256 + 128];
    assert!(center[..3].iter().all(|value| (value - 0.5).abs() < 0.01), "{center:?}");
}
