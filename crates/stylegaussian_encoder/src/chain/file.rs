//! Chains in safetensors files.
//!
//! | part | |
//! | --- | --- |
//! | tensor `{i}.weight` | f32 `[D_out, D_in, side, side]`, of operation i if it is a convolution |
//! | tensor `{i}.bias` | f32 `[D_out]` |
//! | metadata `network` | JSON: `version` (1), `channels` of the input, `operations`, `encoder`, `notes` |
//!
//! Optional are `encoder`, the identity `name@hash` under which features of the network are known, and `notes`,
//! texts for people.

use std::collections::{BTreeMap, HashMap};

use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};
use stylegaussian::EncoderId;

use super::{Chain, Convolution, Kernel, Operation, Padding};

/// The key of a network's metadata. One value holds it all, because the safetensors crate writes keys in random
/// order, and equal networks are to give equal files.
const KEY: &str = "network";
/// Version of the format.
const VERSION: u32 = 1;

/// A chain with what its file says about it.
pub struct ChainFile {
    /// The chain.
    pub chain: Chain,
    /// The identity under which the features are known; `None` if it is the file's own name and hash.
    pub id: Option<EncoderId>,
}

/// The metadata.
#[derive(Serialize, Deserialize)]
struct Written {
    version: u32,
    channels: usize,
    operations: Vec<WrittenOperation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    encoder: Option<String>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    notes: BTreeMap<String, String>,
}

/// An operation in the metadata, such as `{"convolution":{"border":{"reflect":[1,1]},"stride":1,"relu":true}}`,
/// `{"add":2}`, `"both_signs"`, `{"max_pool":{"ceil":true}}` or `"double"`.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum WrittenOperation {
    Convolution { border: Padding, stride: usize, relu: bool },
    Add(usize),
    BothSigns,
    MaxPool { ceil: bool },
    Double,
}

/// Whether a safetensors file holds a chain.
pub(crate) fn is_chain(bytes: &[u8]) -> bool {
    let header = SafeTensors::read_metadata(bytes);
    header.is_ok_and(|(_, header)| header.metadata().as_ref().is_some_and(|keys| keys.contains_key(KEY)))
}

impl Chain {
    /// The bytes of a file. `notes` are names and texts for people.
    pub fn to_bytes(&self, id: Option<&EncoderId>, notes: &[(&str, String)]) -> Vec<u8> {
        let mut tensors: BTreeMap<String, (Vec<usize>, Vec<u8>)> = BTreeMap::new();
        let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let operations = self.operations().iter().enumerate().map(|(i, operation)| match operation {
            Operation::Convolution(convolution) => {
                let Kernel { shape, weight, bias } = convolution.kernel();
                tensors.insert(format!("{i}.weight"), (shape.to_vec(), bytes(&weight)));
                tensors.insert(format!("{i}.bias"), (vec![shape[0]], bytes(&bias)));
                let (border, stride) = (convolution.padding(), convolution.stride());
                WrittenOperation::Convolution { border, stride, relu: convolution.relu() }
            }
            Operation::Add(value) => WrittenOperation::Add(*value),
            Operation::BothSigns => WrittenOperation::BothSigns,
            Operation::MaxPool { ceil } => WrittenOperation::MaxPool { ceil: *ceil },
            Operation::Double => WrittenOperation::Double,
        });
        let written = Written {
            version: VERSION,
            channels: self.channels(0),
            operations: operations.collect(),
            encoder: id.map(EncoderId::to_string),
            notes: notes.iter().map(|(name, text)| ((*name).into(), text.clone())).collect(),
        };
        let written = serde_json::to_string(&written).expect("numbers and texts are valid JSON");
        let views = tensors.iter().map(|(name, (shape, data))| {
            let view = TensorView::new(Dtype::F32, shape.clone(), data);
            (name, view.expect("a kernel has as many values as its shape says"))
        });
        let metadata = HashMap::from([(KEY.into(), written)]);
        safetensors::serialize(views, Some(metadata)).expect("tensors have different names")
    }

    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// A description of what is wrong with them.
    pub fn from_bytes(bytes: &[u8]) -> Result<ChainFile, String> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|error| error.to_string())?;
        let file = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
        let written = header.metadata().as_ref().and_then(|keys| keys.get(KEY));
        let written = written.ok_or_else(|| format!("there is no metadata `{KEY}`"))?;
        let written: Written =
            serde_json::from_str(written).map_err(|error| format!("metadata `{KEY}`: {error}"))?;
        if written.version != VERSION || written.channels == 0 {
            let Written { version, channels, .. } = written;
            return Err(format!(
                "found version {version} of {channels} channels, expected {VERSION}, of at least 1"
            ));
        }
        let mut operations = Vec::new();
        for (i, written) in written.operations.into_iter().enumerate() {
            operations.push(match written {
                WrittenOperation::Convolution { border, stride, relu } => {
                    let convolution = Convolution::strided(&kernel(&file, i)?, border, stride)
                        .map_err(|found| format!("operation {i} has {found}"))?;
                    Operation::Convolution(if relu { convolution.rectified() } else { convolution })
                }
                WrittenOperation::Add(value) => Operation::Add(value),
                WrittenOperation::BothSigns => Operation::BothSigns,
                WrittenOperation::MaxPool { ceil } => Operation::MaxPool { ceil },
                WrittenOperation::Double => Operation::Double,
            });
        }
        let chain = Chain::new(written.channels, operations).map_err(|error| error.to_string())?;
        let id = written.encoder.map(|id| id.parse()).transpose();
        let id = id.map_err(|error: stylegaussian::encoder_id::EncoderIdError| error.to_string())?;
        Ok(ChainFile { chain, id })
    }
}

/// The parameters of operation i.
fn kernel(file: &SafeTensors<'_>, i: usize) -> Result<Kernel, String> {
    let tensor = |part: &str| -> Result<(Vec<usize>, Vec<f32>), String> {
        let name = format!("{i}.{part}");
        let tensor = file.tensor(&name).map_err(|_| format!("there is no tensor `{name}`"))?;
        if tensor.dtype() != Dtype::F32 {
            return Err(format!("tensor `{name}` is {:?}, expected F32", tensor.dtype()));
        }
        let values = tensor.data().as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes));
        Ok((tensor.shape().to_vec(), values.collect()))
    };
    let ((shape, weight), (_, bias)) = (tensor("weight")?, tensor("bias")?);
    let shape = <[usize; 4]>::try_from(shape)
        .map_err(|shape| format!("tensor `{i}.weight` is {shape:?}, expected [out, in, side, side]"))?;
    Ok(Kernel { shape, weight, bias })
}
