//! Checkpoints of trainings, `*.checkpoint.safetensors`.

use stylegaussian_train::nn::check_checkpoint;

/// Reads all tensors and numbers of the checkpoint.
pub fn read(data: &[u8]) {
    let _ = check_checkpoint(data, "fuzz.checkpoint.safetensors");
}
