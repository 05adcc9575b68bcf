//! StyleGaussian's own PyTorch checkpoints, as scenes that stylize exactly like the original.
//!
//! Both kinds are a tuple, at the root or somewhere within it: (xyz `[N, 3]`, log scaling `[N, 3]`, rotation
//! wxyz `[N, 4]`, opacity logit `[N, 1]`, features `[N, C]`, state dict).
//! - Trained model: the features are final, C = D = 256; the state dict holds the decoder, `kernels.{i}`
//!   `[D_out, K * D_in]`, neighbor-major, and `bias.{i}` `[D_out]`. Noise was added to these features, so they
//!   have full rank: L = D, A = I, b = 0.
//! - Feature model: the features are f', C = L = 32; the state dict holds A, `layer.weight` `[D, L]`, and b,
//!   `layer.bias` `[D]`.

use std::cell::Cell;

use glam::Vec3;
use stylegaussian::{
    decoder::{Decoder, Layer},
    scene::{Features, Scene},
};

use super::{
    activate::{StoredGaussians, activate},
    archive::{Archive, is_zip},
    decoder,
    error::{Loaded, Mismatch, mismatch},
    format::Format,
    pytorch::{
        PytorchFile, Tensor,
        pickle::{Id, Object, Pickle, TensorInfo},
    },
    tensors::expect_finite,
};

mod others;

/// A checkpoint's contents, for messages.
const EXPECTED: &str =
    "a tuple (xyz, scaling, rotation, opacity, features, state dict) as StyleGaussian saves it";

/// The format: the container of `torch.save` is a zip archive.
pub(super) const FORMAT: Format = Format {
    name: "StyleGaussian checkpoint (.pth)",
    extensions: &["pth"],
    // A damaged archive is for the reader to complain about.
    recognizes: |bytes, _| {
        let holds_pickle = |archive: Archive| archive.names().any(|name| name.ends_with("data.pkl"));
        is_zip(bytes) && Archive::open(bytes).map_or(true, holds_pickle)
    },
    read: |files, _| Ok(read(&files.main)?),
    write: None,
};

pub(super) fn read(bytes: &[u8]) -> Result<Loaded, Mismatch> {
    read_ours(bytes).map_err(|mismatch| others::explained(bytes).unwrap_or(mismatch))
}

fn read_ours(bytes: &[u8]) -> Result<Loaded, Mismatch> {
    let file = PytorchFile::parse(bytes)?;
    let parts = find_parts(&file.pickle)?;
    let mut warnings = Vec::new();
    let scene = scene(&parts, &file, &mut warnings)?;
    Ok(Loaded::new(scene, warnings))
}

/// The five tensors and the state dict of a checkpoint.
struct Parts<'a> {
    tensors: [&'a TensorInfo; 5],
    state: Id,
}

/// Finds the tuple: at the root, or within it if it was saved together with, say, the iteration.
fn find_parts(pickle: &Pickle) -> Result<Parts<'_>, Mismatch> {
    let parts_of = |id: Id| -> Option<Parts> {
        let Object::Sequence(items) = pickle.object(id) else { return None };
        let (&[a, b, c, d, e, state], _) = items.split_first_chunk::<6>()?;
        let tensor = |id: Id| match pickle.object(id) {
            Object::Tensor(tensor) => Some(tensor),
            _ => None,
        };
        let tensors = [tensor(a)?, tensor(b)?, tensor(c)?, tensor(d)?, tensor(e)?];
        matches!(pickle.object(state), Object::Dictionary(_)).then_some(Parts { tensors, state })
    };
    parts_of(pickle.root)
        .or_else(|| pickle.ids().find_map(parts_of))
        .ok_or_else(|| mismatch("a checkpoint with other contents", EXPECTED))
}

fn scene(parts: &Parts, file: &PytorchFile<&[u8]>, warnings: &mut Vec<String>) -> Result<Scene, Mismatch> {
    let [xyz, scaling, rotation, opacity, features] = parts.tensors;
    let n = xyz.shape.first().copied().unwrap_or(0);
    if u32::try_from(n).is_err() {
        return Err(mismatch(format_args!("{n} Gaussians"), "fewer than 2^32"));
    }
    let source = Source::new(file);
    let rows = |name: &str, info: &TensorInfo, width: Option<usize>| -> Result<Tensor, Mismatch> {
        let tensor = source.read(name, info)?;
        // Opacity may lack its second dimension.
        let found = if let [n] = tensor.shape[..] { [n, 1] } else { tensor.matrix(name)? };
        if found[0] == n && width.is_none_or(|width| found[1] == width) {
            return Ok(tensor);
        }
        let width = width.map_or("C".into(), |width| width.to_string());
        Err(mismatch(format_args!("{name} {:?}", info.shape), format_args!("[{n}, {width}]")))
    };
    let vec3 = |tensor: Tensor| tensor.values.chunks_exact(3).map(Vec3::from_slice).collect();
    let state = State { source: &source, id: parts.state };
    let features = rows("features", features, None)?;
    let (features, decoder) = match state.find("kernels.0") {
        Some(_) => final_model(features, &state)?,
        None => (feature_model(features, &state)?, None),
    };
    let stored = StoredGaussians {
        means: vec3(rows("xyz", xyz, Some(3))?),
        log_scales: vec3(rows("scaling", scaling, Some(3))?),
        rotations_wxyz: rows("rotation", rotation, Some(4))?.values.as_chunks().0.into(),
        opacity_logits: rows("opacity", opacity, Some(1))?.values,
        sh: None,
        features: Some(features),
    };
    Ok(Scene { decoder, ..activate(stored, warnings) })
}

