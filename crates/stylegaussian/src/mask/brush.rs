//! The brush: dabs, and strokes made of them.

use glam::{Affine3A, Vec3};

use super::weights::{CHANNELS, Edit, Mask};
use crate::{
    layers::{Region, Shape},
    random::hash,
};

/// Distance of a stroke's dabs, in radii of the brush. At a quarter, strokes of softness 0.25 or more vary
/// along their middle by less than an 8-bit step.
const SPACING: f32 = 0.25;

/// Dabs of a segment of a stroke, at most; longer segments have them farther apart. A mouse that crosses the
/// screen with a brush of a hundredth of it needs 400.
const MOST_DABS: f32 = 1024.0;

/// The largest radius and the largest distance that count, in scene units: their squares stay within f32.
const FAR: f32 = 1e18;

/// Steps of the random number that rounds weights. With the 8 bits of a weight it fills the 24 bits of an f32.
const ROUNDING_STEPS: f32 = 65_536.0;

/// A round brush.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brush {
    /// Distance from the center at which the brush has no effect, in scene units.
    pub radius: f32,
    /// Share of the radius across which the effect fades, 0..1: 0 is a hard edge, 1 fades from the center on.
    pub softness: f32,
    /// Share of the rest to 255 that one dab adds at the center, 0..1. The dabs of a stroke overlap and add up.
    pub strength: f32,
    /// The channel that is painted, 0..4.
    pub channel: usize,
    /// Channels that lose the share that `channel` gains. None by default.
    pub lessens: [bool; CHANNELS],
    /// Erases the channel instead: a dab removes its share of the weight. Other channels stay.
    pub erases: bool,
}

impl Default for Brush {
    /// Paints the first channel, softly and wholly, within a unit of the scene.
    fn default() -> Self {
        Self {
            radius: 1.0,
            softness: 0.5,
            strength: 1.0,
            channel: 0,
            lessens: [false; CHANNELS],
            erases: false,
        }
    }
}

impl Brush {
    /// The sphere of a dab at `center`: its weight times [`strength`](Self::strength) is the share that
    /// changes.
    pub fn region(&self, center: Vec3) -> Region {
        let (radius, softness) = (self.reach(), self.softness.clamp(0.0, 1.0));
        Region {
            // The middle of the edge.
            shape: Shape::Ellipsoid { radii: Vec3::splat(radius * (1.0 - 0.5 * softness)) },
            shape_from_scene: Affine3A::from_translation(-center),
            softness: softness * radius,
        }
    }

    /// The radius that counts. NaN stays NaN, and reaches nothing.
    fn reach(&self) -> f32 {
        if self.radius > FAR { FAR } else { self.radius }
    }

    /// The weights after a dab that covers the share `share`. `random` is in 0..1 without 1.
    fn dabbed(&self, mut weights: [u8; CHANNELS], share: f32, random: f32) -> [u8; CHANNELS] {
        for (channel, weight) in weights.iter_mut().enumerate() {
            if channel == self.channel {
                *weight = toward(*weight, if self.erases { 0.0 } else { 255.0 }, share, random);
            } else if self.lessens[channel] && !self.erases {
                *weight = toward(*weight, 0.0, share, random);
            }
        }
        weights
    }
}

/// A weight moved toward `target` by `share` of the distance. It is rounded up or down at random, by the
/// fraction: rounded to the nearest, faint dabs would never add up, and all would stop short of the target.
fn toward(weight: u8, target: f32, share: f32, random: f32) -> u8 {
    let weight = f32::from(weight);
    (weight + share * (target - weight) + random).floor() as u8
}

impl Mask {
    /// Paints or erases a dab at each of `centers`, one after the other, in the space of `means` `[N]`. Centers
    /// and brushes that are not finite, or of no size, change nothing.
    ///
    /// The same operations on equal masks give equal masks, whatever the number of threads.
    ///
    /// # Panics
    /// If there is not one mean per Gaussian.
    pub fn paint(&mut self, means: &[Vec3], brush: &Brush, centers: &[Vec3]) -> Edit {
        assert_eq!(means.len(), self.len(), "one mean per Gaussian");
        let centers: Vec<Vec3> = centers.iter().copied().filter(|center| center.is_finite()).collect();
        let first_dab = self.n_dabs;
        self.n_dabs += centers.len() as u64;
        let (Some(&first), true) = (centers.first(), brush.channel < CHANNELS) else {
            return Edit::default();
        };
        let (low, high) = centers.iter().fold((first, first), |(low, high), &c| (low.min(c), high.max(c)));
        let (low, high) = (low - brush.reach(), high + brush.reach());
        let regions: Vec<Region> = centers.iter().map(|&center| brush.region(center)).collect();
        let strength = brush.strength.clamp(0.0, 1.0);
        self.edit(|i, weights| {
            let mean = means[i];
            // Most Gaussians are far away. Comparisons with NaN are false.
            let is_near = mean.cmpge(low).all() && mean.cmple(high).all();
            if !is_near {
                return weights;
            }
            let mut painted = weights;
            for (dab, region) in (first_dab..).zip(&regions) {
                let share = strength * region.weight(mean);
                // False for NaN, too.
                if share > 0.0 {
                    let random = hash((dab << 32) ^ i as u64) >> 48;
                    painted = brush.dabbed(painted, share, random as f32 / ROUNDING_STEPS);
                }
            }
            painted
        })
    }
}

/// A stroke of a brush: dabs a quarter of the radius apart along a line of points, whatever their distance.
#[derive(Clone, Debug)]
pub struct Stroke {
    brush: Brush,
    /// The last point, and the way from the last dab to it.
    last: Option<(Vec3, f32)>,
    edit: Edit,
    /// Whether the edit holds a Gaussian already `[N]`.
    touched: Vec<bool>,
}

impl Stroke {
    /// A stroke that has not begun yet.
    pub fn new(brush: Brush) -> Self {
        Self { brush, last: None, edit: Edit::default(), touched: Vec::new() }
    }

    /// The brush.
    pub fn brush(&self) -> &Brush {
        &self.brush
    }

    /// Goes on to `point`, in the space of `means`. The first point is a dab. Returns the changes since the
    /// last point; points that are not finite are passed over.
    ///
    /// # Panics
    /// If there is not one mean per Gaussian.
    pub fn to(&mut self, mask: &mut Mask, means: &[Vec3], point: Vec3) -> Edit {
        let dabs = self.dabs_to(point);
        let edit = mask.paint(means, &self.brush, &dabs);
        self.touched.resize(mask.len(), false);
        self.edit.append(&edit, &mut self.touched);
        edit
    }

    /// The dabs between the last point and this one.
    fn dabs_to(&mut self, point: Vec3) -> Vec<Vec3> {
        if !point.is_finite() {
            return Vec::new();
        }
        let Some((last, since)) = self.last else {
            self.last = Some((point, 0.0));
            return vec![point];
        };
        let length = last.distance(point);
        let spacing = (SPACING * self.brush.radius).max(length / MOST_DABS);
        // A brush without size or a point too far away to measure makes no dabs.
        let way = since + length;
        let n = if spacing > 0.0 && way.is_finite() { (way / spacing) as usize } else { 0 };
        self.last = Some((point, (way - n as f32 * spacing).max(0.0)));
        (1..=n).map(|k| last.lerp(point, (k as f32 * spacing - since) / length)).collect()
    }

    /// Everything that the stroke changed, as one edit.
    pub fn finish(mut self) -> Edit {
        self.edit.sort();
        self.edit
    }
}
