//! Strokes on the GPU: the store of paintings that all of them share, and whether they can be drawn.

use std::sync::{Arc, Weak};

use bevy::{platform::collections::HashMap, prelude::*, render::Extract};
use stylegaussian::strokes::Strokes;
use stylegaussian_gpu::strokes::{GaussianStrokes, StrokeStore};

use super::shown::address;

/// The paintings that strokes show, on the present device. Styles upload to it, and the splat pass draws from
/// it.
#[derive(Resource, Default)]
pub(crate) struct StrokeTextures(pub(crate) StrokeStore);

/// The game's clock, in seconds, by which strokes move.
#[derive(Resource, Default)]
pub(crate) struct StrokeClock(pub(crate) f64);

/// Reads the clock.
pub(super) fn extract_clock(mut clock: ResMut<StrokeClock>, game: Extract<Res<Time<Virtual>>>) {
    clock.0 = game.elapsed_secs_f64();
}

/// Whether all pipelines are there that the views need to draw strokes. Without a view, nothing is waited for.
#[derive(Resource)]
pub(crate) struct StrokesReady(pub(crate) bool);

impl Default for StrokesReady {
    fn default() -> Self {
        Self(true)
    }
}

/// Strokes that were uploaded, by their address. The weak reference keeps the address from being used again.
#[derive(Default)]
pub(super) struct UploadedStrokes(HashMap<usize, (Weak<Strokes>, Option<GaussianStrokes>)>);

impl UploadedStrokes {
    /// The strokes on the GPU, uploaded now if they are not. `None` if the device has no room for them.
    pub(super) fn get(
        &mut self,
        store: &StrokeStore,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        strokes: &Arc<Strokes>,
    ) -> Option<GaussianStrokes> {
        let upload = || {
            let uploaded = store.upload(device, queue, strokes);
            // Its colors alone are nearer to the style than nothing.
            let uploaded =
                uploaded.inspect_err(|error| warn!("a style is shown without its strokes: {error}"));
            (Arc::downgrade(strokes), uploaded.ok())
        };
        self.0.entry(address(strokes)).or_insert_with(upload).1.clone()
    }

    /// Drops strokes that no style has any more.
    pub(super) fn forget_unused(&mut self) {
        self.0.retain(|_, (strokes, _)| strokes.strong_count() > 0);
    }
}
