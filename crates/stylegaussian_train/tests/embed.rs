//! Embedding a small scene with the built-in encoder.

#[expect(dead_code, reason = "the tests share these, and each uses a part")]
mod support;

use std::sync::{
    Mutex,
    atomic::{AtomicBool, Ordering},
};

use stylegaussian_defaults::{ENCODER, ENCODER_NAME};
use stylegaussian_encoder::Encoder;
use stylegaussian_train::{
    Stage, Watch,
    embed::{EmbedError, EmbedMethod, EmbedOptions, TrainingView, embed},
};
use support::{board, cameras};

fn views() -> Vec<TrainingView> {
    let view = |(i, camera)| TrainingView::rendered(format!("view {i}"), camera, 64);
    cameras().iter().enumerate().map(view).collect()
}

#[test]
fn a_watch_follows_and_interrupts_an_embedding() {
    let encoder = Encoder::from_bytes(ENCODER_NAME, ENCODER.to_vec()).unwrap();
    let options =
        EmbedOptions { method: EmbedMethod::Default, iterations: Some(10), ..EmbedOptions::default() };
    let mut scene = board();

    let interrupted = AtomicBool::new(true);
    let watch = Watch { interrupted: &interrupted, ..Watch::default() };
    let error = embed(&mut scene, &views(), &encoder, &options, watch).unwrap_err();
    assert!(matches!(error, EmbedError::Interrupted), "{error}");
    assert!(scene.features.is_none(), "the scene is unchanged");

    // Interrupted at the fourth step: three are done, and their features are kept.
    interrupted.store(false, Ordering::Relaxed);
    let seen = Mutex::new(Vec::new());
    let progress = |now: stylegaussian_train::Progress| {
        seen.lock().unwrap().push((now.stage, now.done));
        interrupted.store(now.stage == Stage::Refine && now.done == 3, Ordering::Relaxed);
    };
    let watch = Watch { progress: &progress, interrupted: &interrupted };
    // The refinement reports before each step, so the report of 3 comes before the fourth.
    let report = embed(&mut scene, &views(), &encoder, &options, watch).unwrap();
    assert_eq!((report.n_training_views, report.iterations, report.interrupted), (2, 3, true));
    let seen = seen.into_inner().unwrap();
    assert_eq!(seen.iter().filter(|(stage, _)| *stage == Stage::Views).count(), 2);
    let features = scene.features.unwrap();
    assert_eq!(features.n_channels(), encoder.n_channels());
    assert_eq!(features.encoder.as_ref(), Some(encoder.id()));
    assert!(features.values.iter().all(|value| value.is_finite()));
}
