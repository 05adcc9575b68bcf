//! 3DGS scenes as `.ply`, in every dialect in use.
//!
//! The crate ply-rs parses the header, after a check for lines on which it would panic. The rows are read by
//! our own reader: ply-rs returns every value with a fresh copy of its property's name, and its ascii numbers
//! include neither NaN nor `1E5`.

use std::fmt;

use glam::Vec3;

use super::{
    error::{Loaded, Mismatch},
    format::Format,
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
    recognizes: |bytes, _| matches!(bytes, [b'p', b'l', b'y', b'\n' | b'\r' | b' ' | b'\t', ..]),
    read: |files, _| Ok(read(files.take_main())?),
    write: Some(|out, scene, options| Ok(write::write(out, scene, options).map(|()| Vec::new())?)),
};

pub(super) use pack::write as write_compressed;

/// Reads a scene of either layout, compressed or native.
pub(super) fn read(bytes: Vec<u8>) -> Result<Loaded, Mismatch> {
    let header = Header::parse(&bytes)?;
    let is_compressed = compressed::is_compressed(&header);
    let mut loaded =
        if is_compressed { compressed::read(&header, &bytes)? } else { native::read(&header, bytes)? };
    if let Some((up, because)) = header.up() {
        loaded.scene.up = Some(up);
        loaded.axes_because += &format!("; up is {}, because {because}", Direction(up));
    }
    loaded.scene.filter = header.filter(&mut loaded.warnings);
    Ok(loaded)
}

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
