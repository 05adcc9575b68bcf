//! Looks: the colors of one scene's Gaussians, made for a painting, and the strokes over them.
//!
//! A [`Look`] keeps its colors and strokes in the order of the scene's source, because readers order Gaussians
//! differently: a `.ply` keeps the source's order, a `.sgs` is in Morton order. [`Look::new`],
//! [`Look::with_strokes`], [`Look::colors_for`] and [`Look::strokes_for`] convert from and to the order of a
//! scene in memory, and [`OrderedLook`] keeps that order.

use std::{fmt, ops::Range, str::FromStr};

use crate::{fold::StylizeError, random::hash, scene::Scene, strokes::Strokes};

/// Colors of the Gaussians of one scene, the strokes over them, and their origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Display-referred RGB `[N]`, not clamped, in the order of the scene's source.
    pub colors: Vec<[f32; 3]>,
    /// Strokes that are drawn over the colors, their words `[N]` in the same order; `None` if there are none.
    pub strokes: Option<Strokes>,
    /// The scene that the colors belong to.
    pub scene: SceneFingerprint,
    /// Paintings and settings that gave the colors.
    pub made_from: MadeFrom,
}

/// A look in the order of a scene in memory, for parts of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderedLook {
    /// Display-referred RGB `[N]`, not clamped, in the order of the scene.
    pub colors: Vec<[f32; 3]>,
    /// Strokes that are drawn over the colors, their words `[N]` in the same order; `None` if there are none.
    pub strokes: Option<Strokes>,
    /// Paintings and settings that gave the colors.
    pub made_from: MadeFrom,
}

/// Paintings and settings that a look was made from, for people and for repeating it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MadeFrom {
    /// The paintings.
    pub paintings: Vec<Painting>,
    /// Strength of the style against the scene's own structure: 0 is the recolored scene, 1 the default.
    pub strength: f64,
    /// Number of steps of optimization.
    pub steps: u64,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// A painting that a look was made from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Painting {
    /// The file's name, or another name for people.
    pub name: String,
    /// The painting's share, 0..1. The shares of a look sum to 1.
    pub weight: f64,
}

/// Identity of a scene's geometry: the number of Gaussians, and a hash of their means in the order of the
/// source.
///
/// Means alone, because every reader and writer keeps their bits. So the fingerprint survives embedding,
/// `.sgs`, export to 3DGS `.ply` and another machine's `exp`, as well as any change of colors, features,
/// decoder or neighbors. It does not survive anything that moves, adds, drops or splits Gaussians, nor a
/// compressed `.ply`, which rounds means.
///
/// Written as `N@hash`, the hash in 16 hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneFingerprint {
    /// N, the number of Gaussians.
    pub n_gaussians: usize,
    /// The hash.
    pub hash: u64,
}

/// A look that belongs to another scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found a look of another scene ({found}), expected one of this scene ({expected})")]
pub struct LookError {
    /// The scene that the look belongs to.
    pub found: SceneFingerprint,
    /// The scene that it was asked for.
    pub expected: SceneFingerprint,
}

impl Look {
    /// The look of `scene` in `colors` `[N]`: display-referred RGB in the scene's order.
    ///
    /// # Panics
    /// If there is not one color per Gaussian.
    pub fn new(scene: &Scene, colors: &[[f32; 3]], made_from: MadeFrom) -> Self {
        assert_eq!(colors.len(), scene.len(), "one color per Gaussian");
        let in_source_order = scene.by_source().into_iter().map(|i| colors[i as usize]).collect();
        Self { colors: in_source_order, strokes: None, scene: SceneFingerprint::of(scene), made_from }
    }

    /// The look with `strokes` over its colors, whose words `[N]` are in the order of the same `scene`. Strokes
    /// without seeds are none.
    ///
    /// # Panics
    /// If there is not one word per Gaussian.
    #[must_use]
    pub fn with_strokes(self, scene: &Scene, strokes: &Strokes) -> Self {
        if strokes.seeds.is_empty() {
            return Self { strokes: None, ..self };
        }
        assert_eq!(strokes.words.len(), scene.len(), "one word per Gaussian");
        let words = scene.by_source().into_iter().map(|i| strokes.words[i as usize]).collect();
        let Strokes { seeds, textures, .. } = strokes.clone();
        Self { strokes: Some(Strokes { seeds, words, textures }), ..self }
    }

