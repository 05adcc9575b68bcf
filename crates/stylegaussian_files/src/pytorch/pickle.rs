//! A reader for the pickles inside PyTorch files. It executes nothing: the few globals that tensors need are
//! known by name, and any other is an error.
//!
//! Opcodes are those of Python's `pickletools`. Objects live in an arena and refer to one another by index, as
//! pickles do, so that neither reading nor dropping recurses, however deep the nesting.

use std::collections::HashMap;

use crate::error::{Mismatch, mismatch};

/// Index of an object in its [`Pickle`].
pub(crate) type Id = usize;

/// The element type of a storage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StorageType {
    F16,
    BF16,
    F32,
    F64,
    /// Integers and booleans: skipped, never decoded.
    Integer {
        /// Bytes of one element.
        width: usize,
    },
    /// Any other type, such as quantized numbers.
    Unknown,
}

impl StorageType {
    /// The type that a class of the module `torch` stands for.
    fn of_class(name: &str) -> Self {
        match name {
            "HalfStorage" => Self::F16,
            "BFloat16Storage" => Self::BF16,
            "FloatStorage" => Self::F32,
            "DoubleStorage" => Self::F64,
            "BoolStorage" | "ByteStorage" | "CharStorage" => Self::Integer { width: 1 },
            "ShortStorage" => Self::Integer { width: 2 },
            "IntStorage" => Self::Integer { width: 4 },
            "LongStorage" => Self::Integer { width: 8 },
            _ => Self::Unknown,
        }
    }

    /// Bytes of one element, or `None` if the type is unknown.
    pub(super) fn width(self) -> Option<usize> {
        match self {
            Self::F16 | Self::BF16 => Some(2),
            Self::F32 => Some(4),
            Self::F64 => Some(8),
            Self::Integer { width } => Some(width),
            Self::Unknown => None,
        }
    }
}

/// A pickled object.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Object {
    None,
    Integer(i64),
    /// A float, whose value no tensor needs.
    Float,
    Text(String),
    /// A tuple or a list.
    Sequence(Vec<Id>),
    /// A dictionary, ordered or not, as keys and values in the order of the pickle.
    Dictionary(Vec<(Id, Id)>),
    Global(Global),
    Storage(StorageId),
    Tensor(TensorInfo),
}

/// A class or function by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Global {
    OrderedDict,
    Storage(StorageType),
    RebuildParameter,
    RebuildTensor,
}

/// A reference to a storage, which lies outside of the pickle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StorageId {
    pub storage_type: StorageType,
    /// Name of the storage: of the archive's entry under `data/`, or in the list of a stream's storages.
    pub key: String,
    pub n_elements: usize,
}

/// A strided view into a storage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct TensorInfo {
    /// The object that is the storage; several tensors may share one.
    pub storage: Id,
    pub offset: usize,
    pub shape: Vec<usize>,
    pub strides: Vec<usize>,
}

/// All objects of a pickle.
#[derive(Debug)]
pub(crate) struct Pickle {
    objects: Vec<Object>,
    /// The object that was pickled; all others are parts of it.
    pub(crate) root: Id,
}

impl Pickle {
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, Mismatch> {
        Self::read_first(bytes).map(|(pickle, _)| pickle)
    }

    /// The first of several pickles, and the bytes after it.
    pub(super) fn read_first(bytes: &[u8]) -> Result<(Self, &[u8]), Mismatch> {
        let mut machine = Machine { bytes, ..Machine::default() };
        let root = loop {
            if let Some(root) = machine.step()? {
                break root;
            }
        };
        Ok((Self { objects: machine.objects, root }, machine.bytes))
    }

    pub(crate) fn object(&self, id: Id) -> &Object {
        &self.objects[id]
    }

    /// All objects, in the order of their creation.
    pub(crate) fn ids(&self) -> impl Iterator<Item = Id> {
        0..self.objects.len()
    }

    /// The entries of a dictionary, without those that have another key than a text. Other objects have no
    /// entries.
    pub(crate) fn entries(&self, id: Id) -> impl Iterator<Item = (&str, &Object)> {
        let pairs = match &self.objects[id] {
            Object::Dictionary(pairs) => pairs.as_slice(),
            _ => &[],
        };
        pairs.iter().filter_map(|&(key, value)| match &self.objects[key] {
            Object::Text(key) => Some((key.as_str(), &self.objects[value])),
            _ => None,
        })
    }

    /// The texts in a list or tuple. Other objects have none.
    pub(super) fn texts(&self, id: Id) -> impl Iterator<Item = &str> {
        let items = match &self.objects[id] {
            Object::Sequence(items) => items.as_slice(),
            _ => &[],
        };
        items.iter().filter_map(|&item| match &self.objects[item] {
            Object::Text(text) => Some(&text[..]),
            _ => None,
        })
    }
}

