//! Every broken file is an error that names the file and what is wrong, never a panic.

use std::{fs, path::Path};

use safetensors::{Dtype, serialize, tensor::TensorView};
use stylegaussian_encoder::{
    Encoder, Image, StyleSize,
    chain::{Chain, Convolution, Kernel, Operation, Padding},
    style_features, style_statistics,
};

/// The file of a network that begins with a convolution of this kernel, without a border.
fn network(kernel: &Kernel, more: &[Operation]) -> Vec<u8> {
    let convolution = Convolution::new(kernel, Padding::Zeros(0)).unwrap().rectified();
    let operations = [&[Operation::Convolution(convolution)], more].concat();
    Chain::new(kernel.shape[1], operations).unwrap().to_bytes(None, &[])
}

/// An encoder of 2 channels, a half of the image's size: red + green, and 1 - blue.
fn tiny() -> Vec<u8> {
    let weight = vec![1.0, 1.0, 0.0, 0.0, 0.0, -1.0];
    let mix = Kernel { shape: [2, 3, 1, 1], weight, bias: vec![0.0, 1.0] };
    network(&mix, &[Operation::MaxPool { ceil: true }])
}

/// The message of opening these bytes under this name.
fn failure(name: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    let message = Encoder::open(&path).err().expect("a broken encoder opened").to_string();
    assert!(message.contains(name), "the message does not name {name}: {message}");
    message
}

/// VGG's tensors, all zero. The tensor `change` gets the shape `to` and is filled with `value`, or is removed
/// if `to` is empty.
fn vgg(change: &str, to: &[usize], value: f32) -> Vec<u8> {
    let layers = [
        ("conv1_1_rgb01", 64, 3),
        ("conv1_2", 64, 64),
        ("conv2_1", 128, 64),
        ("conv2_2", 128, 128),
        ("conv3_1", 256, 128),
    ];
    let mut tensors: Vec<(String, Vec<usize>)> = Vec::new();
    for (name, outputs, inputs) in layers {
        tensors.push((format!("{name}.weight"), vec![outputs, inputs, 3, 3]));
        tensors.push((format!("{name}.bias"), vec![outputs]));
    }
    for (name, shape) in &mut tensors {
        if name == change {
            *shape = to.to_vec();
        }
    }
    tensors.retain(|(_, shape)| !shape.is_empty());
    let size = |shape: &[usize]| shape.iter().product::<usize>();
    let bytes = |name: &str, shape: &[usize]| {
        let value = if name == change { value } else { 0.0 };
        value.to_le_bytes().repeat(size(shape))
    };
    let data: Vec<Vec<u8>> = tensors.iter().map(|(name, shape)| bytes(name, shape)).collect();
    let views = tensors.iter().zip(&data).map(|((name, shape), data)| {
        (name.clone(), TensorView::new(Dtype::F32, shape.clone(), data).unwrap())
    });
    serialize(views, None).unwrap()
}

fn contains_all(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}

#[test]
fn absent_file() {
    let message = Encoder::open(Path::new("/nowhere/vgg.safetensors")).err().unwrap().to_string();
    contains_all(&message, &["/nowhere/vgg.safetensors"]);
    assert!(Encoder::open(Path::new("/nowhere/vgg.onnx")).is_err());
    assert!(Encoder::open(Path::new("/nowhere/vgg.pth")).is_err());
}

#[test]
fn unknown_extension() {
    contains_all(&failure("vgg.bin", b""), &[".safetensors", ".pth", ".onnx"]);
}

#[test]
fn missing_tensor() {
    let message = failure("vgg.safetensors", &vgg("conv2_2.weight", &[], 0.0));
    // Of ten tensors nine are left, and the message lists the first six.
    contains_all(&message, &["conv2_2.weight", "conv1_1_rgb01.bias", "and 3 more"]);
}