    /// The colors `[N]` in the order of `scene`, display-referred RGB, not clamped.
    ///
    /// # Errors
    /// If the look belongs to another scene.
    pub fn colors_for(&self, scene: &Scene) -> Result<Vec<[f32; 3]>, LookError> {
        self.in_order(&self.colors, scene)
    }

    /// The strokes over the colors, their words `[N]` in the order of `scene`; `None` if the look has none.
    ///
    /// # Errors
    /// If the look belongs to another scene.
    pub fn strokes_for(&self, scene: &Scene) -> Result<Option<Strokes>, LookError> {
        let in_order = |strokes: &Strokes| {
            let words = self.in_order(&strokes.words, scene)?;
            Ok(Strokes { words, seeds: strokes.seeds.clone(), textures: strokes.textures.clone() })
        };
        self.strokes.as_ref().map(in_order).transpose()
    }

    /// Whether strokes are drawn over the colors.
    pub fn has_strokes(&self) -> bool {
        self.strokes.is_some()
    }

    /// The look in the order of `scene`.
    ///
    /// # Errors
    /// If the look belongs to another scene.
    pub fn ordered(&self, scene: &Scene) -> Result<OrderedLook, LookError> {
        Ok(OrderedLook {
            colors: self.colors_for(scene)?,
            strokes: self.strokes_for(scene)?,
            made_from: self.made_from.clone(),
        })
    }

    /// Values `[N]` of the source's Gaussians in the order of `scene`.
    fn in_order<T: Copy + Default>(&self, values: &[T], scene: &Scene) -> Result<Vec<T>, LookError> {
        let expected = SceneFingerprint::of(scene);
        // The number of values is compared as well, since a fingerprint is a public value that anybody can set.
        if self.scene != expected || values.len() != scene.len() {
            return Err(LookError { found: self.scene, expected });
        }
        let mut in_order = vec![T::default(); scene.len()];
        for (value, i) in values.iter().zip(scene.by_source()) {
            in_order[i as usize] = *value;
        }
        Ok(in_order)
    }

    /// N, the number of colors.
    pub fn len(&self) -> usize {
        self.colors.len()
    }

    /// Whether the look has no color.
    pub fn is_empty(&self) -> bool {
        self.colors.is_empty()
    }
}

impl OrderedLook {
    /// The look of the Gaussians of `scene` in `range`, as [`Scene::subset`] has them. The scene is the one
    /// whose order this is.
    ///
    /// # Panics
    /// If the range reaches beyond N.
    pub fn part(&self, scene: &Scene, range: Range<usize>) -> Look {
        // Means and their order are all that a look asks for.
        let part = Scene {
            means: scene.means[range.clone()].to_vec(),
            order: scene.order[range.clone()].to_vec(),
            n_source: scene.n_source,
            ..Scene::default()
        };
        let look = Look::new(&part, &self.colors[range.clone()], self.made_from.clone());
        match &self.strokes {
            Some(strokes) => {
                let indices: Vec<u32> = range.map(|i| i as u32).collect();
                look.with_strokes(&part, &strokes.subset(&indices))
            }
            None => look,
        }
    }
}

/// Mixes looks with one another, and with the colors of a style if there are any:
///
/// ```text
/// w_style style + sum_j w_j (c base + (1 - c) look_j)
/// ```
///
/// All colors are `[N]`, in the order of the scene whose base colors are `base`; weights sum to 1. `content` c
/// blends looks with the base colors; a style's colors have kept their share of the content already.
///
/// # Errors
/// If `content` is not in 0..=1.
///
/// # Panics
/// If two parts have different numbers of colors.
pub fn mix(
    base: &[[f32; 3]],
    content: f64,
    looks: &[(Vec<[f32; 3]>, f64)],
    style: Option<(&[[f32; 3]], f64)>,
) -> Result<Vec<[f32; 3]>, StylizeError> {
    if !(0.0..=1.0).contains(&content) {
        return Err(StylizeError::Content { found: content });
    }
    let mut sum = vec![[0.0; 3]; base.len()];
    let mut add = |colors: &[[f32; 3]], weight: f64| {
        assert_eq!(colors.len(), base.len(), "one color per Gaussian");
        let weight = weight as f32;
        let values = sum.as_flattened_mut().iter_mut().zip(colors.as_flattened());
        values.for_each(|(sum, value)| *sum += weight * value);
    };
    style.into_iter().for_each(|(colors, weight)| add(colors, weight));
    looks.iter().for_each(|(colors, weight)| add(colors, weight * (1.0 - content)));
    add(base, content * looks.iter().map(|(_, weight)| weight).sum::<f64>());
    Ok(sum)
}

