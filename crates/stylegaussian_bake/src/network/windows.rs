//! The windows of a convolution on a picture, as neighbor lists.

use stylegaussian::decoder::ReverseNeighbors;

use super::chain::{Convolution, Padding};

/// Width and height, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Size {
    /// The number of pixels.
    pub fn n_pixels(self) -> usize {
        self.width * self.height
    }

    /// Half of it. An odd last line counts if `ceil`.
    pub(super) fn halved(self, ceil: bool) -> Self {
        let half = |side: usize| if ceil { side.div_ceil(2) } else { side / 2 };
        Self { width: half(self.width), height: half(self.height) }
    }
}

/// The pixels under a kernel.
pub(super) struct Windows {
    /// Rows of the input `[N_out, K]`. If the padding is zeros, those are row N_in.
    pub neighbors: Vec<u32>,
    /// The reversed lists, if there is to be a gradient.
    pub reverse: Option<ReverseNeighbors>,
}

impl Windows {
    /// The windows of `convolution` on a picture of `size`, and the size of the result.
    pub fn new(size: Size, convolution: &Convolution, backward: bool) -> (Size, Self) {
        let (before, after) = match convolution.padding {
            Padding::Reflect([before, after]) => (before, after),
            Padding::Zeros(zeros) => (zeros, zeros),
        };
        let side = convolution.side;
        let places = |n: usize| (n + before + after).saturating_sub(side) / convolution.stride + 1;
        let next = Size { width: places(size.width), height: places(size.height) };
        let source = |place: usize, offset: usize, n: usize| {
            let at = (place * convolution.stride + offset) as isize - before as isize;
            match convolution.padding {
                Padding::Reflect(_) => Some(reflected(at, n)),
                Padding::Zeros(_) => usize::try_from(at).ok().filter(|&at| at < n),
            }
        };
        let mut neighbors = Vec::with_capacity(next.n_pixels() * side * side);
        for y in 0..next.height {
            for x in 0..next.width {
                for dy in 0..side {
                    for dx in 0..side {
                        let row = source(y, dy, size.height).zip(source(x, dx, size.width));
                        let row = row.map_or(size.n_pixels(), |(y, x)| y * size.width + x);
                        neighbors.push(row as u32);
                    }
                }
            }
        }
        let n_in = size.n_pixels() + usize::from(matches!(convolution.padding, Padding::Zeros(1..)));
        let reverse = backward.then(|| ReverseNeighbors::new(&neighbors, side * side, n_in));
        (next, Self { neighbors, reverse })
    }
}

/// The pixel 0..n that a mirror shows at `at`, with as many reflections as it takes.
fn reflected(at: isize, n: usize) -> usize {
    let period = 2 * (n as isize - 1).max(1);
    let at = at.rem_euclid(period);
    (at.min(period - at) as usize).min(n - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_does_not_repeat_the_border() {
        let shown: Vec<usize> = (-3..6).map(|at| reflected(at, 3)).collect();
        assert_eq!(shown, [1, 2, 1, 0, 1, 2, 1, 0, 1]);
        assert!((-3..4).all(|at| reflected(at, 1) == 0));
    }
}
