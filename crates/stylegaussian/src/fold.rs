//! Folding everything that is affine in the stored features into the first layer.
