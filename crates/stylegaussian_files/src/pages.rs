//! Memory in large pages.

/// Asks the system for large pages under the capacity of `values`, most of which was not written yet.
///
/// The first write to a page costs more than filling it: with pages of 4 KiB that was a fifth of the time in
/// which a capture of a million Gaussians is read. A wish alone: small vectors, systems without such pages and
/// refusals change nothing.
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
    // SAFETY: the `inside` bytes from `before` on are within the vector's allocation, and this advice changes
    // no byte of them. An error means that there are no such pages.
    let _ = unsafe { madvise(spare.wrapping_add(before).cast(), inside, Advice::LinuxHugepage) };
}

/// Large pages are asked for on Linux alone.
#[cfg(not(target_os = "linux"))]
pub(super) fn enlarge<T>(_: &mut Vec<T>) {}

#[cfg(test)]
mod tests {
    use super::enlarge;

    #[test]
    fn values_stay_and_more_can_be_added() {
        for n in [0, 1, 1000, 3 << 20] {
            let mut values: Vec<u32> = Vec::with_capacity(n + 1);
            values.extend(0..n as u32);
            enlarge(&mut values);
            values.push(7);
            assert!(values.iter().take(n).copied().eq(0..n as u32) && values[n] == 7);
        }
    }

    /// The kernel marks memory that was asked for (`hg` of `VmFlags`, see proc(5)).
    #[test]
    #[cfg(target_os = "linux")]
    fn large_vectors_are_marked() {
        let mut values: Vec<u8> = Vec::with_capacity(64 << 20);
        enlarge(&mut values);
        let inside = values.as_ptr() as usize + (32 << 20);
        let maps = std::fs::read_to_string("/proc/self/smaps").unwrap();
        let mut is_inside = false;
        let marked = maps.lines().find_map(|line| {
            let range = line.split(' ').next()?.split_once('-');
            let number = |text: &str| usize::from_str_radix(text, 16).ok();
            if let Some((Some(first), Some(end))) = range.map(|(a, b)| (number(a), number(b))) {
                is_inside = (first..end).contains(&inside);
            }
            line.strip_prefix("VmFlags:")
                .filter(|_| is_inside)
                .map(|flags| flags.split(' ').any(|f| f == "hg"))
        });
        if !std::path::Path::new("/sys/kernel/mm/transparent_hugepage").exists() {
            return println!("SKIPPED: this kernel has no large pages on request");
        }
        assert_eq!(marked, Some(true));
    }
}
