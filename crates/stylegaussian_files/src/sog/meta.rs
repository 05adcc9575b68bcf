//! `meta.json`: how the bytes of a SOG scene's planes become numbers.
//!
//! Version 2 keeps codebooks of 256 numbers. Version 1, which names no version, keeps the ends of ranges that a
//! byte divides evenly. Both are tables from a byte to a number here, with the activations applied.

use serde::Deserialize;
use stylegaussian::{scene::ScreenFilter, sh};

use crate::{
    activate::sigmoid,
    error::{Mismatch, mismatch},
    json::parse,
    names::check_plain,
};

/// The number of every byte.
pub(super) type Table = [f32; 256];

/// The metadata of either version.
#[derive(Debug)]
pub(super) struct Meta {
    /// The number of Gaussians.
    pub count: usize,
    /// The means for the codes 0, before the logarithm is undone.
    pub mins: [f64; 3],
    /// The differences between the means for the codes 65,535 and 0, as `mins`.
    pub spans: [f64; 3],
    /// Standard deviations along x, y and z.
    pub scales: [Table; 3],
    /// Coefficients of degree 0, of red, green and blue.
    pub dc: [Table; 3],
    /// Opacities, 0..1.
    pub opacities: Table,
    /// Higher spherical harmonics.
    pub palette: Option<Palette>,
    /// Names of the planes: lower and upper bytes of the means, rotations, scales, colors; with a palette also
    /// its entries and labels. They are plain.
    pub planes: Vec<String>,
    /// How the scene is drawn.
    pub filter: ScreenFilter,
}

/// A palette of spherical harmonics above degree 0.
#[derive(Debug)]
pub(super) struct Palette {
    /// The highest degree. Version 1 leaves it to the width of the plane.
    pub degree: Option<u8>,
    /// The number of entries. Version 1 leaves it to the height of the plane.
    pub n_entries: Option<usize>,
    /// Coefficients.
    pub table: Table,
}

#[derive(Deserialize)]
struct Probe {
    version: Option<serde_json::Number>,
}

#[derive(Deserialize)]
struct Version2 {
    count: u32,
    antialias: Option<bool>,
    model: Option<String>,
    means: Range<3, 2>,
    scales: Coded<1>,
    quats: Named,
    sh0: Coded<1>,
    #[serde(rename = "shN")]
    palette: Option<Palette2>,
}

#[derive(Deserialize)]
struct Palette2 {
    count: u32,
    bands: u8,
    #[serde(flatten)]
    coded: Coded<2>,
}

/// Planes and their codebook. Old writers begin it with a null.
#[derive(Deserialize)]
struct Coded<const FILES: usize> {
    codebook: Vec<Option<f64>>,
    #[serde(deserialize_with = "array")]
    files: [String; FILES],
}

#[derive(Deserialize)]
struct Named {
    files: [String; 1],
}

#[derive(Deserialize)]
struct Version1 {
    means: Shaped,
    scales: Range<3, 1>,
    quats: Named,
    /// The fourth channel is the logit of the opacity.
    sh0: Range<4, 1>,
    #[serde(rename = "shN")]
    palette: Option<Palette1>,
}

#[derive(Deserialize)]
struct Shaped {
    /// `[N, 3]`.
    shape: Vec<u32>,
    #[serde(flatten)]
    range: Range<3, 2>,
}

/// Planes and the numbers for the smallest and the largest code of each channel.
#[derive(Deserialize)]
struct Range<const CHANNELS: usize, const FILES: usize> {
    #[serde(deserialize_with = "array")]
    mins: [f64; CHANNELS],
    #[serde(deserialize_with = "array")]
    maxs: [f64; CHANNELS],
    #[serde(deserialize_with = "array")]
    files: [String; FILES],
}

#[derive(Deserialize)]
struct Palette1 {
    mins: f64,
    maxs: f64,
    files: [String; 2],
}

/// An array of any length, which serde does not derive.
fn array<'de, D, T, const N: usize>(deserializer: D) -> Result<[T; N], D::Error>
where
    D: serde::Deserializer<'de>,
    T: Deserialize<'de>,
{
    let values = Vec::deserialize(deserializer)?;
    let found = values.len();
    values.try_into().map_err(|_| serde::de::Error::invalid_length(found, &format!("{N} values").as_str()))
}

impl Meta {
    /// Reads the metadata. Warnings list repairs.
    pub fn parse(json: &[u8], warnings: &mut Vec<String>) -> Result<Self, Mismatch> {
        let Probe { version } = parse(json, "SOG metadata")?;
        let meta = match version.map(|version| (version.as_u64(), version)) {
            None => Self::version_1(parse(json, "SOG metadata (version 1, as it names none)")?)?,
            Some((Some(2), _)) => Self::version_2(parse(json, "SOG metadata of version 2")?, warnings)?,
            Some((_, version)) => {
                return Err(mismatch(format_args!("SOG version {version}"), "version 2 or none"));
            }
        };
        meta.planes.iter().try_for_each(|name| check_plain(name))?;
        let palette = meta.palette.as_ref().map(|palette| &palette.table);
        let tables = meta.dc.iter().chain([&meta.opacities]).chain(palette);
        if tables.flatten().any(|number| !number.is_finite()) {
            return Err(mismatch("colors from ranges that are not finite", "finite numbers"));
        }
        Ok(meta)
    }

