//! The demo scene: a small floating island with a cottage, a windmill, trees, a pond and a waterfall, made of
//! 60 to 70 thousand flat Gaussians with baked light.
//!
//! It is the same bit for bit on every machine. Random numbers are integers, f32 arithmetic is scalar and in a
//! fixed order, and transcendental functions are computed in software (`libm`).

use glam::Vec3;
use stylegaussian::scene::{Scene, Sh};

pub mod brush;
pub mod house;
pub mod light;
pub mod mill;
pub mod plants;
pub mod random;
pub mod sheep;
pub mod sky;
pub mod terrain;
pub mod water;
pub mod woodwork;

use brush::Canvas;

/// Value of the constant spherical harmonic, 1 / (2 sqrt(pi)).
const SH_0: f32 = 0.282_094_79;

/// Paints everything, in a fixed order. Water comes late, since it mirrors the things around it.
pub fn paint_island() -> Canvas {
    let mut canvas = Canvas::default();
    terrain::paint_ground(&mut canvas);
    terrain::paint_cobbles(&mut canvas);
    terrain::paint_cliffs(&mut canvas);
    terrain::paint_rim(&mut canvas);
    house::paint_house(&mut canvas);
    mill::paint_mill(&mut canvas);
    plants::paint_trees(&mut canvas);
    plants::paint_meadow(&mut canvas);
    woodwork::paint_bridge(&mut canvas);
    woodwork::paint_boat(&mut canvas);
    woodwork::paint_garden(&mut canvas);
    woodwork::paint_well(&mut canvas);
    woodwork::paint_woodpile(&mut canvas);
    woodwork::paint_bench(&mut canvas);
    woodwork::paint_rocks(&mut canvas);
    sheep::paint_sheep(&mut canvas);
    water::paint_water(&mut canvas);
    water::paint_waterfall(&mut canvas);
    sky::paint_sky(&mut canvas, house::chimney_top());
    canvas
}

/// The finished scene, lit, with spherical harmonics of degree 0, in Morton order.
pub fn build() -> Scene {
    let canvas = paint_island();
    let colors = light::bake(&canvas.dabs);
    let n = canvas.dabs.len();
    let coefficients =
        colors.iter().flat_map(|color| ((*color - Vec3::splat(0.5)) / SH_0).to_array()).collect();
    let mut scene = Scene {
        means: canvas.dabs.iter().map(|dab| dab.frame.origin).collect(),
        rotations: canvas.dabs.iter().map(|dab| dab.frame.rotation()).collect(),
        scales: canvas.dabs.iter().map(|dab| dab.sigma).collect(),
        opacities: canvas.dabs.iter().map(|dab| dab.opacity).collect(),
        sh: Some(Sh { degree: 0, coefficients }),
        order: (0..n as u32).collect(),
        n_source: n,
        up: Some(Vec3::Y),
        source: Some("demo_world".into()),
        license: Some("MIT OR Apache-2.0".into()),
        ..Scene::default()
    };
    scene.sort_by_morton();
    // Nobody needs the order of painting, so the sorted order counts as the source's.
    scene.order = (0..n as u32).collect();
    scene
}
