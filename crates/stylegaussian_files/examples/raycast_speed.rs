//! The time of ray casts at a scene, on one core, after the index is built.
//!
//! ```sh
//! cargo run --release -p stylegaussian_files --example raycast_speed -- SCENE
//! ```

use std::time::Instant;

use stylegaussian::{
    raycast::{Ray, RayIndex},
    views,
    work::Work,
};
use stylegaussian_files::read_scene;

/// Rays of one view, on a grid.
const SIDE: u32 = 40;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: raycast_speed SCENE")?;
    let scene = read_scene(path.as_ref())?.scene;
    let begun = Instant::now();
    let index = RayIndex::new(&scene, &Work::default())?;
    println!("{} Gaussians, indexed in {:.0?}", scene.len(), begun.elapsed());
    let mut times = Vec::new();
    let mut n_hits = 0;
    for camera in views::choose_views(&scene, 8, glam::UVec2::splat(SIDE)) {
        let world_from_view = camera.view_from_world.inverse();
        for pixel in 0..SIDE * SIDE {
            let at = glam::Vec2::new((pixel % SIDE) as f32 + 0.5, (pixel / SIDE) as f32 + 0.5);
            let in_view = ((at - camera.center) / camera.focal).extend(1.0);
            let direction = world_from_view.transform_vector3(in_view).normalize();
            let ray = Ray { origin: world_from_view.translation.into(), direction };
            let begun = Instant::now();
            n_hits += usize::from(index.cast(ray).is_some());
            times.push(begun.elapsed().as_secs_f64() * 1e3);
        }
    }
    times.sort_by(f64::total_cmp);
    let (n, mean) = (times.len(), times.iter().sum::<f64>() / times.len() as f64);
    println!(
        "{n} rays, {n_hits} hits: mean {mean:.3} ms, median {:.3} ms, 99% below {:.3} ms, longest {:.3} ms",
        times[n / 2],
        times[n * 99 / 100],
        times[n - 1]
    );
    Ok(())
}
