//! Memory on the heap, counted as it is taken and given back.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    sync::atomic::{AtomicUsize, Ordering::Relaxed},
};

/// The system's allocator with a count of its bytes.
struct Counting;

#[global_allocator]
static COUNTING: Counting = Counting;

/// Bytes that are taken, and the most since the last [`usage_of`].
static NOW: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn take(n_bytes: usize) {
    MOST.fetch_max(NOW.fetch_add(n_bytes, Relaxed) + n_bytes, Relaxed);
}

fn give_back(n_bytes: usize) {
    NOW.fetch_sub(n_bytes, Relaxed);
}

#[expect(unsafe_code, reason = "every call goes to the system's allocator as it came")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // A growing block may be copied, so that both are there for a moment. A shrinking one stays in its
        // place.
        if size > layout.size() {
            take(size);
            give_back(layout.size());
        } else {
            give_back(layout.size() - size);
        }
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        give_back(layout.size());
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Bytes of memory that a function takes.
#[derive(Clone, Copy, Debug)]
pub struct Usage {
    /// The most at any time while it runs.
    pub peak: usize,
    /// Those of its result.
    pub held: usize,
}

/// Runs `make`, and returns its memory. No other thread must take memory meanwhile.
pub fn usage_of<T>(make: impl FnOnce() -> T) -> (T, Usage) {
    let before = NOW.load(Relaxed);
    MOST.store(before, Relaxed);
    let made = make();
    let since = |bytes: &AtomicUsize| bytes.load(Relaxed).saturating_sub(before);
    (made, Usage { peak: since(&MOST), held: since(&NOW) })
}
