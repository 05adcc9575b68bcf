//! Pictures without a window: once around the demo scene, as captured and then in every shipped style, as PNG files, and a
//! sheet that shows each look beside its painting.
//!
//! ```sh
//! cargo run --release --example headless [OUT_DIR]    # default: out/demo
//! ```

use std::{env, f32::consts::TAU, fs, path::Path, time::Instant};

use anyhow::{Context, Result, bail};
use bevy::{
    app::PluginsState,
    camera::RenderTarget,
    core_pipeline::tonemapping::Tonemapping,
    prelude::*,
    render::render_resource::TextureFormat,
    render::view::screenshot::{Screenshot, save_to_disk},
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_stylegaussian::{
    GaussianScene, GaussianSplats, SceneFailed, StyleApplied, StyleFailed, StyleGaussianPlugin, StyleSource,
};
use image::{RgbImage, imageops};

#[path = "backdrop/mod.rs"]
mod backdrop;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");
const STYLES: [&str; 8] = [
    "cubist.jpg",
    "dots.jpg",
    "halftone.png",
    "ink.jpg",
    "mosaic.jpg",
    "print.jpg",
    "strokes.jpg",
    "watercolor.jpg",
];
const FRAMES_PER_LOOK: usize = 5;
const SIZE: UVec2 = UVec2::new(960, 540);

fn main() -> Result<()> {
    let out = env::args().nth(1).unwrap_or_else(|| "out/demo".into());
    let out = Path::new(&out);
    fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let (begun, mut app) = (Instant::now(), windowless_app());
    let assets = app.world().resource::<AssetServer>().clone();
    let target = Image::new_target_texture(SIZE.x, SIZE.y, TextureFormat::Rgba8UnormSrgb, None);
    let target = app.world_mut().resource_mut::<Assets<Image>>().add(target);
    let camera = spawn_camera(app.world_mut(), &target);
    let scene: Handle<GaussianScene> = assets.load("demo.sgs");
    let splats = app.world_mut().spawn((GaussianSplats(scene.clone()), StyleSource::none())).id();
    while app.world().resource::<Assets<GaussianScene>>().get(&scene).is_none() {
        step(&mut app)?;
    }
    let looks: Vec<_> = [None].into_iter().chain(STYLES.map(Some)).collect();
    let n_frames = looks.len() * FRAMES_PER_LOOK;
    for frame in 0..n_frames {
        let look = looks[frame / FRAMES_PER_LOOK];
        if let Some(painting) = look.filter(|_| frame % FRAMES_PER_LOOK == 0) {
            let style = assets.load(format!(
                "styles/{}",
                Path::new(painting).with_extension("style.safetensors").display()
            ));
            app.world_mut().entity_mut(splats).insert(StyleSource::preset(style));
            while !step(&mut app)? {}
        }
        let (sin, cos) = (TAU * frame as f32 / n_frames as f32).sin_cos();
        let eye =
            Transform::from_xyz(11.5 * sin, 4.2, 11.5 * cos).looking_at(Vec3::new(0.0, 0.1, 0.0), Vec3::Y);
        *app.world_mut().entity_mut(camera).get_mut::<Transform>().context("the camera went")? = eye;
        let path = out.join(format!("{frame:03}.png"));
        app.world_mut().spawn(Screenshot::image(target.clone())).observe(save_to_disk(path));
        step(&mut app)?;
        println!("{:>3} of {n_frames}: {}", frame + 1, look.unwrap_or("as captured"));
    }
    // Pictures come back from the GPU a few frames late.
    while app.world_mut().query::<&Screenshot>().iter(app.world()).next().is_some() {
        step(&mut app)?;
    }
    contact_sheet(out, &looks)?.save(out.join("sheet.png"))?;
    println!("{} and {n_frames} frames in {:.0?}", out.join("sheet.png").display(), begun.elapsed());
    Ok(())
}

/// Everything but a window and its events.
fn windowless_app() -> App {
    let window = WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() };
    let files = AssetPlugin { file_path: ASSETS.into(), ..default() };
    let mut app = App::new();
    app.add_plugins(DefaultPlugins.set(window).set(files).disable::<WinitPlugin>());
    app.add_plugins(StyleGaussianPlugin::default());
    while app.plugins_state() == PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    app
}

fn spawn_camera(world: &mut World, target: &Handle<Image>) -> Entity {
    world.resource_scope(|world, mut meshes: Mut<Assets<Mesh>>| {
        let sky = backdrop::sky(&mut meshes, &mut world.resource_mut::<Assets<StandardMaterial>>());
        world.spawn(sky);
    });
    // Splats have soft edges: more samples than one would change nothing but the time they take.
    let lens = Projection::from(PerspectiveProjection { fov: 0.66, ..default() });
    let target = RenderTarget::Image(target.clone().into());
    world.spawn((Camera3d::default(), target, lens, Msaa::Off, Tonemapping::None, Transform::IDENTITY)).id()
}

/// Draws one frame; says whether a style was applied in it.
fn step(app: &mut App) -> Result<bool> {
    app.update();
    if let Some(exit) = app.should_exit() {
        bail!("the renderer gave up: {exit:?}");
    }
    if let Some(failed) = app.world_mut().resource_mut::<Messages<SceneFailed>>().drain().next() {
        bail!("{}", failed.error);
    }
    if let Some(failed) = app.world_mut().resource_mut::<Messages<StyleFailed>>().drain().next() {
        bail!("{}", failed.error);
    }
    Ok(app.world_mut().resource_mut::<Messages<StyleApplied>>().drain().next().is_some())
}

/// The middle frame of each look, its painting beside it, in three columns.
fn contact_sheet(out: &Path, looks: &[Option<&str>]) -> Result<RgbImage> {
    let (width, height) = (480 + 270, 270);
    let mut sheet = RgbImage::new(3 * width, looks.len().div_ceil(3) as u32 * height);
    for (index, look) in looks.iter().enumerate() {
        let corner = UVec2::new(index as u32 % 3 * width, index as u32 / 3 * height).as_i64vec2();
        let frame = out.join(format!("{:03}.png", index * FRAMES_PER_LOOK + FRAMES_PER_LOOK / 2));
        let view = imageops::thumbnail(&image::open(frame)?.into_rgb8(), 480, height);
        imageops::replace(&mut sheet, &view, corner.x, corner.y);
        if let Some(painting) = look {
            let painting = image::open(Path::new(ASSETS).join("styles").join(painting))?.into_rgb8();
            imageops::replace(
                &mut sheet,
                &imageops::thumbnail(&painting, height, height),
                corner.x + 480,
                corner.y,
            );
        }
    }
    Ok(sheet)
}