impl SceneFingerprint {
    /// The fingerprint of `scene`.
    pub fn of(scene: &Scene) -> Self {
        Self::in_order(scene, &scene.by_source())
    }

    /// The fingerprint of `scene`, whose Gaussians come in the order `by_source` from its source.
    pub(crate) fn in_order(scene: &Scene, by_source: &[u32]) -> Self {
        let hash_of_gaussian = |(rank, &i): (u64, &u32)| {
            // Adding 0 makes 0 of -0, which texts in files do not always keep.
            let [x, y, z] = (scene.means[i as usize] + 0.0).to_array().map(|v| u64::from(v.to_bits()));
            // The rank counts too: the same Gaussians in another order would get the wrong colors.
            hash(hash((rank << 32) | x) ^ ((y << 32) | z))
        };
        let hashes = (0..).zip(by_source).map(hash_of_gaussian);
        Self { n_gaussians: scene.len(), hash: hashes.fold(0, u64::wrapping_add) }
    }
}

impl fmt::Display for SceneFingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}@{:016x}", self.n_gaussians, self.hash)
    }
}

/// A text that is not of the form `N@hash`.
#[derive(Debug, thiserror::Error)]
#[error("fingerprint `{found}` is not of the form `N@hash`")]
pub struct FingerprintError {
    found: String,
}

impl FromStr for SceneFingerprint {
    type Err = FingerprintError;

    fn from_str(text: &str) -> Result<Self, FingerprintError> {
        let parsed = text.split_once('@').and_then(|(n, hash)| {
            Some(Self { n_gaussians: n.parse().ok()?, hash: u64::from_str_radix(hash, 16).ok()? })
        });
        parsed.ok_or_else(|| FingerprintError { found: text.into() })
    }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;
    use crate::{scene::Sh, strokes::StrokeSeed};

    /// Gaussians at x = 3, 0, 2, 1, read from rows 3, 0, 2 and 1 of a source, so that the order is that of x.
    fn scene() -> Scene {
        let xs = [3.0, 0.0, 2.0, 1.0_f32];
        Scene {
            means: xs.map(|x| Vec3::new(x, -0.0, 0.5)).into(),
            rotations: vec![Quat::IDENTITY; 4],
            scales: vec![Vec3::ONE; 4],
            opacities: vec![0.5; 4],
            order: vec![3, 0, 2, 1],
            n_source: 4,
            ..Scene::default()
        }
    }

    #[test]
    fn colors_follow_their_gaussians() {
        let scene = scene();
        let colors = scene.means.iter().map(|mean| [mean.x, 0.0, -mean.x]).collect::<Vec<_>>();
        let look = Look::new(&scene, &colors, MadeFrom::default());
        assert_eq!(look.colors[1], [1.0, 0.0, -1.0], "in the source's order");
        assert_eq!(look.colors_for(&scene).unwrap(), colors);
        let moved = scene.subset(&[1, 3, 0, 2]);
        let of_moved = look.colors_for(&moved).unwrap();
        assert!(moved.means.iter().zip(&of_moved).all(|(mean, color)| mean.x == color[0]), "{of_moved:?}");
    }

    #[test]
    fn strokes_follow_their_gaussians() {
        let scene = scene();
        let look = Look::new(&scene, &[[0.5; 3]; 4], MadeFrom::default());
        assert!(!look.has_strokes() && look.strokes_for(&scene).unwrap().is_none());
        let words: Vec<u32> = scene.means.iter().map(|mean| mean.x as u32).collect();
        let strokes = Strokes { words, seeds: vec![StrokeSeed::default(); 4], textures: Vec::new() };
        let look = look.with_strokes(&scene, &strokes);
        assert_eq!(look.strokes_for(&scene).unwrap().unwrap(), strokes);
        let moved = scene.subset(&[1, 3, 0, 2]);
        let of_moved = look.strokes_for(&moved).unwrap().unwrap().words;
        assert!(moved.means.iter().zip(&of_moved).all(|(mean, word)| mean.x as u32 == *word), "{of_moved:?}");
        assert!(look.strokes_for(&scene.subset(&[0, 1, 2])).is_err());
        assert!(!look.with_strokes(&scene, &Strokes::default()).has_strokes());
    }

