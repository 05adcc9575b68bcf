//! The size of a picture.

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

    /// So many pixels more along each side.
    pub(super) fn plus(self, pixels: usize) -> Self {
        Self { width: self.width + pixels, height: self.height + pixels }
    }
}
