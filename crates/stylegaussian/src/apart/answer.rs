//! The answers to calls.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::{
    ApartError, CANVAS, FORGET_CANVAS, FORGET_SURFACE, LAY, PIN, SURFACE,
    bytes::{Reader, piece},
    paint, read_optional, scene,
};
use crate::{
    paint::{Canvas, Company, Direction, Hand, Painted, Pin, Surface, Tints, pin},
    restyle::{Recipe, Styles},
    scene::Scene,
    strokes::Strokes,
    work::Work,
};

/// The answering side, with all that it keeps.
#[derive(Default)]
pub struct Apart {
    pub(super) surfaces: HashMap<u32, Ground>,
    pub(super) canvases: HashMap<u32, Canvas>,
}

/// A scene and its surface.
pub(super) struct Ground {
    scene: Scene,
    surface: Surface,
    last: Option<Last>,
}

/// The paint that was laid on a scene last, for its parts.
struct Last {
    /// The call, behind its surfaces.
    asked: Vec<u8>,
    /// Seeds and textures.
    strokes: Strokes,
    /// Facts for its parts, once one of them has asked. `None` in it if there are none.
    company: Option<Option<Company>>,
}

impl Apart {
    /// Answers a call.
    ///
    /// # Errors
    /// If the bytes are no call, if it names what was not given or is forgotten, or if the style cannot be had.
    pub fn answer(&mut self, call: &[u8], work: &Work) -> Result<Vec<u8>, ApartError> {
        let mut reader = Reader(call);
        let [kind, number] = reader.some()?;
        match kind {
            SURFACE => {
                let whole = read_optional(&mut reader)?;
                let scene = scene(reader)?;
                let surface = match whole {
                    Some(whole) => Surface::part_of(&scene, &self.ground(whole)?.surface, work)?,
                    None => Surface::new(&scene, work)?,
                };
                self.surfaces.insert(number, Ground { scene, surface, last: None });
            }
            CANVAS => {
                self.canvases.insert(number, Canvas::new_if_wanted(&paint(reader)?, work)?);
            }
            LAY => return self.lay(number, reader, work),
            PIN => return self.pin(number, reader),
            FORGET_SURFACE => {
                self.surfaces.remove(&number);
            }
            FORGET_CANVAS => {
                self.canvases.remove(&number);
            }
            _ => return Err(ApartError::Unknown { what: "call" }),
        }
        Ok(Vec::new())
    }

    fn lay(&mut self, surface: u32, mut reader: Reader, work: &Work) -> Result<Vec<u8>, ApartError> {
        let whole = read_optional(&mut reader)?;
        let asked = reader.0;
        let laid = Laid::read(&mut reader)?;
        reader.end()?;
        if let Some(whole) = whole {
            self.meet(whole, asked, &laid, work)?;
        }
        let painted = self.painted(surface, &laid, whole, work)?;
        let bytes = painted.to_bytes();
        self.note(surface, asked, painted);
        Ok(bytes)
    }

    /// Lays paint on a scene, which may be a part of another one that was [met](Self::meet).
    fn painted(
        &self,
        surface: u32,
        laid: &Laid,
        whole: Option<u32>,
        work: &Work,
    ) -> Result<Painted, ApartError> {
        let Ground { scene, surface, .. } = self.ground(surface)?;
        let tints = laid.tints(self)?;
        let hand = Hand { tints: tints.as_ref(), ..laid.hand() };
        let paintings = laid.paintings(self)?;
        let whole = whole.map(|whole| self.ground(whole)).transpose()?;
        let company = whole.and_then(|whole| whole.last.as_ref()?.company.as_ref()?.as_ref());
        let styles = Styles::Painted { paintings, surface, hand };
        let recipe = Recipe { looks: Vec::new(), styles, content: laid.content };
        Ok(recipe.restyle_beside(scene, company, work)?)
    }

