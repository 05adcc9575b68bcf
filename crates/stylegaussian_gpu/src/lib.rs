//! StyleGaussian on the GPU, in raw wgpu and without an engine: the style pass and the splat pass.
