//! Candidate cameras.

use std::f32::consts::TAU;

use crate::{
    Camera,
    bulk::{LARGER, quantiles},
};
use glam::{UVec2, Vec3};

use super::{
    eye::Eye,
    survey::{Framed, Survey},
};

/// Half the angle of an object's overview, in radians: a normal lens with little perspective distortion.
const OBJECT_HALF_ANGLE: f32 = 0.42;
/// The share of the mass that an overview frames, and the factor of room around it.
const FRAMED: f32 = 0.97;
const MARGIN: f32 = 1.1;
/// Least factor of that angle's tangent: Gaussians that overlap in one point are seen whole at a normal lens.
const LEAST_LENS: f32 = 0.1;
/// Factor by which a closer look is closer than an overview.
const CLOSER: f32 = 2.2;
/// Elevations of the rings around an object, in radians over the horizon, and their numbers of cameras.
const RINGS: [(f32, usize); 4] = [(-0.25, 8), (0.12, 16), (0.5, 12), (0.95, 8)];
/// Number of spots on an object at which closer looks aim.
const N_TARGETS: usize = 24;

/// Number of closer looks at each spot, from the nearest overviews.
const N_EYES: usize = 6;
/// Elevation of the circle for showing an object, in radians over the horizon.
const ORBIT_ELEVATION: f32 = 0.3;
/// Factor of the circle's lens over the widest of its overviews. These frame 97% of the mass, and a person's
/// head is less than the rest. Things that end in large Gaussians may still touch the edge.
const ORBIT_ROOM: f32 = 1.12;

/// Half the angle of a view within a place, in radians: wide, as captures of rooms are.
const PLACE_HALF_ANGLE: f32 = 0.65;
/// Half the angle of a closer look within a place, in radians.
const PLACE_CLOSER_HALF_ANGLE: f32 = 0.35;
/// Number of headings at each spot of a place.
const N_HEADINGS: usize = 8;
/// Elevations of views within a place, in radians over the horizon.
const PITCHES: [f32; 2] = [-0.35, 0.1];
/// Elevation of the turn for showing a place, in radians over the horizon.
const TURN_PITCH: f32 = -0.1;
/// Number of spots to stand on within a place.
const N_SPOTS: usize = 10;
/// Standing room around a spot, and the distance below which things are in the way there, in radii of the
/// scene. Floor and ceiling of a room leave as much in its middle. The gaps within a half-transparent thing are
/// smaller, or it would count as a place.
const STANDING_ROOM: f32 = 0.15;

/// Distance of the spots around that of a capture, and of what is in the way there, in distances of what is
/// near.
const BESIDE: f32 = 0.3;
const IN_THE_WAY: f32 = 0.25;

/// View-space z up to which nothing is drawn, in distances of what is seen: a third of the standing room, so
/// that nothing beyond that is cut in the corners of wide pictures either. Every length here is a share of the
/// scene's own, or a scene in other units would be seen from elsewhere.
const NEAR: f32 = 0.05;

/// A camera without a picture size.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    eye: Vec3,
    target: Vec3,
    up: Vec3,
    /// Tangent of the angle between the axis and the nearer pair of the picture's edges.
    tan_half: f32,
    /// Whether it shows the whole scene. Otherwise it is a closer look at a part.
    pub is_overview: bool,
    /// Distance below which things are in the way, in scene units.
    pub clearance: f32,
    /// View-space z up to which nothing is drawn, in scene units.
    near: f32,
}

impl Candidate {
    /// The camera with a picture of `size` pixels.
    pub fn camera(&self, size: UVec2) -> Camera {
        // `tan_half` belongs to the shorter side, and a longer one sees more at the same focal length.
        let fov_y = 2.0 * (self.tan_half * size.y as f32 / size.min_element() as f32).atan();
        Camera { near: self.near, ..Camera::look_at(self.eye, self.target, self.up, fov_y, size) }
    }
}

/// A unit vector at an azimuth and an elevation, in radians.
fn direction(up: Vec3, azimuth: f32, elevation: f32) -> Vec3 {
    let (x, z) = up.any_orthonormal_pair();
    elevation.cos() * (azimuth.cos() * x + azimuth.sin() * z) + elevation.sin() * up
}

