//! Pictures of a scene in paintings, drawn by the CPU with their strokes, and how much of each painting's fine
//! detail they show.
//!
//! Writes `OUT/PAINTING_VIEW.png` with alpha, from views around the scene or from every STEP-th of its cameras:
//!
//! ```sh
//! cargo run --release -p stylegaussian_files --example paint_pictures -- SCENE OUT SIZE VIEWS PAINTING...
//! ```
//!
//! VIEWS is `orbit:N:I,J,...` (N views around the scene, of which these are drawn) or `cameras:I,J,...`, and
//! `:F` after it takes the cameras to a share F of their distance from the scene's middle.

use std::{env, error::Error, path::Path, time::Instant};

use glam::{Affine3A, UVec2, Vec3};
use image::RgbaImage;
use stylegaussian::{
    Camera, Scene,
    paint::{Canvas, Paint, Surface},
    restyle::Recipe,
    splat::{Colors, RenderedImage, render_strokes},
    strokes::StrokeKnobs,
    views,
    work::Work,
};
use stylegaussian_files::read_scene;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [scene, out, size, views, paintings @ ..] = arguments.as_slice() else {
        return Err("usage: paint_pictures SCENE OUT SIZE VIEWS PAINTING...".into());
    };
    let scene = read_scene(scene.as_ref())?.scene;
    let cameras = cameras(&scene, views, size.parse()?)?;
    let start = Instant::now();
    let surface = Surface::new(&scene, &Work::default())?;
    println!("{} Gaussians, {} seeds, surface {:.0} ms", scene.len(), surface.n_seeds(), ms(start));
    std::fs::create_dir_all(out)?;
    for painting in paintings {
        let paint = paint(painting.as_ref())?;
        let start = Instant::now();
        let canvas = Canvas::new(&paint);
        let prepared = ms(start);
        let start = Instant::now();
        let painted = Recipe::painting(&canvas, &surface).restyle(&scene, &Work::default())?;
        let laid = ms(start);
        let name = Path::new(painting).file_name().unwrap_or_default().to_string_lossy();
        let name = name.split('.').next().unwrap_or_default();
        println!(
            "{name}: prepare {prepared:.0} ms, lay {laid:.0} ms, strokes {:.2} of the painting's fine energy",
            painted.fine_energy
        );
        for (view, camera) in &cameras {
            let strokes = (&painted.strokes, &StrokeKnobs::default());
            let drawn = render_strokes(&scene, Colors::Rgb(&painted.colors), strokes, camera, None);
            save(&drawn, &Path::new(out).join(format!("{name}_{view}.png")))?;
        }
    }
    Ok(())
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// A painting's pixels, shrunk if they are too many.
fn paint(path: &Path) -> Result<Paint, Box<dyn Error>> {
    let image = image::open(path)?.to_rgb8();
    let (width, height) = Paint::size_of(image.width(), image.height());
    let image = image::imageops::resize(&image, width, height, image::imageops::FilterType::Triangle);
    Ok(Paint { width: width as usize, height: height as usize, pixels: image.into_raw(), used: None })
}

/// The cameras that `views` names.
fn cameras(scene: &Scene, views: &str, size: u32) -> Result<Vec<(String, Camera)>, Box<dyn Error>> {
    let mut parts = views.split(':');
    let kind = parts.next();
    let all = match kind {
        Some("orbit") => {
            views::orbit(scene, parts.next().ok_or("a number of views")?.parse()?, UVec2::splat(size))
        }
        Some("cameras") => scene.cameras.iter().map(|camera| camera.fitted(size)).collect(),
        _ => return Err("VIEWS is orbit:N:I,J or cameras:I,J".into()),
    };
    let numbers = parts.next().ok_or("numbers of views")?.split(',');
    let factor: f32 = parts.next().unwrap_or("1").parse()?;
    let middle = scene.means.iter().sum::<Vec3>() / scene.len().max(1) as f32;
    let camera = |number: &str| -> Result<(String, Camera), Box<dyn Error>> {
        let camera = all.get(number.parse::<usize>()?).ok_or("fewer views")?;
        Ok((format!("{}{number}", &kind.unwrap_or_default()[..1]), nearer(camera, middle, factor)))
    };
    numbers.map(camera).collect()
}

/// The camera at a share of its distance from `middle`, with the same direction.
fn nearer(camera: &Camera, middle: Vec3, factor: f32) -> Camera {
    let mut near = camera.clone();
    let shift = Affine3A::from_translation((1.0 - factor) * (camera.position() - middle));
    near.view_from_world = camera.view_from_world * shift;
    near
}

/// Writes a picture with alpha.
fn save(drawn: &RenderedImage, path: &Path) -> Result<(), Box<dyn Error>> {
    let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let pixels = drawn.color.iter().zip(&drawn.alpha).flat_map(|(color, alpha)| {
        let [r, g, b] = color.map(|value| byte(value / alpha.max(1e-3)));
        [r, g, b, byte(*alpha)]
    });
    let picture = RgbaImage::from_raw(drawn.size.x, drawn.size.y, pixels.collect());
    Ok(picture.ok_or("a picture of this size")?.save(path)?)
}
