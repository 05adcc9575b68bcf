//! The first bytes of an SPZ payload.

use stylegaussian::sh;

use crate::error::{Mismatch, mismatch};

/// The first four bytes: 0x5053474e in little endian.
pub(super) const MAGIC: &[u8] = b"NGSP";

/// The highest degree of spherical harmonics that a file may have. Scenes carry fewer.
pub(super) const MAX_DEGREE: u8 = 4;

/// The scene was trained with mip-splatting's 2D filter.
pub(super) const ANTIALIASED: u8 = 1;

/// Records of extensions follow.
pub(super) const HAS_EXTENSIONS: u8 = 2;

/// The points are a tree of levels of detail (Spark).
const LOD_TREE: u8 = 0x80;

/// The bytes that all versions begin with.
pub(super) const N_BYTES: usize = 16;

/// An SPZ header. Versions 4 and later append to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    /// The version, 1 to 4.
    pub version: u32,
    /// N, the number of Gaussians.
    pub n: usize,
    /// Degree of the spherical harmonics, 0 to 4.
    pub degree: u8,
    /// Positions are multiples of 2^-this.
    pub fractional_bits: u8,
    /// Bits, see the constants.
    pub flags: u8,
}

impl Header {
    /// Reads and checks a header.
    pub fn parse(bytes: &[u8; N_BYTES]) -> Result<Self, Mismatch> {
        if bytes[..4] != *MAGIC {
            let found = format_args!("data that starts with `{}`", bytes[..4].escape_ascii()).to_string();
            return Err(mismatch(found, "an SPZ header, `NGSP`"));
        }
        let word = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| bytes[at + i]));
        let [degree, fractional_bits, flags] = [bytes[12], bytes[13], bytes[14]];
        let version = word(4);
        if !(1..=4).contains(&version) {
            return Err(mismatch(format_args!("SPZ version {version}"), "1 to 4"));
        }
        // The official reader keeps the count as a signed number.
        let n = i32::try_from(word(8))
            .map_err(|_| mismatch(format_args!("{} Gaussians", word(8)), "fewer than 2^31"))?;
        if degree > MAX_DEGREE {
            return Err(mismatch(format_args!("spherical harmonics of degree {degree}"), "0 to 4"));
        }
        if flags & LOD_TREE != 0 {
            return Err(mismatch(
                "an SPZ with a tree of levels of detail (flag 0x80), which is not supported",
                "an SPZ without one",
            ));
        }
        Ok(Self { version, n: n as usize, degree, fractional_bits, flags })
    }

    /// The header's bytes. Version 4 puts the number of its streams into the last one.
    pub fn to_bytes(self) -> [u8; N_BYTES] {
        let mut bytes = [0; N_BYTES];
        bytes[..4].copy_from_slice(MAGIC);
        bytes[4..8].copy_from_slice(&self.version.to_le_bytes());
        bytes[8..12].copy_from_slice(&(self.n as u32).to_le_bytes());
        bytes[12..15].copy_from_slice(&[self.degree, self.fractional_bits, self.flags]);
        bytes
    }

    /// Bytes of one position: three f16 in version 1, three 24-bit integers later.
    pub fn position_bytes(self) -> usize {
        if self.version == 1 { 6 } else { 9 }
    }

    /// Bytes of one rotation: three components until version 2, the smallest three in a word later.
    pub fn rotation_bytes(self) -> usize {
        if self.version <= 2 { 3 } else { 4 }
    }

    /// Bytes of the coefficients beyond degree 0 of one Gaussian.
    pub fn sh_bytes(self) -> usize {
        3 * (sh::n_coefficients(self.degree) - 1)
    }

    /// Bytes of each array, in the order of the file: positions, opacities, colors, scales, rotations,
    /// harmonics.
    pub fn array_bytes(self) -> [u64; 6] {
        // N is below 2^31 and the factors are at most 72, so no product overflows.
        [self.position_bytes(), 1, 3, 3, self.rotation_bytes(), self.sh_bytes()]
            .map(|per_gaussian| (self.n * per_gaussian) as u64)
    }
}
