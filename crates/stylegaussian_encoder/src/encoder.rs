//! The encoder: a file of weights or an ONNX graph, opened and checked.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use sha2::{Digest, Sha256};
use stylegaussian::EncoderId;

use crate::{
    FeatureMap, Image,
    engine::PROBE_SIDE,
    features::transposed,
    network::{Network, NetworkError, Planes},
    vgg,
    weights::{Weights, WeightsError},
};

/// Least width and height of an image for any encoder, in pixels. VGG with reflection padding needs 5; with 8
/// there are 2x2 positions, so that a standard deviation exists.
pub const MIN_SIDE: u32 = 8;

/// An image encoder. Shared by reference between threads, which may call [`Encoder::encode`] at the same time.
pub struct Encoder {
    id: EncoderId,
    network: Network,
    n_channels: usize,
    min_side: u32,
}

/// An encoder could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum EncoderError {
    /// The file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file's extension is not that of an encoder.
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
    /// The graph's output is infinite or not a number.
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
        /// Least number of columns and rows that the encoder takes.
        min_side: u32,
    },
    /// The image has more or fewer values than its size requires.
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

impl Encoder {
    /// Opens an encoder by its file's extension.
    ///
    /// - `.onnx`: a graph from RGB 0..1 `[1, 3, H, W]` to features `[1, D, h, w]`.
    /// - `.safetensors`: VGG-19 weights in one of the layouts of [`vgg::Layout`].
    /// - `.pth`, `.pt`: torchvision's VGG-19 state dict.
    ///
    /// # Errors
    /// If the file is not of the kind that its extension claims, if a tensor has another shape or is not
    /// finite, or if the graph does not run.
    pub fn open(path: &Path) -> Result<Self, EncoderError> {
        let read = |source| EncoderError::Read { path: path.into(), source };
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        // By extension and not by content: a protobuf message has no marker to know it by.
        let (onnx, hash) = match extension.to_ascii_lowercase().as_str() {
            "onnx" => {
                let onnx = fs::read(path).map_err(read)?;
                let hash = hash(&onnx[..]).map_err(read)?;
                (onnx, hash)
            }
            // The hash is of the file and not of the graph: the graph that is written from weights may change
            // with this crate, the features do not.
            "safetensors" | "pth" | "pt" => {
                let hash = hash(fs::File::open(path).map_err(read)?).map_err(read)?;
                (vgg::graph(&Weights::open(path)?)?, hash)
            }
            _ => return Err(EncoderError::Extension { path: path.into() }),
        };
        let id =
            EncoderId { name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), hash };
        Self::new(id, Network::load(path.display().to_string(), onnx)?)
    }

    /// Opens an encoder from the bytes of an ONNX file, for programs that carry one with them. `name` is the
    /// file's name without `.onnx`.
    ///
    /// # Errors
    /// If the bytes are no ONNX graph, or if the graph is not an encoder's or does not run.
    pub fn from_onnx(name: &str, onnx: Vec<u8>) -> Result<Self, EncoderError> {
        let hash = hash(&onnx[..]).map_err(|source| EncoderError::Read { path: name.into(), source })?;
        Self::new(EncoderId { name: name.into(), hash }, Network::load(name, onnx)?)
    }

    /// Tries the graph on gray images, so that one that cannot run, or gives no numbers, is refused when it is
    /// opened.
    fn new(id: EncoderId, network: Network) -> Result<Self, EncoderError> {
        let input = network.gray(PROBE_SIDE, PROBE_SIDE);
        let output = network.run(&input)?;
        check_finite(&network, &input, &output)?;
        let min_side = least_side(&network)?;
        Ok(Self { id, network, n_channels: output.channels, min_side })
    }

    /// Name and content hash. Files that depend on this encoder record them.
    pub fn id(&self) -> &EncoderId {
        &self.id
    }

    /// Name of the engine that runs it: `tract 0.23`, or `ONNX Runtime 1.24.1, /path/libonnxruntime.so`.
    pub fn runtime(&self) -> &str {
        self.network.runtime().name()
    }

    /// A warning for the user if `ORT_DYLIB_PATH` names a library that cannot be used, otherwise `None`.
    pub fn warning(&self) -> Option<&str> {
        self.network.runtime().warning()
    }

    /// Channels of the features, D.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// The only (width, height) that an ONNX file takes, or `None` if it leaves one of them open.
    pub fn input_size(&self) -> Option<(u32, u32)> {
        let [_, height, width] = self.network.input();
        Some((u32::try_from(width?).ok()?, u32::try_from(height?).ok()?))
    }

    /// Features of an image.
    ///
    /// Several threads may encode at once. tract runs each call on its caller's thread. If that is none of
    /// rayon's, it spreads matrix products over them. ONNX Runtime spreads one call over all cores and takes
    /// calls in turn.
    ///
    /// # Errors
    /// If the image is smaller than [`MIN_SIDE`] or than the graph needs, if the graph takes another size, or
    /// if the engine fails.
    pub fn encode(&self, image: &Image) -> Result<FeatureMap, EncoderError> {
        let (width, height) = (image.width, image.height);
        let n_pixels = width as usize * height as usize;
        let min_side = self.min_side;
        if self.input_size().is_none() && width.min(height) < min_side {
            return Err(EncoderError::ImageTooSmall { width, height, min_side });
        }
        // The fields of `Image` are public, so its size may not fit its values.
        if image.rgb.len() != n_pixels * 3 {
            return Err(EncoderError::ImageValues { width, height, found: image.rgb.len() });
        }
        let input = Planes {
            channels: 3,
            height: height as usize,
            width: width as usize,
            values: transposed(&image.rgb, n_pixels, 3),
        };
        let output = self.network.run(&input)?;
        check_finite(&self.network, &input, &output)?;
        Ok(FeatureMap::from(&output))
    }
}

/// Finds the least side of an image that the graph takes. If the graph leaves height and width open, it has to
/// take any size above that, so an odd one is tried as well.
fn least_side(network: &Network) -> Result<u32, EncoderError> {
    let [_, height, width] = network.input();
    // ONNX Runtime reports each size that it cannot run, small ones included, and needs no trial.
    if (height, width) != (None, None) || !network.runtime().is_tract() {
        return Ok(MIN_SIDE);
    }
    let run = |height, width| network.run(&network.gray(height, width));
    // 65 x 71: odd, not square, and no multiple of a stride. A graph that fails here would fail on users'
    // images.
    run(PROBE_SIDE + 1, PROBE_SIDE + 7)?;
    let sides = [MIN_SIDE, 2 * MIN_SIDE, 4 * MIN_SIDE];
    // The powers of two up to the probe: exact enough for an error's message, at the cost of three small runs.
    let least = sides.into_iter().find(|&side| run(side as usize, side as usize).is_ok());
    Ok(least.unwrap_or(PROBE_SIDE as u32))
}

fn check_finite(network: &Network, input: &Planes, output: &Planes) -> Result<(), EncoderError> {
    match output.values.iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(&found) => Err(EncoderError::NotFinite {
            encoder: network.name().into(),
            found,
            width: input.width,
            height: input.height,
        }),
    }
}

/// The first 16 hexadecimal digits of a file's SHA-256.
fn hash(mut file: impl io::Read) -> io::Result<String> {
    let mut hasher = Sha256::new();
    io::copy(&mut file, &mut hasher)?;
    // 64 bits tell the few encoders of a project apart and stay readable in a message.
    Ok(hasher.finalize()[..8].iter().map(|byte| format!("{byte:02x}")).collect())
}
