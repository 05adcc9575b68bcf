//! A picture of each feature, for `docs/features.md`: the demo scene among meshes, in fog and in shadows, and
//! in paint that moves, has a thickness, and obeys its artist. Without a window.
//!
//! ```sh
//! cargo run --release --example pictures [OUT_DIR]    # default: docs/features
//! ```

use std::{
    env, fs,
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, ensure};
use bevy::{
    camera::RenderTarget,
    core_pipeline::tonemapping::Tonemapping,
    light::CascadeShadowConfigBuilder,
    prelude::*,
    render::{
        render_resource::TextureFormat,
        view::screenshot::{Screenshot, ScreenshotCaptured},
    },
    time::TimeUpdateStrategy,
};
use bevy_stylegaussian::{prelude::*, style::StyleStatistics};
use image::{RgbImage, codecs::jpeg::JpegEncoder, imageops};

#[path = "../backdrop/mod.rs"]
mod backdrop;
mod light;
mod paint;
#[path = "../windowless/mod.rs"]
mod windowless;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets");

/// Size of all pictures.
const SIZE: UVec2 = UVec2::new(480, 270);

/// Bytes of a picture at most: the repository keeps them.
const MAX_BYTES: usize = 60_000;

/// Frames before a picture is taken. Shaders of effects are assets, which are loaded in the background.
const N_SETTLING: usize = 24;

/// The longest time that a style or a picture may take.
const PATIENCE: Duration = Duration::from_secs(300);

/// The usual place of the camera, and what it looks at.
const EYE: Vec3 = Vec3::new(0.0, 3.8, 9.4);
const MIDDLE: Vec3 = Vec3::new(0.0, 0.4, 0.0);

fn main() -> Result<()> {
    let out = env::args().nth(1).unwrap_or_else(|| "docs/features".into());
    let (begun, mut studio) = (Instant::now(), Studio::new(Path::new(&out))?);
    let all: [fn(&mut Studio) -> Result<()>; 20] = [
        light::fog,
        light::air,
        light::two_clouds,
        light::depth_of_field,
        light::ambient_occlusion,
        light::water,
        light::order,
        light::shadows_on_splats,
        light::shadows_of_splats,
        light::tint,
        light::half_size,
        light::msaa,
        light::eyes,
        paint::meshes,
        paint::boil,
        paint::flow,
        paint::relief,
        paint::collection,
        paint::screen_stable,
        paint::direction,
    ];
    for draw in all {
        draw(&mut studio)?;
    }
    println!("{} pictures in {:.0?}", all.len(), begun.elapsed());
    Ok(())
}

/// The picture that was taken last.
#[derive(Resource, Default)]
struct Taken(Option<RgbImage>);

fn take(captured: On<ScreenshotCaptured>, mut taken: ResMut<Taken>) {
    taken.0 = captured.image.clone().try_into_dynamic().ok().map(|picture| picture.into_rgb8());
}

/// An app with the demo scene, in which pictures are set up and taken one after another.
pub struct Studio {
    app: App,
    film: Handle<Image>,
    scene: Handle<GaussianScene>,
    sky: Entity,
    out: PathBuf,
    /// Entities of the current picture.
    spawned: Vec<Entity>,
}

impl Studio {
    fn new(out: &Path) -> Result<Self> {
        fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
        let mut app = windowless::app(ASSETS);
        app.init_resource::<Taken>().add_systems(Startup, backdrop::spawn);
        // Time moves by `advance` alone.
        app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
        let film = Image::new_target_texture(SIZE.x, SIZE.y, TextureFormat::Rgba8UnormSrgb, None);
        let film = app.world_mut().resource_mut::<Assets<Image>>().add(film);
        let scene: Handle<GaussianScene> = app.world().resource::<AssetServer>().load("demo.sgs");
        // An entity of it reports if it cannot be loaded.
        let splats = app.world_mut().spawn(GaussianSplats(scene.clone())).id();
        while !app.world().resource::<Assets<GaussianScene>>().contains(&scene) {
            windowless::step(&mut app)?;
        }
        app.world_mut().despawn(splats);
        // There is no other mesh yet.
        let sky = app.world_mut().query_filtered::<Entity, With<Mesh3d>>().single(app.world())?;
        Ok(Self { app, film, scene, sky, out: out.into(), spawned: Vec::new() })
    }

    /// Spawns what is gone with the next picture.
    fn spawn(&mut self, bundle: impl Bundle) -> Entity {
        let entity = self.app.world_mut().spawn(bundle).id();
        self.spawned.push(entity);
        entity
    }

    fn insert(&mut self, entity: Entity, bundle: impl Bundle) {
        self.app.world_mut().entity_mut(entity).insert(bundle);
    }

    /// A camera without MSAA and tonemapping, unless `more` has them.
    fn camera(&mut self, eye: Vec3, to: Vec3, more: impl Bundle) -> Entity {
        let lens = PerspectiveProjection { fov: 0.66, ..default() };
        let camera = self.spawn((
            Camera3d::default(),
            RenderTarget::from(self.film.clone()),
            Projection::from(lens),
            Msaa::Off,
            Tonemapping::None,
            AmbientLight { brightness: 350.0, ..default() },
            Transform::from_translation(eye).looking_at(to, Vec3::Y),
        ));
        // Afterwards, so that it may replace any of these.
        self.insert(camera, more);
        camera
    }

