//! Containers and pickles made here byte by byte. Files that the real torch.save wrote are in the tests of
//! checkpoints.

use super::*;
use crate::archive::tests::{Packing, archive};

/// A pickle of one scalar tensor in storage '0' of one float.
fn scalar_pickle() -> Vec<u8> {
    let mut pickle = b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n((".to_vec();
    pickle.extend(b"X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x06\0\0\0cuda:0K\x01tQ");
    pickle.extend(b"K\x00))\x89NtR.");
    pickle
}

#[test]
fn big_endian_storages_are_swapped() {
    let entries =
        [("a/data.pkl", Vec::new()), ("a/byteorder", b"big".to_vec()), ("a/data/0", vec![0x3f, 0x80, 0, 0])];
    let bytes = archive(&entries, Packing::Stored);
    let archive = Archive::open(&bytes).unwrap();
    let pickle = Pickle::read(&scalar_pickle()).unwrap();
    let storages = Storages::in_archive(&bytes, &archive, "a/").unwrap();
    let Object::Tensor(info) = pickle.object(pickle.root) else { panic!("no tensor") };
    assert_eq!(storages.read(&bytes, &pickle, "one", info).unwrap().values, [1.0]);
}

#[test]
fn views_outside_their_storage_are_errors() {
    let bytes = archive(&[("data/0", vec![0; 4])], Packing::Stored);
    let archive = Archive::open(&bytes).unwrap();
    let pickle = Pickle::read(&scalar_pickle()).unwrap();
    let storages = Storages::in_archive(&bytes, &archive, "").unwrap();
    let Object::Tensor(scalar) = pickle.object(pickle.root) else { panic!("no tensor") };
    let read = |offset, shape: &[usize], strides: &[usize]| {
        let info = TensorInfo { offset, shape: shape.into(), strides: strides.into(), ..scalar.clone() };
        storages.read(&bytes, &pickle, "view", &info).map(|tensor| tensor.values.len())
    };
    assert_eq!(read(0, &[], &[]).unwrap(), 1);
    assert_eq!(read(0, &[0, usize::MAX], &[1, 1]).unwrap(), 0);
    assert!(read(1, &[], &[]).is_err());
    assert!(read(0, &[2], &[1]).is_err());
    assert!(read(0, &[1 << 40], &[0]).is_err(), "a repeated number must not allocate terabytes");
    assert!(read(0, &[usize::MAX, 2], &[1, 1]).is_err());
    assert!(read(0, &[2, 2], &[usize::MAX, usize::MAX]).is_err());
    assert!(read(0, &[1], &[]).is_err());
}

#[test]
fn damaged_pickles_are_errors() {
    let check = |pickle: &[u8], part: &str| {
        let Err(Mismatch { found, .. }) = Pickle::read(pickle) else { panic!("no error for {part}") };
        assert!(found.contains(part), "{found}");
    };
    check(b"\x80\x02", "no end");
    check(b"\x80\x02.", "empty stack");
    check(b"(K\x01(0.", "empty stack"); // nothing is popped from under a mark
    check(b"t", "no mark");
    check(b"h\x05.", "no memo 5");
    check(b"X\xff\xff\xff\xffabc.", "no end");
    check(b"}K\x01K\x02K\x03\x86R.", "a call of an integer");
    check(b"]K\x01s.", "empty stack");
    check(b"K\x01K\x02a.", "items appended to an integer");
    check(b"(K\x01d.", "a key without a value");
    check(b"\x8a\x09123456789.", "past 64 bits");
    check(b"cos\nsystem\n.", "global `os.system`");
    check(b"I1\n.", "opcode 0x49");
    // A list that contains itself.
    assert!(Pickle::read(b"]q\0h\0a.").is_ok());
}

#[test]
fn numbers_of_a_pickle() {
    let numbers =
        |bytes: &[u8]| Pickle::read(bytes).map(|pickle| pickle.object(pickle.root).clone()).unwrap();
    assert_eq!(numbers(b"J\xfe\xff\xff\xff."), Object::Integer(-2));
    assert_eq!(numbers(b"M\x00\x80."), Object::Integer(32_768));
    assert_eq!(numbers(b"\x8a\x02\x00\x80."), Object::Integer(-32_768));
    assert_eq!(numbers(b"\x8a\x00."), Object::Integer(0));
    assert_eq!(numbers(b"\x8a\x05\0\0\0\0\x01."), Object::Integer(1 << 32));
}

/// A pickled text (`BINUNICODE`).
fn text(value: &str) -> Vec<u8> {
    [b"X", &(value.len() as u32).to_le_bytes()[..], value.as_bytes()].concat()
}

/// A tensor of 3 numbers from the second on, in storage `key` of `class`; `rebuild` with its last arguments.
fn vector(key: &str, class: &str, rebuild: &str, last: &[u8]) -> Vec<u8> {
    let class = format!("ctorch\n{class}\n");
    let storage = [&text("storage")[..], class.as_bytes(), &text(key), &text("cpu"), b"K\x04NtQ"].concat();
    let rebuild = format!("ctorch._utils\n{rebuild}\n((");
    [rebuild.as_bytes(), &storage, b"K\x01K\x03\x85K\x01\x85", last, b"tR"].concat()
}

/// A state dict as Python 2 and PyTorch 0.3 wrote it: the items are an argument of OrderedDict, tensors have
/// four arguments, storages follow the pickles.
fn old_state_dict(class: &str) -> Vec<u8> {
    let item = |name: &str, tensor: Vec<u8>| {
        [&b"](U"[..], &[name.len() as u8], name.as_bytes(), &tensor, b"e"].concat()
    };
    let items = [
        item("weight", vector("7", "FloatStorage", "_rebuild_tensor", b"")),
        item("count", vector("5", class, "_rebuild_tensor_v2", b"\x89N")),
    ];
    let object = [b"\x80\x02ccollections\nOrderedDict\n](", &items.concat()[..], b"e\x85R."].concat();
    let keys = [b"\x80\x02](", &text("5")[..], &text("7"), b"e."].concat();
    let mut bytes = [&legacy::MAGIC[..], &b"\x80\x02M\xe9\x03."[..], b"\x80\x02}.", &object, &keys].concat();
    bytes.extend([4_u64, 10, 20, 30, 40].map(u64::to_le_bytes).concat());
    bytes.extend(4_u64.to_le_bytes());
    bytes.extend([1.0_f32, 2.0, 3.0, 4.0].map(f32::to_le_bytes).concat());
    bytes
}

fn read_dict(bytes: &[u8]) -> Result<StateDict, FileError> {
    let path = Path::new("vgg.pth");
    state_dict(bytes.to_vec(), path).map_err(|mismatch| mismatch.at(path))
}

#[test]
fn a_stream_of_pickles_and_storages() {
    let state = read_dict(&old_state_dict("LongStorage")).unwrap();
    assert_eq!(state.names().collect::<Vec<_>>(), ["weight", "count"]);
    assert_eq!((state.shape("weight"), state.shape("bias")), (Some(&[3][..]), None));
    // The integers before it are skipped by their own width.
    let expected = Tensor { shape: vec![3], values: vec![2.0, 3.0, 4.0] };
    assert_eq!(state.tensor("weight").unwrap(), Some(expected));
    assert_eq!(state.tensor("bias").unwrap(), None);
    let message = state.tensor("count").unwrap_err().to_string();
    assert!(message.contains("vgg.pth") && message.contains("`count` of integers"), "{message}");
}

/// A state dict of the scalar `one` = 2.5.
fn zipped_state_dict(packing: Packing) -> Vec<u8> {
    let item = [&text("one")[..], &scalar_pickle()[2..scalar_pickle().len() - 1], b"s."].concat();
    let entries = [("a/data.pkl", [b"}", &item[..]].concat()), ("a/data/0", 2.5_f32.to_le_bytes().to_vec())];
    archive(&entries, packing)
}

#[test]
fn a_zipped_state_dict() {
    let state = read_dict(&zipped_state_dict(Packing::Stored)).unwrap();
    let expected = Tensor { shape: Vec::new(), values: vec![2.5] };
    assert_eq!(state.tensor("one").unwrap(), Some(expected));
}

#[test]
fn files_without_a_state_dict_are_errors() {
    let check = |bytes: &[u8], part: &str| {
        let message = read_dict(bytes).expect_err("an error").to_string();
        assert!(message.starts_with("vgg.pth: found ") && message.contains(part), "{message}");
    };
    check(b"", "an empty file");
    check(b"ustar and more", "starts with `ustar an`");
    check(b"\x80\x02}.", "expected a PyTorch file: a zip archive, or the pickle stream");
    check(&archive(&[("a/data.pkl", b"K\x01.".to_vec())], Packing::Stored), "a PyTorch file of an integer");
    let whole = old_state_dict("LongStorage");
    for length in [legacy::MAGIC.len(), 30, 100, whole.len() - 30, whole.len() - 1] {
        check(&whole[..length], "truncated?");
    }
    check(&old_state_dict("QInt8Storage"), "storage `5` of unknown elements");
    let mut other_version = whole.clone();
    other_version[legacy::MAGIC.len() + 3] = 0;
    check(&other_version, "protocol version");
    // A storage of 2^64 - 1 elements.
    let mut lying = whole.clone();
    let count = whole.len() - 16 - 8;
    lying[count..count + 8].fill(0xff);
    check(&lying, "storage `7` past the end");
}

#[test]
fn damaged_state_dicts_never_panic() {
    for whole in [zipped_state_dict(Packing::Zip64), old_state_dict("LongStorage")] {
        for at in 0..whole.len() {
            for change in [0x00, 0xff, whole[at] ^ 0x01, whole[at] ^ 0x80, b'9'] {
                let mut damaged = whole.clone();
                damaged[at] = change;
                let Ok(state) = read_dict(&damaged) else { continue };
                for name in state.names() {
                    let _ = state.tensor(name);
                }
            }
        }
    }
}
