//! Skinned meshes in paint: strokes stay on them while they move.

use std::f32::consts::FRAC_PI_2;

use bevy::{
    asset::RenderAssetUsages,
    camera::{ScalingMode, visibility::NoFrustumCulling},
    core_pipeline::{
        prepass::{DepthPrepass, NormalPrepass},
        tonemapping::{DebandDither, Tonemapping},
    },
    light::{CascadeShadowConfigBuilder, DirectionalLightShadowMap},
    mesh::{
        Indices, VertexAttributeValues,
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    prelude::*,
    render::render_resource::PrimitiveTopology,
};

use crate::{StyleSource, StyledMesh, style::decoder::StyleBackend};

use super::{
    meshes::{app, mesh_of, preset, until_painted},
    paint::set,
    world::{
        rendering::{app_with_rendering, psnr, read_back, render_target, target},
        *,
    },
};

/// Columns of the strip, by x. The two on the left are of the first joint, those on the right of the second.
const COLUMNS: [f32; 4] = [-1.0, -0.25, 0.25, 1.0];

/// A strip in the plane z = 0, one unit high, with a joint for each half. Between the halves both move it.
fn strip() -> Mesh {
    let at = |i: usize| [COLUMNS[i / 2], if i.is_multiple_of(2) { -0.5 } else { 0.5 }, 0.0];
    let quads = (0..3_u16).flat_map(|column| [0, 2, 3, 0, 3, 1].map(|k| 2 * column + k));
    let joints = (0..8_u16).map(|i| [u16::from(i >= 4), 0, 0, 0]).collect();
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, (0..8).map(at).collect::<Vec<_>>())
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 0.0, 1.0]; 8])
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, vec![[1.0, 0.0, 0.0, 0.0]; 8])
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, VertexAttributeValues::Uint16x4(joints))
        .with_inserted_indices(Indices::U16(quads.collect()))
}

/// The strip as an entity, and its joints, which are in the origin at rest.
fn spawn(app: &mut App, material: StandardMaterial) -> (Entity, [Entity; 2]) {
    let poses = SkinnedMeshInverseBindposes::from(vec![Mat4::IDENTITY; 2]);
    let inverse_bindposes = add(app, poses);
    let joints = [(); 2].map(|()| app.world_mut().spawn(Transform::default()).id());
    let skin = SkinnedMesh { inverse_bindposes, joints: joints.to_vec() };
    let (mesh, material) = (add(app, strip()), add(app, material));
    let parts = (Mesh3d(mesh), MeshMaterial3d(material), skin, Transform::default(), NoFrustumCulling);
    (app.world_mut().spawn(parts).id(), joints)
}

fn shoot(app: &mut App, image: &Handle<Image>) -> Vec<[f32; 3]> {
    (0..3).for_each(|_| app.update());
    read_back(app, image).iter().map(|&[r, g, b, _]| [r, g, b]).collect()
}

fn luminance([r, g, b]: [f32; 3]) -> f32 {
    stylegaussian::palette::LUMINANCE.dot(Vec3::new(r, g, b))
}

/// Vertices in between have the joints of both sides, all have words, and a joint that moves changes nothing.
#[test]
fn a_painted_skin_has_joints_and_words_at_rest() {
    let mut app = app();
    app.init_asset::<SkinnedMeshInverseBindposes>();
    let source = StyleSource::preset(preset(&mut app));
    let (entity, joints) = spawn(&mut app, StandardMaterial::from(Color::srgb(0.7, 0.3, 0.2)));
    app.world_mut().entity_mut(entity).insert((source, StyledMesh::default()));
    until_painted(&mut app, 1);
    let painted = mesh_of(&app, entity);
    let attributes = |app: &App| {
        let mesh = app.world().resource::<Assets<Mesh>>().get(&painted).unwrap();
        let of = |attribute| mesh.attribute(attribute).unwrap().clone();
        let words = mesh.attributes().find_map(|(_, values)| match values {
            VertexAttributeValues::Uint32x4(words) => Some(words.clone()),
            _ => None,
        });
        let skin = (of(Mesh::ATTRIBUTE_JOINT_WEIGHT), of(Mesh::ATTRIBUTE_JOINT_INDEX));
        (of(Mesh::ATTRIBUTE_POSITION), skin, words.unwrap())
    };
    let before = attributes(&app);
    let (positions, skin, words) = &before;
    let VertexAttributeValues::Float32x3(positions) = positions else { panic!() };
    let (VertexAttributeValues::Float32x4(weights), VertexAttributeValues::Uint16x4(joints_of)) = skin else {
        panic!()
    };
    assert!(positions.len() > 1000 && words.len() == positions.len());
    for ((at, weights), joints) in positions.iter().zip(weights).zip(joints_of) {
        let of_second: f32 = (0..4).filter(|&k| joints[k] == 1).map(|k| weights[k]).sum();
        // Weights are linear between the halves.
        let expected = ((at[0] + 0.25) / 0.5).clamp(0.0, 1.0);
        assert!((of_second - expected).abs() < 1e-4, "{at:?}: {of_second}");
        assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    }
    *app.world_mut().get_mut::<Transform>(joints[1]).unwrap() = Transform::from_xyz(0.0, 3.0, 1.0);
    (0..5).for_each(|_| app.update());
    assert_eq!(mesh_of(&app, entity), painted);
    assert!(attributes(&app) == before && app.world().get::<SkinnedMesh>(entity).is_some());
}

