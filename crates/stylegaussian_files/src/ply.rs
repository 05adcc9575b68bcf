//! 3DGS scenes as `.ply`, in every dialect in use.
//!
//! The crate ply-rs parses the header, after a check for lines on which it would panic. The rows are read by
//! our own reader: ply-rs returns every value with a fresh copy of its property's name, and its ascii numbers
//! include neither NaN nor `1E5`.

use std::fmt;

use glam::Vec3;
use ply_rs::ply::Encoding;
use stylegaussian::work::Work;

use super::{
    error::{Loaded, Mismatch},
    format::Format,
    json::without_mark,
    rows,
};

mod color;
mod columns;
mod compressed;
mod distant;
mod header;
mod native;
mod numbers;
mod pack;
mod write;
mod writers;

use header::Header;

/// The format: binary and ascii, native and compressed.
pub(super) const FORMAT: Format = Format {
    name: "3DGS .ply",
    extensions: &["ply"],
    recognizes: |bytes, _| {
        matches!(without_mark(bytes), [b'p', b'l', b'y', b'\n' | b'\r' | b' ' | b'\t', ..])
    },
    read: |files, _| Ok(read(files.take_main(), &files.work)?),
    write: Some(|out, scene, options| Ok(write::write(out, scene, options).map(|()| Vec::new())?)),
};

pub(super) use pack::write as write_compressed;

/// Reads a scene of either layout, compressed or native.
pub(super) fn read(bytes: Vec<u8>, work: &Work) -> Result<Loaded, Mismatch> {
    let header = Header::parse(&bytes)?;
    let is_compressed = compressed::is_compressed(&header);
    let mut loaded = match is_compressed {
        true => compressed::read(&header, &bytes, work)?,
        false => native::read(&header, bytes, work)?,
    };
    if let Some((up, because)) = header.up() {
        loaded.scene.up = Some(up);
        loaded.axes_because += &format!("; up is {}, because {because}", Direction(up));
    }
    loaded.warnings.extend(header.prefixed());
    loaded.scene.filter = header.filter(&mut loaded.warnings);
    Ok(loaded)
}

/// The rows of a file that begins with `head`, or `None` if they have no common size: ascii, lists, several
/// elements.
pub(super) fn rows(head: &[u8]) -> Option<rows::Header> {
    let end = head.windows(END.len()).position(|window| window == END)?;
    let size = end + END.len() + head[end + END.len()..].iter().position(|&byte| byte == b'\n')? + 1;
    let text = std::str::from_utf8(&head[..size]).ok()?;
    let line = text.find("\nelement vertex ")? + "\nelement vertex ".len();
    let digits = text[line..].find(|c: char| !c.is_ascii_digit())?;
    let [before, after] = [&text[..line], &text[line + digits..]];
    // The header of no row, which needs no bytes after it.
    let header = Header::parse(format!("{before}0{after}").as_bytes()).ok()?;
    let mut elements = header.elements();
    let (vertex, is_alone) = (elements.next()?, elements.next().is_none());
    let is_binary = header.encoding() != Encoding::Ascii;
    Some(rows::Header {
        before: before.into(),
        after: after.into(),
        count: Some(text[line..line + digits].parse().ok()?),
        row: header.fixed_row(vertex).filter(|_| is_alone && is_binary)? as u64,
        size: size as u64,
    })
}

/// The last line of a header, without its end.
const END: &[u8] = b"\nend_header";

/// A direction for messages: an axis by its name.
struct Direction(Vec3);

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(direction) = *self;
        let axis = direction.abs().max_position();
        if direction.abs()[axis] == 1.0 {
            return write!(f, "{}{}", if direction[axis] < 0.0 { '-' } else { '+' }, ['x', 'y', 'z'][axis]);
        }
        write!(f, "({}, {}, {})", direction.x, direction.y, direction.z)
    }
}

#[cfg(test)]
pub(super) mod tests;