#[test]
fn wrong_shape() {
    let message = failure("vgg.safetensors", &vgg("conv3_1.weight", &[200, 128, 3, 3], 0.0));
    contains_all(&message, &["conv3_1.weight", "F32 [200, 128, 3, 3]", "expected F32 [256, 128, 3, 3]"]);
}

#[test]
fn weights_that_are_no_numbers() {
    let message = failure("vgg.safetensors", &vgg("conv1_2.bias", &[64], f32::NAN));
    contains_all(&message, &["conv1_2.bias", "NaN", "index 0"]);
}

#[test]
fn truncated_safetensors() {
    let whole = vgg("", &[], 0.0);
    // Before, within and after the header's length of 8 bytes, and within the header and the data.
    for length in [0, 4, 8, 200, whole.len() / 2, whole.len() - 1] {
        failure("vgg.safetensors", &whole[..length]);
    }
    // A header that claims more than any file holds.
    failure("vgg.safetensors", &[0xFF; 64]);
}

#[test]
fn safetensors_of_something_else() {
    let data = [0_u8; 4];
    let view = TensorView::new(Dtype::F32, vec![1], &data).unwrap();
    let bytes = serialize([("loss", view)], None).unwrap();
    contains_all(&failure("other.safetensors", &bytes), &["conv1_1.weight", "features.0.weight", "loss"]);
}

#[test]
fn an_encoder_of_any_width_and_stride() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiny.encoder.safetensors");
    fs::write(&path, tiny()).unwrap();
    let encoder = Encoder::open(&path).unwrap();
    assert_eq!((encoder.n_channels(), encoder.id().name.as_str()), (2, "tiny"));
    assert_eq!(encoder.id().hash.len(), 16);

    // Left half red, right half blue: features (1, 1) and (0, 0).
    let rgb = (0..8 * 8).flat_map(|i| if i % 8 < 4 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] }).collect();
    let image = Image { width: 8, height: 8, rgb, alpha: None };
    let features = encoder.encode(&image).unwrap();
    assert_eq!((features.width, features.height, features.n_channels), (4, 4, 2));
    assert_eq!(features.values[..8], [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);

    // 16 cells, half 1 and half 0: mean 1/2, variance 16 / 4 / 15.
    let statistics = style_statistics(&encoder, &image, StyleSize::default()).unwrap();
    let deviation = (4.0_f32 / 15.0).sqrt();
    assert_eq!((statistics.mean, statistics.std_dev), (vec![0.5; 2], vec![deviation; 2]));
    assert_eq!(statistics.encoder.as_ref(), Some(encoder.id()));
    let squashed = style_features(&encoder, &image, StyleSize::Squash256).unwrap();
    assert_eq!((squashed.width, squashed.height), (128, 128));
}

#[test]
fn networks_that_are_no_encoder() {
    let gray = Kernel { shape: [1, 1, 1, 1], weight: vec![1.0], bias: vec![0.0] };
    let name = "gray.encoder.safetensors";
    contains_all(&failure(name, &network(&gray, &[])), &["takes 1 channels", "from RGB"]);
    let huge = Kernel { shape: [1, 3, 1, 1], weight: vec![f32::MAX; 3], bias: vec![0.0] };
    contains_all(&failure(name, &network(&huge, &[])), &["inf", "finite"]);
    // 2^24 times as many pixels.
    let one = Kernel { shape: [1, 3, 1, 1], weight: vec![1.0; 3], bias: vec![0.0] };
    contains_all(
        &failure(name, &network(&one, &[const { Operation::Double }; 12])),
        &["64x64 pixels", "numbers"],
    );
    let halved = network(&one, &[const { Operation::MaxPool { ceil: false } }; 7]);
    contains_all(&failure(name, &halved), &["64x64 pixels is too small"]);
    // More pixels than can be counted, before a convolution with a border.
    let same = Kernel { shape: [1; 4], weight: vec![1.0], bias: vec![0.0] };
    let border = Operation::Convolution(Convolution::new(&same, Padding::Zeros(1)).unwrap());
    let countless = [&[const { Operation::Double }; 70][..], &[border]].concat();
    contains_all(&failure(name, &network(&one, &countless)), &["64x64 pixels", "numbers"]);
    failure(name, &tiny()[..200]);
    // Not taken for another kind of file, such as ONNX.
    let cut = Encoder::from_bytes("tiny", tiny()[..200].to_vec()).err().unwrap().to_string();
    assert!(cut.starts_with("tiny: ") && !cut.contains("ONNX"), "{cut}");
}

