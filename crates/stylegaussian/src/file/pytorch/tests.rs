//! Containers and pickles made here byte by byte. Files that the real torch.save wrote are in the tests of checkpoints.

use super::*;

/// A pickle of one scalar tensor in storage '0' of one float.
fn scalar_pickle() -> Vec<u8> {
    let mut pickle = b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n((".to_vec();
    pickle.extend(b"X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x06\0\0\0cuda:0K\x01tQ");
    pickle.extend(b"K\x00))\x89NtR.");
    pickle
}

/// Fields of a record, one after the other.
fn record(signature: &[u8; 4], fields: &[&[u8]]) -> Vec<u8> {
    [&signature[..], &fields.concat()].concat()
}

/// A zip archive of stored entries; with `zip64`, every size and offset stands in the 64-bit fields.
pub(in crate::file) fn archive(entries: &[(&str, Vec<u8>)], zip64: bool) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, data) in entries {
        let local = bytes.len() as u64;
        let (len, size) = (data.len() as u64, data.len() as u32);
        let n_name = (name.len() as u16).to_le_bytes();
        bytes.extend(record(
            b"PK\x03\x04",
            &[&[0; 14], &size.to_le_bytes(), &size.to_le_bytes(), &n_name, &[5, 0]],
        ));
        bytes.extend(name.as_bytes());
        bytes.extend(*b"FB\x01\0Z"); // padding in an extra field, as torch aligns its storages
        bytes.extend(data);
        let (size, offset) = if zip64 { (u32::MAX, u32::MAX) } else { (size, local as u32) };
        let mut extra = Vec::new();
        if zip64 {
            extra.extend(*b"\x01\0\x18\0");
            extra.extend([len, len, local].map(u64::to_le_bytes).concat());
        }
        let n_extra = (extra.len() as u16).to_le_bytes();
        let fields: [&[u8]; 7] = [
            &[0; 16],
            &size.to_le_bytes(),
            &size.to_le_bytes(),
            &n_name,
            &n_extra,
            &[0; 10],
            &offset.to_le_bytes(),
        ];
        directory.extend(record(b"PK\x01\x02", &fields));
        directory.extend([name.as_bytes(), &extra].concat());
    }
    let (start, n) = (bytes.len() as u64, entries.len() as u64);
    let n_directory = directory.len() as u64;
    bytes.extend(directory);
    let end = bytes.len() as u64;
    if zip64 {
        let fields = [n, n, n_directory, start].map(u64::to_le_bytes).concat();
        bytes.extend(record(b"PK\x06\x06", &[&44_u64.to_le_bytes(), &[0; 12], &fields]));
        bytes.extend(record(b"PK\x06\x07", &[&[0; 4], &end.to_le_bytes(), &[1, 0, 0, 0]]));
    }
    let (n, size, start) = match zip64 {
        true => (u16::MAX, u32::MAX, u32::MAX),
        false => (n as u16, n_directory as u32, start as u32),
    };
    let n = n.to_le_bytes();
    bytes.extend(record(
        b"PK\x05\x06",
        &[&[0; 4], &n, &n, &size.to_le_bytes(), &start.to_le_bytes(), &[0; 2]],
    ));
    bytes
}

#[test]
fn zip_and_zip64_give_the_same_entries() {
    let entries = [("x/data.pkl", b"one".to_vec()), ("x/data/0", vec![7; 300])];
    for zip64 in [false, true] {
        let bytes = archive(&entries, zip64);
        let archive = zip::Archive::open(&bytes).unwrap();
        assert_eq!(archive.names().count(), 2);
        for (name, data) in &entries {
            assert_eq!(archive.get(name), Some(&data[..]), "zip64: {zip64}");
        }
    }
}

#[test]
fn big_endian_storages_are_swapped() {
    let entries =
        [("a/data.pkl", Vec::new()), ("a/byteorder", b"big".to_vec()), ("a/data/0", vec![0x3f, 0x80, 0, 0])];
    let bytes = archive(&entries, false);
    let archive = zip::Archive::open(&bytes).unwrap();
    let pickle = Pickle::read(&scalar_pickle()).unwrap();
    let storages = Storages::in_archive(&archive, "a/").unwrap();
    let Object::Tensor(info) = pickle.object(pickle.root) else { panic!("no tensor") };
    assert_eq!(storages.read(&bytes, &pickle, "one", info).unwrap().values, [1.0]);
}

#[test]
fn damaged_archives_are_errors() {
    let entries = [("x/data.pkl", b"one".to_vec())];
    let good = archive(&entries, true);
    let check = |bytes: Vec<u8>, part: &str| {
        let Err(Mismatch { found, .. }) = zip::Archive::open(&bytes) else { panic!("no error for {part}") };
        assert!(found.contains(part), "{found}");
    };
    check(good[..good.len() - 1].into(), "no end record");
    check(good[..10].into(), "too few bytes");
    let at = |signature: &[u8]| good.windows(4).position(|w| w == signature).unwrap();
    let changed = |at: usize, value: u8| {
        let mut bytes = good.clone();
        bytes[at] = value;
        bytes
    };
    check(changed(at(b"PK\x01\x02") + 10, 8), "compressed (method 8)");
    check(changed(at(b"PK\x01\x02"), 0), "damaged central directory");
    check(changed(at(b"PK\x03\x04"), 0), "no entry where");
    // A count of 2^63 entries, and an offset of 2^63.
    // The highest byte of a field of 8 bytes: at 32 + 7, 48 + 7 and 8 + 7 of its record.
    check(changed(at(b"PK\x06\x06") + 39, 0x80), "past its end");
    check(changed(at(b"PK\x06\x06") + 55, 0x80), "past its end");
    check(changed(at(b"PK\x06\x07") + 15, 0x80), "past its end");
}

#[test]
fn views_outside_their_storage_are_errors() {
    let bytes = archive(&[("data/0", vec![0; 4])], false);
    let archive = zip::Archive::open(&bytes).unwrap();
    let pickle = Pickle::read(&scalar_pickle()).unwrap();
    let storages = Storages::in_archive(&archive, "").unwrap();
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

/// A state dict as Python 2 and PyTorch 0.3 wrote it: the items are an argument of OrderedDict, tensors have four
/// arguments, storages follow the pickles.
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
fn zipped_state_dict(zip64: bool) -> Vec<u8> {
    let item = [&text("one")[..], &scalar_pickle()[2..scalar_pickle().len() - 1], b"s."].concat();
    let entries = [("a/data.pkl", [b"}", &item[..]].concat()), ("a/data/0", 2.5_f32.to_le_bytes().to_vec())];
    archive(&entries, zip64)
}

#[test]
fn a_zipped_state_dict() {
    let state = read_dict(&zipped_state_dict(false)).unwrap();
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
    check(&archive(&[("a/data.pkl", b"K\x01.".to_vec())], false), "a PyTorch file of an integer");
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
    for whole in [zipped_state_dict(true), old_state_dict("LongStorage")] {
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
