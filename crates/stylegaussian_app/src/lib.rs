//! The part of an app that the viewer (`examples/viewer`) and the page (`stylegaussian_web`) share: a camera
//! that orbits a scene, a scene or a world that is opened and seen whole, the ways in which styles arrive, the
//! light on paint, and saving a scene in the colors that it is shown in. What the two are steered by, a panel
//! and a script, is their own.

mod arrivals;
mod camera;
mod opening;
mod relief;
mod save;

pub use arrivals::{Arrival, Arrivals, set_transition};
pub use camera::{FIELD_OF_VIEW, Orbit, place_camera, splat_camera};
pub use opening::{Framing, Subject, loaded_asset};
pub use relief::relief_lit_from;
pub use save::save_shown;