/// An overview from `direction`, a unit vector. Its lens just frames the scene, or all of the ball that the
/// scene tells.
fn overview_from(survey: &Survey, direction: Vec3) -> Candidate {
    // At this distance the ball of the scene touches the sides of the cone of view.
    let distance = survey.radius / OBJECT_HALF_ANGLE.sin();
    // Surroundings that are left out do not hide what is framed.
    let before = match survey.framed {
        Framed::Dense(_) => distance - LARGER * survey.radius,
        Framed::All | Framed::Told => 0.0,
    };
    let candidate = Candidate {
        eye: survey.center + distance * direction,
        target: survey.center,
        up: survey.up,
        tan_half: OBJECT_HALF_ANGLE.tan(),
        is_overview: true,
        // No object is so near. Such Gaussians float between it and the camera.
        clearance: 0.25 * distance,
        near: before.max(NEAR * distance),
    };
    match survey.framed {
        Framed::Told => candidate,
        _ => Candidate { tan_half: framing(&candidate, survey), ..candidate },
    }
}

/// The tangent of the half angle at which `candidate` sees nearly all of the scene.
fn framing(candidate: &Candidate, survey: &Survey) -> f32 {
    let view_from_world = candidate.camera(UVec2::ONE).view_from_world;
    let tangents = survey.stand_in.means.iter().map(|&mean| {
        let view = view_from_world.transform_point3(mean);
        view.x.abs().max(view.y.abs()) / view.z.max(NEAR * survey.radius)
    });
    let [tangent] = quantiles(tangents, &survey.masses, [FRAMED]);
    // Never wider than the normal lens, and never a field of view of 0, as of a single Gaussian.
    (MARGIN * tangent).clamp(LEAST_LENS * candidate.tan_half, candidate.tan_half)
}

/// Overviews of the scene from rings around it.
pub(super) fn around(survey: &Survey) -> Vec<Candidate> {
    RINGS
        .iter()
        .enumerate()
        .flat_map(|(ring, &(elevation, n))| {
            // Every second ring is turned by half a step, so that not all rings begin at one azimuth.
            (0..n).map(move |i| (TAU * (i as f32 + 0.5 * (ring % 2) as f32) / n as f32, elevation))
        })
        .map(|(azimuth, elevation)| overview_from(survey, direction(survey.up, azimuth, elevation)))
        .collect()
}

/// Closer looks at an object: from the eyes of its `overviews` at spots on its surface.
///
/// They use longer lenses instead of shorter distances, so that an eye outside the object stays in the open.
pub(super) fn closer_looks_around(survey: &Survey, overviews: &[Candidate]) -> Vec<Candidate> {
    let targets = spread(&survey.stand_in.means, N_TARGETS, |i| {
        survey.masses[i] > 0.0 && (survey.stand_in.means[i] - survey.center).length() < survey.radius
    });
    let looks_at = |target: Vec3| {
        let mut eyes: Vec<&Candidate> = overviews.iter().collect();
        eyes.sort_by(|a, b| a.eye.distance_squared(target).total_cmp(&b.eye.distance_squared(target)));
        eyes.into_iter().take(N_EYES).map(move |&overview| Candidate {
            // Spots lie on the rim. There is more to see a little further in.
            target: survey.center + 0.8 * (target - survey.center),
            tan_half: overview.tan_half / CLOSER,
            is_overview: false,
            ..overview
        })
    };
    targets.into_iter().flat_map(looks_at).collect()
}

/// Overviews of a place: from free spots inside the scene, in all directions.
pub(super) fn within(survey: &Survey) -> Vec<Candidate> {
    let clearance = STANDING_ROOM * survey.radius;
    looking_around(survey, &spots(survey), clearance, NEAR * survey.radius)
}

/// Overviews from the spot of a capture, and from some around it.
pub(super) fn from_eye(survey: &Survey, Eye { at, room }: Eye) -> Vec<Candidate> {
    let (x, z) = survey.up.any_orthonormal_pair();
    let beside = [Vec3::ZERO, x, z, -x, -z].map(|side| at + BESIDE * room * side);
    // All that is near is part of the place.
    looking_around(survey, &beside, IN_THE_WAY * room, NEAR * room)
}

/// Views of all directions from each of these spots.
fn looking_around(survey: &Survey, eyes: &[Vec3], clearance: f32, near: f32) -> Vec<Candidate> {
    let headings = (0..N_HEADINGS).map(|i| TAU * i as f32 / N_HEADINGS as f32);
    let directions: Vec<Vec3> = headings
        .flat_map(|azimuth| PITCHES.map(|elevation| direction(survey.up, azimuth, elevation)))
        .collect();
    let from = |eye: Vec3| {
        directions.iter().map(move |&direction| Candidate {
            eye,
            target: eye + direction,
            up: survey.up,
            tan_half: PLACE_HALF_ANGLE.tan(),
            is_overview: true,
            clearance,
            near,
        })
    };
    eyes.iter().copied().flat_map(from).collect()
}

