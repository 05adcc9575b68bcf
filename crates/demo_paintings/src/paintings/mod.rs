//! One module per painting. Each has one public function, `paint`.

pub mod cubist;
pub mod dots;
pub mod halftone;
pub mod ink;
pub mod mosaic;
pub mod print;
pub mod strokes;
pub mod watercolor;
