//! The headers of a `.ksplat`, checked against the size of the file.

use glam::Vec3;
use half::f16;
use stylegaussian::sh::{MAX_DEGREE, n_coefficients};

use super::f32_at;
use crate::error::{Mismatch, bytes_in_words, mismatch};

/// Size of the file's header, in bytes.
pub(super) const HEADER: usize = 4096;
/// Size of a section's header, in bytes.
pub(super) const SECTION_HEADER: usize = 1024;
/// Spherical harmonics of level 2 lie within plus and minus this, if the header does not say.
const SH_RANGE: f32 = 1.5;
/// Steps from the center of a bucket to its sides, if the section does not say.
const STEPS: u32 = 32_767;

/// A file: its level of compression, and its sections.
pub(super) struct Header<'a> {
    /// 0 to 2.
    pub level: u16,
    /// The smallest and the largest spherical harmonic of level 2.
    sh_range: [f32; 2],
    /// The sections.
    pub sections: Vec<Section<'a>>,
}

/// A section's data.
pub(super) struct Section<'a> {
    /// The rows of its Gaussians.
    pub rows: &'a [u8],
    /// Size of a row, in bytes.
    pub row: usize,
    /// Degree of the spherical harmonics.
    pub degree: u8,
    /// Steps from the center of a bucket to its sides.
    pub range: f32,
    /// Side of a bucket.
    pub block: f32,
    /// The centers of buckets, three f32 each, `bucket_bytes` apart.
    buckets: &'a [u8],
    bucket_bytes: usize,
    /// Gaussians in a full bucket, and the number of full buckets, which come first.
    bucket_size: usize,
    n_full: usize,
    /// The sizes of the other buckets, u32 each.
    partial: &'a [u8],
}

impl<'a> Header<'a> {
    /// Reads all headers and cuts the file into sections.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Mismatch> {
        if bytes.len() < HEADER {
            let found = bytes_in_words(bytes.len() as u64);
            return Err(mismatch(found, format_args!("a .ksplat header of {HEADER}")));
        }
        let [major, minor] = [bytes[0], bytes[1]];
        if major != 0 || minor == 0 {
            return Err(mismatch(
                format_args!(".ksplat version {major}.{minor}"),
                "version 0.1 or later 0.x",
            ));
        }
        let level = u16_at(bytes, 20);
        if level > 2 {
            return Err(mismatch(format_args!(".ksplat compression level {level}"), "0, 1 or 2"));
        }
        let or = |value: f32, default: f32| if value == 0.0 { default } else { value };
        let sh_range = [or(f32_at(bytes, 36), -SH_RANGE), or(f32_at(bytes, 40), SH_RANGE)];
        // The count of sections in use may be 0 in files that were written in one go.
        let n_sections = u32_at(bytes, 4) as usize;
        let (mut headers, mut data) = split(bytes, HEADER, n_sections.saturating_mul(SECTION_HEADER))
            .ok_or_else(|| past_end(bytes, format_args!("{n_sections} headers of sections")))?;
        let mut sections = Vec::new();
        while let Some((header, rest)) = headers.split_at_checked(SECTION_HEADER) {
            let (section, size) = Section::parse(header, data, level)
                .ok_or_else(|| past_end(bytes, format_args!("section {}", sections.len())))??;
            // The last section of a file may be cut behind its Gaussians.
            data = data.get(size..).unwrap_or_default();
            sections.push(section);
            headers = rest;
        }
        Ok(Self { level, sh_range, sections })
    }

    /// The numbers at the end of a row.
    pub fn coefficients(&self, bytes: &[u8]) -> Vec<f32> {
        let [min, max] = self.sh_range;
        match self.level {
            0 => bytes.chunks_exact(4).map(|b| f32_at(b, 0)).collect(),
            1 => bytes.chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
            _ => bytes.iter().map(|&b| min + f32::from(b) / 255.0 * (max - min)).collect(),
        }
    }
}

