//! Writes small ONNX graphs: a chain of layers from one image-like input to one output.
//!
//! ONNX is a protobuf message. The graphs of this crate need only integers, byte strings and nesting, which is
//! less code than a dependency. Field numbers are from `onnx.proto3`.

/// ONNX operator set of the graphs: 13, the first in which all operators used here have their final shape.
const OPERATOR_SET: u64 = 13;
/// `onnx.proto3`'s IR version of that operator set.
const IR_VERSION: u64 = 7;
/// `TensorProto.DataType.FLOAT` and `INT64`.
const FLOAT: u64 = 1;
const INT64: u64 = 7;

/// One convolution's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Convolution {
    /// `[out, in, kernel height, kernel width]`.
    pub shape: [usize; 4],
    /// Kernel, row-major in `shape`.
    pub weight: Vec<f32>,
    /// `[out]`.
    pub bias: Vec<f32>,
}

/// A value inside a chain, to which a later layer can refer.
pub struct Place(String);

/// A chain of layers over a tensor `[1, channels, height, width]`, of any height and width.
pub struct ChainWriter {
    // Apart, since a layer adds to several of them and the file lists each kind as a whole.
    nodes: Message,
    initializers: Message,
    descriptions: Message,
    input_channels: usize,
    channels: usize,
    n_values: usize,
}

impl ChainWriter {
    /// A chain whose input has this many channels.
    pub fn new(input_channels: usize) -> Self {
        Self {
            nodes: Message::default(),
            initializers: Message::default(),
            descriptions: Message::default(),
            input_channels,
            channels: input_channels,
            n_values: 0,
        }
    }

    /// Adds a note for people to the file: a name and a text.
    pub fn describe(mut self, name: &str, text: &str) -> Self {
        self.descriptions = self.descriptions.message(14, Message::default().text(1, name).text(2, text));
        self
    }

    /// Reflection padding of one pixel on each side; the border pixel itself is not repeated.
    pub fn reflect(self) -> Self {
        self.reflect_by(1, 1)
    }

    /// Reflection padding of `before` pixels above and to the left, and of `after` below and to the right.
    pub fn reflect_by(mut self, before: u32, after: u32) -> Self {
        let [before, after] = [before, after].map(i64::from);
        // All begins come before all ends: batch, channel, row, column.
        let pads = self.integers(&[0, 0, before, before, 0, 0, after, after]);
        self.node("Pad", &[&pads], &[Attribute::Text("mode", "reflect")]);
        self
    }

    /// Convolution of stride 1 with `zero_padding` zeros on each side.
    ///
    /// The convolution must have as many inputs as the chain has channels. Readers of weights check that.
    pub fn convolution(self, convolution: &Convolution, zero_padding: u64) -> Self {
        self.any_convolution(convolution, zero_padding, 1)
    }

    /// Convolution without padding at every `stride`-th row and column.
    pub fn strided_convolution(self, convolution: &Convolution, stride: u64) -> Self {
        self.any_convolution(convolution, 0, stride)
    }

    fn any_convolution(mut self, convolution: &Convolution, zero_padding: u64, stride: u64) -> Self {
        let [out, _, height, width] = convolution.shape;
        let weight = self.floats(&convolution.shape, &convolution.weight);
        let bias = self.floats(&[out], &convolution.bias);
        let kernel = [height as u64, width as u64];
        let attributes = [
            Attribute::Integers("kernel_shape", &kernel),
            Attribute::Integers("pads", &[zero_padding; 4]),
            Attribute::Integers("strides", &[stride; 2]),
        ];
        self.node("Conv", &[&weight, &bias], &attributes);
        self.channels = out;
        self
    }

    /// max(x, 0).
    pub fn relu(mut self) -> Self {
        self.node("Relu", &[], &[]);
        self
    }

    /// The chain's value at this point, for [`ChainWriter::add_from`].
    pub fn here(&self) -> Place {
        Place(self.value())
    }

    /// Adds the values at an earlier place, which must have the same shape.
    pub fn add_from(mut self, place: &Place) -> Self {
        self.node("Add", &[&place.0], &[]);
        self
    }

    /// 2x2 maximum with stride 2. An odd last row or column is kept if `ceil`, otherwise dropped.
    pub fn max_pool(mut self, ceil: bool) -> Self {
        let attributes = [
            Attribute::Integers("kernel_shape", &[2, 2]),
            Attribute::Integers("strides", &[2, 2]),
            Attribute::Integer("ceil_mode", ceil.into()),
        ];
        self.node("MaxPool", &[], &attributes);
        self
    }

    /// Doubles width and height: each pixel becomes a 2x2 block.
    pub fn upsample(mut self) -> Self {
        // `Resize` takes the scales as its third input. The second one, a region of interest, stays empty.
        let scales = self.floats(&[4], &[1.0, 1.0, 2.0, 2.0]);
        let attributes = [
            Attribute::Text("mode", "nearest"),
            // Together with `floor`: pixel x of the output copies pixel x / 2 of the input.
            Attribute::Text("coordinate_transformation_mode", "asymmetric"),
            Attribute::Text("nearest_mode", "floor"),
        ];
        self.node("Resize", &["", &scales], &attributes);
        self
    }

