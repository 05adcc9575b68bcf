//! Captured 3D Gaussian Splatting scenes in Bevy, restyled by any image at run time.
