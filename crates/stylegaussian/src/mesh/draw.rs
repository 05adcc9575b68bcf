//! Pictures of painted meshes, on the CPU.

use glam::{Vec2, Vec3};

use super::{corners::detail_at, paint::MeshPaint, split::Split, spots::Spots};
use crate::{
    camera::Camera,
    splat::RenderedImage,
    strokes::{SHARPER, StrokeKnobs, StrokeSeed, StrokeWord},
};

/// Level of detail: that of the kernel `mesh_level`, from the changes of a position by a pixel to the right and
/// down.
fn level(seed: &StrokeSeed, steps: [Vec3; 2]) -> f32 {
    let seed = seed.plain();
    let [x, y] = steps.map(|step| seed.pitch * Vec2::new(seed.right.dot(step), seed.down.dot(step)));
    let facing = x.length().min(y.length());
    let texels = x.perp_dot(y).abs().sqrt().clamp(facing, 3.0 * facing);
    (texels.max(1e-6).log2() + SHARPER).max(0.0)
}

/// Draws a painted mesh as its material shows it without light. `own` are the colors of its vertices before it
/// was painted, and of any point of it.
///
/// Triangles that reach nearer than the camera's near plane are left out.
///
/// # Panics
/// If split, spots, paint and colors are not those of one mesh, or if the paint has no strokes.
pub fn draw(
    (split, spots): (&Split, &Spots),
    paint: &MeshPaint,
    (own, own_at): (&[[f32; 3]], impl Fn(Vec3) -> Vec3),
    camera: &Camera,
) -> RenderedImage {
    let [width, height] = [camera.size.x as usize, camera.size.y as usize];
    let n = width * height;
    let mut picture = RenderedImage {
        size: camera.size,
        color: vec![[0.0; 3]; n],
        alpha: vec![0.0; n],
        depth: vec![0.0; n],
    };
    let strokes = (&*paint.strokes.seeds, &*paint.strokes.textures);
    for numbers in &paint.corners.triangles {
        let corners = numbers.map(|i| paint.corners.corners[i as usize]);
        let vertices = corners.map(|corner| corner.vertex as usize);
        let words = corners.map(|corner| corner.words[corner.corner as usize]);
        let at = vertices.map(|vertex| split.positions[vertex]);
        let view: [Vec3; 3] = at.map(|at| camera.view_from_world.transform_point3(at));
        if view.iter().any(|at| at.z <= camera.near) {
            continue;
        }
        let screen = view.map(|at| camera.focal * at.truncate() / at.z + camera.center);
        let area = (screen[1] - screen[0]).perp_dot(screen[2] - screen[0]);
        // Shares of the corners at a pixel, and its depth.
        let shares = |pixel: Vec2| {
            let [a, b, c] = screen.map(|corner| corner - pixel);
            let flat = Vec3::new(b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)) / area;
            let over_depth = flat / Vec3::new(view[0].z, view[1].z, view[2].z);
            (over_depth / over_depth.element_sum(), over_depth.element_sum().recip())
        };
        let mean = |shares: Vec3, of: [Vec3; 3]| shares.x * of[0] + shares.y * of[1] + shares.z * of[2];
        let low = screen.iter().fold(Vec2::MAX, |low, at| low.min(*at)).max(Vec2::ZERO).as_usizevec2();
        let high = screen.iter().fold(Vec2::MIN, |high, at| high.max(*at)).max(Vec2::ZERO).as_usizevec2();
        let (columns, rows) =
            (low.x..high.x.saturating_add(1).min(width), low.y..high.y.saturating_add(1).min(height));
        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
            let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let (of_corners, z) = shares(pixel);
            let i = y * width + x;
            // Comparisons with NaN, of a triangle without an area, are false.
            let is_nearer = picture.alpha[i] == 0.0 || z < picture.depth[i];
            let is_shown = of_corners.min_element() >= 0.0 && is_nearer;
            if !is_shown {
                continue;
            }
            let here = mean(of_corners, at);
            let steps = [Vec2::X, Vec2::Y].map(|step| mean(shares(pixel + step).0, at) - here);
            let seed = &paint.strokes.seeds[StrokeWord::unpacked(words[0]).seed as usize];
            let knobs = &StrokeKnobs::DEFAULT;
            let detail = detail_at((words, of_corners), here, strokes, knobs, level(seed, steps));
            let of_spot = |vertex: usize| Vec3::from(paint.colors[spots.of_vertex[vertex] as usize]);
            let protection = words.map(|word| Vec3::splat(StrokeWord::unpacked(word).protection));
            let kept = own_at(here) - mean(of_corners, vertices.map(|vertex| Vec3::from(own[vertex])));
            let color =
                mean(of_corners, vertices.map(of_spot)) + mean(of_corners, protection) * kept + detail;
            (picture.color[i], picture.alpha[i], picture.depth[i]) = (color.to_array(), 1.0, z);
        }
    }
    picture
}
