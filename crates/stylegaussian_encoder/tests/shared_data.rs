//! Real VGG weights on real photos. Skipped, with a message, if the shared data is absent.

use std::{path::PathBuf, time::Instant};

use rayon::prelude::*;
use stylegaussian_encoder::{Encoder, Image, StyleSize, style_statistics};

/// The folder of shared data, or `None` if the machine has none.
fn shared_data() -> Option<PathBuf> {
    let folder = std::env::var_os("STYLEGAUSSIAN_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    if !folder.is_dir() {
        eprintln!("SKIPPED: no shared data at {}", folder.display());
        return None;
    }
    Some(folder)
}

fn open(data: &std::path::Path, name: &str) -> Encoder {
    Encoder::open(&data.join("vgg").join(name)).unwrap()
}

fn photo(data: &std::path::Path, index: usize) -> Image {
    let photos = std::fs::read_dir(data.join("photos/bonsai/images")).unwrap();
    let mut photos: Vec<PathBuf> = photos.map(|photo| photo.unwrap().path()).collect();
    photos.sort();
    Image::open(&photos[index]).unwrap()
}

#[test]
fn normalized_features_of_a_photo_are_about_one() {
    let Some(data) = shared_data() else { return };
    let encoder = open(&data, "vgg19_normalised_relu3_1.safetensors");
    let features = encoder.encode(&photo(&data, 0).resized(256, 256)).unwrap();
    assert_eq!((features.width, features.height, features.n_channels), (64, 64, 256));
    let mean = features.values.iter().sum::<f32>() / features.values.len() as f32;
    println!("{}: mean activation {mean:.3}", encoder.runtime());
    assert!((0.5..2.0).contains(&mean), "{mean}");
}

/// The distilled network imitates VGG: the manifest states a correlation per channel of 0.83 at relu3_1.
#[test]
fn distilled_weights_resemble_vgg() {
    let Some(data) = shared_data() else { return };
    let vgg = open(&data, "vgg19_normalised_relu3_1.safetensors");
    let distilled = open(&data, "distilled16x_encoder_relu3_1.safetensors");
    let photo = photo(&data, 3).resized(256, 256);
    let (a, b) = (vgg.encode(&photo).unwrap(), distilled.encode(&photo).unwrap());
    assert_ne!(vgg.id(), distilled.id());
    let (sa, sb) = (a.statistics(), b.statistics());
    let correlation = |channel: usize| {
        let centered = |values: &[f32], mean: &[f32]| f64::from(values[channel] - mean[channel]);
        let products = a.values.chunks(256).zip(b.values.chunks(256));
        let sum: f64 = products.map(|(a, b)| centered(a, &sa.mean) * centered(b, &sb.mean)).sum();
        // 64 x 64 cells, less one: the deviations are unbiased too.
        sum / 4095.0 / f64::from(sa.std_dev[channel]) / f64::from(sb.std_dev[channel])
    };
    // A channel that is 0 everywhere has no correlation.
    let mut correlations: Vec<f64> = (0..256).map(correlation).filter(|value| value.is_finite()).collect();
    correlations.sort_by(f64::total_cmp);
    let median = correlations[correlations.len() / 2];
    println!("median correlation per channel: {median:.3} over {} channels", correlations.len());
    assert!(median > 0.7, "{median}");
}

/// The weights with preprocessing folded in and those without give the same features.
#[test]
fn folded_preprocessing_changes_nothing() {
    let Some(data) = shared_data() else { return };
    let path = data.join("vgg/vgg19_normalised_relu3_1.safetensors");
    let bytes = std::fs::read(&path).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let rest = file.tensors().into_iter().filter(|(name, _)| !name.starts_with("conv1_1_rgb01"));
    let folder = tempfile::tempdir().unwrap();
    let unfolded_path = folder.path().join("unfolded.safetensors");
    std::fs::write(&unfolded_path, safetensors::serialize(rest, None).unwrap()).unwrap();
    let photo = photo(&data, 1).resized(96, 64);
    let folded = Encoder::open(&path).unwrap().encode(&photo).unwrap();
    let unfolded = Encoder::open(&unfolded_path).unwrap().encode(&photo).unwrap();
    let error = folded.values.iter().zip(&unfolded.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("largest difference: {error:e}");
    assert!(error < 2e-4, "{error}");
}

/// Prints times, and asserts that threads do not change a result.
#[test]
fn views_encode_in_parallel() {
    let Some(data) = shared_data() else { return };
    let encoder = open(&data, "vgg19_normalised_relu3_1.safetensors");
    let views: Vec<Image> = (0..8).map(|index| photo(&data, index).resized(256, 256)).collect();
    let warm_up = |view| encoder.encode(view).unwrap();
    // Each thread allocates its scratch memory at its first run, which is not what is timed.
    rayon::broadcast(|_| warm_up(&views[0]));

    let start = Instant::now();
    let in_turn: Vec<_> = views.iter().map(|view| encoder.encode(view).unwrap()).collect();
    let serial = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let at_once: Vec<_> = views.par_iter().map(|view| encoder.encode(view).unwrap()).collect();
    let parallel = start.elapsed().as_secs_f64();
    let each = 1.0 / views.len() as f64;
    println!(
        "{}: {:.3} s per view in turn, {:.3} s on {} threads ({:.2}x)",
        encoder.runtime(),
        serial * each,
        parallel * each,
        rayon::current_num_threads(),
        serial / parallel
    );
    assert!(in_turn == at_once);
}

#[test]
fn style_statistics_of_a_painting() {
    let Some(data) = shared_data() else { return };
    let encoder = open(&data, "vgg19_normalised_relu3_1.safetensors");
    let styles = std::fs::read_dir(data.join("styles")).unwrap().map(|style| style.unwrap().path());
    let painting = styles.filter(|path| path.extension().is_some_and(|e| e == "jpg")).min().unwrap();
    let image = Image::open(&painting).unwrap();
    let start = Instant::now();
    let kept = style_statistics(&encoder, &image, StyleSize::default()).unwrap();
    println!("{}x{}: {:.2} s", image.width, image.height, start.elapsed().as_secs_f64());
    let squashed = style_statistics(&encoder, &image, StyleSize::Squash256).unwrap();
    assert_eq!(kept.encoder.as_ref(), Some(encoder.id()));
    assert_ne!(kept, squashed);
    assert!(kept.mean.iter().all(|mean| *mean >= 0.0));
    let similar = kept.mean.iter().zip(&squashed.mean).map(|(a, b)| (a - b).abs()).sum::<f32>() / 256.0;
    assert!(similar < 0.5, "the size changes the mean by {similar}");
}
