//! Agreement between the views of a stylized scene, as in the paper's Table 1. One view is warped into another,
//! and on surfaces that both see, the two pictures should be equal.
//!
//! The paper warps along optical flow. Here a pixel's mean depth gives its surface, and the surface gives its
//! position in the other view, so warp and visibility depend on the scene and not on its style. The *RMSE* is
//! that of displayed colors. A gray picture has none, so the RMSE is also reported relative to the picture's
//! standard deviation. The *VGG distance* replaces the paper's LPIPS: the squared distance of unit-normalized
//! features from relu1_1 to relu3_1, summed over layers with equal weights for all channels. LPIPS itself has
//! learned weights.

use std::{collections::BTreeSet, fs, path::Path};

use glam::{Affine3A, UVec2, Vec2, Vec3Swizzles};
use serde::{Deserialize, Serialize};
use stylegaussian::{
    Camera, Scene,
    splat::{Colors, RenderedImage, render},
};

use super::judge::Judge;
use crate::{
    cameras::utf8,
    error::{Context, TrainError, ensure},
    nn::{
        coverage::coverage_of_cells,
        loss_network::{FeatureRows, RELU3_1, picture_tensor},
        parameter::to_vec,
    },
};

/// Least coverage at which a pixel's mean depth counts as that of a surface.
const COVERED: f32 = 0.95;

/// Largest relative difference between two depths of the same surface. Bilinear positions on slanted surfaces
/// differ by less, an object's edge and its background by more.
const SAME_SURFACE: f32 = 0.02;

/// Views of the orbit of [`Pairs::of_orbit`], 10 degrees apart.
pub const N_ORBIT: usize = 36;

/// Pairs of cameras by their numbers. The first's view is warped into the second's.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pairs {
    /// Neighboring views.
    short: Vec<[usize; 2]>,
    /// Views some way apart.
    long: Vec<[usize; 2]>,
}

impl Pairs {
    /// Neighbors, and views 40 degrees apart, on an orbit of `N_ORBIT` views.
    ///
    /// # Errors
    /// Never: the list is part of the program, and a test reads it.
    pub fn of_orbit() -> Result<Self, TrainError> {
        serde_json::from_str(include_str!("orbit_pairs.json")).context(|| "orbit_pairs.json")
    }

    /// Reads `{"short": [[0, 1], ...], "long": [[0, 7], ...]}`.
    ///
    /// # Errors
    /// If the file cannot be read, is not of that form, or names a camera that is not among `n_cameras`.
    pub fn read(path: &Path, n_cameras: usize) -> Result<Self, TrainError> {
        let name = || path.display();
        let bytes = fs::read(path).context(|| format!("{}: cannot read it", name()))?;
        let pairs: Self = serde_json::from_slice(&utf8(&bytes)).context(|| {
            format!("{}: expected {{\"short\": [[0, 1], ...], \"long\": [[0, 7], ...]}}", name())
        })?;
        let outside = pairs.short.iter().chain(&pairs.long).flatten().find(|i| **i >= n_cameras);
        ensure!(
            outside.is_none(),
            "{}: found camera {}, expected 0 to {}",
            name(),
            outside.copied().unwrap_or_default(),
            n_cameras.saturating_sub(1)
        );
        Ok(pairs)
    }
}

/// Agreement between views, as means over pairs.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Agreement {
    /// Between neighboring views.
    pub short: Difference,
    /// Between views some way apart.
    pub long: Difference,
}

/// Difference between a view and another that was warped into it. NaN (`null` in JSON) if no two views share a
/// surface.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Difference {
    /// Root of the mean squared difference of displayed colors, 0..1.
    pub rmse: f64,
    /// The same relative to the standard deviation of the view's colors.
    pub rmse_over_std_dev: f64,
    /// Squared distance of unit-normalized features, summed over layers.
    pub vgg_distance: f64,
}

/// Positions in one view of the surfaces that another sees.
struct Warp {
    /// For each pixel of the target view `[H, W]` the position in the source view, in pixels from the center of
    /// the first. `None` if the source view does not see that surface.
    positions: Vec<Option<Vec2>>,
}

/// Pixel indices around a position and their bilinear weights, or `None` at the border and outside.
fn corners(at: Vec2, size: UVec2) -> Option<[(usize, f32); 4]> {
    let corner = at.floor();
    // All four corners must exist: a position on the last line has nothing beyond it.
    let inside = corner.cmpge(Vec2::ZERO).all() && (corner + 1.0).cmplt(size.as_vec2()).all();
    inside.then(|| {
        let (f, width) = (at - corner, size.x as usize);
        let first = corner.y as usize * width + corner.x as usize;
        [
            (first, (1.0 - f.x) * (1.0 - f.y)),
            (first + 1, f.x * (1.0 - f.y)),
            (first + width, (1.0 - f.x) * f.y),
            (first + width + 1, f.x * f.y),
        ]
    })
}

