//! The air of a planet by tables: aerial perspective, as Bevy's `Atmosphere` gives it to meshes.

use glam::{Mat3, Mat4, Vec2, Vec3, Vec4};

use super::Air;

/// Distance, in meters, at which whatever is farther is taken to be: beyond all air, and its square is still a
/// number.
pub const FARTHEST_AIR: f32 = 1e9;

/// The air of a planet as one eye sees it, and the axes of two tables of it.
///
/// T(h, mu) is the share of the light that passes from the height h to the top of the air, along a ray whose
/// angle to the vertical has the cosine mu. L(uv, w) is the logarithm of the light that comes from the air up
/// to the slice w behind a point uv of the picture. With a point t meters away, at the height h', where the
/// cosine is mu', and d the thickness of a slice, the air before it is
///
/// ```text
/// transmission = T(h, mu) / T(h', mu')            or T(h', -mu') / T(h, -mu) if the ray meets the ground
/// light = exposure min(t / d, 1) exp(L(uv, t))
/// ```
///
/// Rays are from the eye, in view space (x right, y up, z backward).
#[derive(Clone, Debug, PartialEq)]
pub struct Atmosphere {
    /// Radius of the planet, in meters.
    pub inner_radius: f32,
    /// Height of the top of the air above the ground, in meters.
    pub thickness: f32,
    /// Height of the eye above the ground, in meters, above 0.
    pub altitude: f32,
    /// Unit vector from the planet's center to the eye, in view space.
    pub up: Vec3,
    /// Meters from the units of view space.
    pub meters_from_view: Mat3,
    /// The projection of the camera that L is for, reverse z. The pictures of other projections from the same
    /// eye, such as smaller ones, find their points in it.
    pub clip_from_view: Mat4,
    /// Distance of the end of the last slice of L, in meters.
    pub max_distance: f32,
    /// Number of slices of L.
    pub n_slices: u32,
    /// The camera's factor on the light of L.
    pub exposure: f32,
    /// Whether each channel passes by the mean of the three, as for meshes on GPUs that blend no other way.
    pub is_gray: bool,
}

impl Atmosphere {
    /// Whether all numbers are finite and all lengths are above 0.
    pub fn is_usable(&self) -> bool {
        let lengths = [self.inner_radius, self.thickness, self.altitude, self.max_distance];
        let is_finite = self.up.is_finite()
            && self.meters_from_view.is_finite()
            && self.clip_from_view.is_finite()
            && self.exposure.is_finite();
        is_finite && self.n_slices > 0 && lengths.iter().all(|length| length.is_finite() && *length > 0.0)
    }

    /// The length of a ray in meters, at most [`FARTHEST_AIR`].
    fn meters(&self, ray: Vec3) -> f32 {
        (self.meters_from_view * ray).length().min(FARTHEST_AIR)
    }

    /// The place in L of the end of a ray, each coordinate 0..1 within the texture, and the share of what is
    /// there.
    pub fn aerial_place(&self, ray: Vec3) -> Vec4 {
        let clip = self.clip_from_view * ray.extend(1.0);
        let uv = Vec2::new(clip.x, clip.y) / clip.w * Vec2::new(0.5, -0.5) + 0.5;
        let (share, n_slices) = (self.meters(ray) / self.max_distance, self.n_slices as f32);
        // A texel holds what is before the end of its slice. Before the first end, light grows from 0.
        let w = (share - 0.5 / n_slices).clamp(0.0, 1.0);
        Vec4::new(uv.x, uv.y, w, (share * n_slices).clamp(0.0, 1.0))
    }

    /// The place in T of a height and a cosine, each coordinate 0..1 within the texture: the length of the ray
    /// between the shortest and the longest one from there, and the distance of the horizon (Bruneton and
    /// Neyret 2008, "Precomputed Atmospheric Scattering", section 4).
    pub fn transmittance_place(&self, height: f32, mu: f32) -> Vec2 {
        let outer_radius = self.inner_radius + self.thickness;
        let height = height.clamp(0.0, self.thickness);
        let along = (self.inner_radius + height) * mu;
        // Squares of radii differ by less than f32 tells apart, so their differences are products.
        let to_horizon = (height * (height + 2.0 * self.inner_radius)).sqrt();
        let longest = (self.thickness * (self.thickness + 2.0 * self.inner_radius)).sqrt();
        let shortest = self.thickness - height;
        let above = shortest * (outer_radius + self.inner_radius + height);
        let length = ((along * along + above).sqrt() - along).max(0.0);
        Vec2::new((length - shortest) / (to_horizon + longest - shortest), to_horizon / longest)
    }

