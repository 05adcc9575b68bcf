//! Cameras for a scene that comes without photos.
//!
//! A scene is either an *object*, seen from outside, or a *place*, seen from within. Test views decide: some
//! from all around the scene and some from free spots inside it. If those inside show more of its Gaussians and
//! are surrounded by it, the scene is a place. Among many candidate cameras of that kind (overviews and closer
//! looks), each step then takes the one that adds most to the views before it. Any number of views thus covers
//! the scene as well as that many views can.
//!
//! A scene that was captured from about one spot within it is a place too, and is seen from there, also if its
//! sky is empty or the same can be seen from outside: `eye` finds the spot.
//!
//! What is framed is the dense part of the scene, without surroundings, as in [`Scene::bulk`], or the ball that
//! [`Scene::frame`] tells. A sky far away is no part of the scene.
//!
//! The stages, one module each: `survey` (size, middle and a simplified version of the scene), `eye` (the spot
//! of a capture from within), `up` (the up direction), `candidates` (candidate cameras), `coverage` (the
//! Gaussians that a camera sees, and the choice).

mod candidates;
mod coverage;
mod eye;
mod survey;
#[cfg(test)]
mod tests;
mod up;

use crate::{
    Camera, Scene,
    bulk::{before_backdrop, is_within},
    frame::Frame,
    work::{Canceled, Work},
};
use glam::{UVec2, Vec3};

pub use crate::bulk::bounds_without_backdrop;
use candidates::Candidate;
use coverage::TestViews;
pub use eye::Eye;
use survey::{Framed, N_STAND_IN, Survey};

/// Factor by which test views within a place must show more than those around it. A closed shell shows the same
/// from both sides, and counts as an object.
const PLACE_SHOWS_MORE: f32 = 1.15;

/// Least share of a place's inner views that must show the scene. A place surrounds its viewer, an object does
/// not.
const PLACE_ENCLOSES: f32 = 0.7;

/// One in this many inner views is tested first. If these show less than enough by [`NEARLY`], the others are
/// not tested. The mean of forty shares in 0..1 has a deviation of 0.08 at most.
const FEW: usize = 4;
const NEARLY: f32 = 0.2;

/// Chooses `n` upright cameras with pictures of `size` pixels that together see as much of `scene` as possible,
/// the most useful first. Returns none if nothing of the scene is visible.
///
/// Up is [`Scene::up`], or a guess from the scene's surfaces if that is `None`. The choice depends on the scene
/// alone.
pub fn choose_views(scene: &Scene, n: usize, size: UVec2) -> Vec<Camera> {
    // Nobody cancels it.
    choose_views_if_wanted(scene, n, size, &Work::default()).unwrap_or_default()
}

/// As [`choose_views`].
///
/// # Errors
/// If `work` is canceled.
pub fn choose_views_if_wanted(
    scene: &Scene,
    n: usize,
    size: UVec2,
    work: &Work,
) -> Result<Vec<Camera>, Canceled> {
    // What follows tells no share.
    let survey = Survey::new(scene, N_STAND_IN, &work.part(0.0, 0.0))?;
    let Some(survey) = survey else { return Ok(Vec::new()) };
    let (overviews, closer) = match Overviews::take(&survey, work)? {
        Overviews::Around(views) => {
            let closer = candidates::closer_looks_around(&survey, &views.usable());
            (views, closer)
        }
        Overviews::Within(views) => {
            let closer = candidates::closer_looks_within(&views.usable());
            (views, closer)
        }
    };
    // Overviews come first in the pool. Of equal gains the first wins, which makes the choice the same each
    // time.
    let chosen = overviews.and(TestViews::take(&survey, closer, work)?).choose(n);
    Ok(cameras(chosen, size))
}

/// Gaussians by which overviews are chosen. A third of [`N_STAND_IN`] chooses nearly the same, in a third of
/// the time.
const N_OF_OVERVIEWS: usize = N_STAND_IN / 3;

/// Chooses as [`choose_views`] does, but among overviews alone, and in a fraction of its time.
///
/// # Errors
/// If `work` is canceled.
pub fn choose_overviews(scene: &Scene, n: usize, size: UVec2, work: &Work) -> Result<Vec<Camera>, Canceled> {
    // What follows tells no share.
    let survey = Survey::new(scene, N_OF_OVERVIEWS, &work.part(0.0, 0.0))?;
    let Some(survey) = survey else { return Ok(Vec::new()) };
    let (Overviews::Around(views) | Overviews::Within(views)) = Overviews::take(&survey, work)?;
    Ok(cameras(views.choose(n), size))
}

