//! The encoder: a file of weights or an ONNX graph, opened and checked.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
};

use sha2::{Digest, Sha256};
use stylegaussian::EncoderId;

use crate::{
    FeatureMap, Image,
    features::transposed,
    network::{Network, NetworkError, Planes},
    rehearsal::rehearse,
    runtime::{Engine, Runtime},
    vgg,
    weights::{Weights, WeightsError},
};

/// Least width and height of an image for any encoder, in pixels. VGG with reflection padding needs 5; with 8 there are
/// 2x2 cells, so that a standard deviation exists.
pub const MIN_SIDE: u32 = 8;

/// The environment variable that names the encoder's file when no flag does.
pub const ENCODER_VARIABLE: &str = "STYLEGAUSSIAN_ENCODER";

/// Size of the image on which an ONNX file is tried when it is opened.
pub(crate) const PROBE_SIDE: usize = 64;

/// An image encoder. Shared by reference between threads: [`Encoder::encode`] runs on all of them at once.
pub struct Encoder {
    id: EncoderId,
    network: Network,
    n_channels: usize,
    min_side: u32,
}

/// An encoder could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum EncoderError {
    /// Nobody named an encoder.
    #[error(
        "no encoder is known: name one with `--encoder FILE` or in the environment variable {ENCODER_VARIABLE}; it is \
         VGG-19 weights (.safetensors, or torchvision's .pth) or an ONNX file (.onnx, 1x3xHxW RGB 0..1 to 1xDxhxw)"
    )]
    NoEncoder,
    /// The file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file's extension is none of the known ones.
    #[error("{}: not an encoder's file; expected .safetensors, .pth, .pt or .onnx", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
    },
    /// The weights are not VGG's.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The graph cannot be loaded or run, or is not an encoder's.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The graph gives infinite values or such that are not numbers.
    #[error("{encoder}: the encoder gave {found} on an image of {width}x{height}, expected finite numbers")]
    NotFinite {
        /// The encoder's file.
        encoder: String,
        /// The value.
        found: f32,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// The image is too small.
    #[error("the image is {width}x{height}, expected at least {min_side}x{min_side} pixels")]
    ImageTooSmall {
        /// Its columns.
        width: u32,
        /// Its rows.
        height: u32,
        /// What the encoder needs.
        min_side: u32,
    },
    /// The image's values are not as many as its size says.
    #[error("the image of {width}x{height} has {found} values, expected 3 for each pixel")]
    ImageValues {
        /// Its columns.
        width: u32,
        /// Its rows.
        height: u32,
        /// Its values.
        found: usize,
    },
}

/// An ONNX file's name without its extension, and its bytes: an encoder that a program carries with it.
pub type BuiltIn<'a> = (&'a str, &'a [u8]);

/// Opens the encoder that `explicit` names, else the one that [`ENCODER_VARIABLE`] names, else the one that is built in.
///
/// # Errors
/// When there is none of them, which the message explains, or when the one there is cannot be opened.
pub fn resolve(explicit: Option<&Path>, built_in: Option<BuiltIn<'_>>) -> Result<Encoder, EncoderError> {
    if let Some(path) = explicit {
        return Encoder::open(path);
    }
    match (named_by_environment(), built_in) {
        (Some(path), _) => Encoder::open(&path),
        (None, Some((name, onnx))) => Encoder::from_onnx(name, onnx.to_vec()),
        (None, None) => Err(EncoderError::NoEncoder),
    }
}

/// The file that [`ENCODER_VARIABLE`] names.
pub fn named_by_environment() -> Option<PathBuf> {
    env::var_os(ENCODER_VARIABLE).filter(|path| !path.is_empty()).map(PathBuf::from)
}

impl Encoder {
    /// Opens an encoder by its file's extension.
    ///
    /// - `.onnx`: a graph from RGB 0..1 `[1, 3, H, W]` to features `[1, D, h, w]`.
    /// - `.safetensors`: VGG-19 weights in one of the layouts of [`vgg::Layout`].
    /// - `.pth`, `.pt`: torchvision's VGG-19 state dict.
    ///
    /// # Errors
    /// When the file is not what its extension says, when a tensor has another shape or is not finite, or when the
    /// graph does not run.
    pub fn open(path: &Path) -> Result<Self, EncoderError> {
        let read = |source| EncoderError::Read { path: path.into(), source };
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        let (min_side, onnx) = match extension.to_ascii_lowercase().as_str() {
            "onnx" => {
                let onnx = fs::read(path).map_err(read)?;
                (least_side(&path.display().to_string(), &onnx)?, onnx)
            }
            "safetensors" | "pth" | "pt" => (MIN_SIDE, vgg::graph(&Weights::open(path)?)?),
            _ => return Err(EncoderError::Extension { path: path.into() }),
        };
        let id = EncoderId {
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            hash: hash(fs::File::open(path).map_err(read)?).map_err(read)?,
        };
        Self::new(id, Network::load(path.display().to_string(), onnx)?, min_side)
    }

