//! Images without a window: a turntable of the demo scene, on which the paint of every shipped style arrives as
//! a wave and balls of paint wander through the captured colors, and a contact sheet that shows each style
//! beside its painting.
//!
//! ```sh
//! cargo run --release --example headless [OUT_DIR]    # default: out/demo
//! ```

use std::{
    env,
    f32::consts::TAU,
    fs,
    path::Path,
    time::{Duration, Instant},
};

use anyhow::{Context, Result};
use bevy::{
    camera::RenderTarget, core_pipeline::tonemapping::Tonemapping, prelude::*,
    render::render_resource::TextureFormat, render::view::screenshot, time::TimeUpdateStrategy,
};
use bevy_stylegaussian::prelude::*;
use image::{RgbImage, imageops};

#[path = "backdrop/mod.rs"]
mod backdrop;
#[path = "windowless/mod.rs"]
mod windowless;

use windowless::step;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
/// The captured colors, then the shipped styles.
const STYLES: [&str; 9] =
    ["captured", "cubist", "dots", "halftone", "ink", "mosaic", "print", "strokes", "watercolor"];
const FRAMES_PER_STYLE: usize = 7;
/// Frames until a wave has crossed the scene.
const FRAMES_PER_WAVE: u32 = 5;
/// Frames in which balls wander, and the styles of the balls.
const WANDERING: usize = 15;
const BALLS: [&str; 3] = ["mosaic", "ink", "print"];
const N_FRAMES: usize = STYLES.len() * FRAMES_PER_STYLE + WANDERING;
/// Time from frame to frame.
const FRAME: Duration = Duration::from_millis(150);

fn main() -> Result<()> {
    let out = env::args().nth(1).unwrap_or_else(|| "out/demo".into());
    let out = Path::new(&out);
    fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let (begun, mut app) = (Instant::now(), windowless::app(ASSETS));
    app.add_systems(Startup, backdrop::spawn);
    let assets = app.world().resource::<AssetServer>().clone();
    let target = Image::new_target_texture(960, 540, TextureFormat::Rgba8UnormSrgb, None);
    let target = app.world_mut().resource_mut::<Assets<Image>>().add(target);
    let (lens, film) = (PerspectiveProjection { fov: 0.66, ..default() }, RenderTarget::from(target.clone()));
    // Splats have soft edges, so multisampling would only take more time.
    let camera = (Camera3d::default(), film, Projection::from(lens), Msaa::Off, Tonemapping::None);
    let camera = app.world_mut().spawn(camera).id();
    let scene: Handle<GaussianScene> = assets.load("demo.sgs");
    let splats = app.world_mut().spawn((GaussianSplats(scene.clone()), StyleSource::none())).id();
    // Otherwise the first frames would be saved without the scene.
    while !app.world().resource::<Assets<GaussianScene>>().contains(&scene) {
        step(&mut app)?;
    }
    let mut balls = Vec::new();
    for frame in 0..N_FRAMES {
        let angle = TAU * frame as f32 / N_FRAMES as f32;
        let (name, style) = match STYLES.get(frame / FRAMES_PER_STYLE) {
            Some(&"captured") | None => ("captured", StyleSource::none()),
            Some(&name) => (name, painted(&assets, name)),
        };
        if frame > 0 && frame % FRAMES_PER_STYLE == 0 && frame <= STYLES.len() * FRAMES_PER_STYLE {
            // From another side each time.
            let origin = Quat::from_rotation_y(2.4 * name.len() as f32 + angle) * Vec3::new(3.5, 0.0, 0.0);
            let wave = StyleTransition::sphere(origin, FRAME * FRAMES_PER_WAVE);
            app.world_mut().entity_mut(splats).insert((style, wave));
            // Time stands still until the style is there: frames here cost nothing but time.
            app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
            while step(&mut app)?.is_empty() {}
            app.insert_resource(TimeUpdateStrategy::ManualDuration(FRAME));
        }
        let wandered = (frame + WANDERING).checked_sub(N_FRAMES);
        if wandered == Some(0) {
            balls = BALLS.map(|name| app.world_mut().spawn((ball(), painted(&assets, name))).id()).to_vec();
        }
        for (i, &ball) in balls.iter().enumerate() {
            let turn = TAU * (i as f32 / balls.len() as f32 + wandered.unwrap_or(0) as f32 / 24.0);
            let place = Transform::from_xyz(3.4 * turn.cos(), 0.4, 3.4 * turn.sin());
            app.world_mut().entity_mut(ball).insert(place);
        }
        // By the frame's number and not by time, so that the same pictures come out on any machine.
        let eye = Quat::from_rotation_y(angle) * Vec3::new(0.0, 3.8, 9.4);
        let eye = Transform::from_translation(eye).looking_at(0.4 * Vec3::Y, Vec3::Y);
        app.world_mut().entity_mut(camera).insert(eye);
        let save = screenshot::save_to_disk(out.join(format!("{frame:03}.png")));
        // Spawned before the update that draws the frame that it takes.
        app.world_mut().spawn(screenshot::Screenshot::image(target.clone())).observe(save);
        step(&mut app)?;
        println!("{:>3} of {N_FRAMES}: {name}", frame + 1);
    }
    // The last images arrive from the GPU a few frames late.
    while app.world_mut().query::<&screenshot::Screenshot>().iter(app.world()).next().is_some() {
        step(&mut app)?;
    }
    contact_sheet(out)?.save(out.join("sheet.png"))?;
    println!("{} and {N_FRAMES} frames in {:.0?}", out.join("sheet.png").display(), begun.elapsed());
    Ok(())
}

/// A shipped style.
fn painted(assets: &AssetServer, name: &str) -> StyleSource {
    StyleSource::preset(assets.load(format!("styles/{name}.style.safetensors")))
}

/// A ball of paint with a soft edge.
fn ball() -> StyleVolume {
    StyleVolume::new(Sphere::new(1.9)).with_softness(0.3)
}

/// The last frame of each style with its painting beside it, in three columns.
fn contact_sheet(out: &Path) -> Result<RgbImage> {
    // A cell is 480 + 6 + 270 wide and 270 high, with 8 between cells.
    let mut sheet = RgbImage::from_pixel(3 * 764 + 8, 3 * 278 + 8, image::Rgb([22, 27, 38]));
    let mut paste = |path: &Path, width: u32, x: i64, y: i64| -> Result<()> {
        let picture = image::open(path).with_context(|| format!("cannot read {}", path.display()))?;
        imageops::replace(&mut sheet, &imageops::thumbnail(&picture.into_rgb8(), width, 270), x, y);
        Ok(())
    };
    for (index, style) in STYLES.iter().enumerate() {
        let (x, y) = (8 + 764 * (index as i64 % 3), 8 + 278 * (index as i64 / 3));
        let paintings = ["jpg", "png"].map(|end| Path::new(ASSETS).join(format!("styles/{style}.{end}")));
        let painting = paintings.iter().find(|path| path.exists());
        // The last frame, in which the wave has passed.
        let frame = out.join(format!("{:03}.png", (index + 1) * FRAMES_PER_STYLE - 1));
        paste(&frame, 480, if painting.is_some() { x } else { x + 138 }, y)?;
        painting.map_or(Ok(()), |painting| paste(painting, 270, x + 486, y))?;
    }
    Ok(sheet)
}
