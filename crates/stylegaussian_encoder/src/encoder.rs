//! The encoder: a network's file, opened and checked.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use sha2::{Digest, Sha256};
use stylegaussian::{
    EncoderId,
    work::{Canceled, Work},
};

#[cfg(all(feature = "onnx", not(target_family = "wasm")))]
use crate::onnx::{Graph, OnnxError, Planes};
use crate::{
    FeatureMap, Image,
    chain::{self, Chain, ChainFile, Size},
    image::{MIN_SIDE, PROBE_SIDE},
    vgg,
    weights::{Weights, WeightsError},
};

/// Most numbers of a value of a chain for an image of [`PROBE_SIDE`]: 2^28, 1 GiB. VGG's largest has 2^18, its
/// 64 channels of 64x64 pixels.
const MAX_NUMBERS: f64 = (1_u64 << 28) as f64;

/// An image encoder. Shared by reference between threads, which may call [`Encoder::encode`] at the same time.
pub struct Encoder {
    id: EncoderId,
    /// The file, for messages.
    name: String,
    network: Network,
    n_channels: usize,
    min_side: u32,
}

enum Network {
    Chain(Chain),
    #[cfg(all(feature = "onnx", not(target_family = "wasm")))]
    Onnx(Graph),
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
    /// A network's file is broken, or its network is no encoder.
    #[error("{encoder}: {found}, expected a network from RGB to features")]
    Chain {
        /// The encoder's file.
        encoder: String,
        /// Description of the fault.
        found: String,
    },
    /// The graph cannot be loaded or run, or is not an encoder's.
    #[cfg(all(feature = "onnx", not(target_family = "wasm")))]
    #[error(transparent)]
    Onnx(#[from] OnnxError),
    /// The program reads no ONNX files.
    #[error(
        "{encoder}: an ONNX file, which a program reads if it is built with the feature `onnx`, and no browser"
    )]
    NoOnnx {
        /// The encoder's file.
        encoder: String,
    },
    /// The network's output is infinite or not a number.
    #[error("{encoder}: the encoder gave {found} on an image of {width}x{height}, expected finite numbers")]
    NotFinite {
        /// The encoder's file.
        encoder: String,
        /// The value.
        found: f32,
        /// Columns of the image.
        width: u32,
        /// Rows of the image.
        height: u32,
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
    /// Nobody wants the features any more.
    #[error(transparent)]
    Canceled(#[from] Canceled),
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
    /// - `.safetensors`: a network that `stylegaussian distill` wrote, or VGG-19 weights in one of the layouts
    ///   of [`vgg::Layout`].
    /// - `.pth`, `.pt`: torchvision's VGG-19 state dict.
    /// - `.onnx`, with the feature `onnx`: a graph from RGB 0..1 `[1, 3, H, W]` to features `[1, D, h, w]`.
    ///
    /// # Errors
    /// If the file is not of the kind that its extension claims, if a tensor has another shape or is not
    /// finite, or if the network does not run.
    pub fn open(path: &Path) -> Result<Self, EncoderError> {
        let is_known = ["onnx", "safetensors", "pth", "pt"].contains(&&*extension(path));
        if !is_known {
            return Err(EncoderError::Extension { path: path.into() });
        }
        let bytes = fs::read(path).map_err(|source| EncoderError::Read { path: path.into(), source })?;
        Self::from_bytes(&path.display().to_string(), bytes)
    }

    /// Opens an encoder from the bytes of a file that [`open`](Self::open) takes, for programs that carry one
    /// with them. `name` is the file's name. Without an extension, the bytes are those of a network that
    /// `stylegaussian distill` wrote.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn from_bytes(name: &str, bytes: Vec<u8>) -> Result<Self, EncoderError> {
        let path = Path::new(name);
        // By extension and not by content: a protobuf message has no marker to know it by.
        match &*extension(path) {
            "onnx" => Self::from_onnx_file(name.into(), stem(path), bytes),
            "safetensors" | "pth" | "pt" if !chain::is_chain(&bytes) => {
                let id = EncoderId { name: stem(path), hash: hash(&bytes) };
                Self::of_chain(id, name.into(), vgg::encoder(&Weights::from_bytes(path, bytes)?)?)
            }
            _ => Self::from_chain_file(name.into(), stem(path), &bytes),
        }
    }

    fn from_chain_file(name: String, stem: String, bytes: &[u8]) -> Result<Self, EncoderError> {
        let ChainFile { chain, id } =
            Chain::from_bytes(bytes).map_err(|found| EncoderError::Chain { encoder: name.clone(), found })?;
        Self::of_chain(id.unwrap_or_else(|| EncoderId { name: stem, hash: hash(bytes) }), name, chain)
    }

    /// Checks that a chain is an encoder's, and tries it on a gray image, so that one that gives no numbers is
    /// refused when it is opened.
    fn of_chain(id: EncoderId, name: String, chain: Chain) -> Result<Self, EncoderError> {
        let wrong = |found: String| EncoderError::Chain { encoder: name.clone(), found };
        if chain.channels(0) != 3 {
            return Err(wrong(format!("the network takes {} channels", chain.channels(0))));
        }
        let square = |side: usize| Size { width: side, height: side };
        let largest = chain.largest(square(PROBE_SIDE));
        if largest > MAX_NUMBERS {
            return Err(wrong(format!(
                "for {PROBE_SIDE}x{PROBE_SIDE} pixels it computes {largest:.0} numbers"
            )));
        }
        // The powers of two up to the probe: exact enough for an error's message.
        let sides = [MIN_SIDE, 2 * MIN_SIDE, 4 * MIN_SIDE, 8 * MIN_SIDE];
        let min_side = sides.into_iter().find(|&side| chain.takes(square(side as usize)));
        let Some(min_side) = min_side else {
            return Err(wrong(format!("an image of {PROBE_SIDE}x{PROBE_SIDE} pixels is too small for it")));
        };
        let n_channels = chain.channels(chain.last());
        let encoder = Self { id, name, network: Network::Chain(chain), n_channels, min_side };
        let n_pixels = min_side as usize * min_side as usize;
        encoder.encode(&Image {
            width: min_side,
            height: min_side,
            rgb: vec![0.5; 3 * n_pixels],
            alpha: None,
        })?;
        Ok(encoder)
    }

    #[cfg(not(all(feature = "onnx", not(target_family = "wasm"))))]
    fn from_onnx_file(name: String, _: String, _: Vec<u8>) -> Result<Self, EncoderError> {
        Err(EncoderError::NoOnnx { encoder: name })
    }

    /// Tries the graph on gray images, so that one that cannot run, or gives no numbers, is refused when it is
    /// opened.
    #[cfg(all(feature = "onnx", not(target_family = "wasm")))]
    fn from_onnx_file(name: String, stem: String, onnx: Vec<u8>) -> Result<Self, EncoderError> {
        let id = EncoderId { name: stem, hash: hash(&onnx) };
        let graph = Graph::load(name.clone(), onnx)?;
        let output = graph.run(&graph.gray(PROBE_SIDE, PROBE_SIDE))?;
        let min_side = least_side(&graph)?;
        let n_channels = output.channels;
        let encoder = Self { id, name, network: Network::Onnx(graph), n_channels, min_side };
        encoder.check_finite(&output.values, PROBE_SIDE as u32, PROBE_SIDE as u32)?;
        Ok(encoder)
    }

    /// Name and content hash. Files that depend on this encoder record them.
    pub fn id(&self) -> &EncoderId {
        &self.id
    }

    /// Name of the engine that runs it: `its own engine`, `tract 0.23`, or
    /// `ONNX Runtime 1.24.1, /path/libonnxruntime.so`.
    pub fn runtime(&self) -> &str {
        match &self.network {
            Network::Chain(_) => "its own engine",
            #[cfg(all(feature = "onnx", not(target_family = "wasm")))]
            Network::Onnx(graph) => graph.runtime().name(),
        }
    }

    /// A warning for the user if it is an ONNX file and `ORT_DYLIB_PATH` names a library that cannot be used,
    /// otherwise `None`.
    pub fn warning(&self) -> Option<&str> {
        match &self.network {
            Network::Chain(_) => None,
            #[cfg(all(feature = "onnx", not(target_family = "wasm")))]
            Network::Onnx(graph) => graph.runtime().warning(),
        }
    }

    /// Channels of the features, D.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// The only (width, height) that an ONNX file takes, or `None` if it leaves one of them open.
    pub fn input_size(&self) -> Option<(u32, u32)> {
        match &self.network {
            Network::Chain(_) => None,
            #[cfg(all(feature = "onnx", not(target_family = "wasm")))]
            Network::Onnx(graph) => {
                let [_, height, width] = graph.input();
                Some((u32::try_from(width?).ok()?, u32::try_from(height?).ok()?))
            }
        }
    }

    /// Features of an image.
    ///
    /// Several threads may encode at once. A chain spreads each call over the threads of rayon's pool that it
    /// is called in, tract over rayon's global ones. ONNX Runtime uses all cores, and takes calls in turn.
    ///
    /// # Errors
    /// If the image is smaller than [`MIN_SIDE`] or than the network needs, if an ONNX graph takes another
    /// size, or if the engine fails.
    pub fn encode(&self, image: &Image) -> Result<FeatureMap, EncoderError> {
        self.encode_if_wanted(image, &Work::default())
    }

    /// As [`encode`](Self::encode). A graph that another engine runs is run to its end once it has begun.
    ///
    /// # Errors
    /// As [`encode`](Self::encode), or [`EncoderError::Canceled`] if `work` is canceled.
    pub fn encode_if_wanted(&self, image: &Image, work: &Work) -> Result<FeatureMap, EncoderError> {
        work.check()?;
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
        let features = match &self.network {
            Network::Chain(chain) => {
                let size = Size { width: width as usize, height: height as usize };
                if !chain.takes(size) {
                    let found = format!("the network takes no image of {width}x{height} pixels");
                    return Err(EncoderError::Chain { encoder: self.name.clone(), found });
                }
                let sizes = chain.sizes(size);
                let size = sizes[chain.last()];
                let values = chain.output_if_wanted(&sizes, image.rgb.clone(), work)?;
                let (width, height) = (size.width as u32, size.height as u32);
                FeatureMap { width, height, n_channels: self.n_channels, values }
            }
            #[cfg(all(feature = "onnx", not(target_family = "wasm")))]
            Network::Onnx(graph) => FeatureMap::from(&graph.run(&Planes::of(image))?),
        };
        self.check_finite(&features.values, width, height)?;
        Ok(features)
    }

    fn check_finite(&self, values: &[f32], width: u32, height: u32) -> Result<(), EncoderError> {
        match values.iter().find(|value| !value.is_finite()) {
            None => Ok(()),
            Some(&found) => Err(EncoderError::NotFinite { encoder: self.name.clone(), found, width, height }),
        }
    }
}