/// Bytes of the smallest floating-point number of a tensor.
const SMALLEST_VALUE: usize = 2;

/// The file, and the number of values that may still be read. Tensors can share a storage, and a file of a few
/// kilobytes can name one as many times as it likes. All together never have more values than the file has room
/// for.
struct Source<'a> {
    file: &'a PytorchFile<&'a [u8]>,
    values_left: Cell<usize>,
}

impl<'a> Source<'a> {
    fn new(file: &'a PytorchFile<&'a [u8]>) -> Self {
        Self { file, values_left: Cell::new(file.len() / SMALLEST_VALUE) }
    }

    fn read(&self, name: &str, info: &TensorInfo) -> Result<Tensor, Mismatch> {
        let n_values = info.shape.iter().try_fold(1, |n: usize, &size| n.checked_mul(size));
        let left = n_values.and_then(|n| self.values_left.get().checked_sub(n)).ok_or_else(|| {
            let found = format_args!("`{name}` {:?}, which shares its values with other tensors", info.shape);
            mismatch(found, "tensors that the file has room for together")
        })?;
        self.values_left.set(left);
        self.file.read(name, info)
    }
}

/// The state dict of the network beside the Gaussians.
struct State<'a> {
    source: &'a Source<'a>,
    id: Id,
}

impl<'a> State<'a> {
    /// The tensor of this name, with or without names of modules before it. If two entries match, the later one
    /// counts.
    fn find(&self, name: &str) -> Option<&'a TensorInfo> {
        // A name of a module ends with a dot, so that `kernels.0` is not found in `otherkernels.0`.
        let is_named = |key: &str| key.strip_suffix(name).is_some_and(|p| p.is_empty() || p.ends_with('.'));
        let mut found = self.source.file.pickle.entries(self.id).filter_map(|(key, value)| match value {
            Object::Tensor(tensor) if is_named(key) => Some(tensor),
            _ => None,
        });
        let first = found.next();
        found.last().or(first)
    }

    fn read(&self, name: &str) -> Result<Tensor, Mismatch> {
        let info = self.find(name).ok_or_else(|| {
            let keys: Vec<&str> =
                self.source.file.pickle.entries(self.id).map(|(key, _)| key).take(12).collect();
            mismatch(
                format_args!("a state dict without `{name}` (it has: {})", keys.join(" ")),
                "`kernels.{i}` and `bias.{i}`, or `layer.weight` and `layer.bias`",
            )
        })?;
        let tensor = self.source.read(name, info)?;
        expect_finite(name, &tensor.values)?;
        Ok(tensor)
    }
}

/// Full-rank features and the decoder.
fn final_model(features: Tensor, state: &State) -> Result<(Features, Option<Decoder>), Mismatch> {
    let [_, d] = features.matrix("features")?;
    let mut layers = Vec::new();
    let (mut k, mut d_in) = (0, d);
    while let name = format!("kernels.{}", layers.len())
        && state.find(&name).is_some()
    {
        let kernel = state.read(&name)?;
        let [d_out, columns] = kernel.matrix(&name)?;
        if layers.is_empty() {
            // The file does not hold K. The first kernel has K D columns.
            k = columns.checked_div(d_in).unwrap_or(0);
        }
        if k == 0 || k.checked_mul(d_in) != Some(columns) {
            let expected = format_args!("[D_out, K * {d_in}] with the same K in each").to_string();
            return Err(mismatch(format_args!("`{name}` {:?}", kernel.shape), expected));
        }
        let bias = state.read(&format!("bias.{}", layers.len()))?.values;
        layers.push(Layer { weight: kernel.values, bias, d_in, d_out });
        d_in = d_out;
    }
    let decoder = Decoder { layers, k, ..Decoder::default() };
    decoder::validate(&decoder)?;
    // The file holds D numbers per row, but the basis D times as many: the file's size does not bound it.
    if d > Features::MAX_CHANNELS {
        let expected = format!("at most {}", Features::MAX_CHANNELS);
        return Err(mismatch(format_args!("features of {d} channels"), expected));
    }
    let mut basis = vec![0.0; d * d];
    basis.iter_mut().step_by(d + 1).for_each(|diagonal| *diagonal = 1.0);
    Ok((features_of(features.values, d, basis, vec![0.0; d]), Some(decoder)))
}

/// Low-dimensional features and the affine map of them.
fn feature_model(features: Tensor, state: &State) -> Result<Features, Mismatch> {
    let [_, l] = features.matrix("features")?;
    let basis = state.read("layer.weight")?;
    let offset = state.read("layer.bias")?;
    let d = offset.values.len();
    if l == 0 || basis.shape != [d, l] {
        return Err(mismatch(format_args!("`layer.weight` {:?}", basis.shape), format_args!("[{d}, {l}]")));
    }
    Ok(features_of(features.values, l, basis.values, offset.values))
}

fn features_of(values: Vec<f32>, n_latent: usize, basis: Vec<f32>, offset: Vec<f32>) -> Features {
    Features { values, n_latent, basis, offset, extra: Vec::new(), n_extra: 0, encoder: None }
}

#[cfg(test)]
pub(super) mod tests;
