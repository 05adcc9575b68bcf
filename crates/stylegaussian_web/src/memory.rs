//! The app's memory, which ends at 4 GB in a browser. Running out of it ends the app, so what is large is
//! refused before.

use js_sys::Uint8Array;

/// Memory that a scene takes while it is read, packed for the GPU and shown, in sizes of its `.sgs`, which lies
/// beside it. The page's memory grew by 810 MB for 3 million Gaussians in 162 MB.
const SCENE_OVER_FILE: usize = 4;

/// A copy of bytes that are the browser's.
///
/// # Errors
/// If there is no room for it.
pub fn copied(bytes: &Uint8Array) -> Result<Vec<u8>, String> {
    let n_bytes = bytes.length() as usize;
    let mut copy = Vec::new();
    copy.try_reserve_exact(n_bytes).map_err(|_| no_room("the file", n_bytes))?;
    copy.resize(n_bytes, 0);
    bytes.copy_to(&mut copy);
    Ok(copy)
}

/// Sees that a scene of a file of this size can be shown.
///
/// # Errors
/// If there is no room for it.
pub fn expect_room(name: &str, n_bytes: usize) -> Result<(), String> {
    if has_room(n_bytes, SCENE_OVER_FILE) { Ok(()) } else { Err(no_room(name, SCENE_OVER_FILE * n_bytes)) }
}

/// Whether there is room for `n_pieces` of this size.
fn has_room(n_bytes: usize, n_pieces: usize) -> bool {
    let mut pieces = vec![Vec::<u8>::new(); n_pieces];
    let has_room = pieces.iter_mut().all(|piece| piece.try_reserve_exact(n_bytes).is_ok());
    // A compiler may leave out memory that nobody uses.
    std::hint::black_box(&pieces);
    has_room
}

fn no_room(what: &str, n_bytes: usize) -> String {
    format!("{what}: found no room for {} MB in the page's memory", n_bytes / 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_told() {
        assert!(has_room(1 << 20, 4));
        assert!(!has_room(usize::MAX / 2, 4));
        assert!(expect_room("a.spz", 1 << 20).is_ok());
        let error = expect_room("a.spz", isize::MAX as usize / 4).unwrap_err();
        assert!(error.starts_with("a.spz: found no room for "), "{error}");
    }
}
