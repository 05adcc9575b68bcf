//! Evaluation: how well a stylized scene shows its paintings, in numbers.
//!
//! For every painting and view, the *style error* is the squared distance between the channel means and
//! deviations of VGG-19's relu1_1, relu2_1 and relu3_1 on the picture and on the painting, averaged over
//! channels and summed over layers: the paper's style loss without relu4_1. A decoder could lower it by
//! painting everything in one contrasty way. Two other numbers show that: how often the error is smallest for
//! the picture's own painting, and the *content error*, the mean squared distance of relu3_1 from the unstyled
//! view's.
//!
//! Palette alone can win all of these. *Texture* leaves it out: the same errors on luminance of equal mean and
//! deviation, so that no recoloring helps. How often the own painting is then the nearest, and its mean rank,
//! say whether brushwork came over. The distance of each cell's features to the nearest in the painting, and
//! the energy of fine detail (*grain*) relative to the painting's, show it as well.
//!
//! A mesh may be painted beside the scene: a ball in the scene's colors, which is judged likewise.
//!
//! References are the unstyled scene; the scene recolored to the painting's mean and covariance, which needs no
//! network; and, if a 2D decoder is given, AdaIN on each view separately. Whether the views agree is measured
//! by warping one into another.

mod baseline;
mod consistency;
mod gallery;
mod image_decoder;
mod judge;
mod mesh;
mod nearest_features;
mod report;
mod texture;

pub use consistency::{Agreement, Difference, Pairs};
pub use gallery::{Outcome, Painter, Subject, Views, decoded, evaluate};
pub use image_decoder::ImageDecoder;
pub use judge::Judge;
pub use report::{Evaluation, Measures, PaintingEvaluation};
