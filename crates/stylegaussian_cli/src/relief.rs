//! Relief on the command line: light on the thickness of paint.

use clap::Args;
use glam::Vec3;
use stylegaussian::{Scene, strokes::StrokeKnobs};

use crate::arguments::{FACTORS, direction, within};

/// Options of relief.
#[derive(Args, Debug)]
pub struct ReliefArgs {
    /// Thickness of the paint, as a factor, which a light falls on: 1 is usual, and 0 is flat.
    #[arg(
        long,
        value_name = "FACTOR",
        default_value = "0",
        requires = "restyling",
        allow_negative_numbers = true,
        value_parser = within(FACTORS),
    )]
    relief: f32,
    /// Direction to that light, in the scene's space. Default: from above, and from one side.
    #[arg(
        long,
        value_name = "X,Y,Z",
        requires = "relief",
        allow_hyphen_values = true,
        value_parser = direction,
    )]
    light: Option<Vec3>,
}

impl ReliefArgs {
    /// The knobs of strokes with this relief on `scene`.
    pub fn knobs(&self, scene: &Scene) -> StrokeKnobs {
        let aside = |up: Vec3| up + up.any_orthonormal_vector();
        let usual = || aside(scene.up.and_then(Vec3::try_normalize).unwrap_or(Vec3::Y));
        let light = self.light.unwrap_or_else(usual);
        StrokeKnobs { relief: self.relief, light, ..StrokeKnobs::DEFAULT }
    }
}
