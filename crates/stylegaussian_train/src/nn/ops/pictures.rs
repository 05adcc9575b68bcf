//! The windows of convolutions over pictures in rows `[n * H * W, C]`.

use super::Windows;

/// The line of a picture of `n` lines that `i` reflects to, if it lies outside. The border itself is not
/// repeated.
fn reflected(i: isize, n: usize) -> usize {
    let last = n as isize - 1;
    let i = i.abs();
    // The clamp is for pictures narrower than the kernel, where one reflection does not lead inside.
    (if i > last { 2 * last - i } else { i }).clamp(0, last) as usize
}

impl Windows {
    /// The `kernel` x `kernel` windows at every `stride`-th line and column of `n` pictures, stacked
    /// vertically, each of `size` = [W, H] and reflected at its own border.
    ///
    /// A window's middle is at the window's own position; if the kernel is even, that is the pixel before the
    /// middle. Each picture has ceil(W / stride) x ceil(H / stride) windows.
    pub fn of_pictures(size: [usize; 2], n: usize, kernel: usize, stride: usize) -> Self {
        let [width, height] = size;
        let [columns, lines] = size.map(|side| side.div_ceil(stride));
        let before = (kernel - 1) / 2;
        let line = |place: usize, tap: usize, n: usize| {
            reflected((place * stride + tap) as isize - before as isize, n)
        };
        let mut neighbors = Vec::with_capacity(n * lines * columns * kernel * kernel);
        for picture in 0..n {
            for place in 0..lines * columns {
                for tap in 0..kernel * kernel {
                    let y = line(place / columns, tap / kernel, height);
                    let x = line(place % columns, tap % kernel, width);
                    neighbors.push(((picture * height + y) * width + x) as u32);
                }
            }
        }
        Self::new(neighbors, kernel * kernel, n * width * height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_reflected_within_their_picture() {
        let windows = Windows::of_pictures([3, 2], 2, 3, 1);
        assert_eq!(windows.n_out(), 12);
        // The picture's corner 0 of 0 1 2 / 3 4 5, and the last corner, 11, of the second picture 6 7 8 / 9 10
        // 11.
        assert_eq!(windows.neighbors[..9], [4, 3, 4, 1, 0, 1, 4, 3, 4]);
        assert_eq!(windows.neighbors[99..], [7, 8, 7, 10, 11, 10, 7, 8, 7]);
    }

    #[test]
    fn strides_keep_the_last_odd_line() {
        // 0 1 2 / 3 4 5 / 6 7 8 in 2x2 blocks; beyond line 2 comes line 1 again.
        let windows = Windows::of_pictures([3, 3], 1, 2, 2);
        assert_eq!(windows.neighbors, [0, 1, 3, 4, 2, 1, 5, 4, 6, 7, 3, 4, 8, 7, 5, 4]);
        // A kernel of 4 starts one line before its block.
        assert_eq!(Windows::of_pictures([4, 4], 1, 4, 2).neighbors[..4], [5, 4, 5, 6]);
    }
}
