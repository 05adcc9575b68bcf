#![no_main]
#![allow(dead_code, unused_imports, reason = "the readers' sources, of which a target uses a part")]

// The crates of the readers need the graph engine and the training framework, which build for more than half an
// hour with sanitizers. Nothing of them takes part in reading cameras: here the readers' own sources stand in
// for the crates.
extern crate self as stylegaussian_encoder;
extern crate self as stylegaussian_train;

#[path = "../../crates/stylegaussian_train/src"]
mod train {
    pub mod cameras;
}

#[path = "../../crates/stylegaussian_encoder/src"]
mod images {
    pub mod guard;
    pub mod image;
}

#[path = "../readers/cameras.rs"]
mod reader;

pub use images::{
    guard,
    image::{self, Image, ImageError},
};
pub use train::cameras;

libfuzzer_sys::fuzz_target!(|data: &[u8]| reader::read(data));
