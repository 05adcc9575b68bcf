//! Reads the ONNX graphs that `stylegaussian_encoder` writes: chains of padding, convolutions, ReLUs, sums and
//! max-pooling.
//!
//! ONNX is a protobuf message. Field numbers are from `onnx.proto3`.

use std::collections::HashMap;

use super::{
    chain::{Chain, Operation},
    convolution::{Convolution, Padding},
};

/// A node of the graph.
#[derive(Default)]
struct Node {
    operator: String,
    inputs: Vec<String>,
    outputs: Vec<String>,
    integers: HashMap<String, Vec<u64>>,
}

/// An initializer: shape and little-endian bytes.
struct Constant {
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

/// One field of a message: its number and its value.
enum Field<'a> {
    Integer(u64, u64),
    Bytes(u64, &'a [u8]),
}

/// The fields of a message.
struct Message<'a>(&'a [u8]);

impl Message<'_> {
    fn varint(&mut self) -> Result<u64, String> {
        let mut value = 0;
        // Ten bytes of seven bits hold the 64 bits of the longest number.
        for shift in (0..70).step_by(7) {
            let (&byte, rest) = self.0.split_first().ok_or("a message that ends within a number")?;
            self.0 = rest;
            value |= u64::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err("a number of more than 64 bits".into())
    }
}