    /// The bytes of the ONNX file.
    pub fn finish(self) -> Vec<u8> {
        let output = self.value();
        let graph = Message::default()
            .append(self.nodes)
            .text(2, "chain")
            .append(self.initializers)
            // Named sizes may have any value. Two names for the output's, since the graph itself relates them
            // to the input's.
            .message(11, value_info("v0", self.input_channels, ["height", "width"]))
            .message(12, value_info(&output, self.channels, ["output_height", "output_width"]));
        Message::default()
            .integer(1, IR_VERSION)
            .text(2, "stylegaussian_encoder")
            .message(7, graph)
            .message(8, Message::default().text(1, "").integer(2, OPERATOR_SET))
            .append(self.descriptions)
            .0
    }

    fn value(&self) -> String {
        format!("v{}", self.n_values)
    }

    /// Appends an operator from the last value (and `more` constants) to a new value.
    fn node(&mut self, operator: &str, more: &[&str], attributes: &[Attribute<'_>]) {
        let mut node = Message::default().text(1, &self.value());
        self.n_values += 1;
        for name in more {
            node = node.text(1, name);
        }
        node = node.text(2, &self.value()).text(3, &self.value()).text(4, operator);
        for attribute in attributes {
            node = node.message(5, attribute.write());
        }
        self.nodes = std::mem::take(&mut self.nodes).message(1, node);
    }

    fn floats(&mut self, shape: &[usize], values: &[f32]) -> String {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(shape, FLOAT, &bytes)
    }

    fn integers(&mut self, values: &[i64]) -> String {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        // `raw_data` is little-endian whatever the machine.
        self.initializer(&[values.len()], INT64, &bytes)
    }

    fn initializer(&mut self, shape: &[usize], data_type: u64, bytes: &[u8]) -> String {
        // The number of bytes so far grows with each initializer, so no name comes twice.
        let name = format!("c{}", self.initializers.0.len());
        let mut tensor = Message::default();
        for &size in shape {
            tensor = tensor.integer(1, size as u64);
        }
        tensor = tensor.integer(2, data_type).text(8, &name).bytes(9, bytes);
        self.initializers = std::mem::take(&mut self.initializers).message(5, tensor);
        name
    }
}

fn value_info(name: &str, channels: usize, size: [&str; 2]) -> Message {
    let known = |size: usize| Message::default().integer(1, size as u64);
    let [height, width] = size.map(|symbol| Message::default().text(2, symbol));
    let shape = Message::default()
        .message(1, known(1))
        .message(1, known(channels))
        .message(1, height)
        .message(1, width);
    let tensor = Message::default().integer(1, FLOAT).message(2, shape);
    Message::default().text(1, name).message(2, Message::default().message(1, tensor))
}

/// An attribute of an operator. The numbers in `write` are the fields and types of `AttributeProto`.
enum Attribute<'a> {
    Integer(&'a str, u64),
    Integers(&'a str, &'a [u64]),
    Text(&'a str, &'a str),
}

impl Attribute<'_> {
    fn write(&self) -> Message {
        match *self {
            Self::Integer(name, value) => Message::default().text(1, name).integer(3, value).integer(20, 2),
            Self::Text(name, value) => Message::default().text(1, name).text(4, value).integer(20, 3),
            Self::Integers(name, values) => {
                let start = Message::default().text(1, name);
                values.iter().fold(start, |message, &value| message.integer(8, value)).integer(20, 7)
            }
        }
    }
}

/// A protobuf message under construction.
#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    /// Appends 7 bits at a time, lowest first; the eighth bit marks that more follow.
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    // A field's tag is its number and its wire type: 0 for a varint, 2 for bytes with their length before them.
    fn integer(mut self, field: u64, value: u64) -> Self {
        self.varint(field << 3);
        self.varint(value);
        self
    }

    fn bytes(mut self, field: u64, bytes: &[u8]) -> Self {
        self.varint(field << 3 | 2);
        self.varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
        self
    }

    fn text(self, field: u64, text: &str) -> Self {
        self.bytes(field, text.as_bytes())
    }

    fn message(self, field: u64, message: Message) -> Self {
        self.bytes(field, &message.0)
    }

    fn append(mut self, fields: Message) -> Self {
        self.0.extend(fields.0);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_match_the_protobuf_documentation() {
        // The two examples of protobuf's encoding guide: `a = 150` in field 1, and `b = "testing"` in field 2.
        assert_eq!(Message::default().integer(1, 150).0, [0x08, 0x96, 0x01]);
        assert_eq!(Message::default().text(2, "testing").0, b"\x12\x07testing");
    }
}
