//! The cut through a world's levels of detail: the level that each of its nodes is shown at, under a budget.
//!
//! A *node* is a part of space with Gaussians at several levels. A surface that fills a node of size s with n
//! Gaussians has them s / sqrt(n) apart. That distance in pixels is the node's *error* at a level. All nodes
//! begin with the fewest Gaussians that they have. Then the node with the largest error takes its next finer
//! level, again and again, until the budget is spent or no error is above half a pixel.

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::{Affine3A, Mat4, Vec3, Vec4};

use crate::camera::Camera;

/// Error under which no finer level is taken, in pixels: Gaussians half a pixel apart are finer than what
/// pixels show.
const LEAST_ERROR: f32 = 0.5;

/// Factor of the error of a step that was taken in the cut before. A level changes only if another node needs
/// the Gaussians clearly more, so none goes back and forth while a camera trembles.
const STAY: f32 = 1.25;

/// The view of a camera.
#[derive(Clone, Copy, Debug)]
pub struct CutView {
    eye: Vec3,
    /// The frustum's planes, which face inward: normal and offset, of any length.
    planes: [Vec4; 6],
    /// Pixels of a unit at distance 1, or at any distance if rays are parallel.
    pixels: f32,
    is_parallel: bool,
}

impl CutView {
    /// A camera's view. `world_from_view` is its place, and `clip_from_view` its projection, whose depth may
    /// run either way. The picture is `height` pixels high.
    pub fn new(world_from_view: Affine3A, clip_from_view: Mat4, height: f32) -> Self {
        let clip_from_world = clip_from_view * Mat4::from(world_from_view.inverse());
        let [x, y, z, w] = [0, 1, 2, 3].map(|i| clip_from_world.row(i));
        Self {
            eye: world_from_view.translation.into(),
            planes: [w + x, w - x, w + y, w - y, z, w - z],
            pixels: 0.5 * height * clip_from_view.y_axis.y.abs(),
            is_parallel: clip_from_view.w_axis.w == 1.0,
        }
    }

    /// The view of a pinhole camera.
    pub fn of_camera(camera: &Camera) -> Self {
        let size = camera.size.as_vec2();
        let (scale, shift) = (2.0 * camera.focal / size, 2.0 * camera.center / size - 1.0);
        // The depth runs from 1 at the near plane to 0. The picture is upside down, as its frustum may be.
        let clip_from_view = Mat4::from_cols(
            Vec4::new(scale.x, 0.0, 0.0, 0.0),
            Vec4::new(0.0, scale.y, 0.0, 0.0),
            Vec4::new(shift.x, shift.y, 0.0, 1.0),
            Vec4::new(0.0, 0.0, camera.near, 0.0),
        );
        Self::new(camera.view_from_world.inverse(), clip_from_view, size.y)
    }

    /// The same view, in which all errors have this factor, 0..1: of one that is expected and not there yet.
    #[must_use]
    pub fn weighted(self, factor: f32) -> Self {
        Self { pixels: factor * self.pixels, ..self }
    }

    /// Pixels along the diagonal of a box in the world, where it is nearest: 0 outside of the frustum.
    pub fn pixels(&self, [min, max]: [Vec3; 2]) -> f32 {
        let (center, half) = (0.5 * (min + max), 0.5 * (max - min));
        // The corner that is farthest along the normal.
        let is_before = |plane: &Vec4| {
            let normal = plane.truncate();
            normal.dot(center) + normal.abs().dot(half) + plane.w >= 0.0
        };
        if !self.planes.iter().all(is_before) {
            return 0.0;
        }
        let distance = if self.is_parallel { 1.0 } else { self.eye.max(min).min(max).distance(self.eye) };
        let pixels = self.pixels * (max - min).length() / distance;
        // A camera inside of the box is at no distance.
        if pixels.is_nan() { 0.0 } else { pixels.min(f32::MAX) }
    }
}

/// A node as a cut sees it.
#[derive(Clone, Copy, Debug)]
pub struct CutNode<'a> {
    /// The smallest and the largest corner of its box in the world.
    pub bounds: [Vec3; 2],
    /// Gaussians at each level, the finest first; 0 if it has none of its own there.
    pub counts: &'a [usize],
    /// The views that may see it.
    pub views: &'a [CutView],
    /// Pixels that it covers at least, whatever the views say: of a node that was seen a moment ago.
    pub least_pixels: f32,
}