impl<'a> Message<'a> {
    fn next(&mut self) -> Result<Option<Field<'a>>, String> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let tag = self.varint()?;
        match tag & 7 {
            0 => Ok(Some(Field::Integer(tag >> 3, self.varint()?))),
            2 => {
                let length = self.varint()?;
                let fits = usize::try_from(length).ok().filter(|&length| length <= self.0.len());
                let length = fits.ok_or("a message that ends within a field")?;
                let (bytes, rest) = self.0.split_at(length);
                self.0 = rest;
                Ok(Some(Field::Bytes(tag >> 3, bytes)))
            }
            other => Err(format!("a field of wire type {other}")),
        }
    }

    fn for_each(mut self, mut visit: impl FnMut(Field<'a>) -> Result<(), String>) -> Result<(), String> {
        while let Some(field) = self.next()? {
            visit(field)?;
        }
        Ok(())
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

impl Node {
    fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut node = Self::default();
        Message(bytes).for_each(|field| {
            match field {
                Field::Bytes(1, name) => node.inputs.push(text(name)),
                Field::Bytes(2, name) => node.outputs.push(text(name)),
                Field::Bytes(4, name) => node.operator = text(name),
                Field::Bytes(5, attribute) => {
                    let (mut name, mut values) = (String::new(), Vec::new());
                    Message(attribute).for_each(|field| {
                        match field {
                            Field::Bytes(1, bytes) => name = text(bytes),
                            Field::Integer(3 | 8, value) => values.push(value),
                            _ => (),
                        }
                        Ok(())
                    })?;
                    node.integers.insert(name, values);
                }
                _ => (),
            }
            Ok(())
        })?;
        Ok(node)
    }

    fn integer(&self, name: &str, default: u64) -> u64 {
        self.integers.get(name).and_then(|values| values.first()).copied().unwrap_or(default)
    }
}

impl Constant {
    fn read(bytes: &[u8]) -> Result<(String, Self), String> {
        let (mut name, mut constant) = (String::new(), Self { shape: Vec::new(), bytes: Vec::new() });
        Message(bytes).for_each(|field| {
            match field {
                Field::Integer(1, size) => constant.shape.push(size as usize),
                Field::Bytes(8, bytes) => name = text(bytes),
                Field::Bytes(9, bytes) => constant.bytes = bytes.to_vec(),
                _ => (),
            }
            Ok(())
        })?;
        Ok((name, constant))
    }

    fn floats(&self) -> Vec<f32> {
        self.bytes.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
    }

    fn integers(&self) -> Vec<i64> {
        self.bytes.as_chunks::<8>().0.iter().map(|&bytes| i64::from_le_bytes(bytes)).collect()
    }
}

/// Reads a chain from the bytes of an ONNX file.
///
/// # Errors If the bytes are no ONNX graph of these operators, or shapes do not fit one another. The text
/// describes it.
pub(super) fn read(bytes: &[u8]) -> Result<Chain, String> {
    let mut graph: &[u8] = &[];
    Message(bytes).for_each(|field| {
        if let Field::Bytes(7, found) = field {
            graph = found;
        }
        Ok(())
    })?;
    let (mut nodes, mut constants) = (Vec::new(), HashMap::new());
    Message(graph).for_each(|field| {
        match field {
            Field::Bytes(1, node) => nodes.push(Node::read(node)?),
            Field::Bytes(5, constant) => {
                let (name, constant) = Constant::read(constant)?;
                constants.insert(name, constant);
            }
            _ => (),
        }
        Ok(())
    })?;
    if nodes.is_empty() {
        return Err("no node of a graph".into());
    }
    Builder { constants, ..Default::default() }.build(&nodes)
}

/// A chain under construction.
#[derive(Default)]
struct Builder {
    constants: HashMap<String, Constant>,
    operations: Vec<Operation>,
    /// Number of each named value: 0 is the input, i + 1 the result of operation i.
    values: HashMap<String, usize>,
    /// Channels of each value.
    channels: Vec<usize>,
    /// Reflection before the next convolution, in pixels before and after.
    reflection: Option<[usize; 2]>,
}

impl Builder {
    fn build(mut self, nodes: &[Node]) -> Result<Chain, String> {
        self.channels.push(3);
        if let Some(input) = nodes[0].inputs.first() {
            self.values.insert(input.clone(), 0);
        }
        for node in nodes {
            self.add(node).map_err(|found| format!("operator {}: {found}", node.operator))?;
        }
        Ok(Chain::new(self.operations))
    }

    fn add(&mut self, node: &Node) -> Result<(), String> {
        let (Some(input), Some(output)) = (node.inputs.first(), node.outputs.first()) else {
            return Err("without input or output".into());
        };
        let last = self.operations.len();
        if self.values.get(input) != Some(&last) {
            return Err("not on the value before it".into());
        }
        match node.operator.as_str() {
            "Pad" => {
                let pads = node.inputs.get(1).and_then(|name| self.constants.get(name));
                let pads = pads.map(Constant::integers).unwrap_or_default();
                let [0, 0, top, left, 0, 0, bottom, right] = pads[..] else {
                    return Err(format!("pads {pads:?}"));
                };
                let small = 0..8;
                if top != left || bottom != right || !small.contains(&top) || !small.contains(&bottom) {
                    return Err(format!("pads {pads:?}"));
                }
                self.reflection = Some([top as usize, bottom as usize]);
            }
            "Conv" => {
                let convolution = self.convolution(node)?;
                self.channels.push(convolution.d_out());
                self.operations.push(Operation::Convolution(convolution));
            }
            "Relu" => match self.operations.last_mut() {
                Some(Operation::Convolution(convolution)) => convolution.relu = true,
                _ => return Err("not after a convolution".into()),
            },
            "Add" => {
                let from = node.inputs.get(1).and_then(|name| self.values.get(name));
                let from = *from.ok_or("without its second input")?;
                if self.channels[from] != self.channels[last] {
                    return Err(format!("of {} and {} channels", self.channels[from], self.channels[last]));
                }
                self.channels.push(self.channels[last]);
                self.operations.push(Operation::Add(from));
            }
            "MaxPool" => {
                self.channels.push(self.channels[last]);
                self.operations.push(Operation::MaxPool { ceil: node.integer("ceil_mode", 0) == 1 });
            }
            _ => return Err("unknown here".into()),
        }
        self.values.insert(output.clone(), self.operations.len());
        Ok(())
    }

    fn convolution(&mut self, node: &Node) -> Result<Convolution, String> {
        let constant = |i: usize| node.inputs.get(i).and_then(|name| self.constants.get(name));
        let (Some(weight), Some(bias)) = (constant(1), constant(2)) else {
            return Err("without weight or bias".into());
        };
        let [out, d_in, height, width] = weight.shape[..] else {
            return Err(format!("weight {:?}", weight.shape));
        };
        let expected = self.channels[self.operations.len()];
        let n = [out, d_in, height, width].into_iter().try_fold(1, usize::checked_mul);
        let (oihw, bias) = (weight.floats(), bias.floats());
        if d_in != expected || height != width || !(1..=8).contains(&height) || Some(oihw.len()) != n {
            return Err(format!("weight {:?} on {expected} channels", weight.shape));
        }
        if bias.len() != out || out == 0 {
            return Err(format!("{} biases for {out} channels", bias.len()));
        }
        if oihw.iter().chain(&bias).any(|value| !value.is_finite()) {
            return Err("a weight that is not finite".into());
        }
        let zeros = node.integer("pads", 0) as usize;
        let padding = match (self.reflection.take(), zeros) {
            (Some(pads), 0) => Padding::Reflect(pads),
            (None, 0..8) => Padding::Zeros(zeros),
            _ => return Err(format!("pads {zeros}")),
        };
        let stride = node.integer("strides", 1);
        if !(1..=8).contains(&stride) || !height.is_multiple_of(stride as usize) {
            return Err(format!("stride {stride} of a kernel of {height} pixels"));
        }
        Ok(Convolution::from_oihw([out, d_in, height], &oihw, bias, padding, stride as usize))
    }
}
