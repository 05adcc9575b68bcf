//! Pictures of paint: on meshes and the sky, in motion, in relief, of several paintings, and as its artist
//! wants it.

use std::{f32::consts::TAU, time::Duration};

use anyhow::Result;
use bevy::prelude::*;
use bevy_stylegaussian::{
    prelude::*,
    style::{StyleMotion, StyleRelief},
};

use super::{EYE, MIDDLE, Studio, backdrop, beside, grid};

/// A place from which strokes are seen one by one, and what is looked at.
const NEAR: Vec3 = Vec3::new(0.4, 1.9, 5.2);
const HOUSE: Vec3 = Vec3::new(-0.5, 0.6, 0.0);

/// Radius of the sky over the usual distance of the camera: its strokes are as large on screen.
const SKY: f32 = backdrop::RADIUS / 10.0;

/// The style that most pictures show.
fn strokes(studio: &Studio) -> StyleSource {
    StyleSource::preset(studio.style("strokes"))
}

pub fn meshes(studio: &mut Studio) -> Result<()> {
    studio.camera(EYE, MIDDLE, ());
    studio.sun(Vec3::new(4.0, 8.0, 6.0));
    let style = strokes(studio);
    let garden = studio.garden(style);
    studio.until_applied(&[garden])?;
    let like = StyledMesh::like(garden);
    let mut painted = vec![studio.sky];
    studio.insert(studio.sky, like.with_stroke_scale(SKY));
    let cone = Cone { radius: 0.6, height: 1.3 };
    for mesh in [
        studio.mesh(Torus::new(0.3, 0.7), Color::srgb(0.9, 0.6, 0.1), Vec3::new(-2.6, 1.5, 1.8)),
        studio.mesh(Sphere::new(0.6), Color::srgb(0.8, 0.2, 0.15), Vec3::new(2.4, 1.2, 2.4)),
        studio.mesh(cone, Color::srgb(0.2, 0.35, 0.75), Vec3::new(0.4, 1.3, 3.0)),
    ] {
        studio.insert(mesh, like);
        painted.push(mesh);
    }
    studio.until_applied(&painted)?;
    studio.shoot_and_save("meshes")
}

/// Three frames of strokes that move, so many steps of so much time apart.
fn film(
    studio: &mut Studio,
    motion: StyleMotion,
    (n_steps, step): (usize, Duration),
    name: &str,
) -> Result<()> {
    studio.camera(NEAR, HOUSE, ());
    let style = strokes(studio).with_motion(motion);
    let garden = studio.garden(style);
    studio.until_applied(&[garden])?;
    let mut frames = vec![studio.shoot()?];
    while frames.len() < 3 {
        for _ in 0..n_steps {
            studio.advance(step)?;
        }
        frames.push(studio.shoot()?);
    }
    studio.save(name, &beside(&frames))
}

pub fn boil(studio: &mut Studio) -> Result<()> {
    film(studio, StyleMotion::boil(8.0), (1, Duration::from_millis(125)), "boil")
}

pub fn flow(studio: &mut Studio) -> Result<()> {
    film(studio, StyleMotion::flow(0.5), (2, Duration::from_millis(250)), "flow")
}

pub fn relief(studio: &mut Studio) -> Result<()> {
    studio.camera(NEAR, HOUSE, ());
    let lit = |from: Vec3| StyleRelief::lit_from(from).with_amount(2.0);
    let flat = strokes(studio);
    let garden = studio.garden(flat.clone().with_relief(lit(Vec3::new(-2.0, 1.0, 0.6))));
    studio.until_applied(&[garden])?;
    let from_left = studio.shoot()?;
    // It computes nothing, so nothing is to be waited for.
    studio.insert(garden, flat.with_relief(lit(Vec3::new(2.0, 1.0, 0.6))));
    let from_right = studio.shoot()?;
    studio.save("relief", &beside(&[from_left, from_right]))
}

pub fn collection(studio: &mut Studio) -> Result<()> {
    studio.camera(EYE, MIDDLE, ());
    let paintings = ["strokes", "watercolor", "print", "mosaic"].map(|name| studio.style(name));
    let garden = studio.garden(StyleSource::collection(paintings));
    studio.until_applied(&[garden])?;
    studio.shoot_and_save("collection")
}

pub fn screen_stable(studio: &mut Studio) -> Result<()> {
    let camera = studio.camera(NEAR, HOUSE, ());
    let style = strokes(studio);
    let garden = studio.garden(style.clone());
    studio.until_applied(&[garden])?;
    let mut shoot_near_and_far = |is_stable: bool| -> Result<[image::RgbImage; 2]> {
        studio.insert(garden, style.clone().with_screen_stable(is_stable));
        let mut shoot_from = |distance: f32| {
            let eye = HOUSE + distance * (NEAR - HOUSE);
            studio.insert(camera, Transform::from_translation(eye).looking_at(HOUSE, Vec3::Y));
            studio.shoot()
        };
        Ok([shoot_from(0.7)?, shoot_from(2.8)?])
    };
    let ([near, far], [stable_near, stable_far]) = (shoot_near_and_far(false)?, shoot_near_and_far(true)?);
    studio.save("screen_stable", &grid(&[near, far, stable_near, stable_far]))
}

pub fn direction(studio: &mut Studio) -> Result<()> {
    studio.camera(Vec3::new(0.0, 6.2, 7.6), Vec3::ZERO, ());
    // Around the island; the last point is the first.
    let ring: Vec<Vec3> = (0..=24)
        .map(|i| {
            let (sin, cos) = (TAU * (i % 24) as f32 / 24.0).sin_cos();
            2.5 * Vec3::new(cos, 0.1, sin)
        })
        .collect();
    let style = strokes(studio).with_stroke_direction(ring);
    let garden = studio.garden(style);
    studio.until_applied(&[garden])?;
    studio.shoot_and_save("direction")
}