/// The levels that are chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cut {
    /// The level of each node, or `None` if it has no Gaussians, or if even the fewest of all nodes exceed the
    /// budget.
    pub levels: Vec<Option<usize>>,
    /// Pixels along the diagonal of each node in the view that is nearest to it, and no less than its least
    /// pixels.
    pub pixels: Vec<f32>,
    /// Whether any view sees each node.
    pub is_seen: Vec<bool>,
    /// Gaussians of all levels that are chosen.
    pub n_gaussians: usize,
}

/// The distance of a node's Gaussians in pixels, if it covers so many pixels with so many Gaussians.
pub fn error(pixels: f32, count: usize) -> f32 {
    pixels / (count.max(1) as f32).sqrt()
}

/// Chooses a level for each node, `budget` Gaussians of all of them at most. `before` is the last cut's choice,
/// which stays where views hardly change; it may be shorter.
///
/// Nodes that no view sees have their fewest Gaussians. If those of all nodes exceed the budget, nodes of
/// little error have none. Of nodes with equal boxes and counts, a nearer one has no coarser level. The same
/// input gives the same cut, and a cut from itself is itself.
pub fn cut(nodes: &[CutNode], budget: usize, before: &[Option<usize>]) -> Cut {
    let (pixels, is_seen): (Vec<f32>, Vec<bool>) = nodes.iter().map(pixels_of).unzip();
    let had = |node: usize, level: usize| before.get(node).copied().flatten().is_some_and(|had| had <= level);
    let need = |node: usize, count: usize, next: usize| {
        error(pixels[node], count) * if had(node, next) { STAY } else { 1.0 }
    };
    let fewest: Vec<Option<usize>> = nodes.iter().map(|node| fewest(node.counts)).collect();
    let count = |node: usize, level: usize| nodes[node].counts[level];
    let mut levels = vec![None; nodes.len()];
    let mut total = 0;
    // Errors are not negative, and the bits of such floats sort as they do.
    let mut first: Vec<(Reverse<u32>, usize, usize)> = fewest
        .iter()
        .enumerate()
        .filter_map(|(node, level)| {
            let level = (*level)?;
            Some((Reverse(need(node, count(node, level), level).to_bits()), node, level))
        })
        .collect();
    first.sort_unstable();
    let mut steps = BinaryHeap::new();
    for (_, node, level) in first {
        let Some(next) = fits(total, 0, count(node, level), budget) else { continue };
        (levels[node], total) = (Some(level), next);
        let finer = finer(nodes[node].counts, level);
        steps.extend(finer.map(|finer| step(need(node, count(node, level), finer), node, finer)));
    }
    while let Some((need_bits, Reverse(node), level)) = steps.pop() {
        if f32::from_bits(need_bits) <= LEAST_ERROR {
            break;
        }
        let present = levels[node].map_or(0, |level| count(node, level));
        let Some(next) = fits(total, present, count(node, level), budget) else { continue };
        (levels[node], total) = (Some(level), next);
        let finer = finer(nodes[node].counts, level);
        steps.extend(finer.map(|finer| step(need(node, count(node, level), finer), node, finer)));
    }
    Cut { levels, pixels, is_seen, n_gaussians: total }
}

/// A step to a finer level: those of larger errors come first, then those of nodes before others.
fn step(need: f32, node: usize, level: usize) -> (u32, Reverse<usize>, usize) {
    (need.to_bits(), Reverse(node), level)
}

/// Gaussians once a run takes the place of another, or `None` if they exceed the budget.
fn fits(total: usize, without: usize, with: usize, budget: usize) -> Option<usize> {
    (total - without).checked_add(with).filter(|next| *next <= budget)
}

/// Pixels along a node's diagonal in the view that is nearest to it, and whether any view sees it.
fn pixels_of(node: &CutNode) -> (f32, bool) {
    let least = if node.least_pixels > 0.0 { node.least_pixels.min(f32::MAX) } else { 0.0 };
    let seen = node.views.iter().map(|view| view.pixels(node.bounds)).fold(0.0, f32::max);
    (least.max(seen), seen > 0.0)
}