    /// A directional light with shadows, from this side. With the ambient light, white is just white.
    fn sun(&mut self, from: Vec3) {
        let cascades =
            CascadeShadowConfigBuilder { maximum_distance: 40.0, first_cascade_far_bound: 15.0, ..default() };
        let light = DirectionalLight { illuminance: 1_800.0, shadow_maps_enabled: true, ..default() };
        let place = Transform::from_translation(from).looking_at(Vec3::ZERO, Vec3::Y);
        self.spawn((light, cascades.build(), place));
    }

    /// A mesh, transparent if the color is.
    fn mesh(&mut self, shape: impl Into<Mesh>, color: Color, at: Vec3) -> Entity {
        let alpha_mode = if color.alpha() < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque };
        let material = StandardMaterial { base_color: color, alpha_mode, ..default() };
        let material = self.app.world_mut().resource_mut::<Assets<StandardMaterial>>().add(material);
        let mesh = self.app.world_mut().resource_mut::<Assets<Mesh>>().add(shape.into());
        self.spawn((Mesh3d(mesh), MeshMaterial3d(material), Transform::from_translation(at)))
    }

    /// The demo scene, as captured unless `more` has a style.
    fn garden(&mut self, more: impl Bundle) -> Entity {
        let garden = self.spawn(GaussianSplats(self.scene.clone()));
        self.insert(garden, more);
        garden
    }

    /// A shipped style.
    fn style(&self, name: &str) -> Handle<StyleStatistics> {
        self.app.world().resource::<AssetServer>().load(format!("styles/{name}.style.safetensors"))
    }

    fn until_applied(&mut self, entities: &[Entity]) -> Result<()> {
        let (begun, mut missing) = (Instant::now(), entities.to_vec());
        while !missing.is_empty() {
            let applied = windowless::step(&mut self.app)?;
            missing.retain(|entity| !applied.contains(entity));
            ensure!(begun.elapsed() < PATIENCE, "no style after {PATIENCE:?}: {missing:?}");
            // Frames while styles are computed only take time from them.
            thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    /// Moves the game's clock, up to 250 ms: it takes no longer steps.
    fn advance(&mut self, time: Duration) -> Result<()> {
        self.app.insert_resource(TimeUpdateStrategy::ManualDuration(time));
        windowless::step(&mut self.app)?;
        self.app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
        Ok(())
    }

    fn shoot(&mut self) -> Result<RgbImage> {
        for _ in 0..N_SETTLING {
            windowless::step(&mut self.app)?;
            thread::sleep(Duration::from_millis(5));
        }
        self.app.world_mut().spawn(Screenshot::image(self.film.clone())).observe(take);
        let begun = Instant::now();
        loop {
            windowless::step(&mut self.app)?;
            if let Some(picture) = self.app.world_mut().resource_mut::<Taken>().0.take() {
                return Ok(picture);
            }
            ensure!(begun.elapsed() < PATIENCE, "no picture after {PATIENCE:?}");
        }
    }

    /// Takes the picture and saves it.
    fn shoot_and_save(&mut self, name: &str) -> Result<()> {
        let picture = self.shoot()?;
        self.save(name, &picture)
    }

    /// Saves a picture, as good as its size allows, and clears the studio.
    fn save(&mut self, name: &str, picture: &RgbImage) -> Result<()> {
        let mut bytes = Vec::new();
        for quality in [90, 85, 80, 70, 60, 50] {
            bytes.clear();
            picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, quality))?;
            if bytes.len() <= MAX_BYTES {
                break;
            }
        }
        ensure!(bytes.len() <= MAX_BYTES, "{name} takes {} bytes, expected {MAX_BYTES} at most", bytes.len());
        let path = self.out.join(format!("{name}.jpg"));
        fs::write(&path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
        println!("{}, {} bytes", path.display(), bytes.len());
        let world = self.app.world_mut();
        world.entity_mut(self.sky).remove::<StyledMesh>();
        for entity in self.spawned.drain(..) {
            world.despawn(entity);
        }
        windowless::step(&mut self.app)?;
        Ok(())
    }
}

/// The middle parts of pictures, side by side, with lines between them.
fn beside(pictures: &[RgbImage]) -> RgbImage {
    let width = SIZE.x / pictures.len() as u32;
    let mut sheet = RgbImage::from_pixel(SIZE.x, SIZE.y, image::Rgb([255; 3]));
    for (i, picture) in pictures.iter().enumerate() {
        let part = imageops::crop_imm(picture, (SIZE.x - width) / 2 + 1, 0, width - 2, SIZE.y).to_image();
        imageops::replace(&mut sheet, &part, (i as u32 * width + 1).into(), 0);
    }
    sheet
}

/// The middle parts of four pictures, two above two.
fn grid(pictures: &[RgbImage; 4]) -> RgbImage {
    let (width, height) = (SIZE.x / 2, SIZE.y / 2);
    let mut sheet = RgbImage::from_pixel(SIZE.x, SIZE.y, image::Rgb([255; 3]));
    for (i, picture) in (0..4_u32).zip(pictures) {
        let part =
            imageops::crop_imm(picture, width / 2 + 1, height / 2 + 1, width - 2, height - 2).to_image();
        let (x, y) = (i % 2 * width + 1, i / 2 * height + 1);
        imageops::replace(&mut sheet, &part, x.into(), y.into());
    }
    sheet
}