fn broken(what: impl std::fmt::Display) -> Mismatch {
    mismatch(format_args!("a pickle with {what}"), "a whole pickle of tensors, as torch.save writes it")
}

/// Python's pickle machine: a stack of objects, marks in the stack, and a memo of objects that occur again.
#[derive(Default)]
struct Machine<'a> {
    bytes: &'a [u8],
    objects: Vec<Object>,
    stack: Vec<Id>,
    marks: Vec<usize>,
    memo: HashMap<usize, Id>,
}

impl<'a> Machine<'a> {
    /// Executes one opcode. The last one, STOP, returns the root.
    fn step(&mut self) -> Result<Option<Id>, Mismatch> {
        match self.byte()? {
            0x80 => self.take(1).map(|_| ())?, // PROTO
            0x95 => self.take(8).map(|_| ())?, // FRAME
            b'.' => return self.pop().map(Some),
            b'(' => self.marks.push(self.stack.len()),
            b'0' => self.pop().map(|_| ())?,
            b'1' => self.pop_to_mark().map(|_| ())?,
            b'2' => {
                let top = self.top()?;
                self.stack.push(top);
            }
            opcode @ (b'q' | b'r' | 0x94 | b'h' | b'j') => self.memo_opcode(opcode)?,
            opcode @ (b'N' | 0x88 | 0x89 | b'J' | b'K' | b'M' | 0x8a | b'G') => self.number_opcode(opcode)?,
            opcode @ (b'X' | 0x8c | 0x8d | b'U' | b'T' | b'C' | b'B') => self.text_opcode(opcode)?,
            opcode @ (b')' | 0x85 | 0x86 | 0x87 | b't' | b']' | b'l' | b'a' | b'e') => {
                self.sequence_opcode(opcode)?;
            }
            opcode @ (b'}' | b'd' | b's' | b'u') => self.dictionary_opcode(opcode)?,
            opcode @ (b'c' | 0x93 | b'Q' | b'R' | b'b') => self.object_opcode(opcode)?,
            opcode => return Err(broken(format_args!("opcode {opcode:#04x}"))),
        }
        Ok(None)
    }

    /// BINPUT, LONG_BINPUT, MEMOIZE, BINGET, LONG_BINGET.
    fn memo_opcode(&mut self, opcode: u8) -> Result<(), Mismatch> {
        let key = match opcode {
            b'q' | b'h' => self.byte()?.into(),
            b'r' | b'j' => self.length(4)?,
            _ => self.memo.len(),
        };
        if matches!(opcode, b'h' | b'j') {
            let id = self.memo.get(&key).ok_or_else(|| broken(format_args!("no memo {key}")))?;
            self.stack.push(*id);
        } else {
            let top = self.top()?;
            self.memo.insert(key, top);
        }
        Ok(())
    }

    /// NONE, NEWTRUE, NEWFALSE, BININT, BININT1, BININT2, LONG1, BINFLOAT.
    fn number_opcode(&mut self, opcode: u8) -> Result<(), Mismatch> {
        let object = match opcode {
            b'N' => Object::None,
            0x88 => Object::Integer(1),
            0x89 => Object::Integer(0),
            b'J' => Object::Integer(i32::from_le_bytes(self.array()?).into()),
            b'K' => Object::Integer(self.byte()?.into()),
            b'M' => Object::Integer(u16::from_le_bytes(self.array()?).into()),
            0x8a => {
                let n = self.byte()?;
                Object::Integer(long(self.take(n.into())?)?)
            }
            _ => {
                self.take(8)?;
                Object::Float
            }
        };
        self.push(object);
        Ok(())
    }

    /// BINUNICODE, SHORT_BINUNICODE, BINUNICODE8, SHORT_BINSTRING, BINSTRING, SHORT_BINBYTES, BINBYTES.
    fn text_opcode(&mut self, opcode: u8) -> Result<(), Mismatch> {
        let size_bytes = match opcode {
            0x8c | b'U' | b'C' => 1,
            0x8d => 8,
            _ => 4,
        };
        let n = self.length(size_bytes)?;
        let text = String::from_utf8_lossy(self.take(n)?).into_owned();
        self.push(Object::Text(text));
        Ok(())
    }

    /// EMPTY_TUPLE, TUPLE1, TUPLE2, TUPLE3, TUPLE, EMPTY_LIST, LIST, APPEND, APPENDS.
    fn sequence_opcode(&mut self, opcode: u8) -> Result<(), Mismatch> {
        let items = match opcode {
            b')' | b']' => Vec::new(),
            0x85..=0x87 => self.pop_many(usize::from(opcode - 0x84))?,
            b'a' => self.pop_many(1)?,
            _ => self.pop_to_mark()?,
        };
        if !matches!(opcode, b'a' | b'e') {
            self.push(Object::Sequence(items));
            return Ok(());
        }
        let list = self.top()?;
        match &mut self.objects[list] {
            Object::Sequence(list) => list.extend(items),
            other => return Err(broken(format_args!("items appended to {}", name_of(other)))),
        }
        Ok(())
    }