/// Half of a strip is turned by a right angle: its pixels are the same ones, turned.
#[test]
fn strokes_stay_on_a_skin_that_bends() {
    const SIDE: usize = 512;
    /// Units of the picture's sides, around the origin.
    const UNITS: f32 = 2.5;
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    let source = StyleSource::preset(preset(&mut app));
    let gray = StandardMaterial { unlit: true, ..StandardMaterial::from(Color::srgb(0.5, 0.5, 0.5)) };
    let (entity, joints) = spawn(&mut app, gray);
    app.world_mut().entity_mut(entity).insert((source, StyledMesh::default()));
    let image = render_target(&mut app, UVec2::splat(SIDE as u32));
    app.world_mut().spawn((
        Camera3d::default(),
        Projection::from(OrthographicProjection {
            scaling_mode: ScalingMode::Fixed { width: UNITS, height: UNITS },
            ..OrthographicProjection::default_3d()
        }),
        target(&image),
        Tonemapping::None,
        DebandDither::Disabled,
        Msaa::Off,
        Transform::from_xyz(0.0, 0.0, 2.0),
    ));
    until_painted(&mut app, 1);
    let straight = shoot(&mut app, &image);
    let turn = Quat::from_rotation_z(FRAC_PI_2);
    *app.world_mut().get_mut::<Transform>(joints[1]).unwrap() = Transform::from_rotation(turn);
    let bent = shoot(&mut app, &image);

    // Pixels of either half, a little within its edges. The turned half lies over the other one up to 0.5.
    let of_half = |sign: f32| {
        let coordinate = |i: usize| UNITS * ((i as f32 + 0.5) / SIDE as f32 - 0.5);
        let all = (0..SIDE * SIDE).map(|i| (i % SIDE, i / SIDE));
        let columns = if sign > 0.0 { 0.3..0.95 } else { 0.55..0.95 };
        all.filter(move |&(column, row)| {
            columns.contains(&(sign * coordinate(column))) && coordinate(row).abs() < 0.45
        })
    };
    let pixel = |picture: &[[f32; 3]], column: usize, row: usize| luminance(picture[row * SIDE + column]);
    let root_mean_square = |differences: &mut dyn Iterator<Item = f32>| {
        let (sum, n) = differences.fold((0.0_f32, 0.0_f32), |(sum, n), d| (sum + d * d, n + 1.0));
        (sum / n).sqrt()
    };
    let grain = root_mean_square(
        &mut of_half(1.0)
            .map(|(column, row)| pixel(&straight, column + 1, row) - pixel(&straight, column, row)),
    );
    let turned = root_mean_square(
        &mut of_half(1.0)
            .map(|(column, row)| pixel(&bent, row, SIDE - 1 - column) - pixel(&straight, column, row)),
    );
    let kept = root_mean_square(
        &mut of_half(-1.0).map(|(column, row)| pixel(&bent, column, row) - pixel(&straight, column, row)),
    );
    assert!(grain > 0.02, "{grain}: no strokes to compare");
    assert!(turned < 0.1 * grain && kept < 0.1 * grain, "{turned} and {kept} of {grain}");
}

/// A bent strip before a wall, lit, with a shadow and with depth and normals of a prepass: at no strength its
/// picture is that of Bevy's own material. The pose is one that bends the halves' middle like any split of it.
#[test]
fn a_painted_skin_has_the_depth_and_the_shadow_of_the_mesh() {
    let Some(mut app) = app_with_rendering(StyleBackend::Cpu) else { return };
    app.insert_resource(DirectionalLightShadowMap { size: 512 });
    let source = StyleSource::preset(preset(&mut app));
    let (entity, joints) = spawn(&mut app, StandardMaterial::from(Color::srgb(0.7, 0.3, 0.2)));
    let wall = add(&mut app, Rectangle::new(6.0, 6.0).into());
    let white = add(&mut app, StandardMaterial::from(Color::WHITE));
    app.world_mut().spawn((Mesh3d(wall), MeshMaterial3d(white), Transform::from_xyz(0.0, 0.0, -0.6)));
    let cascades = CascadeShadowConfigBuilder { num_cascades: 1, maximum_distance: 8.0, ..default() }.build();
    let sun = DirectionalLight { illuminance: 5_000.0, shadow_maps_enabled: true, ..default() };
    let beside = Transform::from_xyz(-1.0, 1.5, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    app.world_mut().spawn((sun, cascades, beside));
    let image = render_target(&mut app, UVec2::splat(128));
    app.world_mut().spawn((
        Camera3d::default(),
        target(&image),
        (Tonemapping::None, DebandDither::Disabled, Msaa::Off),
        (DepthPrepass, NormalPrepass),
        Transform::from_xyz(0.3, 0.2, 3.2).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    let straight = shoot(&mut app, &image);
    *app.world_mut().get_mut::<Transform>(joints[1]).unwrap() = Transform::from_xyz(0.0, 0.4, 0.5);
    let plain = shoot(&mut app, &image);
    let bundle = (source.clone().with_strength(0.0), StyledMesh::default());
    app.world_mut().entity_mut(entity).insert(bundle);
    until_painted(&mut app, 1);
    let same = psnr(&shoot(&mut app, &image), &plain, |_| true);
    set(&mut app, entity, source);
    let painted = psnr(&shoot(&mut app, &image), &plain, |_| true);
    let moved = psnr(&straight, &plain, |_| true);
    // Pixels at the edges may flip.
    assert!(same > 36.0, "{same:.1} dB");
    assert!(
        moved < 28.0 && painted < 33.0,
        "straight {moved:.1} dB, painted {painted:.1} dB: nothing is seen"
    );
}