/// The depth of the surface at a pixel, or `None` if the scene does not cover it.
fn surface_depth(view: &RenderedImage, pixel: usize) -> Option<f32> {
    // The rasterizer's depth is summed with the blend weights, as colors are.
    (view.alpha[pixel] > COVERED).then(|| view.depth[pixel] / view.alpha[pixel])
}

impl Warp {
    /// The warp of the view `from` into the view `into`.
    fn new(from: (&Camera, &RenderedImage), into: (&Camera, &RenderedImage)) -> Self {
        let world_from_into: Affine3A = into.0.view_from_world.inverse();
        let from_into = from.0.view_from_world * world_from_into;
        let position = |pixel: usize| {
            let depth = surface_depth(into.1, pixel)?;
            let (x, y) = (pixel % into.1.size.x as usize, pixel / into.1.size.x as usize);
            let ray = (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - into.0.center) / into.0.focal;
            let seen = from_into.transform_point3((ray * depth).extend(depth));
            // Pixel centers are at integer + 0.5; positions here count from the first center.
            let at = from.0.focal * seen.xy() / seen.z + from.0.center - 0.5;
            // Behind the camera the division mirrors the point into the picture.
            let around = corners(at, from.1.size).filter(|_| seen.z > 0.0)?;
            // All four corners, or the bilinear color would mix two surfaces.
            let same = |(pixel, _): &(usize, f32)| {
                surface_depth(from.1, *pixel).is_some_and(|z| (z - seen.z).abs() <= SAME_SURFACE * seen.z)
            };
            around.iter().all(same).then_some(at)
        };
        Self { positions: (0..into.1.alpha.len()).map(position).collect() }
    }

    /// Warps `picture`, of the view `from`, into the view with the picture `into`. Pixels without a position
    /// keep the color of `into`.
    fn apply(&self, picture: &[[f32; 3]], size: UVec2, into: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let pixel = |(position, own): (&Option<Vec2>, &[f32; 3])| {
            let Some(around) = position.and_then(|at| corners(at, size)) else { return *own };
            [0, 1, 2].map(|i| around.iter().map(|(pixel, weight)| weight * picture[*pixel][i]).sum())
        };
        self.positions.iter().zip(into).map(pixel).collect()
    }
}

/// A pair of views, by their indices among those that are used, and the warp between them.
struct Pair {
    from: usize,
    into: usize,
    warp: Warp,
}

/// The views of a scene that are compared, and the warps between them.
pub struct Consistency {
    cameras: Vec<Camera>,
    /// Without view-dependent color, which differs between views for good reason.
    unstyled: Vec<RenderedImage>,
    short: Vec<Pair>,
    long: Vec<Pair>,
}

impl Consistency {
    /// Renders `scene` and finds the warps between the views that `pairs` names. Pairs that share no surface
    /// are left out.
    pub fn new(scene: &Scene, cameras: &[Camera], pairs: &Pairs) -> Self {
        let colors = scene.base_colors();
        // Sorted, so that a number's position can be found by bisection, and each view is rendered once.
        let used: BTreeSet<usize> = pairs.short.iter().chain(&pairs.long).flatten().copied().collect();
        let used: Vec<usize> = used.into_iter().collect();
        let cameras: Vec<Camera> = used.iter().map(|&i| cameras[i].clone()).collect();
        let unstyled: Vec<RenderedImage> =
            cameras.iter().map(|camera| render(scene, Colors::Rgb(&colors), camera)).collect();
        let warped = |list: &[[usize; 2]]| -> Vec<Pair> {
            let pair = |numbers: &[usize; 2]| {
                // The position of a camera's number among those that are used.
                let [from, into] = numbers.map(|number| used.partition_point(|&i| i < number));
                let side = |i: usize| (&cameras[i], &unstyled[i]);
                Pair { from, into, warp: Warp::new(side(from), side(into)) }
            };
            let shares_surface = |pair: &Pair| pair.warp.positions.iter().any(Option::is_some);
            list.iter().map(pair).filter(shares_surface).collect()
        };
        Self { short: warped(&pairs.short), long: warped(&pairs.long), cameras, unstyled }
    }

    /// The views' cameras, by their numbers in the pairs.
    pub fn cameras(&self) -> impl Iterator<Item = &Camera> {
        self.cameras.iter()
    }

    /// The views without style, in the order of [`Consistency::cameras`].
    pub fn unstyled(&self) -> &[RenderedImage] {
        &self.unstyled
    }

