//! From what a style asks for, and what is prepared of a scene, to colors and strokes.
//!
//! A [`Recipe`] is a mix of looks and of styles. Looks are there already. Styles are laid on as strokes
//! ([`paint`]) or decoded ([`fold`]): [`is_painted`] says which.

use std::error::Error;

use crate::{
    ChannelStatistics, Decoder, Look, Scene,
    fold::{self, ChannelMap, StylizeError, normalized},
    look::{self, LookError},
    paint::{self, Canvas, Company, DirectionError, Hand, Painted, Pin, PinError, Surface},
    strokes::{MAX_TEXTURES, Strokes},
    work::{Canceled, Work},
};

/// A style of a scene.
pub struct Recipe<'a> {
    /// Looks of the scene.
    pub looks: Vec<WeightedLook<'a>>,
    /// Styles beside them.
    pub styles: Styles<'a>,
    /// Share of the base colors that looks and paint keep, or of the features that decoded styles keep, 0..1.
    pub content: f64,
}

/// A look of a mix.
pub struct WeightedLook<'a> {
    /// Its name, for messages.
    pub name: &'a str,
    /// The look.
    pub look: &'a Look,
    /// Its weight, at least 0.
    pub weight: f64,
}

/// Styles of a mix, and their weights, at least 0. All weights of a recipe are normalized together to sum 1.
pub enum Styles<'a> {
    /// Paintings, laid on as strokes.
    Painted {
        /// The paintings.
        paintings: Vec<(&'a Canvas, f64)>,
        /// The surface of the scene.
        surface: &'a Surface,
        /// Choices beside them. Its pins number the paintings.
        hand: Hand<'a>,
    },
    /// Statistics, decoded.
    Decoded {
        /// The statistics.
        styles: Vec<(&'a ChannelStatistics, f64)>,
        /// The decoder.
        decode: &'a mut dyn Decode,
    },
    /// Paint that was laid on [apart](crate::apart).
    Laid {
        /// What such a recipe without looks gave.
        painted: Painted,
        /// The weights of its paintings together.
        weight: f64,
    },
    /// None: there are looks alone.
    None,
}

/// Decodes a scene's features, mapped to a style, to colors. [`Decoder`]s do so on the CPU.
pub trait Decode {
    /// The color of each Gaussian `[N]`.
    ///
    /// # Errors
    /// If scene, decoder and map do not fit one another, if the device fails, or if `work` is canceled.
    fn decode(
        &mut self,
        scene: &Scene,
        map: &ChannelMap,
        work: &Work,
    ) -> Result<Vec<[f32; 3]>, Box<dyn Error + Send + Sync>>;
}

impl Decode for &Decoder {
    fn decode(
        &mut self,
        scene: &Scene,
        map: &ChannelMap,
        work: &Work,
    ) -> Result<Vec<[f32; 3]>, Box<dyn Error + Send + Sync>> {
        Ok(fold::stylize_if_wanted(scene, self, map, work)??)
    }
}

/// A recipe gives no style.
#[derive(Debug, thiserror::Error)]
pub enum RestyleError {
    /// Scene, styles or weights do not go together.
    #[error(transparent)]
    Stylize(#[from] StylizeError),
    /// A look belongs to another scene.
    #[error("{name}: {source}")]
    Look {
        /// The look.
        name: String,
        /// The fingerprints of both scenes.
        source: LookError,
    },
    /// The strength of the palette is no share.
    #[error("the palette's strength is {found}, expected a number from 0 to 1")]
    Palette {
        /// The strength.
        found: f32,
    },
    /// The direction of strokes is none.
    #[error(transparent)]
    Direction(#[from] DirectionError),
    /// There are too many paintings.
    #[error("found {found} paintings, expected at most {MAX_TEXTURES}")]
    Paintings {
        /// Their number.
        found: usize,
    },
    /// A pinned place is none of the paintings'.
    #[error(transparent)]
    Pin(#[from] PinError),
    /// The decoder fails.
    #[error(transparent)]
    Decode(Box<dyn Error + Send + Sync>),
    /// Nobody wants the style any more.
    #[error(transparent)]
    Canceled(#[from] Canceled),
}

/// Whether styles are laid on as paint. They are, unless somebody asks for a decoder, the scene carries
/// features with a decoder that was trained for them, or a style carries no paint.
pub fn is_painted(scene: &Scene, asks_for_decoder: bool, all_carry_paint: bool) -> bool {
    let has_own_decoder = scene.decoder.is_some() && scene.features.is_some();
    !asks_for_decoder && !has_own_decoder && all_carry_paint
}

impl Recipe<'_> {
    /// A painting alone.
    pub fn painting<'a>(canvas: &'a Canvas, surface: &'a Surface) -> Recipe<'a> {
        let styles = Styles::Painted { paintings: vec![(canvas, 1.0)], surface, hand: Hand::default() };
        Recipe { looks: Vec::new(), styles, content: 0.0 }
    }

    /// The colors and the strokes of `scene`.
    ///
    /// # Errors
    /// If parts do not go together: a look with the scene, decoded styles with a scene without features or with
    /// the decoder, weights or content with their ranges. If `work` is canceled.
    pub fn restyle(self, scene: &Scene, work: &Work) -> Result<Painted, RestyleError> {
        self.restyle_beside(scene, None, work)
    }

    /// As [`restyle`](Self::restyle), with its paint laid on as in the scene of `company`, if there is one: see
    /// [`paint::lay_beside`].
    ///
    /// # Errors
    /// As [`restyle`](Self::restyle).
    pub fn restyle_beside(
        self,
        scene: &Scene,
        company: Option<&Company>,
        work: &Work,
    ) -> Result<Painted, RestyleError> {
        self.made(scene, company.map_or(Present::Nothing, Present::Company), work)
    }

    /// The colors of `scene` under the `strokes` that the same recipe gave before its paintings changed: see
    /// [`paint::recolored`].
    ///
    /// # Errors
    /// As [`restyle`](Self::restyle).
    ///
    /// # Panics
    /// If the strokes are of another number of Gaussians.
    pub fn recolor(
        self,
        scene: &Scene,
        strokes: &Strokes,
        work: &Work,
    ) -> Result<Vec<[f32; 3]>, RestyleError> {
        Ok(self.made(scene, Present::Strokes(strokes), work)?.colors)
    }

    /// Colors, and new strokes unless there are some that stay.
    fn made(self, scene: &Scene, present: Present<'_>, work: &Work) -> Result<Painted, RestyleError> {
        if !(0.0..=1.0).contains(&self.content) {
            return Err(StylizeError::Content { found: self.content }.into());
        }
        // All weights in a row, the looks' first.
        let weights = self.looks.iter().map(|look| look.weight).chain(self.styles.weights());
        let weights = normalized(&weights.collect::<Vec<_>>())?;
        let (of_looks, of_styles) = weights.split_at(self.looks.len());
        // Before the styles, which take longer: a look of another scene must not make its user wait.
        let (mut colors_of_looks, mut parts) = (Vec::new(), Vec::new());
        for (WeightedLook { name, look, .. }, weight) in self.looks.iter().zip(of_looks) {
            work.check()?;
            let failed = |source| RestyleError::Look { name: (*name).into(), source };
            colors_of_looks.push((look.colors_for(scene).map_err(failed)?, *weight));
            let mut strokes = look.strokes_for(scene).map_err(failed)?.unwrap_or_default();
            strokes.fade(1.0 - self.content as f32);
            parts.push((strokes, *weight));
        }
        let share: f64 = of_styles.iter().sum();
        // Styles of no weight beside a look need not be computed.
        let styled = if share > 0.0 {
            self.styles.made(scene, self.content, present, work)?
        } else {
            Painted::default()
        };
        if parts.is_empty() {
            return Ok(styled);
        }
        let colors = (share > 0.0).then_some((&*styled.colors, share));
        let colors = look::mix(&scene.base_colors(), self.content, &colors_of_looks, colors)?;
        let strokes = mixed(std::iter::once((styled.strokes, share)).chain(parts));
        Ok(Painted { colors, strokes, ..Painted::default() })
    }
}

/// Paint that is there before a recipe's own.
enum Present<'a> {
    Nothing,
    /// That of a scene that this one stands beside, or is a part of.
    Company(&'a Company),
    /// Strokes of this scene, which stay.
    Strokes(&'a Strokes),
}

impl Styles<'_> {
    fn weights(&self) -> Vec<f64> {
        match self {
            Self::Painted { paintings, .. } => paintings.iter().map(|(_, weight)| *weight).collect(),
            Self::Decoded { styles, .. } => styles.iter().map(|(_, weight)| *weight).collect(),
            Self::Laid { weight, .. } => vec![*weight],
            Self::None => Vec::new(),
        }
    }

    fn made(
        self,
        scene: &Scene,
        content: f64,
        present: Present<'_>,
        work: &Work,
    ) -> Result<Painted, RestyleError> {
        match self {
            Self::Painted { paintings, surface, hand } => {
                if !(0.0..=1.0).contains(&hand.palette) {
                    return Err(RestyleError::Palette { found: hand.palette });
                }
                if let Some(direction) = &hand.direction {
                    direction.check()?;
                }
                if paintings.len() > MAX_TEXTURES {
                    return Err(RestyleError::Paintings { found: paintings.len() });
                }
                if let Present::Strokes(under) = present {
                    let colors = paint::recolored(scene, surface, &paintings, &hand, content, under, work)?;
                    return Ok(Painted { colors, ..Painted::default() });
                }
                if let Present::Company(company) = present {
                    let how = (&hand, content, company);
                    return Ok(paint::lay_beside(scene, surface, &paintings, how, work)?);
                }
                Pin::check_for(hand.pins, surface, paintings.iter().map(|(canvas, _)| *canvas))?;
                Ok(paint::lay(scene, surface, &paintings, &hand, content, work)?)
            }
            Self::Decoded { styles, decode } => {
                let features = scene.features.as_ref().ok_or(StylizeError::NoFeatures)?;
                let map = fold::transfer(features, &styles, content)?;
                work.check()?;
                let colors = decode.decode(scene, &map, work);
                work.check()?;
                let colors = colors.map_err(RestyleError::Decode)?;
                Ok(Painted { colors, ..Painted::default() })
            }
            Self::Laid { painted, .. } => Ok(painted),
            Self::None => Ok(Painted::default()),
        }
    }
}

/// Strokes in a mix by their weights. Each spot shows those of one part, and some show none if a part has none.
fn mixed(parts: impl Iterator<Item = (Strokes, f64)>) -> Strokes {
    let (mut mixed, mut total) = (Strokes::default(), 0.0);
    for (strokes, weight) in parts.filter(|(_, weight)| *weight > 0.0) {
        total += weight;
        mixed.mix(&strokes, (weight / total) as f32);
    }
    mixed
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;
    use crate::{look::MadeFrom, paint::Paint};

    fn scene() -> Scene {
        let mut scene = Scene {
            means: (0..100).map(|i| Vec3::new((i % 10) as f32, (i / 10) as f32, 0.0)).collect(),
            rotations: vec![Quat::IDENTITY; 100],
            scales: vec![Vec3::new(0.5, 0.5, 0.01); 100],
            opacities: vec![0.9; 100],
            order: (0..100).collect(),
            n_source: 100,
            ..Scene::default()
        };
        scene.set_colors(&vec![[0.2, 0.4, 0.6]; 100]);
        scene
    }

    fn canvas() -> Canvas {
        Canvas::new(&Paint {
            width: 32,
            height: 32,
            pixels: (0..3 * 32 * 32).map(|i| (i % 251) as u8).collect(),
            used: None,
        })
    }

    #[test]
    fn looks_and_paint_are_mixed_by_all_weights_together() {
        let (scene, canvas, work) = (scene(), canvas(), Work::default());
        let surface = Surface::new(&scene, &work).unwrap();
        let painted = Recipe::painting(&canvas, &surface).restyle(&scene, &work).unwrap();
        let look = Look::new(&scene, &vec![[0.5, 0.25, 0.0]; 100], MadeFrom::default());
        let recipe = |of_look: f64, of_painting: f64| Recipe {
            looks: vec![WeightedLook { name: "look", look: &look, weight: of_look }],
            styles: Styles::Painted {
                paintings: vec![(&canvas, of_painting)],
                surface: &surface,
                hand: Hand::default(),
            },
            content: 0.0,
        };
        let mixed = recipe(1.0, 3.0).restyle(&scene, &work).unwrap();
        let laid = Styles::Laid { painted: painted.clone(), weight: 3.0 };
        let of_laid = Recipe { styles: laid, ..recipe(1.0, 3.0) }.restyle(&scene, &work).unwrap();
        assert_eq!((&of_laid.colors, &of_laid.strokes), (&mixed.colors, &mixed.strokes));
        for (mixed, painted) in mixed.colors.iter().zip(&painted.colors) {
            let expected = Vec3::from(*painted) * 0.75 + Vec3::new(0.5, 0.25, 0.0) * 0.25;
            assert!(Vec3::from(*mixed).distance(expected) < 1e-5, "{mixed:?} {expected}");
        }
        let alone = recipe(2.0, 0.0).restyle(&scene, &work).unwrap();
        assert_eq!(alone.colors, vec![[0.5, 0.25, 0.0]; 100]);
        assert!(alone.strokes.seeds.is_empty());
        assert!(matches!(recipe(0.0, 0.0).restyle(&scene, &work), Err(RestyleError::Stylize(_))));
        let other = scene.subset(&[0, 1, 2]);
        let found = recipe(1.0, 0.0).restyle(&other, &work).map(|_| ());
        assert!(matches!(found, Err(RestyleError::Look { name, .. }) if name == "look"));
    }

    #[test]
    fn nothing_is_given_once_it_is_canceled() {
        let (scene, canvas, work) = (scene(), canvas(), Work::default());
        let surface = Surface::new(&scene, &work).unwrap();
        work.cancel();
        assert_eq!(Surface::new(&scene, &work).err(), Some(Canceled));
        let found = Recipe::painting(&canvas, &surface).restyle(&scene, &work).map(|_| ());
        assert!(matches!(found, Err(RestyleError::Canceled(Canceled))));
    }

    #[test]
    fn a_decoder_is_used_if_there_is_a_reason() {
        let plain = scene();
        assert!(is_painted(&plain, false, true));
        assert!(!is_painted(&plain, true, true));
        assert!(!is_painted(&plain, false, false));
    }
}
