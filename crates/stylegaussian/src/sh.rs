//! Spherical harmonics, degrees 0 to 3.
