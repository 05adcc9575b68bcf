//! Inputs that come later: assets that are loaded, and values that are made by the first computation that needs
//! them.

use std::{
    sync::{Arc, Mutex, OnceLock, TryLockError},
    time::Duration,
};

use bevy::{asset::LoadState, prelude::*};
use stylegaussian::{
    ChannelStatistics,
    paint::Paint,
    work::{Canceled, Work},
};

use crate::style::{make::worker::Painting, wish::error::StyleError};

/// An input, or `Ok(None)` while it is being loaded or computed.
pub(crate) type Input<T> = Result<Option<T>, Arc<StyleError>>;

/// A computation without a result.
#[derive(Debug)]
pub(crate) enum Failure {
    /// Nobody wants it any more.
    Canceled,
    /// It cannot be had. All who want it share the reason.
    Failed(Arc<StyleError>),
}

impl From<Canceled> for Failure {
    fn from(_: Canceled) -> Self {
        Self::Canceled
    }
}

impl From<StyleError> for Failure {
    fn from(error: StyleError) -> Self {
        Self::Failed(Arc::new(error))
    }
}

/// A computation's end as [`Workers`](crate::work::Workers) take it.
pub(crate) fn settled<T>(computed: Result<T, Failure>) -> Result<Result<T, Arc<StyleError>>, Canceled> {
    match computed {
        Ok(value) => Ok(Ok(value)),
        Err(Failure::Failed(error)) => Ok(Err(error)),
        Err(Failure::Canceled) => Err(Canceled),
    }
}

/// A value that the first computation makes that needs it. All share it, or the reason why there is none.
pub(crate) type Later<T> = Arc<Lazy<T>>;

/// The canvas of a painting.
pub(crate) type Stretched = Arc<Painting>;

/// The statistics of a painting.
pub(crate) type Encoded = Arc<ChannelStatistics>;

/// The target of a [`Later`].
pub(crate) struct Lazy<T> {
    value: OnceLock<Result<T, Arc<StyleError>>>,
    /// Makes the value, as long as there is none.
    make: Mutex<Option<Box<Make<T>>>>,
}

type Make<T> = dyn Fn(&Work) -> Result<T, Failure> + Send;

/// Time after which a computation that waits for another one's value looks whether it is still wanted itself.
const LOOK: Duration = Duration::from_millis(5);

/// A value that is made later, by `make`. That may be called again if it was canceled.
pub(crate) fn later<T>(make: impl Fn(&Work) -> Result<T, Failure> + Send + 'static) -> Later<T> {
    let make: Box<Make<T>> = Box::new(make);
    Arc::new(Lazy { value: OnceLock::new(), make: Mutex::new(Some(make)) })
}

impl<T> Lazy<T> {
    /// The value, or the reason why there is none, once a computation has needed it.
    #[cfg(any(feature = "images", test))]
    pub(crate) fn known(&self) -> Option<&Result<T, Arc<StyleError>>> {
        self.value.get()
    }
}

impl<T: Clone> Lazy<T> {
    /// The value, which is made now if there is none. If another computation makes it, this one waits, and
    /// makes it itself if the other one is canceled. Not for the main thread.
    ///
    /// # Errors
    /// If `work` is canceled, which leaves the value to the next who needs it, or if there is none.
    pub(crate) fn get(&self, work: &Work) -> Result<T, Failure> {
        loop {
            if let Some(value) = self.value.get() {
                return value.clone().map_err(Failure::Failed);
            }
            work.check()?;
            let mut make = match self.make.try_lock() {
                Ok(make) => make,
                // A panic leaves no value.
                Err(TryLockError::Poisoned(make)) => make.into_inner(),
                Err(TryLockError::WouldBlock) => {
                    std::thread::sleep(LOOK);
                    continue;
                }
            };
            // `None` if it was made just now.
            let Some(made) = make.as_ref().map(|make| make(work)) else { continue };
            let value = match made {
                Ok(value) => Ok(value),
                Err(Failure::Failed(error)) => Err(error),
                Err(Failure::Canceled) => return Err(Failure::Canceled),
            };
            // Nobody else has the lock.
            let _ = self.value.set(value);
            *make = None;
        }
    }
}

/// An asset, or `Ok(None)` while it may still come.
pub(crate) fn loaded<'a, A: Asset>(
    server: &AssetServer,
    assets: &'a Assets<A>,
    handle: &Handle<A>,
) -> Result<Option<&'a A>, Arc<StyleError>> {
    let asset = assets.get(handle);
    // A reload that fails leaves the old asset in place, and that is used. Assets that a program adds have no
    // load state.
    match server.get_load_state(handle) {
        Some(LoadState::Failed(error)) if asset.is_none() => {
            Err(Arc::new(StyleError::Load(error.to_string())))
        }
        _ => Ok(asset),
    }
}

