//! The whole style pass at once, for tools: the twin of `stylegaussian::fold::stylize`.

use stylegaussian::{
    Decoder, Scene,
    fold::{ChannelMap, StylizeError},
};

use super::{
    error::StyleSceneError, folded_layers::FoldedLayers, pass::StylePass, scene::StyleScene,
    weights::GpuDecoder,
};
use crate::{buffers::ReadBackError, colors::GaussianColors, device::HeadlessDevice};

/// A scene could not be stylized on the GPU.
#[derive(Debug, thiserror::Error)]
pub enum StylizeOnGpuError {
    /// The scene, the style and the decoder do not fit one another.
    #[error(transparent)]
    Stylize(#[from] StylizeError),
    /// The scene does not fit the device's limits.
    #[error(transparent)]
    Scene(StyleSceneError),
    /// The device ran out of memory.
    #[error("the GPU has no memory left for the scene: {0}")]
    OutOfMemory(wgpu::Error),
    /// The colors did not come back.
    #[error(transparent)]
    ReadBack(#[from] ReadBackError),
}

impl From<StyleSceneError> for StylizeOnGpuError {
    fn from(error: StyleSceneError) -> Self {
        match error {
            StyleSceneError::Stylize(error) => Self::Stylize(error),
            error => Self::Scene(error),
        }
    }
}

/// Decodes a scene's mapped features to colors `[N]` on the GPU and waits for them: display-referred RGB, not
/// clamped, in the precision of f16.
///
/// # Errors
/// If the decoder or the map does not fit the scene, or if the scene does not fit the device.
pub async fn stylize(
    gpu: &HeadlessDevice,
    scene: &Scene,
    decoder: &Decoder,
    map: &ChannelMap,
) -> Result<Vec<[f32; 3]>, StylizeOnGpuError> {
    let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let submitted = submit(gpu, scene, decoder, map);
    if let Some(error) = scope.pop().await {
        return Err(StylizeOnGpuError::OutOfMemory(error));
    }
    Ok(submitted?.read(&gpu.device, &gpu.queue)?)
}

fn submit(
    gpu: &HeadlessDevice,
    scene: &Scene,
    decoder: &Decoder,
    map: &ChannelMap,
) -> Result<GaussianColors, StylizeOnGpuError> {
    let HeadlessDevice { device, queue, .. } = gpu;
    let style_scene = StyleScene::new(device, queue, scene, decoder)?;
    let folded = FoldedLayers::new(style_scene.content(), decoder, map)?;
    let weights = GpuDecoder::new(device, queue, &folded).map_err(StyleSceneError::from)?;
    let colors = GaussianColors::new(device, scene.len()).map_err(StyleSceneError::from)?;
    let mut encoder =
        device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("stylize") });
    StylePass::new(device).encode(device, &mut encoder, &style_scene, &weights, &colors)?;
    queue.submit([encoder.finish()]);
    Ok(colors)
}