    /// The places in T of the numerator and the denominator of the share that passes along a ray.
    pub fn segment_places(&self, ray: Vec3) -> [Vec2; 2] {
        let meters = self.meters(ray);
        let radius = self.inner_radius + self.altitude;
        let along = radius * (ray / ray.length().max(1e-20)).dot(self.up);
        // By how much the square of the radius grows.
        let growth = meters * (meters + 2.0 * along);
        let radius_there = (radius * radius + growth).max(0.0).sqrt();
        let height_there = self.altitude + growth / (radius + radius_there);
        let mu = along / radius;
        let mu_there = ((along + meters) / radius_there.max(1e-20)).clamp(-1.0, 1.0);
        // The cosine at which a ray touches the ground.
        let meets_ground =
            along < 0.0 && along * along >= self.altitude * (self.altitude + 2.0 * self.inner_radius);
        let sign = if meets_ground { -1.0 } else { 1.0 };
        let here = self.transmittance_place(self.altitude, sign * mu);
        let there = self.transmittance_place(height_there, sign * mu_there);
        if meets_ground { [there, here] } else { [here, there] }
    }

    /// The air between the eye and the end of a ray: that of the atmosphere before `air`. `aerial` and
    /// `transmittance` read L and T.
    pub fn behind_atmosphere(
        &self,
        air: Air,
        ray: Vec3,
        aerial: impl Fn(Vec3) -> Vec3,
        transmittance: impl Fn(Vec2) -> Vec3,
    ) -> Air {
        let place = self.aerial_place(ray);
        let light = self.exposure * place.w * aerial(place.truncate()).exp();
        let [part, whole] = self.segment_places(ray).map(transmittance);
        // Where nothing passes to the top, nothing is known.
        let passed = Vec3::select(whole.cmpgt(Vec3::ZERO), (part / whole).min(Vec3::ONE), Vec3::ONE);
        let passed = if self.is_gray { Vec3::splat(passed.element_sum() / 3.0) } else { passed };
        Air { transmission: passed * air.transmission, light: passed * air.light + light }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small planet: 3 to the ground, 5 to the top of its air, and an eye at 4.
    fn small() -> Atmosphere {
        Atmosphere {
            inner_radius: 3.0,
            thickness: 2.0,
            altitude: 1.0,
            up: Vec3::Y,
            meters_from_view: Mat3::IDENTITY,
            clip_from_view: Mat4::perspective_infinite_reverse_rh(std::f32::consts::FRAC_PI_2, 1.0, 0.1),
            max_distance: 12.0,
            n_slices: 4,
            exposure: 0.5,
            is_gray: false,
        }
    }

    #[track_caller]
    fn near(found: Vec2, expected: [f32; 2]) {
        assert!(found.distance(expected.into()) < 1e-5, "found {found}, expected {expected:?}");
    }

    #[test]
    fn slices_end_at_their_distances() {
        let air = small();
        // 3 and 1.5 away, at the right edge of the picture and a quarter from its top.
        let ray = Vec3::new(2.0, 1.0, -2.0);
        assert!(air.aerial_place(ray).abs_diff_eq(Vec4::new(1.0, 0.25, 0.125, 1.0), 1e-6));
        assert!(air.aerial_place(0.5 * ray).abs_diff_eq(Vec4::new(1.0, 0.25, 0.0, 0.5), 1e-6));
        // In a world whose unit is two meters, the first slice ends half as far away.
        let large = Atmosphere { meters_from_view: 2.0 * Mat3::IDENTITY, ..air };
        assert!(large.aerial_place(0.5 * ray).abs_diff_eq(Vec4::new(1.0, 0.25, 0.125, 1.0), 1e-6));
        assert!(large.aerial_place(1e30 * ray).abs_diff_eq(Vec4::new(1.0, 0.25, 1.0, 1.0), 1e-6));
    }

    /// The longest rays are 4 at the ground, and the horizon is the root of 7 from the eye.
    #[test]
    fn places_of_transmittance_by_hand() {
        let (air, horizon) = (small(), 7.0_f32.sqrt());
        near(air.transmittance_place(1.0, 1.0), [0.0, horizon / 4.0]);
        // Level, the top is 3 away.
        near(air.transmittance_place(1.0, 0.0), [2.0 / (horizon + 3.0), horizon / 4.0]);
        // To the horizon and on from there.
        near(air.transmittance_place(1.0, -horizon / 4.0), [1.0, horizon / 4.0]);
        near(air.transmittance_place(0.0, 1.0), [0.0, 0.0]);
        near(air.transmittance_place(0.0, 0.0), [1.0, 0.0]);
        // At the top and above it, all passes on the way up.
        near(air.transmittance_place(2.0, 0.5), [0.0, 1.0]);
        near(air.transmittance_place(9.0, 1.0), [0.0, 1.0]);

        // Up by 1, to the top. Down by 1, to the ground, where both rays are looked up backward.
        near(air.segment_places(Vec3::Y)[0], [0.0, horizon / 4.0]);
        near(air.segment_places(Vec3::Y)[1], [0.0, 1.0]);
        near(air.segment_places(Vec3::NEG_Y)[0], [0.0, 0.0]);
        near(air.segment_places(Vec3::NEG_Y)[1], [0.0, horizon / 4.0]);
        // Level by 3, to the top, where the cosine is 3 / 5.
        near(air.segment_places(3.0 * Vec3::NEG_Z)[1], [0.0, 1.0]);
    }

    /// Heights of a meter count on a planet of any size.
    #[test]
    fn large_planets_have_low_heights() {
        let earth =
            Atmosphere { inner_radius: 6.36e6, thickness: 1e5, altitude: 2.0, n_slices: 32, ..small() };
        let inner = 6.36e6_f64;
        for height in [0.5_f64, 2.0, 30.0] {
            let radius = inner + height;
            let v = (radius * radius - inner * inner).sqrt() / (6.46e6_f64.powi(2) - inner * inner).sqrt();
            let found = earth.transmittance_place(height as f32, 0.3).y;
            assert!((f64::from(found) / v - 1.0).abs() < 1e-5, "found {found}, expected {v}");
        }
        // Nothing between: the quotient is 1.
        let [part, whole] = earth.segment_places(Vec3::new(0.0, 1e-3, -1e-3));
        assert!(part.distance(whole) < 1e-5, "{part} and {whole}");
    }

    #[test]
    fn air_takes_and_adds_light() {
        let (air, ray) = (small(), Vec3::NEG_Y);
        let before = Air { transmission: Vec3::splat(0.5), light: Vec3::splat(0.2) };
        // At the ground a quarter passes to the top, half at the eye. A third of the first slice adds light.
        let (ground, eye) = (Vec3::new(0.25, 0.25, 0.0), Vec3::new(0.5, 0.25, 0.0));
        let transmittance = |uv: Vec2| if uv.y == 0.0 { ground } else { eye };
        let found = air.behind_atmosphere(before, ray, |_| Vec3::splat(2.0_f32.ln()), transmittance);
        let passed = Vec3::new(0.5, 1.0, 1.0);
        assert!(found.transmission.abs_diff_eq(0.5 * passed, 1e-6), "{found:?}");
        assert!(found.light.abs_diff_eq(0.2 * passed + 1.0 / 3.0, 1e-6), "{found:?}");
        let gray = Atmosphere { is_gray: true, ..air };
        let found = gray.behind_atmosphere(Air::CLEAR, ray, |_| Vec3::ZERO, transmittance);
        assert!(found.transmission.abs_diff_eq(Vec3::splat(2.5 / 3.0), 1e-6), "{found:?}");
    }

    #[test]
    fn atmospheres_without_a_size_are_unusable() {
        assert!(small().is_usable());
        for unusable in [
            Atmosphere { thickness: 0.0, ..small() },
            Atmosphere { inner_radius: f32::NAN, ..small() },
            Atmosphere { max_distance: f32::INFINITY, ..small() },
            Atmosphere { n_slices: 0, ..small() },
            Atmosphere { exposure: f32::NAN, ..small() },
        ] {
            assert!(!unusable.is_usable(), "{unusable:?}");
        }
    }
}