    /// Sees that a scene has this paint, and what its parts need to know of that.
    fn meet(&mut self, number: u32, asked: &[u8], laid: &Laid, work: &Work) -> Result<(), ApartError> {
        let is_asked = |last: &Last| last.asked == asked;
        if !self.ground(number)?.last.as_ref().is_some_and(is_asked) {
            let painted = self.painted(number, laid, None, work)?;
            self.note(number, asked, painted);
        }
        let Ground { surface, last: Some(last), .. } = self.ground(number)? else { return Ok(()) };
        if last.company.is_some() {
            return Ok(());
        }
        let tints = laid.tints(self)?;
        let hand = Hand { tints: tints.as_ref(), ..laid.hand() };
        let company = Company::new(surface, &laid.paintings(self)?, &hand, &last.strokes, work)?;
        if let Some(last) = self.surfaces.get_mut(&number).and_then(|ground| ground.last.as_mut()) {
            last.company = Some(company);
        }
        Ok(())
    }

    /// Notes what was laid on a scene.
    fn note(&mut self, number: u32, asked: &[u8], painted: Painted) {
        if let Some(ground) = self.surfaces.get_mut(&number) {
            let strokes = Strokes { words: Vec::new(), ..painted.strokes };
            ground.last = Some(Last { asked: asked.to_vec(), strokes, company: None });
        }
    }

    fn pin(&self, surface: u32, mut reader: Reader) -> Result<Vec<u8>, ApartError> {
        let Ground { surface, .. } = self.ground(surface)?;
        // Those that are pinned stay as they are beside any other.
        read_optional(&mut reader)?;
        let laid = Laid::read(&mut reader)?;
        let mut strokes = Strokes { seeds: reader.list()?, ..Strokes::default() };
        reader.end()?;
        pin(&mut strokes, surface, &laid.paintings(self)?, &laid.hand())
            .map_err(|error| ApartError::Style(error.to_string()))?;
        Ok(piece(&strokes.seeds).into_owned())
    }

    fn ground(&self, number: u32) -> Result<&Ground, ApartError> {
        self.surfaces.get(&number).ok_or(ApartError::Unknown { what: "surface" })
    }

    fn canvas(&self, number: u32) -> Result<&Canvas, ApartError> {
        self.canvases.get(&number).ok_or(ApartError::Unknown { what: "canvas" })
    }
}

/// A [`Laying`](super::Laying) that was read.
struct Laid {
    is_collection: bool,
    /// Whether strokes follow a vector (1), a curve (2) or nothing (0), and its points.
    direction: (u32, Vec<Vec3>),
    palette: f32,
    content: f64,
    numbers: Vec<u32>,
    weights: Vec<f64>,
    tints: [u32; 2],
    colors: Vec<[f32; 3]>,
    pins: Vec<Pin>,
}

impl Laid {
    /// Reads what follows the surface.
    fn read(reader: &mut Reader) -> Result<Self, ApartError> {
        let [is_collection, direction] = reader.some()?;
        let (is_collection, direction) = (is_collection != 0, (direction, reader.list()?));
        let (palette, content) = (reader.one()?, reader.one()?);
        let numbers: Vec<u32> = reader.list()?;
        let weights = reader.values(numbers.len())?;
        let (tints, colors) = (reader.some()?, reader.list()?);
        let places: Vec<[f32; 5]> = reader.list()?;
        let of_pins: Vec<u32> = reader.values(places.len())?;
        let pin = |([x, y, z, u, v], painting): ([f32; 5], u32)| Pin {
            at: Vec3::new(x, y, z),
            place: Vec2::new(u, v),
            painting: painting as usize,
        };
        let pins = places.into_iter().zip(of_pins).map(pin).collect();
        Ok(Self { is_collection, direction, palette, content, numbers, weights, tints, colors, pins })
    }

    fn paintings<'a>(&self, apart: &'a Apart) -> Result<Vec<(&'a Canvas, f64)>, ApartError> {
        let painting = |(number, weight): (&u32, &f64)| Ok((apart.canvas(*number)?, *weight));
        self.numbers.iter().zip(&self.weights).map(painting).collect()
    }

    fn tints(&self, apart: &Apart) -> Result<Option<Tints>, ApartError> {
        Ok(match self.tints {
            [0, _] => None,
            [1, number] => Some(apart.canvas(number)?.tints().clone()),
            _ => Some(Tints::of_colors(&self.colors)?),
        })
    }

    fn hand(&self) -> Hand<'_> {
        Hand {
            is_collection: self.is_collection,
            tints: None,
            palette: self.palette,
            direction: match &self.direction {
                (1, points) => points.first().copied().map(Direction::Along),
                (2, points) => Some(Direction::Curve(points)),
                _ => None,
            },
            pins: &self.pins,
        }
    }
}
