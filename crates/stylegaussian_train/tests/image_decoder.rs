//! The 2D decoder on real weights and a real photo.

#[expect(dead_code, reason = "the tests share these, and each uses a part")]
mod support;

use stylegaussian_encoder::{Encoder, FeatureMap, Image};
use stylegaussian_train::eval::ImageDecoder;
use support::data;

/// Peak signal to noise ratio of two images of one size.
fn decibels(a: &Image, b: &Image) -> f64 {
    let squares: f64 = a.rgb.iter().zip(&b.rgb).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (squares / a.rgb.len() as f64).log10()
}

#[test]
fn a_photo_comes_back_from_its_features() {
    let (Some(vgg), Some(photos)) = (data("vgg"), data("photos")) else { return };
    let encoder = Encoder::open(&vgg.join("vgg19_normalised_relu3_1.safetensors")).unwrap();
    let decoder = ImageDecoder::open(&vgg.join("wct_decoder_relu3_1.safetensors")).unwrap();
    let photos = std::fs::read_dir(photos.join("snowmiku/images")).unwrap();
    let photo = photos.map(|photo| photo.unwrap().path()).min().unwrap();
    let photo = Image::open(&photo).unwrap().resized(512, 384);
    let found = decoder.decode(&encoder.encode(&photo).unwrap()).unwrap();
    assert_eq!((found.width, found.height, found.rgb.len()), (512, 384, photo.rgb.len()));
    let quality = decibels(&photo, &found);
    println!("reconstruction: {quality:.1} dB");
    assert!(quality > 25.0, "{quality} dB");

    let two_channels = FeatureMap { width: 4, height: 4, n_channels: 2, values: vec![0.0; 32] };
    let message = decoder.decode(&two_channels).unwrap_err().to_string();
    assert!(message.contains("256 channels") && message.contains("found 2 of 4x4"), "{message}");
}

#[test]
fn weights_of_another_decoder_are_refused() {
    let Some(vgg) = data("vgg") else { return };
    let path = vgg.join("distilled16x_decoder_relu3_1.safetensors");
    let message = ImageDecoder::open(&path).err().expect("a decoder of 64 channels opened").to_string();
    assert!(
        message.contains("distilled16x_decoder_relu3_1") && message.contains("[128, 256, 3, 3]"),
        "{message}"
    );
}