    /// Agreement of `views`, in the order of [`Consistency::cameras`].
    ///
    /// # Errors
    /// If the device fails.
    pub fn measure(&self, judge: &Judge, views: &[RenderedImage]) -> Result<Agreement, TrainError> {
        let pictures: Vec<Displayed> = views.iter().map(Displayed::new).collect();
        let of = |pairs: &[Pair]| {
            let differences: Result<Vec<Difference>, TrainError> = pairs
                .iter()
                .map(|pair| difference(judge, pair, &pictures[pair.from], &pictures[pair.into]))
                .collect();
            Ok::<_, TrainError>(Difference::mean(&differences?))
        };
        Ok(Agreement { short: of(&self.short)?, long: of(&self.long)? })
    }
}

impl Agreement {
    /// The mean of several.
    pub fn mean(all: &[Self]) -> Self {
        let part = |of: fn(&Self) -> Difference| Difference::mean(&all.iter().map(of).collect::<Vec<_>>());
        Self { short: part(|a| a.short), long: part(|a| a.long) }
    }
}

impl Difference {
    /// The mean of several, or NaN if there are none, because 0 would mean perfect agreement.
    fn mean(all: &[Self]) -> Self {
        // 0 / 0 is NaN.
        let n = all.len() as f64;
        let mean = |part: fn(&Self) -> f64| all.iter().map(part).sum::<f64>() / n;
        Self {
            rmse: mean(|d| d.rmse),
            rmse_over_std_dev: mean(|d| d.rmse_over_std_dev),
            vgg_distance: mean(|d| d.vgg_distance),
        }
    }
}

/// A view as a display shows it.
struct Displayed {
    size: UVec2,
    rgb: Vec<[f32; 3]>,
}

impl Displayed {
    fn new(view: &RenderedImage) -> Self {
        let pixels = view.color.iter().zip(&view.alpha);
        let rgb = pixels.map(|(color, a)| color.map(|c| (c + (1.0 - a) * 0.5).clamp(0.0, 1.0))).collect();
        Self { size: view.size, rgb }
    }
}

fn difference(
    judge: &Judge,
    pair: &Pair,
    from: &Displayed,
    into: &Displayed,
) -> Result<Difference, TrainError> {
    let warped = pair.warp.apply(&from.rgb, from.size, &into.rgb);
    let visible: Vec<bool> = pair.warp.positions.iter().map(Option::is_some).collect();
    let rmse = root_mean_square(&warped, &into.rgb, &visible);
    let mean = mean_color(&into.rgb, &visible);
    // The deviation from one mean color is the distance from a picture of that color.
    let std_dev = root_mean_square(&into.rgb, &vec![mean; into.rgb.len()], &visible);
    let features = |rgb: &[[f32; 3]], size: UVec2| {
        let picture = picture_tensor(rgb.as_flattened(), judge.network.device());
        judge.network.features_to_relu3_1(picture, [size.x as usize, size.y as usize])
    };
    let share: Vec<f32> = visible.iter().map(|visible| f32::from(u8::from(*visible))).collect();
    let layers = features(&warped, into.size).into_iter().zip(features(&into.rgb, into.size));
    let distance = |(a, b): (FeatureRows, FeatureRows)| {
        let cells = coverage_of_cells(&share, [into.size.x as usize, into.size.y as usize], a.size);
        Ok::<_, TrainError>(feature_distance(&to_vec(&a.rows)?, &to_vec(&b.rows)?, &cells))
    };
    Ok(Difference {
        rmse,
        // A gray picture compared with itself gives 0 and not NaN.
        rmse_over_std_dev: rmse / std_dev.max(f64::MIN_POSITIVE),
        vgg_distance: layers.take(RELU3_1 + 1).map(distance).sum::<Result<f64, TrainError>>()?,
    })
}

fn mean_color(rgb: &[[f32; 3]], visible: &[bool]) -> [f32; 3] {
    let n = visible.iter().filter(|visible| **visible).count().max(1) as f64;
    let seen = || rgb.iter().zip(visible).filter(|(_, visible)| **visible);
    [0, 1, 2].map(|i| (seen().map(|(color, _)| f64::from(color[i])).sum::<f64>() / n) as f32)
}

fn root_mean_square(a: &[[f32; 3]], b: &[[f32; 3]], visible: &[bool]) -> f64 {
    let n = 3 * visible.iter().filter(|visible| **visible).count().max(1);
    let seen = a.iter().zip(b).zip(visible).filter(|(_, visible)| **visible);
    let square = |((a, b), _): ((&[f32; 3], &[f32; 3]), &bool)| -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
    };
    (seen.map(square).sum::<f64>() / n as f64).sqrt()
}

