//! Cameras for a scene that comes without photos.
//!
//! A scene is either an *object*, seen from outside, or a *place*, seen from within. Which of the two is found by
//! looking: test views are taken from all around it and from free spots inside it, and whichever shows more of its
//! Gaussians wins (a place must surround its spots, too). Among many candidate cameras of the winning kind (overviews and closer looks), a greedy choice takes
//! at each step the one that adds most to what has been seen so far, so that any number of views covers the scene as
//! well as that many views can.
//!
//! The stages, one module each: `survey` (size, middle and a thinned-out stand-in of the scene), `up` (which way is
//! up), `candidates` (cameras that could be taken), `coverage` (what a camera sees, and the choice).

mod candidates;
mod coverage;
mod survey;
#[cfg(test)]
mod tests;
mod up;

use glam::UVec2;
use stylegaussian::{Camera, Scene};

use candidates::Candidate;
use coverage::TestViews;
use survey::Survey;

/// A scene is a place only if test views within it show this much more than such around it: a closed shell shows the
/// same from both sides, and is taken for an object.
const PLACE_SHOWS_MORE: f32 = 1.15;

/// ... and if this much of what one sees from within is something: one stands in a place, and floats over an object.
const PLACE_ENCLOSES: f32 = 0.7;

/// `n` cameras with pictures of `size` pixels that together see as much of `scene` as they can, upright, the most
/// telling first; none when there is nothing to see.
///
/// Up is [`Scene::up`], or is guessed from the scene's surfaces where the file does not tell. The choice depends on the
/// scene alone: one scene, one set of cameras.
pub fn choose_views(scene: &Scene, n: usize, size: UVec2) -> Vec<Camera> {
    let Some(survey) = Survey::new(scene) else { return Vec::new() };
    let (overviews, closer) = match Overviews::take(&survey) {
        Overviews::Around(views) => {
            let closer = candidates::closer_looks_around(&survey, &views.usable());
            (views, closer)
        }
        Overviews::Within(views) => {
            let closer = candidates::closer_looks_within(&views.usable());
            (views, closer)
        }
    };
    let chosen = overviews.and(TestViews::take(&survey, closer)).choose(n);
    cameras(chosen, size)
}

/// `n` cameras on a circle for showing `scene`: around an object, or turning on the spot in a place.
///
/// The circle runs counter-clockwise as seen from above.
pub fn orbit(scene: &Scene, n: usize, size: UVec2) -> Vec<Camera> {
    let Some(survey) = Survey::new(scene) else { return Vec::new() };
    let circle = match Overviews::take(&survey) {
        Overviews::Around(_) => candidates::circle_around(&survey, n),
        // The most telling overview stands where most can be seen.
        Overviews::Within(views) => match views.choose(1).first() {
            Some(best) => candidates::turn_within(&survey, best, n),
            None => candidates::circle_around(&survey, n),
        },
    };
    cameras(circle, size)
}

fn cameras(candidates: Vec<Candidate>, size: UVec2) -> Vec<Camera> {
    let size = size.max(UVec2::ONE);
    candidates.into_iter().map(|candidate| candidate.camera(size)).collect()
}

/// Test views of the whole scene, of the kind that suits it.
enum Overviews {
    /// Of an object.
    Around(TestViews),
    /// Of a place.
    Within(TestViews),
}

impl Overviews {
    fn take(survey: &Survey) -> Self {
        let around = TestViews::take(survey, candidates::around(survey));
        let within = TestViews::take(survey, candidates::within(survey));
        let encloses = within.covered() > PLACE_ENCLOSES;
        if encloses && within.share_seen() > PLACE_SHOWS_MORE * around.share_seen() {
            Self::Within(within)
        } else {
            Self::Around(around)
        }
    }
}