    #[test]
    fn a_part_has_its_own_colors_and_seeds() {
        let scene = scene();
        let colors = scene.means.iter().map(|mean| [mean.x; 3]).collect::<Vec<_>>();
        // Seed 7 of x = 3, and so on, with other bits beside it.
        let seed = |i: u32| StrokeSeed { look: i, ..StrokeSeed::default() };
        let words = vec![0xABC0_0007, 0xABC0_0005, 0xABC0_0007, 0xABC0_0002];
        let strokes = Strokes { words, seeds: (0..8).map(seed).collect(), textures: Vec::new() };
        let look = Look::new(&scene, &colors, MadeFrom::default()).with_strokes(&scene, &strokes);
        let ordered = look.ordered(&scene).unwrap();
        assert_eq!(ordered.colors, colors);
        let part = scene.subset(&[0, 1, 2]);
        let found = ordered.part(&scene, 0..3);
        assert_eq!(found.colors_for(&part).unwrap(), [[3.0; 3], [0.0; 3], [2.0; 3]]);
        let strokes = found.strokes_for(&part).unwrap().unwrap();
        assert_eq!(strokes.seeds.len(), 2, "two of eight are used");
        let of = |word: u32| (word & 0xFFFC_0000, strokes.seeds[(word & 0x3_FFFF) as usize]);
        let expected = [7, 5, 7].map(|i| (0xABC0_0000, seed(i)));
        assert_eq!(strokes.words.iter().map(|&word| of(word)).collect::<Vec<_>>(), expected);
        assert!(look.ordered(&part).is_err());
    }

    #[test]
    fn a_fingerprint_is_of_the_means_alone() {
        let fingerprint = SceneFingerprint::of(&scene());
        let of = |change: fn(&mut Scene)| {
            let mut changed = scene();
            change(&mut changed);
            SceneFingerprint::of(&changed)
        };
        // Rows that were dropped while reading leave gaps. An exported file has none.
        let same: [fn(&mut Scene); 4] = [
            |s| s.order = vec![9, 1, 5, 2],
            |s| s.means[0].y = 0.0,
            |s| s.scales[2] = Vec3::splat(1.000_001),
            |s| s.sh = Some(Sh { degree: 0, coefficients: vec![1.0; 12] }),
        ];
        assert!(same.into_iter().all(|change| of(change) == fingerprint));
        let other: [fn(&mut Scene); 4] = [
            |s| s.means[0].z = 0.500_000_06,
            |s| s.means.swap(0, 1),
            |s| s.order.swap(0, 1),
            |s| *s = s.subset(&[0, 1, 2]),
        ];
        assert!(other.into_iter().all(|change| of(change) != fingerprint));
        assert_eq!(fingerprint.to_string().parse::<SceneFingerprint>().unwrap(), fingerprint);
        assert_eq!(SceneFingerprint::of(&Scene::default()).to_string(), "0@0000000000000000");
    }

    #[test]
    fn a_mix_by_hand() {
        let looks = [(vec![[1.0, 0.0, 0.5]], 0.25), (vec![[0.0, 1.0, 0.5]], 0.25)];
        let (base, style) = ([[0.5, 0.5, 1.0]], [[1.5, 0.0, 0.0]]);
        let of = |content| mix(&base, content, &looks, Some((&style, 0.5)));
        assert_eq!(of(0.0).unwrap(), [[1.0, 0.25, 0.25]]);
        // Half of the looks' share becomes the base color's. The style has its own share of the content.
        assert_eq!(of(0.5).unwrap(), [[1.0, 0.25, 0.375]]);
        assert_eq!(mix(&base, 1.0, &[(vec![[9.0; 3]], 1.0)], None).unwrap(), base);
        for content in [-0.1, 1.1, f64::NAN] {
            assert!(matches!(of(content), Err(StylizeError::Content { .. })), "{content}");
        }
    }

    #[test]
    fn another_scene_is_refused() {
        let look = Look::new(&scene(), &[[0.5; 3]; 4], MadeFrom::default());
        let other = scene().subset(&[0, 1, 2]);
        let error = look.colors_for(&other).unwrap_err();
        assert_eq!((error.found.n_gaussians, error.expected.n_gaussians), (4, 3));
        let lie = Look { scene: SceneFingerprint::of(&other), ..look };
        assert!(lie.colors_for(&other).is_err(), "the fingerprint of three Gaussians, but four colors");
        for text in ["", "4", "4@", "x@00", "4@0g", "-1@00"] {
            assert!(text.parse::<SceneFingerprint>().is_err(), "{text}");
        }
    }
}
