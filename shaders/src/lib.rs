//! The WGSL of `stylegaussian_gpu`, and the Rust twins of its structs.
