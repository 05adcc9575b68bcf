//! Tests of paint as a whole, on a wall of small Gaussians.
