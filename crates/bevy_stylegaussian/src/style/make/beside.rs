//! A painted scene, as others know it that are painted to stand beside it, or to be parts of it.

use std::sync::{Arc, OnceLock};

use bevy::prelude::*;
use stylegaussian::{
    paint::{Canvas, Company, Hand},
    strokes::Strokes,
    work::{Canceled, Work},
};

use super::worker::Ground;

/// A painted scene.
pub(crate) struct Beside {
    pub(super) surface: Arc<Ground>,
    pub(super) strokes: Arc<Strokes>,
    /// Facts for those beside it, once the first of them has asked. `None` if there are none.
    company: OnceLock<Option<Company>>,
}

/// The painted scene that an entity's own is a part of, at some level of detail. It gets the colors and strokes
/// that it has there.
#[derive(Component, Clone)]
pub(crate) struct PaintedBeside(pub(crate) Arc<Beside>);

impl Beside {
    pub(super) fn new(surface: Arc<Ground>, strokes: Arc<Strokes>) -> Self {
        Self { surface, strokes, company: OnceLock::new() }
    }

    /// Facts for those beside it, which have these paintings and this hand. `None` if there are none.
    ///
    /// # Errors
    /// If `work` is canceled.
    pub(super) fn company(
        &self,
        paintings: &[(&Canvas, f64)],
        hand: &Hand,
        work: &Work,
    ) -> Result<Option<&Company>, Canceled> {
        if self.company.get().is_none() {
            let company = Company::new(&self.surface, paintings, hand, &self.strokes, work)?;
            // Jobs of a lane are done one after another, so nobody else has set it.
            let _ = self.company.set(company);
        }
        Ok(self.company.get().and_then(Option::as_ref))
    }
}