/// A network that adds values whose sizes are equal for some images alone.
#[test]
fn images_that_a_network_cannot_add_up_are_refused() {
    let one = Kernel { shape: [1, 3, 1, 1], weight: vec![1.0; 3], bias: vec![0.0] };
    let there_and_back = [Operation::MaxPool { ceil: true }, Operation::Double, Operation::Add(1)];
    let encoder = Encoder::from_bytes("even", network(&one, &there_and_back)).unwrap();
    let image = |side: u32| Image { width: side, height: 8, rgb: vec![0.5; side as usize * 24], alpha: None };
    assert!(encoder.encode(&image(10)).is_ok());
    contains_all(&encoder.encode(&image(9)).unwrap_err().to_string(), &["even: ", "9x8"]);
}

#[test]
fn images_smaller_than_a_network_needs_are_refused() {
    let wide = Kernel { shape: [2, 3, 17, 17], weight: vec![0.01; 2 * 3 * 17 * 17], bias: vec![0.0; 2] };
    let encoder = Encoder::from_bytes("wide", network(&wide, &[])).unwrap();
    let image = |side: u32| Image {
        width: side,
        height: side,
        rgb: vec![0.5; (side * side * 3) as usize],
        alpha: None,
    };
    assert!(encoder.encode(&image(16)).is_err());
    let features = encoder.encode(&image(32)).unwrap();
    assert_eq!((features.width, features.height, features.n_channels), (16, 16, 2));
    // 3 x 17 x 17 weights of 0.01 over gray.
    assert!(features.values.iter().all(|value| (value - 4.335).abs() < 1e-4), "{:?}", features.values[0]);
}

#[test]
fn garbage_checkpoints() {
    failure("vgg.pth", b"");
    failure("vgg.pth", b"PK\x03\x04 not a zip");
    failure("vgg.pt", &[0x80; 300]);
}

#[test]
fn images_that_cannot_be_encoded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiny.encoder.safetensors");
    fs::write(&path, tiny()).unwrap();
    let encoder = Encoder::open(&path).unwrap();
    let pixel = Image { width: 1, height: 1, rgb: vec![0.5; 3], alpha: None };
    contains_all(&encoder.encode(&pixel).unwrap_err().to_string(), &["1x1", "8x8"]);
    assert!(style_statistics(&encoder, &pixel, StyleSize::default()).is_err());
    let short = Image { width: 20, height: 20, rgb: vec![0.5; 3], alpha: None };
    contains_all(&encoder.encode(&short).unwrap_err().to_string(), &["20x20", "3 values"]);
}

#[test]
fn paths_without_a_file_or_an_extension() {
    let folder = tempfile::tempdir().unwrap();
    let message = |path: &Path| Encoder::open(path).err().unwrap().to_string();
    contains_all(&message(Path::new("")), &["expected .safetensors, .pth, .pt or .onnx"]);
    contains_all(&message(folder.path()), &[&folder.path().display().to_string()]);
    for name in ["folder.onnx", "folder.pth", "folder.safetensors"] {
        let path = folder.path().join(name);
        fs::create_dir(&path).unwrap();
        contains_all(&message(&path), &[name]);
    }
    let expected =
        if cfg!(feature = "onnx") { "cannot load this ONNX graph" } else { "with the feature `onnx`" };
    contains_all(&failure("VGG.ONNX", b"no graph"), &[expected]);
}
