//! Memory in large pages.

/// Asks the system for large pages under the capacity of `values`, most of which was not written yet.
///
/// The first write to a page costs more than filling it: with pages of 4 KiB that was a fifth of the time in which a capture
/// of a million Gaussians is read. A wish alone: small vectors, systems without such pages and refusals change nothing.
#[cfg(target_os = "linux")]
#[expect(
    unsafe_code,
    reason = "advice is about memory by its address; the comment above the call names the bound"
)]
pub(super) fn enlarge<T>(values: &mut Vec<T>) {
    use rustix::mm::{Advice, madvise};

    /// The size of a large page on x86-64, and on others with pages of 4 KiB.
    const LARGE: usize = 2 << 20;

    let spare = values.as_mut_ptr().cast::<u8>();
    let n_bytes = values.capacity().saturating_mul(size_of::<T>());
    let before = spare.align_offset(LARGE);
    let Some(inside) = n_bytes.checked_sub(before).map(|rest| rest - rest % LARGE).filter(|&n| n > 0) else {
        return;
    };
    // SAFETY: the `inside` bytes from `before` on are within the vector's allocation, and this advice changes no byte of
    // them. An error means that there are no such pages.
    let _ = unsafe { madvise(spare.wrapping_add(before).cast(), inside, Advice::LinuxHugepage) };
}

/// Large pages are asked for on Linux alone.
#[cfg(not(target_os = "linux"))]
pub(super) fn enlarge<T>(_: &mut Vec<T>) {}