    /// An ONNX file's bytes, as [`Encoder::open`] would take them from a file of this name, which goes without `.onnx`.
    ///
    /// # Errors
    /// When the bytes are no ONNX graph, or when it is not an encoder's or does not run.
    pub fn from_onnx(name: &str, onnx: Vec<u8>) -> Result<Self, EncoderError> {
        let min_side = least_side(name, &onnx)?;
        let hash = hash(&onnx[..]).map_err(|source| EncoderError::Read { path: name.into(), source })?;
        Self::new(EncoderId { name: name.into(), hash }, Network::load(name, onnx)?, min_side)
    }

    fn new(id: EncoderId, network: Network, min_side: u32) -> Result<Self, EncoderError> {
        let mut encoder = Self { id, network, n_channels: 0, min_side };
        encoder.n_channels = encoder.probe()?;
        Ok(encoder)
    }

    /// Name and content hash, for the files that depend on this encoder.
    pub fn id(&self) -> &EncoderId {
        &self.id
    }

    /// The engine that runs it: `tract 0.23`, or `ONNX Runtime 1.24.1, /path/libonnxruntime.so`.
    pub fn runtime(&self) -> &str {
        self.network.runtime().name()
    }

    /// What a user should know: `ORT_DYLIB_PATH` was set, but what it names is not usable.
    pub fn warning(&self) -> Option<&str> {
        self.network.runtime().warning()
    }

    /// Channels of the features, D.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// The only (width, height) that an ONNX file takes, where it fixes both.
    pub fn input_size(&self) -> Option<(u32, u32)> {
        let [_, height, width] = self.network.input();
        Some((u32::try_from(width?).ok()?, u32::try_from(height?).ok()?))
    }

    /// Features of an image.
    ///
    /// Several threads may encode at once. With tract each call runs on its caller's thread; ONNX Runtime spreads one
    /// call over all cores and takes calls in turn.
    ///
    /// # Errors
    /// When the image is smaller than [`MIN_SIDE`], or has another size than the graph takes, or the engine fails.
    pub fn encode(&self, image: &Image) -> Result<FeatureMap, EncoderError> {
        let (width, height) = (image.width, image.height);
        let n_pixels = width as usize * height as usize;
        let min_side = self.min_side;
        if self.input_size().is_none() && width.min(height) < min_side {
            return Err(EncoderError::ImageTooSmall { width, height, min_side });
        }
        if image.rgb.len() != n_pixels * 3 {
            return Err(EncoderError::ImageValues { width, height, found: image.rgb.len() });
        }
        let input = Planes {
            channels: 3,
            height: height as usize,
            width: width as usize,
            values: transposed(&image.rgb, n_pixels, 3),
        };
        Ok(FeatureMap::from(&self.run(&input)?))
    }

    fn run(&self, input: &Planes) -> Result<Planes, EncoderError> {
        let output = self.network.run(input)?;
        match output.values.iter().find(|value| !value.is_finite()) {
            None => Ok(output),
            Some(&found) => Err(EncoderError::NotFinite {
                encoder: self.network.name().into(),
                found,
                width: input.width,
                height: input.height,
            }),
        }
    }

    /// Runs a gray image, so that a graph that cannot run, or gives no numbers, is refused when it is opened.
    fn probe(&self) -> Result<usize, EncoderError> {
        let [_, height, width] = self.network.input();
        let (height, width) = (height.unwrap_or(PROBE_SIDE), width.unwrap_or(PROBE_SIDE));
        let values = vec![0.5; 3 * height * width];
        Ok(self.run(&Planes { channels: 3, height, width, values })?.channels)
    }
}

/// The least side of an image for a foreign graph, having made sure that tract does not panic over it.
fn least_side(name: &str, onnx: &[u8]) -> Result<u32, EncoderError> {
    let runtime = Runtime::get().map_err(NetworkError::from)?;
    match runtime.engine {
        // Reports what it cannot do, small images included.
        Engine::OnnxRuntime => Ok(MIN_SIDE),
        Engine::Tract => rehearse(onnx).map_err(|reason| {
            let (name, runtime) = (name.into(), runtime.name().into());
            NetworkError::Load { name, runtime, reason }.into()
        }),
    }
}

/// The first 16 hexadecimal digits of a file's SHA-256.
fn hash(mut file: impl io::Read) -> io::Result<String> {
    let mut hasher = Sha256::new();
    io::copy(&mut file, &mut hasher)?;
    Ok(hasher.finalize()[..8].iter().map(|byte| format!("{byte:02x}")).collect())
}
