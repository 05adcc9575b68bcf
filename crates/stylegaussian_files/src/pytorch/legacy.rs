//! The container of `torch.save` before version 1.6: five pickles, then the storages.
//!
//! `_legacy_save` in `torch/serialization.py`: magic number, protocol version, system information, the object,
//! the keys of the storages. The storages follow in the order of the keys, each a 64-bit number of elements and
//! the elements, all little-endian.

use std::collections::HashMap;

use crate::error::{Mismatch, mismatch};

use super::{
    pickle::{Object, Pickle, StorageType},
    storage::Storages,
};

/// The pickled magic number 0x1950a86a20f9469cfc6c: protocol 2, a LONG1 of 10 bytes, the end.
pub(super) const MAGIC: [u8; 15] = *b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.";

/// The only protocol version of this container.
const PROTOCOL_VERSION: i64 = 1001;

/// Bytes of the number of elements before each storage.
const COUNT_BYTES: usize = 8;

/// The pickled object of a file that starts with [`MAGIC`], and the positions of its storages.
pub(super) fn parse(bytes: &[u8]) -> Result<(Pickle, Storages), Mismatch> {
    let (version, rest) = Pickle::read_first(&bytes[MAGIC.len()..])?;
    match version.object(version.root) {
        Object::Integer(PROTOCOL_VERSION) => {}
        other => {
            return Err(mismatch(
                format_args!("a PyTorch file of protocol version {other:?}"),
                format_args!("version {PROTOCOL_VERSION}"),
            ));
        }
    }
    // Type sizes and byte order of the machine that wrote the file. Storages are little-endian all the same.
    let (_system, rest) = Pickle::read_first(rest)?;
    let (pickle, rest) = Pickle::read_first(rest)?;
    let (keys, rest) = Pickle::read_first(rest)?;

    // The list of keys has no types. A storage has one where a tensor refers to it.
    let widths = element_widths(&pickle);
    let mut ranges = HashMap::new();
    let mut at = bytes.len() - rest.len();
    for key in keys.texts(keys.root) {
        let width = widths.get(key).copied().flatten().ok_or_else(|| {
            mismatch(format_args!("storage `{key}` of unknown elements"), "floats, integers or booleans")
        })?;
        let end = end_of_storage(bytes, at, width).ok_or_else(|| {
            mismatch(format_args!("storage `{key}` past the end (truncated?)"), "a whole PyTorch file")
        })?;
        ranges.insert(key.to_owned(), at + COUNT_BYTES..end);
        at = end;
    }
    Ok((pickle, Storages::in_stream(ranges)))
}

/// Bytes of one element of each storage, by the storage's key; `None` for an unknown type.
fn element_widths(pickle: &Pickle) -> HashMap<&str, Option<usize>> {
    let storages = pickle.ids().filter_map(|id| match pickle.object(id) {
        Object::Storage(storage) => Some((&storage.key[..], StorageType::width(storage.storage_type))),
        _ => None,
    });
    storages.collect()
}

/// The end of the storage that starts at `at` with its number of elements, or `None` if the file ends before.
fn end_of_storage(bytes: &[u8], at: usize, width: usize) -> Option<usize> {
    let &count = bytes.get(at..)?.first_chunk::<COUNT_BYTES>()?;
    let size = usize::try_from(u64::from_le_bytes(count)).ok()?.checked_mul(width)?;
    let end = at.checked_add(COUNT_BYTES)?.checked_add(size)?;
    (end <= bytes.len()).then_some(end)
}
