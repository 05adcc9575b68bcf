//! The paint of a style, as meshes take it.

use std::sync::Arc;

use stylegaussian::{
    Scene,
    mesh::Sky,
    paint::{Hand, Painted, Surface},
    restyle::{self, Recipe},
    work::Work,
};

use super::{
    beside::Beside,
    later::Failure,
    request::{Decided, LaterCanvas, Same, as_parts, made},
};

/// Paintings, and how they are laid on. Two that are equal paint alike.
pub(crate) struct Brushwork {
    canvases: Vec<(Same<LaterCanvas>, f64)>,
    decided: Decided,
    /// Share of the content's colors that stays, 0..1.
    content: f64,
    /// The painted scene that meshes stand beside, or `None` if each stands alone.
    beside: Option<Beside>,
}

impl PartialEq for Brushwork {
    fn eq(&self, other: &Self) -> bool {
        let of = |brushwork: &Self| {
            let beside = brushwork.beside.as_ref();
            beside.map(|beside| (Same(Arc::clone(&beside.surface)), Same(Arc::clone(&beside.strokes))))
        };
        self.canvases == other.canvases
            && self.decided == other.decided
            && self.content == other.content
            && of(self) == of(other)
    }
}

impl Brushwork {
    pub(super) fn new(
        canvases: Vec<(Same<LaterCanvas>, f64)>,
        decided: Decided,
        content: f64,
        beside: Option<Beside>,
    ) -> Self {
        Self { canvases, decided, content, beside }
    }

    /// Size of a pixel of the painting in units of the painted scene, or `None` if meshes stand alone.
    pub(crate) fn pixel(&self) -> Option<f32> {
        self.beside.as_ref().map(|beside| beside.surface.pixel())
    }

    /// The scale at which a sky is painted: see [`Sky::scale`].
    pub(crate) fn sky_scale(&self) -> f32 {
        self.beside.as_ref().map_or(1.0, |beside| Sky::scale(&beside.surface))
    }

    /// Paints the spots of a mesh, in whose units one of the painted scene has the size `scale`. Not for the
    /// main thread.
    ///
    /// # Errors
    /// If nobody wants it any more, or it cannot be had.
    pub(crate) fn paint(&self, spots: &Scene, scale: f32, work: &Work) -> Result<Painted, Failure> {
        let canvases = made(&self.canvases, &work.part(0.0, 0.1))?;
        let at = work.part(0.1, 0.1);
        let tints = self.decided.tints.as_ref().map(|tints| tints.made(&at)).transpose()?;
        let paintings = as_parts(&canvases);
        let hand = Hand {
            is_collection: self.decided.is_collection,
            tints: tints.as_ref(),
            palette: self.decided.palette,
            direction: self.decided.direction(),
            pins: &[],
        };
        let (surfaces, laying) = (work.part(0.1, 0.6), work.part(0.6, 1.0));
        let (mut company, mut surface) = (None, None);
        if let Some(beside) = &self.beside {
            company = beside.company(&paintings, &hand, work)?;
            if company.is_some() {
                surface = Some(Surface::beside(spots, &beside.surface, scale, &surfaces)?);
            }
        }
        let surface = match surface {
            Some(surface) => surface,
            None => Surface::new(spots, &surfaces)?,
        };
        let styles = restyle::Styles::Painted { paintings, surface: &surface, hand };
        let recipe = Recipe { looks: Vec::new(), styles, content: self.content };
        Ok(recipe.restyle_beside(spots, company, &laying)?)
    }
}
