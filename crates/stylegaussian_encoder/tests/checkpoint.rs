//! torchvision's weights from a `.pth`, written here as PyTorch before 1.6 wrote them: pickles, then the
//! storages.

mod twin;

use std::fs;

use safetensors::{Dtype, serialize_to_file, tensor::TensorView};
use stylegaussian_encoder::Encoder;
use twin::{random_image, random_values};

/// Name and shape of every tensor up to relu3_1.
fn tensors() -> Vec<(String, Vec<usize>)> {
    let layers = [(0, 3, 64), (2, 64, 64), (5, 64, 128), (7, 128, 128), (10, 128, 256)];
    let both = |(module, inputs, outputs): (usize, usize, usize)| {
        let weight = (format!("features.{module}.weight"), vec![outputs, inputs, 3, 3]);
        [weight, (format!("features.{module}.bias"), vec![outputs])]
    };
    layers.into_iter().flat_map(both).collect()
}

fn values(index: usize, shape: &[usize]) -> Vec<u8> {
    let values = random_values(shape.iter().product(), index as u64);
    values.iter().flat_map(|value| (value * 0.05).to_le_bytes()).collect()
}

/// A pickled string (`BINUNICODE`).
fn text(value: &str) -> Vec<u8> {
    [b"X", &(value.len() as u32).to_le_bytes()[..], value.as_bytes()].concat()
}

/// A pickled integer (`BININT`).
fn integer(value: usize) -> Vec<u8> {
    [b"J", &(value as u32).to_le_bytes()[..]].concat()
}

/// A pickled tuple (`MARK ... TUPLE`).
fn tuple(items: &[Vec<u8>]) -> Vec<u8> {
    [b"(", &items.concat()[..], b"t"].concat()
}

/// `_rebuild_tensor_v2(storage, 0, shape, strides, False, {})`, called (`REDUCE`).
fn tensor(key: &str, shape: &[usize]) -> Vec<u8> {
    let n_values = shape.iter().product();
    let storage = [
        text("storage"),
        b"ctorch\nFloatStorage\n".to_vec(),
        text(key),
        text("cpu"),
        integer(n_values),
        b"N".to_vec(),
    ];
    let strides: Vec<_> = (0..shape.len()).map(|axis| integer(shape[axis + 1..].iter().product())).collect();
    let sizes: Vec<_> = shape.iter().map(|&size| integer(size)).collect();
    let arguments = [
        // `BINPERSID`: the storage is named here, its values follow after the pickles.
        [tuple(&storage), b"Q".to_vec()].concat(),
        integer(0),
        tuple(&sizes),
        tuple(&strides),
        // `requires_grad` is False, and there are no backward hooks.
        b"\x89".to_vec(),
        b"}".to_vec(),
    ];
    [b"ctorch._utils\n_rebuild_tensor_v2\n".to_vec(), tuple(&arguments), b"R".to_vec()].concat()
}

fn pickle(value: &[u8]) -> Vec<u8> {
    [b"\x80\x02", value, b"."].concat()
}

fn checkpoint(tensors: &[(String, Vec<usize>)]) -> Vec<u8> {
    // `sys_info`, the third pickle of the format. `\x88` is True.
    let system =
        [b"}(", &text("protocol_version")[..], &integer(1001), &text("little_endian"), b"\x88u"].concat();
    let entry = |(index, (name, shape)): (usize, &(String, Vec<usize>))| {
        [text(name), tensor(&index.to_string(), shape)].concat()
    };
    let entries: Vec<Vec<u8>> = tensors.iter().enumerate().map(entry).collect();
    let dictionary = [b"}(", &entries.concat()[..], b"u"].concat();
    let keys: Vec<Vec<u8>> = (0..tensors.len()).map(|index| text(&index.to_string())).collect();
    // PyTorch's magic number 0x1950a86a20f9469cfc6c as a pickled `LONG1` of ten bytes.
    let mut bytes = pickle(b"\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19");
    bytes.extend(pickle(&integer(1001)));
    bytes.extend(pickle(&system));
    bytes.extend(pickle(&dictionary));
    bytes.extend(pickle(&[b"](", &keys.concat()[..], b"e"].concat()));
    for (index, (_, shape)) in tensors.iter().enumerate() {
        bytes.extend((shape.iter().product::<usize>() as u64).to_le_bytes());
        bytes.extend(values(index, shape));
    }
    bytes
}

#[test]
fn a_checkpoint_encodes_as_its_safetensors_do() {
    let folder = tempfile::tempdir().unwrap();
    let (pth, safetensors) = (folder.path().join("vgg19.pth"), folder.path().join("vgg19.safetensors"));
    let tensors = tensors();
    fs::write(&pth, checkpoint(&tensors)).unwrap();
    let data: Vec<Vec<u8>> =
        tensors.iter().enumerate().map(|(index, (_, shape))| values(index, shape)).collect();
    let views = tensors.iter().zip(&data);
    let views =
        views.map(|((name, shape), data)| (name, TensorView::new(Dtype::F32, shape.clone(), data).unwrap()));
    serialize_to_file(views, None, &safetensors).unwrap();

    let (by_pth, by_safetensors) = (Encoder::open(&pth).unwrap(), Encoder::open(&safetensors).unwrap());
    let image = random_image(32, 24);
    assert!(by_pth.encode(&image).unwrap() == by_safetensors.encode(&image).unwrap());
    assert_eq!(by_pth.id().name, "vgg19");
    assert_ne!(by_pth.id(), by_safetensors.id());
}

#[test]
fn broken_checkpoints_name_the_file_and_the_tensor() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("vgg19.pth");
    let failure = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        Encoder::open(&path).err().expect("a broken checkpoint opened").to_string()
    };
    let whole = checkpoint(&tensors());
    // Within the magic number, within the dictionary, and within the values.
    for length in [10, 100, whole.len() / 2, whole.len() - 1] {
        let message = failure(&whole[..length]);
        assert!(message.contains("vgg19.pth"), "{message}");
    }

    let mut changed = tensors();
    // The fifth tensor is conv2_1's weight.
    changed[4].1 = vec![128, 64, 5, 5];
    let message = failure(&checkpoint(&changed));
    assert!(message.contains("features.5.weight") && message.contains("[128, 64, 3, 3]"), "{message}");

    let mut vgg_16 = tensors();
    // conv4_1 of VGG-16. In VGG-19 this module is a ReLU and has no tensors.
    vgg_16.push(("features.17.weight".into(), vec![1]));
    assert!(failure(&checkpoint(&vgg_16)).contains("VGG-16"));
}