/// Finds the least side of an image that the graph takes. If the graph leaves height and width open, it has to
/// take any size above that, so an odd one is tried as well.
#[cfg(all(feature = "onnx", not(target_family = "wasm")))]
fn least_side(graph: &Graph) -> Result<u32, EncoderError> {
    let [_, height, width] = graph.input();
    // ONNX Runtime reports each size that it cannot run, small ones included, and needs no trial.
    if (height, width) != (None, None) || !graph.runtime().is_tract() {
        return Ok(MIN_SIDE);
    }
    let run = |height, width| graph.run(&graph.gray(height, width));
    // 65 x 71: odd, not square, and no multiple of a stride. A graph that fails here would fail on users'
    // images.
    run(PROBE_SIDE + 1, PROBE_SIDE + 7)?;
    let sides = [MIN_SIDE, 2 * MIN_SIDE, 4 * MIN_SIDE];
    // The powers of two up to the probe: exact enough for an error's message, at the cost of three small runs.
    let least = sides.into_iter().find(|&side| run(side as usize, side as usize).is_ok());
    Ok(least.unwrap_or(PROBE_SIDE as u32))
}

/// A file's extension in lower case.
fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// A file's name without extension; of `NAME.encoder.safetensors` it is `NAME`.
fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    stem.strip_suffix(".encoder").unwrap_or(&stem).into()
}

/// The first 16 hexadecimal digits of a file's SHA-256.
fn hash(bytes: &[u8]) -> String {
    // 64 bits tell the few encoders of a project apart and stay readable in a message.
    Sha256::digest(bytes)[..8].iter().map(|byte| format!("{byte:02x}")).collect()
}