    /// EMPTY_DICT, DICT, SETITEM, SETITEMS.
    fn dictionary_opcode(&mut self, opcode: u8) -> Result<(), Mismatch> {
        let items = match opcode {
            b'}' => Vec::new(),
            b's' => self.pop_many(2)?,
            _ => self.pop_to_mark()?,
        };
        let (pairs, []) = items.as_chunks::<2>() else { return Err(broken("a key without a value")) };
        let pairs = pairs.iter().map(|&[key, value]| (key, value));
        if !matches!(opcode, b's' | b'u') {
            let pairs = pairs.collect();
            self.push(Object::Dictionary(pairs));
            return Ok(());
        }
        let dictionary = self.top()?;
        match &mut self.objects[dictionary] {
            Object::Dictionary(dictionary) => dictionary.extend(pairs),
            other => return Err(broken(format_args!("keys set on {}", name_of(other)))),
        }
        Ok(())
    }

    /// GLOBAL, STACK_GLOBAL, BINPERSID, REDUCE, BUILD.
    fn object_opcode(&mut self, opcode: u8) -> Result<(), Mismatch> {
        let object = match opcode {
            b'c' => Object::Global(global(&self.line()?, &self.line()?)?),
            0x93 => {
                let names = self.pop_many(2)?;
                match (&self.objects[names[0]], &self.objects[names[1]]) {
                    (Object::Text(module), Object::Text(name)) => Object::Global(global(module, name)?),
                    _ => return Err(broken("a global without a name")),
                }
            }
            b'Q' => {
                let id = self.pop()?;
                self.storage(id)?
            }
            b'R' => {
                let arguments = self.pop()?;
                let function = self.pop()?;
                self.reduce(function, arguments)?
            }
            // BUILD sets attributes, such as a state dict's `_metadata`. No tensor needs them.
            _ => return self.pop().map(|_| ()),
        };
        self.push(object);
        Ok(())
    }

    /// The storage of a persistent id: ('storage', type, key, location, number of elements). Before version 1.6
    /// a sixth item followed: `None`, or a part of the storage, which is refused.
    fn storage(&self, id: Id) -> Result<Object, Mismatch> {
        if let [tag, storage_type, key, _location, n_elements, part @ ..] = self.sequence(id)?
            && part.iter().all(|&item| self.objects[item] == Object::None)
            && let Object::Text(tag) = &self.objects[*tag]
            && tag == "storage"
            && let Object::Global(Global::Storage(storage_type)) = self.objects[*storage_type]
            && let Object::Text(key) = &self.objects[*key]
        {
            let n_elements = self.count(*n_elements)?;
            return Ok(Object::Storage(StorageId { storage_type, key: key.clone(), n_elements }));
        }
        Err(broken("a persistent id that is no storage"))
    }

    /// The result of calling a known global.
    fn reduce(&self, function: Id, arguments: Id) -> Result<Object, Mismatch> {
        let arguments = self.sequence(arguments)?;
        match (&self.objects[function], arguments) {
            (Object::Global(Global::OrderedDict), []) => Ok(Object::Dictionary(Vec::new())),
            // Python 2 passes the items; Python 3 sets them one by one afterwards.
            (Object::Global(Global::OrderedDict), &[items]) => self.pairs(items).map(Object::Dictionary),
            (Object::Global(Global::RebuildParameter), [data, ..]) => match &self.objects[*data] {
                tensor @ Object::Tensor(_) => Ok(tensor.clone()),
                other => Err(broken(format_args!("a parameter made of {}", name_of(other)))),
            },
            (Object::Global(Global::RebuildTensor), [storage, offset, shape, strides, ..]) => {
                if !matches!(self.objects[*storage], Object::Storage(_)) {
                    return Err(broken("a tensor without a storage"));
                }
                let offset = self.count(*offset)?;
                let (shape, strides) = (self.counts(*shape)?, self.counts(*strides)?);
                Ok(Object::Tensor(TensorInfo { storage: *storage, offset, shape, strides }))
            }
            (other, arguments) => {
                Err(broken(format_args!("a call of {} with {} arguments", name_of(other), arguments.len())))
            }
        }
    }

    /// A sequence of (key, value).
    fn pairs(&self, id: Id) -> Result<Vec<(Id, Id)>, Mismatch> {
        let pair = |&item: &Id| match self.sequence(item)? {
            &[key, value] => Ok((key, value)),
            other => Err(broken(format_args!("a dictionary's item of {} parts", other.len()))),
        };
        self.sequence(id)?.iter().map(pair).collect()
    }

