//! What `stylegaussian distill` is told.

use std::path::PathBuf;

use clap::Args;

use crate::cli::Backend;

/// Train a small encoder to give the features of a large one.
///
/// The student sees random crops of the images, in other sizes and colors too, and learns what the teacher says of each.
/// At the end it is compared with the teacher on images held out. Progress is kept in OUT.checkpoint.safetensors; Ctrl-C
/// saves and ends.
#[derive(Args, Clone, Debug)]
pub struct DistillArgs {
    /// The encoder to learn from: VGG-19 weights (.safetensors, .pth) or an ONNX file.
    #[arg(long, value_name = "FILE")]
    pub teacher: PathBuf,
    /// Folders of images (.jpg, .png) to learn on.
    #[arg(long, value_name = "DIR", num_args = 1.., required_unless_present = "judge")]
    pub images: Vec<PathBuf>,
    /// A folder of images to compare on. Otherwise every 16th of `--images`, which is then not learned from.
    #[arg(long, value_name = "DIR")]
    pub held_out: Option<PathBuf>,
    /// The encoder to write.
    #[arg(short, long, value_name = "OUT.onnx", required_unless_present = "judge")]
    pub output: Option<PathBuf>,
    /// Compare this encoder with the teacher on `--held-out`, and train nothing.
    #[arg(long, value_name = "ENCODER", requires = "held_out", conflicts_with_all = ["images", "output", "resume"])]
    pub judge: Option<PathBuf>,
    /// Steps, of four crops of 128x128 pixels each.
    #[arg(long, value_name = "N", default_value_t = 16_000)]
    pub iterations: u32,
    /// Adam's learning rate at the first step; it falls to nothing along a cosine.
    #[arg(long, value_name = "RATE", default_value_t = 2e-3)]
    pub learning_rate: f32,
    /// Random seed.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub seed: u64,
    /// Goes on from OUT.checkpoint.safetensors.
    #[arg(long)]
    pub resume: bool,
    /// What trains: `gpu` needs a build with the `gpu` feature and never falls back silently.
    #[arg(long, value_enum, default_value = "auto")]
    pub backend: Backend,
    /// Print the comparison as JSON.
    #[arg(long)]
    pub json: bool,
}