impl<'a> Section<'a> {
    /// Cuts a section off the front of `data` and says how much of it belongs to the section. `None` if the
    /// data is too short.
    fn parse(header: &[u8], data: &'a [u8], level: u16) -> Option<Result<(Self, usize), Mismatch>> {
        let [n, most, bucket_size, n_buckets] = [0, 4, 8, 12].map(|at| u32_at(header, at) as usize);
        let [n_full, n_partial] = [32, 36].map(|at| u32_at(header, at) as usize);
        let bucket_bytes = usize::from(u16_at(header, 20));
        let degree = match u8::try_from(u16_at(header, 40)) {
            Ok(degree) if degree <= MAX_DEGREE => degree,
            _ => {
                let found = format!("spherical harmonics of degree {}", u16_at(header, 40));
                return Some(Err(mismatch(found, "0 to 3")));
            }
        };
        let n_rest = 3 * (n_coefficients(degree) - 1);
        let row = match level {
            0 => 44 + 4 * n_rest,
            1 => 24 + 2 * n_rest,
            _ => 24 + n_rest,
        };
        let (partial, data) = data.split_at_checked(n_partial.checked_mul(4)?)?;
        let (buckets, data) = data.split_at_checked(bucket_bytes.checked_mul(n_buckets)?)?;
        let rows = data.get(..n.checked_mul(row)?)?;
        let range = match u32_at(header, 24) {
            0 => STEPS,
            range => range,
        };
        let section = Self {
            rows,
            row,
            degree,
            range: range as f32,
            block: f32_at(header, 16),
            buckets,
            bucket_bytes,
            bucket_size,
            n_full,
            partial,
        };
        if level > 0 && (bucket_bytes < 12 || section.in_buckets() < n) {
            let found = format!("buckets for {} of {n} Gaussians", section.in_buckets());
            return Some(Err(mismatch(found, "a center for each")));
        }
        // Room is kept for more Gaussians than there are.
        Some(Ok((section, partial.len() + buckets.len() + most.max(n).saturating_mul(row))))
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.rows.len() / self.row
    }

    /// The number of Gaussians that have a bucket with a center.
    fn in_buckets(&self) -> usize {
        let n_centers = self.buckets.len().checked_div(self.bucket_bytes).unwrap_or(0);
        self.bucket_sizes().take(n_centers).fold(0, usize::saturating_add)
    }

    /// The sizes of the buckets, full ones first.
    fn bucket_sizes(&self) -> impl Iterator<Item = usize> {
        let partial = self.partial.chunks_exact(4).map(|size| u32_at(size, 0) as usize);
        std::iter::repeat_n(self.bucket_size, self.n_full).chain(partial)
    }

    /// The center of each Gaussian's bucket, first to last; zeros at the end if there are too few, as level 0
    /// may have.
    pub fn centers(&self) -> impl Iterator<Item = Vec3> {
        // Buckets without a whole center were refused if they are needed.
        let size = self.bucket_bytes.max(12);
        let center = |bucket: &[u8]| Vec3::from_array([0, 4, 8].map(|at| f32_at(bucket, at)));
        let of_bucket = self.buckets.chunks_exact(size).map(center);
        let n = self.len();
        of_bucket
            .zip(self.bucket_sizes())
            .flat_map(|(center, size)| std::iter::repeat_n(center, size))
            .chain(std::iter::repeat(Vec3::ZERO))
            .take(n)
    }
}

/// `len` bytes at `start`, and all bytes after them.
fn split(bytes: &[u8], start: usize, len: usize) -> Option<(&[u8], &[u8])> {
    bytes.get(start..)?.split_at_checked(len)
}

fn past_end(bytes: &[u8], what: std::fmt::Arguments) -> Mismatch {
    mismatch(
        format_args!("a .ksplat of {}", bytes_in_words(bytes.len() as u64)),
        format_args!("room for {what}"),
    )
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}