    fn sequence(&self, id: Id) -> Result<&[Id], Mismatch> {
        match &self.objects[id] {
            Object::Sequence(items) => Ok(items),
            other => Err(broken(format_args!("{} where a tuple belongs", name_of(other)))),
        }
    }

    fn count(&self, id: Id) -> Result<usize, Mismatch> {
        match self.objects[id] {
            Object::Integer(value) => {
                usize::try_from(value).map_err(|_| broken(format_args!("a count of {value}")))
            }
            ref other => Err(broken(format_args!("{} where a count belongs", name_of(other)))),
        }
    }

    /// The sizes of a shape, or its strides. Limited to 8, as each tensor copies a shape that it shares with
    /// others: a short pickle could name one long shape many times.
    fn counts(&self, id: Id) -> Result<Vec<usize>, Mismatch> {
        match self.sequence(id)? {
            dimensions if dimensions.len() <= 8 => dimensions.iter().map(|&id| self.count(id)).collect(),
            dimensions => Err(broken(format_args!("a tensor of {} dimensions", dimensions.len()))),
        }
    }

    fn push(&mut self, object: Object) {
        self.stack.push(self.objects.len());
        self.objects.push(object);
    }

    fn top(&self) -> Result<Id, Mismatch> {
        self.stack.last().copied().ok_or_else(|| broken("an empty stack"))
    }

    fn pop(&mut self) -> Result<Id, Mismatch> {
        self.pop_many(1).map(|items| items[0])
    }

    /// The top `n` objects, lowest first. Objects below the last mark are out of reach.
    fn pop_many(&mut self, n: usize) -> Result<Vec<Id>, Mismatch> {
        let floor = self.marks.last().copied().unwrap_or(0);
        match self.stack.len().checked_sub(n) {
            Some(start) if start >= floor => Ok(self.stack.split_off(start)),
            _ => Err(broken("an empty stack")),
        }
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, Mismatch> {
        let mark = self.marks.pop().ok_or_else(|| broken("no mark"))?;
        Ok(self.stack.split_off(mark))
    }

    fn byte(&mut self) -> Result<u8, Mismatch> {
        self.array().map(|[byte]| byte)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Mismatch> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    /// A little-endian length of `n` bytes.
    fn length(&mut self, n: usize) -> Result<usize, Mismatch> {
        let mut array = [0; 8];
        array[..n].copy_from_slice(self.take(n)?);
        usize::try_from(u64::from_le_bytes(array)).map_err(|_| broken("a length out of range"))
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], Mismatch> {
        let (taken, rest) = self.bytes.split_at_checked(n).ok_or_else(|| broken("no end (truncated?)"))?;
        self.bytes = rest;
        Ok(taken)
    }

    /// The text up to the end of the line.
    fn line(&mut self) -> Result<String, Mismatch> {
        let end =
            self.bytes.iter().position(|&byte| byte == b'\n').ok_or_else(|| broken("no end (truncated?)"))?;
        let line = String::from_utf8_lossy(self.take(end)?).into_owned();
        self.take(1)?;
        Ok(line)
    }
}

/// The globals that tensors and state dicts are made of.
fn global(module: &str, name: &str) -> Result<Global, Mismatch> {
    match (module, name) {
        ("collections", "OrderedDict") => Ok(Global::OrderedDict),
        ("torch._utils", "_rebuild_parameter") => Ok(Global::RebuildParameter),
        // The first form, before version 0.4, lacks trailing arguments that are ignored here.
        ("torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2") => Ok(Global::RebuildTensor),
        ("torch", name) if name.ends_with("Storage") => Ok(Global::Storage(StorageType::of_class(name))),
        _ => Err(mismatch(
            format_args!("global `{}.{}` in the pickle", module.escape_debug(), name.escape_debug()),
            "only OrderedDict, torch storages, _rebuild_tensor and _rebuild_parameter; \
             nothing else is executed",
        )),
    }
}

/// A little-endian two's complement number of up to 8 bytes.
fn long(bytes: &[u8]) -> Result<i64, Mismatch> {
    let negative = bytes.last().is_some_and(|&byte| byte >= 0x80);
    let mut array = [if negative { 0xff } else { 0 }; 8];
    array.get_mut(..bytes.len()).ok_or_else(|| broken("a number past 64 bits"))?.copy_from_slice(bytes);
    Ok(i64::from_le_bytes(array))
}

/// The kind of an object, for messages.
pub(super) fn name_of(object: &Object) -> &'static str {
    match object {
        Object::None => "None",
        Object::Integer(_) => "an integer",
        Object::Float => "a float",
        Object::Text(_) => "a text",
        Object::Sequence(_) => "a tuple or list",
        Object::Dictionary(_) => "a dictionary",
        Object::Global(_) => "a global",
        Object::Storage(_) => "a storage",
        Object::Tensor(_) => "a tensor",
    }
}