/// The name of an asset for messages: its path, or what it is if it has none.
pub(crate) fn name<A: Asset>(handle: &Handle<A>, what: &str) -> String {
    handle.path().map_or_else(|| what.into(), ToString::to_string)
}

/// The part of an image that is used, in a form that can be looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Crop([u32; 4]);

impl Crop {
    pub(crate) fn new(part: Rect) -> Self {
        Self([part.min.x, part.min.y, part.max.x, part.max.y].map(f32::to_bits))
    }

    /// Left, top, right and bottom edges, as shares of the sides.
    pub(crate) fn area(self) -> [f32; 4] {
        self.0.map(f32::from_bits)
    }
}

/// The canvas of a painting that may be used.
pub(crate) fn stretched(name: &str, paint: &Paint, work: &Work) -> Result<Stretched, Failure> {
    match paint.is_usable() {
        true => Ok(Arc::new(Painting::new_if_wanted(paint, work)?)),
        false => Err(StyleError::Transparent { image: name.into() }.into()),
    }
}

/// The name of an image that is a style.
pub(crate) fn image_name(handle: &Handle<Image>) -> String {
    name(handle, "a style image")
}

#[cfg(test)]
mod tests {
    use std::{
        sync::{
            atomic::{AtomicUsize, Ordering::Relaxed},
            mpsc,
        },
        time::Instant,
    };

    use super::*;

    #[test]
    fn a_canceled_value_is_made_by_the_next() {
        let n_calls = Arc::new(AtomicUsize::new(0));
        let counted = Arc::clone(&n_calls);
        let value = later(move |work| {
            counted.fetch_add(1, Relaxed);
            work.at(0.5)?;
            Ok(7)
        });
        let canceled = Work::default();
        canceled.cancel();
        assert!(matches!(value.get(&canceled), Err(Failure::Canceled)));
        assert_eq!(n_calls.load(Relaxed), 0, "it was begun although nobody waits");
        // Canceled when it is half done.
        let stopping = Arc::new(OnceLock::<Work>::new());
        let known = Arc::clone(&stopping);
        let telling = Work::telling(move |_| known.get().unwrap().cancel());
        assert!(matches!(value.get(stopping.get_or_init(|| telling)), Err(Failure::Canceled)));
        assert!(value.known().is_none() && n_calls.load(Relaxed) == 1);
        for _ in 0..2 {
            assert_eq!(value.get(&Work::default()).unwrap(), 7);
        }
        assert_eq!(n_calls.load(Relaxed), 2);
        // What is there, is there for all.
        assert_eq!(value.get(&canceled).unwrap(), 7);
    }

    #[test]
    fn a_failure_stays() {
        let n_calls = Arc::new(AtomicUsize::new(0));
        let counted = Arc::clone(&n_calls);
        let value: Later<u32> = later(move |_| {
            counted.fetch_add(1, Relaxed);
            Err(StyleError::Ended.into())
        });
        for _ in 0..2 {
            let failed = value.get(&Work::default());
            assert!(matches!(failed, Err(Failure::Failed(error)) if matches!(*error, StyleError::Ended)));
        }
        assert_eq!(n_calls.load(Relaxed), 1);
    }

    /// Of three who want the same value, the first makes it and is canceled, one waits and is canceled, and one
    /// waits and gets it.
    #[test]
    fn who_waits_is_canceled_alone_and_does_what_a_canceled_one_left() {
        let (begun, begins) = mpsc::channel();
        let value = later(move |work| {
            begun.send(()).unwrap();
            // Only the first one takes so long.
            while work.done() < 0.5 {
                work.check()?;
                std::thread::sleep(Duration::from_millis(1));
            }
            Ok(7)
        });
        let [first, second, third] = [0; 3].map(|_| Work::default());
        third.at(0.5).unwrap();
        std::thread::scope(|scope| {
            let of = |work: &Work| {
                let (value, work) = (Arc::clone(&value), work.clone());
                scope.spawn(move || value.get(&work))
            };
            let makes = of(&first);
            begins.recv().unwrap();
            let [waits, gets] = [&second, &third].map(of);
            let canceled = Instant::now();
            second.cancel();
            assert!(matches!(waits.join().unwrap(), Err(Failure::Canceled)));
            assert!(canceled.elapsed() < Duration::from_secs(1), "{:?}", canceled.elapsed());
            assert!(!gets.is_finished() && value.known().is_none());
            first.cancel();
            assert!(matches!(makes.join().unwrap(), Err(Failure::Canceled)));
            assert_eq!(gets.join().unwrap().unwrap(), 7);
        });
        assert!(matches!(value.known(), Some(Ok(7))));
    }
}
