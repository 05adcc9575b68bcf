//! A bake on its way, and the way of its results to the main thread.

use std::sync::{Arc, Mutex, PoisonError};

use stylegaussian::{
    Scene, look,
    strokes::Strokes,
    work::{Canceled, Work},
};
use stylegaussian_encoder::image::DynamicImage;

use crate::{
    style::{make::images::pixels::whole, wish::error::StyleError},
    work::{Lane, Workers},
};

use super::engine::{Baking, Engine};

/// Everything that a bake is made from.
pub(super) struct Request {
    pub(super) scene: Arc<Scene>,
    /// The paintings' pixels and their weights.
    pub(super) paintings: Vec<(DynamicImage, f32)>,
    pub(super) steps: u32,
    /// Number of results, at least 1.
    pub(super) n_shown: u32,
    /// Share of the base colors in the results, 0..1.
    pub(super) content: f64,
    /// The strokes that are shown.
    pub(super) strokes: Option<Arc<Strokes>>,
}

/// A look that is better than the last one.
pub(super) struct Better {
    /// Colors `[N]` in scene order.
    pub(super) colors: Arc<[[f32; 3]]>,
    /// The strokes over them; those that are shown already if they are the same, which then stay as they are
    /// while colors fade.
    pub(super) strokes: Option<Arc<Strokes>>,
    /// Steps that gave them.
    pub(super) steps: u32,
}

/// A bake under way. Dropping it cancels the bake.
pub(crate) struct Running {
    bake: crate::work::Running<()>,
    newest: Arc<Newest>,
}

/// The newest result that nobody has taken.
type Newest = Mutex<Option<Result<Better, StyleError>>>;

impl Running {
    /// Queues a bake.
    pub(super) fn start(workers: &Workers, engine: &Engine, request: Request) -> Self {
        let newest = Arc::<Newest>::default();
        let (engine, of_bake) = (engine.clone(), Arc::clone(&newest));
        if cfg!(target_family = "wasm") {
            publish(&newest, Err(StyleError::Refine("a browser has no threads for it".into())));
            return Self { bake: workers.start(Lane::Bakes, |_| Ok(())), newest };
        }
        let bake = move |work: &Work| bake(&engine, request, &of_bake, work);
        Self { bake: workers.start(Lane::Bakes, bake), newest }
    }

    /// The newest result, once.
    pub(super) fn take(&self) -> Option<Result<Better, StyleError>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Share of the bake that is done, 0..1.
    pub(super) fn done(&self) -> f32 {
        self.bake.done()
    }
}

fn publish(newest: &Newest, result: Result<Better, StyleError>) {
    *newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
}

/// Share of the time that the beginning of a bake takes.
const BEGINNING: f32 = 0.1;

/// Bakes until all steps are done or nobody wants the result any more.
fn bake(engine: &Engine, request: Request, newest: &Newest, work: &Work) -> Result<(), Canceled> {
    let done = try_bake(engine, request, newest, work);
    work.check()?;
    if let Err(error) = done {
        publish(newest, Err(error));
    }
    Ok(())
}

fn try_bake(engine: &Engine, request: Request, newest: &Newest, work: &Work) -> Result<(), StyleError> {
    let Request { scene, paintings: images, steps, n_shown, content, strokes } = request;
    let mut paintings = Vec::with_capacity(images.len());
    for (image, weight) in &images {
        let Ok(painting) = whole(image, &work.part(0.0, 0.0)) else { return Ok(()) };
        paintings.push((painting, *weight));
    }
    drop(images);
    let mut baking = engine.begin(&scene, paintings, steps, &work.part(0.0, BEGINNING))?;
    let work = work.part(BEGINNING, 1.0);
    let strokes = strokes_of(&*baking, content, strokes);
    for step in 1..=steps {
        if work.at((step - 1) as f32 / steps as f32).is_err() {
            return Ok(());
        }
        baking.step(&scene, &work);
        if work.is_canceled() {
            return Ok(());
        }
        // The k-th result comes with the first step that has done k / n_shown of them all.
        let results = |steps_done: u32| u64::from(steps_done) * u64::from(n_shown) / u64::from(steps);
        if results(step) > results(step - 1) {
            let colors = look::mix(&scene.base_colors(), content, &[(baking.colors().to_vec(), 1.0)], None)?;
            publish(newest, Ok(Better { colors: colors.into(), strokes: strokes.clone(), steps: step }));
        }
    }
    Ok(())
}

/// The strokes of a bake beside a share of the base colors, or those that are `shown` if they are the same.
fn strokes_of(baking: &dyn Baking, content: f64, shown: Option<Arc<Strokes>>) -> Option<Arc<Strokes>> {
    let mut strokes = baking.strokes().clone();
    if strokes.seeds.is_empty() {
        return None;
    }
    if content > 0.0 {
        strokes.fade(1.0 - content as f32);
    }
    match shown {
        Some(shown) if *shown == strokes => Some(shown),
        _ => Some(Arc::new(strokes)),
    }
}