/// `n` cameras on a circle for showing `scene`: around an object, or turning on the spot in a place.
///
/// The circle runs counter-clockwise as seen from above.
pub fn orbit(scene: &Scene, n: usize, size: UVec2) -> Vec<Camera> {
    // Nobody cancels it.
    let work = Work::default();
    let Ok(Some(survey)) = Survey::new(scene, N_STAND_IN, &work) else { return Vec::new() };
    let circle = match Overviews::take(&survey, &work) {
        Err(Canceled) => Vec::new(),
        Ok(Overviews::Around(_)) => candidates::circle_around(&survey, n),
        // The first choice stands at the spot from which most can be seen.
        Ok(Overviews::Within(views)) => match views.choose(1).first() {
            Some(best) => candidates::turn_within(&survey, best, n),
            None => candidates::circle_around(&survey, n),
        },
    };
    cameras(circle, size)
}

/// The part of a scene that chosen cameras frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// The ball that fills a picture of all that is framed.
    pub frame: Frame,
    /// The up direction, a unit vector: [`Scene::up`], or a guess from the surfaces.
    pub up: Vec3,
    /// The number of Gaussians that are left out: a backdrop, and surroundings that the ball does not hold.
    pub n_left_out: usize,
    /// The spot from which the capture was made, if it was made from about one spot within. A camera shows such
    /// a place from there.
    pub eye: Option<Eye>,
}

/// The part of `scene` that [`choose_views`] and [`orbit`] frame, or `None` if nothing of it is visible.
pub fn framing(scene: &Scene) -> Option<Framing> {
    // Nobody cancels it.
    framing_if_wanted(scene, &Work::default()).unwrap_or_default()
}

/// As [`framing`].
///
/// # Errors
/// If `work` is canceled.
pub fn framing_if_wanted(scene: &Scene, work: &Work) -> Result<Option<Framing>, Canceled> {
    let Some(survey) = Survey::new(scene, N_OF_OVERVIEWS, work)? else { return Ok(None) };
    let frame = Frame { center: survey.center, radius: survey.radius };
    let count =
        |is_left_out: &dyn Fn(Vec3) -> bool| scene.means.iter().filter(|&&mean| is_left_out(mean)).count();
    let n_left_out = match survey.framed {
        Framed::Told => count(&|mean| mean.distance(frame.center) > frame.radius),
        Framed::Dense(region) => count(&|mean| !is_within(mean, region)),
        Framed::All => {
            before_backdrop(scene).map_or(0, |(middle, limit)| count(&|mean| mean.distance(middle) >= limit))
        }
    };
    Ok(Some(Framing { frame, up: survey.up, n_left_out, eye: survey.eye }))
}

fn cameras(candidates: Vec<Candidate>, size: UVec2) -> Vec<Camera> {
    let size = size.max(UVec2::ONE);
    candidates.into_iter().map(|candidate| candidate.camera(size)).collect()
}

/// Test views of the whole scene, of the kind that suits it.
enum Overviews {
    /// Around an object.
    Around(TestViews),
    /// Within a place.
    Within(TestViews),
}

impl Overviews {
    fn take(survey: &Survey, work: &Work) -> Result<Self, Canceled> {
        if let Some(eye) = survey.eye {
            let within = TestViews::take(survey, candidates::from_eye(survey, eye), work)?;
            if !within.usable().is_empty() {
                return Ok(Self::Within(within));
            }
        }
        let around = TestViews::take(survey, candidates::around(survey), work)?;
        // A few views tell an object that is plainly none to stand in.
        let (few, others): (Vec<_>, Vec<_>) =
            candidates::within(survey).into_iter().enumerate().partition(|(i, _)| i % FEW == 0);
        let take = |of: Vec<(usize, Candidate)>| {
            TestViews::take(survey, of.into_iter().map(|(_, candidate)| candidate).collect(), work)
        };
        let few = take(few)?;
        if few.covered() < PLACE_ENCLOSES - NEARLY {
            return Ok(Self::Around(around));
        }
        let within = few.and(take(others)?);
        let encloses = within.covered() > PLACE_ENCLOSES;
        if encloses && within.share_seen() > PLACE_SHOWS_MORE * around.share_seen() {
            Ok(Self::Within(within))
        } else {
            Ok(Self::Around(around))
        }
    }
}