/// Mean squared distance of rows `[cells, D]` after scaling to unit length, weighted by the cells' shares.
fn feature_distance(a: &[f32], b: &[f32], cells: &[f32]) -> f64 {
    let n_channels = (a.len() / cells.len().max(1)).max(1);
    let length = |row: &[f32]| row.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt().max(1e-10);
    let rows = a.chunks_exact(n_channels).zip(b.chunks_exact(n_channels));
    let distance = |(a, b): (&[f32], &[f32])| -> f64 {
        let (la, lb) = (length(a), length(b));
        a.iter().zip(b).map(|(a, b)| (f64::from(*a) / la - f64::from(*b) / lb).powi(2)).sum()
    };
    let total: f64 = cells.iter().map(|share| f64::from(*share)).sum();
    rows.zip(cells).map(|(rows, share)| f64::from(*share) * distance(rows)).sum::<f64>()
        / total.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn the_list_of_the_orbit_fits_it() {
        let pairs = Pairs::of_orbit().unwrap();
        assert_eq!((pairs.short.len(), pairs.long.len()), (12, 12));
        assert!(pairs.short.iter().chain(&pairs.long).flatten().all(|i| *i < N_ORBIT));
        assert!(pairs.short.iter().all(|[a, b]| (b + N_ORBIT - a) % N_ORBIT == 1));
        assert!(pairs.long.iter().all(|[a, b]| (b + N_ORBIT - a) % N_ORBIT == 4));
    }

    /// A wall at z = 4 whose color is its x coordinate, seen by a camera at `x`.
    fn wall(x: f32) -> (Camera, RenderedImage) {
        let size = UVec2::new(16, 8);
        let camera = Camera {
            view_from_world: Affine3A::from_translation(Vec3::new(-x, 0.0, 0.0)),
            focal: Vec2::splat(8.0),
            center: size.as_vec2() / 2.0,
            size,
            near: Camera::NEAR,
        };
        let n = (size.x * size.y) as usize;
        let world_x = |i: usize| (i as f32 % 16.0 + 0.5 - 8.0) / 8.0 * 4.0 + x;
        let color = (0..n).map(|i| [world_x(i) / 20.0 + 0.5, 0.5, 0.0]).collect();
        (camera, RenderedImage { size, color, alpha: vec![1.0; n], depth: vec![4.0; n] })
    }

    /// A step of 0.8 to the right moves the wall by 8 * 0.8 / 4 = 1.6 pixels; colors that belong to the wall
    /// agree.
    #[test]
    fn what_belongs_to_a_surface_agrees_wherever_it_is_seen_from() {
        let (left, right) = (wall(0.0), wall(0.8));
        let warp = Warp::new((&left.0, &left.1), (&right.0, &right.1));
        let at = warp.positions[3 * 16 + 4].unwrap();
        assert!((at - Vec2::new(5.6, 3.0)).length() < 1e-5, "{at}");
        assert_eq!(warp.positions[3 * 16 + 15], None, "out of the other's sight");
        let warped = warp.apply(&left.1.color, left.1.size, &right.1.color);
        let visible: Vec<bool> = warp.positions.iter().map(Option::is_some).collect();
        assert!(visible.iter().filter(|v| **v).count() > 80);
        assert!(root_mean_square(&warped, &right.1.color, &visible) < 1e-6);
        // Colors that belong to the picture instead of the surface do not.
        let warped = warp.apply(&right.1.color, left.1.size, &right.1.color);
        let rmse = root_mean_square(&warped, &right.1.color, &visible);
        assert!((rmse - (0.8 / 20.0) / 3.0_f64.sqrt()).abs() < 1e-4, "{rmse}");
    }

    #[test]
    fn what_is_hidden_in_the_other_view_is_left_out() {
        let (mut left, right) = (wall(0.0), wall(0.8));
        left.1.depth.fill(2.0);
        let warp = Warp::new((&left.0, &left.1), (&right.0, &right.1));
        assert!(warp.positions.iter().all(Option::is_none), "something nearer is in the way");
        left.1.depth.fill(4.0);
        left.1.alpha.fill(0.5);
        let warp = Warp::new((&left.0, &left.1), (&right.0, &right.1));
        assert!(warp.positions.iter().all(Option::is_none), "no surface");
    }

    #[test]
    fn features_are_compared_by_direction() {
        let (a, b) = ([3.0, 4.0, 1.0, 0.0], [6.0, 8.0, 0.0, 5.0]);
        assert!((feature_distance(&a, &b, &[1.0, 1.0]) - 1.0).abs() < 1e-12, "(0 + 2) / 2");
        assert!(feature_distance(&a, &b, &[1.0, 0.0]).abs() < 1e-12);
    }
}
