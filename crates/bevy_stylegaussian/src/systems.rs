//! System sets of the plugin.

use bevy::prelude::*;

/// The plugin's system sets in `PostUpdate`, in this order. Changes made before them are drawn in the same
/// frame, unless they need background work.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum StyleGaussianSystems {
    /// Attaches loaded scenes and their bounds to entities, and sends
    /// [`GaussianSceneFailed`](crate::GaussianSceneFailed).
    Scenes,
    /// Requests styles, takes over results from the background, and sends [`StyleApplied`](crate::StyleApplied)
    /// and [`StyleFailed`](crate::StyleFailed).
    Styles,
}
