//! Distillation: training a small encoder to give the features of a large one.
//!
//! The student sees random crops of images, also in other sizes and colors, and learns the teacher's features
//! of each.

mod crops;
mod distillation;
mod report;
mod student;

pub use distillation::{DistillConfig, DistillLosses, Distillation};
pub use report::{Comparison, compare};