/// Closer looks within a place: its `overviews` through a longer lens.
pub(super) fn closer_looks_within(overviews: &[Candidate]) -> Vec<Candidate> {
    let tan_half = PLACE_CLOSER_HALF_ANGLE.tan();
    overviews.iter().map(|&overview| Candidate { tan_half, is_overview: false, ..overview }).collect()
}

/// A circle around an object, a little from above, at one distance and with one lens.
pub(super) fn circle_around(survey: &Survey, n: usize) -> Vec<Candidate> {
    let azimuth = |i: usize| TAU * i as f32 / n as f32;
    let mut circle: Vec<Candidate> =
        (0..n).map(|i| overview_from(survey, direction(survey.up, azimuth(i), ORBIT_ELEVATION))).collect();
    // One lens for all, or the object would pulse while the camera goes around it.
    let widest = circle.iter().fold(0.0f32, |widest, candidate| widest.max(candidate.tan_half));
    let room = if survey.framed == Framed::Told { 1.0 } else { ORBIT_ROOM };
    for candidate in &mut circle {
        candidate.tan_half = room * widest;
    }
    circle
}

/// A turn on the spot of `overview`, a view within a place.
pub(super) fn turn_within(survey: &Survey, overview: &Candidate, n: usize) -> Vec<Candidate> {
    let toward = |i: usize| direction(survey.up, TAU * i as f32 / n as f32, TURN_PITCH);
    (0..n).map(|i| Candidate { target: overview.eye + toward(i), ..*overview }).collect()
}

/// Free spots inside the scene's box, spread out, the most central first.
fn spots(survey: &Survey) -> Vec<Vec3> {
    const STEPS: i32 = 3;
    let steps = -STEPS..=STEPS;
    let grid = steps.clone().flat_map(|x| {
        let steps = steps.clone();
        steps.clone().flat_map(move |y| steps.clone().map(move |z| Vec3::new(x as f32, y as f32, z as f32)))
    });
    let room = STANDING_ROOM * survey.radius;
    let mut free: Vec<Vec3> = grid
        // Seven spots along each axis, out to 80% of the box, whose sides are the walls of a room.
        .map(|step| survey.center + 0.8 / STEPS as f32 * step * survey.half_size)
        .filter(|&spot| is_free(survey, spot, room))
        .collect();
    // `spread` begins with the first, so the most central spot is always among the chosen.
    free.sort_by(|a, b| a.distance_squared(survey.center).total_cmp(&b.distance_squared(survey.center)));
    spread(&free, N_SPOTS, |_| true)
}

/// Whether hardly any mass lies within `room` of `spot`.
fn is_free(survey: &Survey, spot: Vec3, room: f32) -> bool {
    // To a sphere around the Gaussian at one standard deviation.
    let is_near = |i: usize| {
        let scales = survey.stand_in.scales[i];
        survey.stand_in.means[i].distance(spot) - scales.max_element() <= room
    };
    let sum = |masses: &mut dyn Iterator<Item = f32>| masses.map(f64::from).sum::<f64>();
    let near = sum(&mut (0..survey.masses.len()).filter(|&i| is_near(i)).map(|i| survey.masses[i]));
    // A thousandth of the mass may be nearer, because stray Gaussians float everywhere.
    near < 0.001 * sum(&mut survey.masses.iter().copied())
}

/// Up to `n` of the points that are `eligible`, beginning with the first and each as far as possible from those
/// before it.
fn spread(points: &[Vec3], n: usize, eligible: impl Fn(usize) -> bool) -> Vec<Vec3> {
    let points: Vec<Vec3> = (0..points.len()).filter(|&i| eligible(i)).map(|i| points[i]).collect();
    let Some(&first) = points.first() else { return Vec::new() };
    let mut chosen = vec![first];
    let mut distances: Vec<f32> = points.iter().map(|point| point.distance_squared(first)).collect();
    while chosen.len() < n.min(points.len()) {
        let farthest =
            (0..points.len()).fold(0, |best, i| if distances[i] > distances[best] { i } else { best });
        let next = points[farthest];
        chosen.push(next);
        for (distance, point) in distances.iter_mut().zip(&points) {
            *distance = distance.min(point.distance_squared(next));
        }
    }
    chosen
}