    fn version_2(meta: Version2, warnings: &mut Vec<String>) -> Result<Self, Mismatch> {
        let filter = filter(&meta, warnings);
        let scales = table("scales", &meta.scales.codebook, warnings)?.map(f32::exp);
        let dc = table("sh0", &meta.sh0.codebook, warnings)?;
        let mut planes: Vec<String> = meta.means.files.into();
        planes.extend(meta.quats.files);
        planes.extend(meta.scales.files);
        planes.extend(meta.sh0.files);
        let mut palette = None;
        if let Some(Palette2 { count, bands, coded }) = meta.palette {
            if !(1..=sh::MAX_DEGREE).contains(&bands) {
                return Err(mismatch(format_args!("spherical harmonics of {bands} bands"), "1 to 3"));
            }
            let table = table("shN", &coded.codebook, warnings)?;
            palette = Some(Palette { degree: Some(bands), n_entries: Some(count as usize), table });
            planes.extend(coded.files);
        }
        Ok(Self {
            count: meta.count as usize,
            mins: meta.means.mins,
            spans: spans(&meta.means.mins, &meta.means.maxs),
            scales: [scales; 3],
            dc: [dc; 3],
            opacities: lerp(0.0, 1.0),
            palette,
            planes,
            filter,
        })
    }

    fn version_1(meta: Version1) -> Result<Self, Mismatch> {
        let count = match meta.means.shape[..] {
            [count, 3] => count as usize,
            _ => return Err(mismatch(format_args!("means of shape {:?}", meta.means.shape), "[N, 3]")),
        };
        let Range { mins, maxs, files } = meta.means.range;
        let mut planes: Vec<String> = files.into();
        planes.extend(meta.quats.files);
        planes.extend(meta.scales.files);
        planes.extend(meta.sh0.files);
        let palette = meta.palette.map(|Palette1 { mins, maxs, files }| {
            planes.extend(files);
            Palette { degree: None, n_entries: None, table: lerp(mins, maxs) }
        });
        Ok(Self {
            count,
            mins,
            spans: spans(&mins, &maxs),
            scales: [0, 1, 2].map(|c| lerp(meta.scales.mins[c], meta.scales.maxs[c]).map(f32::exp)),
            dc: [0, 1, 2].map(|c| lerp(meta.sh0.mins[c], meta.sh0.maxs[c])),
            opacities: lerp(meta.sh0.mins[3], meta.sh0.maxs[3]).map(sigmoid),
            palette,
            planes,
            filter: ScreenFilter::Classic,
        })
    }
}

/// The filter that the metadata asks for: `model` in newer files, `antialias` in older ones.
fn filter(meta: &Version2, warnings: &mut Vec<String>) -> ScreenFilter {
    let asked = meta.model.as_deref().unwrap_or(match meta.antialias {
        Some(true) => "antialiased",
        _ => "default",
    });
    match asked {
        "default" => ScreenFilter::Classic,
        "antialiased" => ScreenFilter::Antialiased,
        other => {
            warnings.push(format!("splats of the model `{}` are drawn as ellipsoids", other.escape_debug()));
            ScreenFilter::Classic
        }
    }
}

fn spans(mins: &[f64; 3], maxs: &[f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| maxs[axis] - mins[axis])
}

/// A byte's share of the way from `min` to `max`.
fn lerp(min: f64, max: f64) -> Table {
    std::array::from_fn(|byte| (min + (max - min) * byte as f64 / 255.0) as f32)
}

/// A codebook. The first number is null if an old writer could not sort it; PlayCanvas' engine puts a step
/// below the second in its place, and so does this.
fn table(name: &str, codebook: &[Option<f64>], warnings: &mut Vec<String>) -> Result<Table, Mismatch> {
    let mut numbers: Vec<f32> =
        codebook.iter().map(|value| value.map_or(f32::NAN, |value| value as f32)).collect();
    if let ([None, ..], [first, second, .., last]) = (codebook, &mut numbers[..]) {
        *first = *second + (*second - *last) / 255.0;
        warnings
            .push(format!("the codebook of `{name}` begins with null, which older writers left by mistake"));
    }
    if let Some(at) = numbers.iter().position(|number| !number.is_finite()) {
        let found = format!("the codebook of `{name}` with no finite number at {at}");
        return Err(mismatch(found, "finite numbers"));
    }
    let found = format_args!("a codebook of `{name}` with {} numbers", numbers.len()).to_string();
    numbers.try_into().map_err(|_| mismatch(found, "256"))
}
