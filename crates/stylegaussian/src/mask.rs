//! Masks: weights of a scene's Gaussians, painted by hand or selected.
//!
//! A [`Mask`] has four channels of 8 bits. They are independent: layers that read them lie on one another, and
//! the upper one covers the lower one. [`Brush::lessens`] names channels that give way where another is
//! painted.
//!
//! A channel can be put to use in three ways, together or apart:
//!
//! - as the mask of a [`Layer`](crate::layers::Layer), which shows a look where the channel is painted;
//! - as a *tint*: such a layer whose look is one color;
//! - as a [`Visibility`], which *hides* painted Gaussians, or *crops* to them.
//!
//! Every change gives an [`Edit`], which undoes itself and names the ranges to upload again. A [`History`]
//! keeps them.

mod brush;
mod history;
mod lasso;
mod selection;
mod stored;
mod visibility;
pub(crate) mod weights;

#[cfg(test)]
mod tests;

pub use brush::{Brush, Stroke};
pub use history::History;
pub use lasso::Lasso;
pub use selection::{Combine, Selection};
pub use stored::{MaskError, StoredMask};
pub use visibility::{MaskUse, Visibility};
pub use weights::{CHANNELS, Edit, Mask};
