//! VGG as a chain against a naive convolution written from the layers' definition.

mod twin;

use std::{collections::HashMap, path::Path};

use safetensors::{Dtype, serialize_to_file, tensor::TensorView};
use stylegaussian_encoder::{Encoder, Image};
use twin::{Border, Feature, Vgg, random_image, random_values};

/// Writes f32 tensors to a safetensors file.
fn write(path: &Path, tensors: &[(String, Vec<usize>, Vec<f32>)]) {
    let bytes: Vec<Vec<u8>> =
        tensors.iter().map(|(.., values)| values.iter().flat_map(|v| v.to_le_bytes()).collect()).collect();
    let views: HashMap<&str, TensorView<'_>> = tensors
        .iter()
        .zip(&bytes)
        .map(|((name, shape, _), bytes)| {
            (&name[..], TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap())
        })
        .collect();
    serialize_to_file(views, None, path).unwrap();
}

/// Random kernels of VGG's shapes, scaled so that activations neither vanish nor explode.
fn random_vgg(names: [&str; 5]) -> Vec<(String, Vec<usize>, Vec<f32>)> {
    let channels = [3, 64, 64, 128, 128, 256];
    let mut tensors = Vec::new();
    for (layer, name) in names.into_iter().enumerate() {
        let (inputs, outputs) = (channels[layer], channels[layer + 1]);
        let scale = (6.0 / (inputs as f32 * 9.0)).sqrt();
        let weight =
            random_values(outputs * inputs * 9, layer as u64 + 1).iter().map(|v| v * scale).collect();
        tensors.push((format!("{name}.weight"), vec![outputs, inputs, 3, 3], weight));
        let bias = random_values(outputs, layer as u64 + 11).iter().map(|v| v * 0.1).collect();
        tensors.push((format!("{name}.bias"), vec![outputs], bias));
    }
    tensors
}

fn check(tensors: &[(String, Vec<usize>, Vec<f32>)], vgg: &Vgg, size: (u32, u32)) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("vgg.safetensors");
    write(&path, tensors);
    let encoder = Encoder::open(&path).unwrap();
    let image = random_image(size.0, size.1);
    let found = encoder.encode(&image).unwrap();
    let expected = vgg.encode(&Feature::from(&image));
    assert_eq!((found.width as usize, found.height as usize), (expected.width, expected.height));
    assert_eq!(found.n_channels, 256);
    // A tolerance relative to the largest feature: each one sums 1,152 products at the last layer.
    let largest = expected.values.iter().fold(0.0_f32, |a, &b| a.max(b.abs()));
    assert!(largest > 0.1, "the twin's features vanish: nothing is compared");
    for cell in 0..found.width as usize * found.height as usize {
        for channel in 0..256 {
            let found = found.values[cell * 256 + channel];
            let expected = expected.values[channel * expected.width * expected.height + cell];
            assert!(
                (found - expected).abs() < 1e-4 * largest.max(1.0),
                "cell {cell}, channel {channel}: {found}, expected {expected}"
            );
        }
    }
}

const NORMALIZED: [&str; 5] = ["conv1_1_rgb01", "conv1_2", "conv2_1", "conv2_2", "conv3_1"];
const TORCHVISION: [&str; 5] = ["features.0", "features.2", "features.5", "features.7", "features.10"];

#[test]
fn normalized_weights_match_the_twin() {
    let tensors = random_vgg(NORMALIZED);
    let vgg = Vgg::new(&tensors, NORMALIZED, None, Border::Reflect, true);
    // Odd sizes: ceil pooling makes 53 -> 27 -> 14 and 37 -> 19 -> 10.
    check(&tensors, &vgg, (53, 37));
    check(&tensors, &vgg, (8, 8));
}

#[test]
fn conv0_comes_before_conv1_1() {
    let names = ["conv1_1", "conv1_2", "conv2_1", "conv2_2", "conv3_1"];
    let mut tensors = random_vgg(names);
    // BGR with a shift, as Caffe's preprocessing.
    let conv0 = vec![0.0, 0.0, 2.0, 0.0, 2.0, 0.0, 2.0, 0.0, 0.0];
    tensors.push(("conv0.weight".into(), vec![3, 3, 1, 1], conv0.clone()));
    tensors.push(("conv0.bias".into(), vec![3], vec![-0.8, -0.9, -1.0]));
    let vgg = Vgg::new(&tensors, names, Some((conv0, vec![-0.8, -0.9, -1.0])), Border::Reflect, true);
    check(&tensors, &vgg, (19, 21));
}

#[test]
fn torchvision_weights_match_the_twin() {
    let tensors = random_vgg(TORCHVISION);
    // ImageNet's normalization as torchvision documents it: (x - mean) / deviation, then zero padding, floor
    // pooling.
    let (mean, std_dev) = ([0.485_f32, 0.456, 0.406], [0.229_f32, 0.224, 0.225]);
    let mut scale = vec![0.0; 9];
    let mut shift = vec![0.0; 3];
    for channel in 0..3 {
        scale[channel * 3 + channel] = 1.0 / std_dev[channel];
        shift[channel] = -mean[channel] / std_dev[channel];
    }
    let vgg = Vgg::new(&tensors, TORCHVISION, Some((scale, shift)), Border::Zero, false);
    check(&tensors, &vgg, (37, 30));
}

#[test]
fn encoding_is_deterministic_and_parallel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("vgg.safetensors");
    write(&path, &random_vgg(NORMALIZED));
    let encoder = Encoder::open(&path).unwrap();
    let images: Vec<Image> = (0..6).map(|i| random_image(24 + i, 40 - i)).collect();
    let alone: Vec<_> = images.iter().map(|image| encoder.encode(image).unwrap()).collect();
    let together: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> =
            images.iter().map(|image| scope.spawn(|| encoder.encode(image).unwrap())).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert!(alone == together);
}
