//! Shared by the tests: small scenes that can be styled, and apps without a window.
#![allow(dead_code, reason = "each test uses its part")]

pub mod rendering;

use std::{sync::Arc, time::Duration};

use bevy::{asset::AssetPlugin, prelude::*};
use stylegaussian::{ChannelStatistics, Decoder, Features, Layer, Scene, scene::Sh};

use crate::{GaussianScene, StyleGaussianPlugin, StyleThreads, style::StyleStatistics};

/// Channels of the encoder, latent features, and the decoder's neighbors, in the small scenes.
// Three different numbers, so that mixing them up is found by a shape.
const D: usize = 8;
const L: usize = 4;
const K: usize = 3;

/// Pseudorandom numbers in -1..1 (a linear congruential generator of 64 bits with Knuth's constants).
pub fn numbers(seed: u64) -> impl FnMut() -> f32 {
    // Odd, so that no seed begins at 0.
    let mut state = seed.wrapping_mul(2) + 1;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        // The upper 24 bits, which are the good ones, and as many as an f32 holds: 0..2 less 1.
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// `n` Gaussians in the cube -1..1, with spherical harmonics of degree 1, features and a decoder.
pub fn small_scene(n: usize, seed: u64) -> Scene {
    let mut next = numbers(seed);
    let mut many = |count: usize, scale: f32| (0..count).map(|_| scale * next()).collect::<Vec<f32>>();
    let means = many(3 * n, 1.0).chunks_exact(3).map(Vec3::from_slice).collect();
    let rotations = many(4 * n, 1.0).chunks_exact(4).map(|q| Quat::from_slice(q).normalize()).collect();
    // 0.03 to 0.08: small against the cube, so that the splats can be told apart.
    let scales = many(3 * n, 0.05).chunks_exact(3).map(|s| Vec3::from_slice(s).abs() + 0.03).collect();
    let layer = |d_in: usize, d_out: usize, many: &mut dyn FnMut(usize, f32) -> Vec<f32>| Layer {
        weight: many(d_out * K * d_in, 0.6),
        bias: many(d_out, 0.5),
        d_in,
        d_out,
    };
    Scene {
        means,
        rotations,
        scales,
        // 0.15 to 0.95: no splat is invisible, and none hides all that is behind it.
        opacities: many(n, 0.4).into_iter().map(|o| 0.55 + o).collect(),
        sh: Some(Sh { degree: 1, coefficients: many(12 * n, 0.5) }),
        order: (0..n as u32).collect(),
        n_source: n,
        features: Some(Features {
            values: many(L * n, 1.0),
            n_latent: L,
            basis: many(D * L, 1.0),
            offset: many(D, 1.0),
            extra: Vec::new(),
            n_extra: 0,
            encoder: None,
        }),
        decoder: Some(Decoder {
            layers: vec![layer(D, 16, &mut many), layer(16, 8, &mut many), layer(8, 3, &mut many)],
            k: K,
            ..Decoder::default()
        }),
        ..Scene::default()
    }
}

/// One round Gaussian.
#[derive(Clone, Copy)]
pub struct Ball {
    pub mean: Vec3,
    pub scale: f32,
    pub opacity: f32,
    pub color: [f32; 3],
}

/// A scene of round Gaussians without features. It looks the same from every side.
pub fn balls(balls: &[Ball]) -> Scene {
    let n = balls.len();
    let mut scene = Scene {
        means: balls.iter().map(|ball| ball.mean).collect(),
        rotations: vec![Quat::IDENTITY; n],
        scales: balls.iter().map(|ball| Vec3::splat(ball.scale)).collect(),
        opacities: balls.iter().map(|ball| ball.opacity).collect(),
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    };
    scene.set_colors(&balls.iter().map(|ball| ball.color).collect::<Vec<_>>());
    scene
}

/// Statistics of a style for the small scenes.
pub fn small_style(seed: u64) -> ChannelStatistics {
    let mut next = numbers(seed + 1000);
    ChannelStatistics {
        mean: (0..D).map(|_| next()).collect(),
        std_dev: (0..D).map(|_| next().abs() + 0.1).collect(),
        covariance: None,
        encoder: None,
    }
}

/// An app with the plugin and without rendering.
pub fn app_without_rendering() -> App {
    app_with_assets(AssetPlugin::default())
}

/// All cores at the usual priority.
pub const QUICK_THREADS: StyleThreads = StyleThreads { count: 2, priority: 50 };

/// As [`app_without_rendering`], with assets from another source.
pub fn app_with_assets(assets: AssetPlugin) -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, assets, TransformPlugin));
    // Bevy's `ImagePlugin` would do this, but it belongs to rendering.
    app.init_asset::<Image>().add_plugins(StyleGaussianPlugin::default());
    // Tests wait for nothing else.
    app.insert_resource(QUICK_THREADS);
    // What a runner does before the first update. These tests call `update` themselves.
    app.finish();
    app.cleanup();
    app
}

/// Adds an asset.
pub fn add<A: Asset>(app: &mut App, asset: A) -> Handle<A> {
    app.world_mut().resource_mut::<Assets<A>>().add(asset)
}

/// Adds a scene.
pub fn add_scene(app: &mut App, scene: Scene) -> Handle<GaussianScene> {
    add(app, GaussianScene::new(scene))
}

/// Adds a style.
pub fn add_style(app: &mut App, style: ChannelStatistics) -> Handle<StyleStatistics> {
    add(app, StyleStatistics { statistics: Arc::new(style), paint: None })
}

/// Updates until `done` returns true. Fails after a minute.
pub fn update_until(app: &mut App, what: &str, mut done: impl FnMut(&mut World) -> bool) {
    let start = std::time::Instant::now();
    while !done(app.world_mut()) {
        assert!(start.elapsed() < Duration::from_secs(60), "not within a minute: {what}");
        app.update();
        // Leaves the cores to background tasks.
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// All messages of a kind since the last call.
pub fn drain<M: Message>(app: &mut App) -> Vec<M> {
    app.world_mut().resource_mut::<Messages<M>>().drain().collect()
}
