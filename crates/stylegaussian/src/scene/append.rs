//! Several scenes as one.

use super::{Scene, ScreenFilter, Sh};
use crate::sh::n_coefficients;

impl Scene {
    /// Adds the Gaussians of another scene behind its own: geometry and captured colors. They come behind its
    /// source, too, so a scene that began empty is its own source.
    ///
    /// Colors have the higher degree of the two. Coefficients that one of them lacks are 0, which is mid-gray,
    /// the same from every side. If the filters differ, it is [`ScreenFilter::Classic`]. An empty scene takes
    /// the other's origin. The up direction is the first one that is known. Features, neighbors and the mask
    /// would not be those of all Gaussians, and are removed.
    ///
    /// ```
    /// # use stylegaussian::Scene;
    /// # let parts: [Scene; 0] = [];
    /// let mut whole = Scene::default();
    /// for part in &parts {
    ///     whole.append(part);
    /// }
    /// ```
    pub fn append(&mut self, other: &Self) {
        self.append_colors(other);
        if self.is_empty() {
            (self.offset, self.filter) = (other.offset, other.filter);
        } else if !other.is_empty() && self.filter != other.filter {
            self.filter = ScreenFilter::Classic;
        }
        let between = (other.offset - self.offset).as_vec3();
        self.means.extend(other.means.iter().map(|&mean| mean + between));
        self.rotations.extend(&other.rotations);
        self.scales.extend(&other.scales);
        self.opacities.extend(&other.opacities);
        // All that is there stays: worlds are put together of thousands of parts.
        let rows = self.n_source..self.n_source + other.len();
        self.n_source = rows.end;
        self.order.extend(rows.map(|row| row as u32));
        self.up = self.up.or(other.up);
        (self.features, self.neighbors, self.mask) = (None, None, None);
    }

    /// Adds the coefficients of another scene, before its Gaussians are added.
    fn append_colors(&mut self, other: &Self) {
        let (before, n) = (self.sh.take(), self.len());
        let degrees = [&before, &other.sh].map(|sh| sh.as_ref().map_or(0, |sh| sh.degree));
        let degree = degrees[0].max(degrees[1]);
        let mut colors = match before {
            Some(sh) if sh.degree == degree => sh,
            before => {
                let mut wider = Sh { degree, coefficients: Vec::new() };
                extend(&mut wider, before.as_ref(), n);
                wider
            }
        };
        extend(&mut colors, other.sh.as_ref(), other.len());
        self.sh = Some(colors);
    }
}

/// Adds the coefficients of `n` Gaussians, whose degree is no higher.
fn extend(colors: &mut Sh, others: Option<&Sh>, n: usize) {
    let width = 3 * n_coefficients(colors.degree);
    let Some(others) = others else {
        colors.coefficients.resize(colors.coefficients.len() + n * width, 0.0);
        return;
    };
    colors.coefficients.reserve(n * width);
    for row in others.coefficients.chunks_exact(3 * n_coefficients(others.degree)) {
        let end = colors.coefficients.len() + width;
        colors.coefficients.extend_from_slice(row);
        colors.coefficients.resize(end, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Quat, Vec3};

    use super::*;

    /// One Gaussian at (x, x, x), whose coefficients are all `x`.
    fn part(degree: Option<u8>, x: f32) -> Scene {
        let sh = degree.map(|degree| Sh { degree, coefficients: vec![x; 3 * n_coefficients(degree)] });
        Scene {
            means: vec![Vec3::splat(x)],
            rotations: vec![Quat::IDENTITY],
            scales: vec![Vec3::splat(x)],
            opacities: vec![x / 4.0],
            order: vec![4],
            n_source: 5,
            sh,
            ..Scene::default()
        }
    }

    fn joined(parts: &[Scene]) -> Scene {
        let mut all = Scene::default();
        parts.iter().for_each(|part| all.append(part));
        all.validate().unwrap();
        all
    }

    #[test]
    fn scenes_come_one_after_the_other() {
        let all = joined(&[part(Some(0), 1.0), part(Some(0), 2.0), part(Some(0), 3.0)]);
        assert_eq!(all.means, [1.0, 2.0, 3.0].map(Vec3::splat));
        assert_eq!((&all.scales, &all.opacities[..]), (&all.means, &[0.25, 0.5, 0.75][..]));
        assert_eq!((&all.order[..], all.n_source), (&[0, 1, 2][..], 3));
        assert!(joined(&[]).is_empty());
    }

    #[test]
    fn colors_have_the_higher_degree() {
        // 4 coefficients of 3 channels, of which a part of degree 0 has the first.
        let (one, two) = ([1.0_f32; 12], [vec![2.0_f32; 3], vec![0.0; 9]].concat());
        let of = |parts: &[Scene]| {
            let sh = joined(parts).sh.unwrap();
            (sh.degree, sh.coefficients)
        };
        assert_eq!(of(&[part(Some(1), 1.0), part(Some(0), 2.0)]), (1, [&one[..], &two].concat()));
        assert_eq!(of(&[part(Some(0), 2.0), part(Some(1), 1.0)]), (1, [&two[..], &one].concat()));
        let gray = [0.0_f32; 12];
        assert_eq!(of(&[part(None, 2.0), part(Some(1), 1.0)]), (1, [&gray[..], &one].concat()));
        assert_eq!(of(&[part(Some(1), 1.0), part(None, 2.0)]), (1, [&one[..], &gray].concat()));
    }

    #[test]
    fn facts_of_both_are_kept_if_they_agree() {
        let far = |x: f64| Scene { offset: DVec3::new(x, 0.0, 0.0), ..part(Some(0), 1.0) };
        let all = joined(&[far(5e6), far(5e6 + 2.0)]);
        assert_eq!((all.offset.x, all.means[1]), (5e6, Vec3::new(3.0, 1.0, 1.0)));
        let up = |up: Option<Vec3>| Scene { up, ..part(Some(0), 1.0) };
        assert_eq!(joined(&[up(None), up(Some(Vec3::Z)), up(Some(Vec3::X))]).up, Some(Vec3::Z));
        let [classic, antialiased] = [ScreenFilter::Classic, ScreenFilter::Antialiased];
        let filtered = |filter: ScreenFilter| Scene { filter, ..part(Some(0), 1.0) };
        assert_eq!(joined(&[filtered(antialiased), filtered(antialiased)]).filter, antialiased);
        assert_eq!(joined(&[filtered(antialiased), filtered(classic)]).filter, classic);
        assert_eq!(joined(&[filtered(antialiased), Scene::default()]).filter, antialiased);
        let mut painted = part(Some(0), 1.0);
        painted.mask = Some(crate::mask::weights::Mask::new(1));
        painted.append(&part(Some(0), 2.0));
        assert!(painted.mask.is_none() && painted.validate().is_ok());
        // Rows 0 to 3 of its source were dropped.
        assert_eq!((&painted.order[..], painted.n_source), (&[4, 5][..], 6));
    }
}
