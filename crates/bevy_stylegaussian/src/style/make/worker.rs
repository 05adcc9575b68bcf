//! Paintings and scenes as the browser's worker holds them: it prepares them and lays on paint, without
//! stopping frames. Where it does not, they are prepared on the page's thread once they are used.

use std::{
    ops::Deref,
    sync::{
        Arc, OnceLock,
        atomic::{AtomicU32, Ordering},
    },
};

use bevy::prelude::*;
use stylegaussian::{
    Scene,
    apart::Call,
    paint::{Canvas, Paint, Surface},
    work::{Canceled, Work},
};

use crate::work::{
    Lane, Running, Workers,
    browser::{self, Fail},
};

/// A painting.
pub(crate) struct Painting {
    paint: Paint,
    /// Its canvas, if it is used on the page's thread.
    canvas: OnceLock<Canvas>,
    there: There,
}

/// A scene that is prepared to be painted.
pub(crate) struct Ground {
    scene: Arc<Scene>,
    /// The painted scene that it is a part of.
    beside: Option<Arc<Ground>>,
    /// Its surface, if it is used on the page's thread.
    surface: OnceLock<Surface>,
    there: There,
}

impl Painting {
    fn new(paint: &Paint) -> Self {
        Self { paint: paint.clone(), canvas: OnceLock::new(), there: There::new(Call::ForgetCanvas) }
    }

    /// As [`Canvas::new_if_wanted`], but it is prepared when it is used.
    pub(crate) fn new_if_wanted(paint: &Paint, work: &Work) -> Result<Self, Canceled> {
        work.check()?;
        Ok(Self::new(paint))
    }

    /// As [`Canvas::reread_if_wanted`].
    #[cfg(feature = "images")]
    pub(crate) fn reread_if_wanted(&self, paint: &Paint, work: &Work) -> Result<Self, Canceled> {
        Ok(Self { canvas: (**self).reread_if_wanted(paint, work)?.into(), ..Self::new(paint) })
    }

    /// Whether it is used on the page's thread.
    pub(crate) fn is_here(&self) -> bool {
        self.canvas.get().is_some()
    }

    /// Its number in the worker, which prepares it if it has not done so.
    pub(crate) async fn number(&self) -> Result<u32, Fail> {
        let call = Call::Canvas(self.there.number, &self.paint);
        self.there.hold(call, None).await
    }
}

impl Deref for Painting {
    type Target = Canvas;

    fn deref(&self) -> &Canvas {
        self.canvas.get_or_init(|| Canvas::new(&self.paint))
    }
}

impl Ground {
    /// Whether it is used on the page's thread.
    pub(crate) fn is_here(&self) -> bool {
        self.surface.get().is_some()
    }

    /// Its number in the worker, which prepares it if it has not done so.
    pub(crate) async fn number(&self) -> Result<u32, Fail> {
        self.hold(None).await
    }

    /// As [`number`](Self::number). `work` can cancel it if nobody else waits for it.
    async fn hold(&self, work: Option<&Work>) -> Result<u32, Fail> {
        let beside = match &self.beside {
            Some(beside) => Some(Box::pin(beside.number()).await?),
            None => None,
        };
        self.there.hold(Call::Surface(self.there.number, &self.scene, beside), work).await
    }

    /// Its surface, computed on the page's thread.
    fn found(&self, work: &Work) -> Result<Surface, Canceled> {
        match &self.beside {
            Some(whole) => Surface::part_of(&self.scene, whole, work),
            None => Surface::new(&self.scene, work),
        }
    }
}

impl Deref for Ground {
    type Target = Surface;

    fn deref(&self) -> &Surface {
        let found = || self.found(&Work::default());
        self.surface.get_or_init(|| found().expect("nobody else has the work, so nobody cancels it"))
    }
}

/// A place in the worker.
struct There {
    number: u32,
    /// The worker that holds it, by its number; 0 if none does.
    holder: AtomicU32,
    forget: fn(u32) -> Call<'static>,
}

impl There {
    fn new(forget: fn(u32) -> Call<'static>) -> Self {
        static LAST: AtomicU32 = AtomicU32::new(0);
        let number = LAST.fetch_add(1, Ordering::Relaxed);
        Self { number, holder: AtomicU32::new(0), forget }
    }

    /// Its number, under which the worker then holds it. `work` can cancel that if nobody else waits for it.
    async fn hold(&self, call: Call<'_>, work: Option<&Work>) -> Result<u32, Fail> {
        let present = browser::present()?;
        // Calls are answered in turn, so whoever comes while this one is under way finds it there.
        if self.holder.swap(present, Ordering::Relaxed) != present {
            let own = Work::default();
            let answer = browser::call(&call.pieces(), work.unwrap_or(&own), work.is_some()).await;
            if let Err(fail) = answer {
                self.holder.store(0, Ordering::Relaxed);
                return Err(fail);
            }
        }
        Ok(self.number)
    }
}

impl Drop for There {
    fn drop(&mut self) {
        browser::tell(self.holder.load(Ordering::Relaxed), &(self.forget)(self.number).pieces());
    }
}

/// Begins to prepare a scene, which may be a part of one that is painted.
pub(crate) fn ground(
    scene: &Arc<Scene>,
    beside: Option<&Arc<Ground>>,
    workers: &Workers,
) -> Running<Arc<Ground>> {
    let (there, beside) = (There::new(Call::ForgetSurface), beside.cloned());
    let ground = Ground { scene: Arc::clone(scene), beside, surface: OnceLock::new(), there };
    workers.start_async(Lane::Styles, async move |work: Work| {
        loop {
            match ground.hold(Some(&work)).await {
                Ok(_) => return Ok(Arc::new(ground)),
                Err(Fail::Replaced) => {}
                Err(Fail::Canceled) => return Err(Canceled),
                Err(Fail::Absent) => {
                    let surface = ground.found(&work)?.into();
                    return Ok(Arc::new(Ground { surface, ..ground }));
                }
                Err(Fail::Said(reason)) => {
                    error!("a scene cannot be prepared to be painted: {reason}");
                    return Err(Canceled);
                }
            }
        }
    })
}

/// A painting that strokes follow, on the page's thread.
///
/// # Errors
/// If `work` is canceled.
#[cfg(feature = "images")]
pub(crate) fn followed(paint: &Paint, work: &Work) -> Result<Painting, Canceled> {
    Ok(Painting { canvas: Canvas::new_if_wanted(paint, work)?.into(), ..Painting::new(paint) })
}

/// Whether scenes are prepared beside frames, and not between them.
pub(crate) fn is_beside_frames() -> bool {
    browser::present().is_ok() && browser::is_ready()
}
