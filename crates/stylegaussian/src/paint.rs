//! A painting's own paint on a scene, zero-shot: without training, features or photos.
//!
//! A painting is split into detail (its strokes) and the colors that are left without it. The scene gets these
//! colors, and the splat pass draws the detail over them by the pixel ([`strokes`](crate::strokes)), so a
//! stroke is as sharp as the screen.
//!
//! 1. Once per scene ([`Surface`]): *seeds* cover it at the spacing of a brush stroke, and each Gaussian
//!    belongs to one, so that strokes end at edges of color and at creases. A seed has a tangent plane, and a
//!    direction in it along the scene's edges.
//! 2. Once per painting ([`Canvas`]): it is *read at its own scale*, the largest of three at which nearly half
//!    of its contrast is finer than a stroke. Its detail is evened out a little, and becomes two textures.
//! 3. Per scene and painting ([`lay`]): each seed takes the *place* in the painting whose surroundings look
//!    like its own, in the painting's colors. Gaussians that stand out of the scene and of the strokes are
//!    *protected*, and keep their own detail. Each seed lays on as much detail as the painting has and the
//!    scene lacks, and two factors make small pictures of the scene (*proofs*) as detailed as the painting. At
//!    last the proofs get its palette and its shares of dark and bright.
//!
//! A painting's pixel is one of a picture of 512 pixels that shows the whole scene, or of 394 pixels from the
//! middle ones of its capture's cameras.
//!
//! The stages, one module each: `sight` (how large and how visible Gaussians are), `frames` (normals and
//! directions), `seeds`, `smooth` (the scene without its detail), `surface` (all that depends on the scene
//! alone), `painting` (the part that a style carries), `used` (what may be used of it), `picture` (blurred
//! copies), `detail` (the textures), `tints` (the colors), `canvas` (all that depends on the painting alone),
//! `collection` (which of several paintings a seed takes), `places` (where in it), `choice` (both), `direction`
//! (of strokes, if one is given), `pins` (places that are given), `proofs` and `bands` (how much detail
//! pictures show), `balance` (the gains), `tone` (dark and bright), `grade` (the colors under strokes), `lay`
//! (all of it), `company` (scenes that stand beside a painted one or are parts of it), `redraw` (pictures that
//! change).

mod balance;
mod bands;
mod canvas;
mod choice;
mod collection;
mod company;
mod detail;
mod direction;
mod frames;
mod grade;
mod hand;
mod lay;
mod painting;
mod patch;
mod picture;
mod pins;
mod places;
mod proofs;
pub mod redraw;
mod seeds;
mod sight;
mod smooth;
mod surface;
#[cfg(test)]
mod tests;
mod tints;
mod tone;
mod used;

pub use canvas::Canvas;
pub use company::Company;
pub use direction::{Direction, DirectionError};
pub use hand::Hand;
pub use lay::{Painted, lay, lay_beside, recolored};
pub use painting::{AreaError, MAX_PIXELS, Paint, pixels_of};
pub use pins::{OtherScene, Pin, PinError, StoredPins, pin};
pub use surface::Surface;
pub use tints::{MAX_COLORS, Tints, TintsError};
