//! The K nearest neighbors of every Gaussian: the decoder's window.

/// Neighbor lists `[N, K]`, row-major: self first, then by ascending distance, ties by source index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Neighbors {
    /// K.
    pub k: usize,
    /// Gaussian indices `[N, K]`.
    pub indices: Vec<u32>,
}
