//! Training one decoder from embedded scenes and paintings.

pub mod ops;