/// The level of the fewest Gaussians, the finest of several, or `None` if there are none at any.
pub fn fewest(counts: &[usize]) -> Option<usize> {
    (0..counts.len()).filter(|&level| counts[level] > 0).min_by_key(|&level| counts[level])
}

/// The next finer level that has more Gaussians.
fn finer(counts: &[usize], level: usize) -> Option<usize> {
    (0..level).rev().find(|&finer| counts[finer] > counts[level])
}

#[cfg(test)]
mod tests {
    use glam::{Quat, UVec2, Vec2};

    use super::*;
    use crate::random::Random;

    /// A camera at a place that looks along -z, 90 degrees wide and high, 1000 pixels high.
    fn view(at: Vec3) -> CutView {
        let projection = Mat4::perspective_infinite_reverse_rh(std::f32::consts::FRAC_PI_2, 1.0, 0.1);
        CutView::new(Affine3A::from_translation(at), projection, 1000.0)
    }

    /// Cells of a unit's size in a row along -z, from the origin on.
    fn row<'a>(n: usize, counts: &'a [usize], views: &'a [CutView]) -> Vec<CutNode<'a>> {
        let bounds = |i: usize| {
            let z = -(i as f32);
            [Vec3::new(-0.5, -0.5, z - 1.0), Vec3::new(0.5, 0.5, z)]
        };
        (0..n).map(|i| CutNode { bounds: bounds(i), counts, views, least_pixels: 0.0 }).collect()
    }

    const COUNTS: [usize; 4] = [8000, 1000, 100, 10];

    #[test]
    fn pixels_are_those_of_the_nearest_face() {
        let view = view(Vec3::new(0.0, 0.0, 3.0));
        let bounds = [Vec3::new(-0.5, -0.5, -1.0), Vec3::new(0.5, 0.5, 0.0)];
        // 500 pixels to a unit at distance 1, and a diagonal of sqrt(3) at distance 3.
        assert!((view.pixels(bounds) - 500.0 * 3.0_f32.sqrt() / 3.0).abs() < 1e-2);
        assert_eq!(view.weighted(0.5).pixels(bounds), 0.5 * view.pixels(bounds));
        let moved = |by: Vec3| bounds.map(|corner| corner + by);
        assert_eq!(view.pixels(moved(Vec3::new(0.0, 0.0, 5.0))), 0.0, "behind");
        assert_eq!(view.pixels(moved(Vec3::new(6.0, 0.0, 0.0))), 0.0, "beside");
        assert!(view.pixels(moved(Vec3::new(3.9, 0.0, 0.0))) > 0.0, "its edge is within 45 degrees");
        assert_eq!(view.pixels([Vec3::splat(-9.0), Vec3::splat(9.0)]), f32::MAX, "around the camera");
        assert_eq!(view.pixels([Vec3::NAN, Vec3::ONE]), 0.0);
    }

