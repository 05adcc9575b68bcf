#![no_main]
#![allow(dead_code, unused_imports, reason = "the reader's sources, of which the target uses a part")]

// The training framework builds for more than half an hour with sanitizers and takes no part in reading: here
// the reader's own sources stand in for the crate.
extern crate self as stylegaussian_train;

#[path = "../../crates/stylegaussian_train/src/error.rs"]
mod error;
#[path = "../../crates/stylegaussian_train/src/nn/checkpoint/file.rs"]
mod file;
#[path = "../readers/checkpoint.rs"]
mod reader;

mod nn {
    pub use crate::file::check_checkpoint;
}

pub use error::TrainError;

libfuzzer_sys::fuzz_target!(|data: &[u8]| reader::read(data));
