//! Pictures of a moving scene: `--frames` and `--fps`, and strokes that move by `--boil` or `--flow`.

use clap::Args;
use glam::Vec3;
use stylegaussian::{Camera, strokes::StrokeMotion};

use crate::arguments::{FACTORS, direction, within};

/// Distance of strokes that are redrawn if `--motion-amount` is not given, in widths of a stroke.
const BOIL_AMOUNT: f32 = 0.5;
/// Length of a run of strokes that flow, likewise.
const FLOW_AMOUNT: f32 = 2.0;

/// Options of moving pictures.
#[derive(Args, Debug)]
pub struct MotionArgs {
    /// Number of pictures: a turntable of as many views, or the given views in order, each for an equal time.
    /// Default: a picture for each view, and for a film without cameras 120.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=999_999))]
    pub frames: Option<u32>,
    /// Pictures per second, of films and of strokes that move.
    // Animated WebP tells times in milliseconds.
    #[arg(long, value_name = "F", default_value = "24", value_parser = within(0.1_f64..=1000.0))]
    pub fps: f64,
    /// Strokes are redrawn so many times a second.
    #[arg(
        long,
        value_name = "RATE",
        requires = "restyling",
        conflicts_with = "flow",
        allow_negative_numbers = true,
        value_parser = within(FACTORS),
    )]
    boil: Option<f32>,
    /// Strokes run along their own direction so many times a second.
    #[arg(
        long,
        value_name = "RATE",
        requires = "restyling",
        allow_negative_numbers = true,
        value_parser = within(FACTORS),
    )]
    flow: Option<f32>,
    /// Distance by which strokes are beside their places or that they run, in widths of a stroke. Default: 0.5
    /// for --boil, 2 for --flow.
    #[arg(
        long,
        value_name = "WIDTHS",
        requires = "restyling",
        allow_negative_numbers = true,
        value_parser = within(FACTORS),
    )]
    motion_amount: Option<f32>,
    /// Direction to whose side strokes flow, in the scene's space.
    #[arg(
        long,
        value_name = "X,Y,Z",
        default_value = "1,0,0",
        allow_hyphen_values = true,
        value_parser = direction,
    )]
    flow_toward: Vec3,
}

impl MotionArgs {
    /// The way in which strokes move.
    pub fn motion(&self) -> StrokeMotion {
        let amount = |usual: f32| self.motion_amount.unwrap_or(usual);
        match (self.boil, self.flow) {
            (Some(rate), _) => StrokeMotion::Boil { rate, amount: amount(BOIL_AMOUNT) },
            (None, Some(rate)) => {
                StrokeMotion::Flow { rate, amount: amount(FLOW_AMOUNT), toward: self.flow_toward }
            }
            (None, None) => StrokeMotion::Still,
        }
    }

    /// The view of each picture, and its time in seconds: each of `views` once, or `--frames` of them.
    pub fn timed(&self, views: Vec<Camera>) -> Vec<(Camera, f64)> {
        let n = self.frames.map_or(views.len(), |frames| frames as usize);
        let view = |i: usize| (views[i * views.len() / n].clone(), i as f64 / self.fps);
        if views.is_empty() { Vec::new() } else { (0..n).map(view).collect() }
    }
}

#[cfg(test)]
mod tests {
    use glam::UVec2;

    use super::*;

    fn arguments(frames: Option<u32>, fps: f64) -> MotionArgs {
        let (boil, flow, motion_amount, flow_toward) = (None, None, None, Vec3::X);
        MotionArgs { frames, fps, boil, flow, motion_amount, flow_toward }
    }

    #[test]
    fn views_share_the_pictures() {
        let view = |x: f32| Camera::look_at(Vec3::X * x, Vec3::Z, Vec3::Y, 0.8, UVec2::splat(8));
        let views = vec![view(0.0), view(1.0)];
        let of = |arguments: MotionArgs| -> Vec<(f32, f64)> {
            let timed = arguments.timed(views.clone());
            timed.iter().map(|(camera, seconds)| (camera.position().x.round(), *seconds)).collect()
        };
        assert_eq!(of(arguments(None, 24.0)), [(0.0, 0.0), (1.0, 1.0 / 24.0)]);
        let expected = [(0.0, 0.0), (0.0, 0.1), (0.0, 0.2), (1.0, 0.3), (1.0, 0.4)];
        let found = of(arguments(Some(5), 10.0));
        assert!(
            found.iter().zip(&expected).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-9),
            "{found:?}"
        );
        assert_eq!(of(arguments(Some(1), 24.0)), [(0.0, 0.0)]);
        assert!(arguments(Some(3), 24.0).timed(Vec::new()).is_empty());
    }

    #[test]
    fn rates_and_amounts_are_those_given() {
        let with = |boil, flow, motion_amount| {
            MotionArgs { boil, flow, motion_amount, ..arguments(None, 24.0) }.motion()
        };
        assert_eq!(with(None, None, Some(1.0)), StrokeMotion::Still);
        assert_eq!(with(Some(8.0), None, None), StrokeMotion::Boil { rate: 8.0, amount: 0.5 });
        let flow = StrokeMotion::Flow { rate: 0.5, amount: 3.0, toward: Vec3::X };
        assert_eq!(with(None, Some(0.5), Some(3.0)), flow);
        assert!(with(Some(0.0), None, None).is_still());
    }
}