    #[test]
    fn a_pinhole_camera_sees_what_its_projection_does() {
        let eye = Vec3::new(1.0, 2.0, 9.0);
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 1.2, UVec2::new(200, 100));
        let place = Affine3A::from_mat4(Mat4::look_at_rh(eye, Vec3::ZERO, Vec3::Y)).inverse();
        let projection = Mat4::perspective_infinite_reverse_rh(1.2, 2.0, camera.near);
        let (found, expected) = (CutView::of_camera(&camera), CutView::new(place, projection, 100.0));
        let mut n_seen = 0;
        for i in 0..500 {
            let [x, y, z] = [i % 10, i / 10 % 10, i / 100].map(|i| 3.1 * i as f32 - 14.3);
            let bounds = [Vec3::new(x, y, z), Vec3::new(x + 0.7, y + 0.9, z + 1.1)];
            let (found, expected) = (found.pixels(bounds), expected.pixels(bounds));
            assert!((found - expected).abs() <= 1e-3 * expected, "{bounds:?}: {found} {expected}");
            n_seen += usize::from(found > 0.0);
        }
        assert!(n_seen > 10 && n_seen < 500, "{n_seen}");
        // Rays that are off the picture's middle see more on one side.
        let aside = CutView::of_camera(&Camera { center: Vec2::new(0.0, 50.0), ..camera });
        let right = [Vec3::new(9.0, -0.5, -1.0), Vec3::new(9.5, 0.5, 0.0)];
        assert!(
            aside.pixels(right) > 0.0 && aside.pixels(right.map(|at| at * Vec3::new(-1.0, 1.0, 1.0))) == 0.0
        );
    }

    #[test]
    fn parallel_rays_see_all_distances_alike_and_depth_may_run_either_way() {
        for (near, far) in [(0.0, 100.0), (100.0, 0.0)] {
            let projection = Mat4::orthographic_rh(-2.0, 2.0, -2.0, 2.0, near, far);
            let view = CutView::new(Affine3A::IDENTITY, projection, 400.0);
            let at = |z: f32| view.pixels([Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z)]);
            assert_eq!((at(-5.0), at(-50.0), at(5.0)), (100.0, 100.0, 0.0), "{near} {far}");
        }
        let turned = Affine3A::from_rotation_translation(Quat::from_rotation_y(1.0), Vec3::X);
        for projection in
            [Mat4::perspective_rh(1.0, 1.0, 0.1, 100.0), Mat4::perspective_infinite_reverse_rh(1.0, 1.0, 0.1)]
        {
            let view = CutView::new(turned, projection, 400.0);
            let ahead = turned.transform_point3(Vec3::new(0.0, 0.0, -4.0));
            let behind = turned.transform_point3(Vec3::new(0.0, 0.0, 4.0));
            let of = |at: Vec3| view.pixels([at - 0.1, at + 0.1]);
            assert!(of(ahead) > 0.0 && of(behind) == 0.0);
        }
    }

    /// Also the first camera, which is beside the row, and the last, which sees nothing.
    #[test]
    fn a_nearer_cell_is_never_coarser_and_no_budget_is_exceeded() {
        for at in [Vec3::new(3.0, 0.0, 5.0), Vec3::new(0.0, 0.0, 0.5), Vec3::new(0.0, 0.0, -90.0)] {
            let views = [view(at)];
            let nodes = row(40, &COUNTS, &views);
            for budget in [0, 9, 10, 405, 1000, 12_345, 100_000, usize::MAX] {
                let found = cut(&nodes, budget, &[]);
                let count = |level: &Option<usize>| level.map_or(0, |level| COUNTS[level]);
                assert_eq!(found.n_gaussians, found.levels.iter().map(count).sum::<usize>());
                assert!(found.n_gaussians <= budget);
                assert!(
                    found.pixels.iter().zip(&found.is_seen).all(|(pixels, seen)| (*pixels > 0.0) == *seen)
                );
                let mut seen: Vec<usize> = (0..40).filter(|&i| found.pixels[i] > 0.0).collect();
                seen.sort_by(|a, b| found.pixels[*b].total_cmp(&found.pixels[*a]));
                let level = |i: &usize| found.levels[*i].unwrap_or(usize::MAX);
                assert!(seen.iter().map(level).is_sorted(), "{budget}: {found:?}");
                let unseen = (0..40).filter(|i| found.pixels[*i] == 0.0);
                assert!(unseen.map(|i| found.levels[i]).all(|level| level.is_none_or(|level| level == 3)));
            }
        }
    }

    #[test]
    fn refining_ends_at_half_a_pixel_and_begins_nearest_first() {
        let views = [view(Vec3::new(0.0, 0.0, 2.0))];
        let nodes = row(3, &COUNTS, &views);
        // 433, 289 and 217 pixels. At 10 Gaussians, the errors are 137, 91 and 68 pixels.
        assert_eq!(cut(&nodes, 129, &[]).levels, [Some(2), Some(3), Some(3)]);
        // At 100 they are 43, 29 and 22, so all come to 100 before one comes to 1000.
        assert_eq!(cut(&nodes, 300, &[]).levels, [Some(2); 3]);
        assert_eq!(cut(&nodes, 1200, &[]).levels, [Some(1), Some(2), Some(2)]);
        // At 1000 they are still 14, 9 and 7.
        assert_eq!(cut(&nodes, usize::MAX, &[]).levels, [Some(0); 3]);
        let far = [view(Vec3::new(0.0, 0.0, 200.0))];
        // 4.3 pixels: an error of 1.4 at 10 Gaussians, and 0.4 at 100.
        assert_eq!(cut(&row(3, &COUNTS, &far), usize::MAX, &[]).levels, [Some(2); 3]);
    }

    /// Levels change back later than they came, and not while a camera stands still.
    #[test]
    fn levels_stay_while_a_camera_trembles() {
        let of = |z: f32, before: &[Option<usize>]| {
            let views = [view(Vec3::new(0.0, 0.0, z))];
            cut(&row(1, &COUNTS[2..], &views), usize::MAX, before).levels
        };
        // 866 / z pixels, and an error of half a pixel at 866 / (0.5 sqrt(10)) = 548.
        assert_eq!((of(546.0, &[]), of(550.0, &[])), (vec![Some(0)], vec![Some(1)]));
        assert_eq!(of(550.0, &[Some(0)]), [Some(0)]);
        assert_eq!(of(550.0, &[Some(1)]), [Some(1)]);
        assert_eq!(of(690.0, &[Some(0)]), [Some(1)], "more than a quarter farther");
    }

    /// Boxes, counts and budgets of any kind, such as more Gaussians at a coarser level.
    #[test]
    fn a_cut_from_itself_is_itself() {
        let mut random = Random::new(7);
        for round in 0..30 {
            let views = [view(Vec3::new(0.0, 0.0, 8.0)), view(Vec3::new(4.0, 1.0, 20.0)).weighted(0.5)];
            let n_levels = 1 + round % 5;
            let mut next = |end: usize| random.below(end) as f32;
            let counts: Vec<Vec<usize>> =
                (0..60).map(|_| (0..n_levels).map(|_| next(900) as usize).collect()).collect();
            let nodes: Vec<CutNode> = counts
                .iter()
                .map(|counts| {
                    let min = Vec3::new(next(20) - 10.0, next(20) - 10.0, next(20) - 10.0);
                    let bounds = [min, min + Vec3::new(next(5), next(5), next(5))];
                    CutNode { bounds, counts, views: &views, least_pixels: 0.0 }
                })
                .collect();
            let budget = next(40_000) as usize;
            let first = cut(&nodes, budget, &[]);
            assert!(first.n_gaussians <= budget);
            assert_eq!(cut(&nodes, budget, &first.levels), first, "{round}");
            assert_eq!(cut(&nodes, budget, &[]), first, "the same twice");
        }
    }

    #[test]
    fn hostile_nodes_are_shown_as_far_as_they_can_be() {
        let views = [view(Vec3::ZERO), CutView::new(Affine3A::IDENTITY, Mat4::NAN, f32::NAN)];
        let bounds = [[Vec3::NAN; 2], [Vec3::MAX, Vec3::MIN], [Vec3::MIN, Vec3::MAX], [Vec3::INFINITY; 2]];
        let counts: [&[usize]; 4] = [&[usize::MAX, usize::MAX - 1], &[0, 0], &[], &[5]];
        let nodes: Vec<CutNode> = bounds
            .iter()
            .flat_map(|&bounds| {
                let views = &views[..];
                counts.map(|counts| CutNode { bounds, counts, views, least_pixels: f32::NAN })
            })
            .collect();
        let all = cut(&nodes, usize::MAX, &[Some(usize::MAX); 99]);
        assert!(all.pixels.iter().all(|pixels| pixels.is_finite() && *pixels >= 0.0));
        assert!(nodes.iter().zip(&all.levels).all(|(node, level)| match level {
            Some(level) => node.counts[*level] > 0,
            None => true,
        }));
        assert_eq!(cut(&nodes, 4, &[]).levels, [None; 16]);
        assert_eq!(cut(&nodes, 20, &[]).n_gaussians, 20);
        assert_eq!(cut(&[], 20, &[]), Cut::default());
        // A node that was seen a moment ago has the level of one that is seen.
        let remembered = CutNode { bounds: bounds[0], counts: &COUNTS, views: &[], least_pixels: 1e3 };
        let found = cut(&[remembered], 8000, &[]);
        assert_eq!((found.levels, found.pixels, found.is_seen), (vec![Some(0)], vec![1e3], vec![false]));
    }
}
