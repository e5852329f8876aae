//! What a checkpoint's pickle can hold.

use crate::element::ElementType;

/// Number of an object in its arena.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Id(pub(super) u32);

/// An object.
#[derive(Debug, Clone, PartialEq)]
pub enum Object {
    /// `None`.
    None,
    /// A truth value.
    Bool(bool),
    /// An integer.
    Int(i64),
    /// A float.
    Float(f64),
    /// A text.
    Text(String),
    /// A tuple.
    Tuple(Vec<Id>),
    /// A list.
    List(Vec<Id>),
    /// A dictionary (`OrderedDict` too) or the attributes of a namespace.
    Dict(Vec<(Id, Id)>),
    /// A name of the closed list, before it is applied to something.
    Name(Name),
    /// An array of numbers somewhere in the archive.
    Storage(Box<Storage>),
    /// A view of a storage.
    Tensor(Box<Tensor>),
    /// Data of no interest here, kept as its name.
    Opaque(&'static str),
}

/// Names that a checkpoint may use. None of them runs anything here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Name {
    /// `collections.OrderedDict`.
    OrderedDict,
    /// `argparse.Namespace`.
    Namespace,
    /// `torch._utils._rebuild_tensor_v2`.
    RebuildTensor,
    /// `torch._utils._rebuild_parameter`.
    RebuildParameter,
    /// `torch.FloatStorage` and its like.
    StorageOf(ElementType),
    /// Numbers of NumPy, such as a training run leaves among its settings.
    Inert(&'static str),
}

impl Name {
    /// What a pickle calls it, or `None` for everything else.
    pub fn of(module: &str, name: &str) -> Option<Self> {
        Some(match (module, name) {
            ("collections", "OrderedDict") => Self::OrderedDict,
            ("argparse", "Namespace") => Self::Namespace,
            ("torch._utils", "_rebuild_tensor_v2") => Self::RebuildTensor,
            ("torch._utils", "_rebuild_parameter") => Self::RebuildParameter,
            ("torch", "HalfStorage") => Self::StorageOf(ElementType::F16),
            ("torch", "BFloat16Storage") => Self::StorageOf(ElementType::Bf16),
            ("torch", "FloatStorage") => Self::StorageOf(ElementType::F32),
            ("torch", "DoubleStorage") => Self::StorageOf(ElementType::F64),
            ("torch", "CharStorage") => Self::StorageOf(ElementType::I8),
            ("torch", "ShortStorage") => Self::StorageOf(ElementType::I16),
            ("torch", "IntStorage") => Self::StorageOf(ElementType::I32),
            ("torch", "LongStorage") => Self::StorageOf(ElementType::I64),
            ("torch", "ByteStorage") => Self::StorageOf(ElementType::U8),
            ("torch", "BoolStorage") => Self::StorageOf(ElementType::Bool),
            ("numpy.core.multiarray" | "numpy._core.multiarray", "scalar") => Self::Inert("numpy scalar"),
            ("numpy", "dtype") => Self::Inert("numpy dtype"),
            ("_codecs", "encode") => Self::Inert("bytes"),
            _ => return None,
        })
    }
}

/// An array of numbers in an entry of the archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Storage {
    /// Name of its entry under `data/`.
    pub key: String,
    /// Type of its elements.
    pub kind: ElementType,
    /// Number of its elements.
    pub len: u64,
}

/// A view of a storage.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tensor {
    /// What it looks at.
    pub storage: Storage,
    /// Its first element's place in the storage.
    pub offset: u64,
    /// Sizes, the slowest first.
    pub shape: Vec<usize>,
    /// Elements from one to the next along each side.
    pub strides: Vec<u64>,
}

/// All objects of a pickle.
#[derive(Debug)]
pub(crate) struct Objects {
    pub(super) arena: Vec<Object>,
    pub(super) root: Id,
}

impl Objects {
    /// What the pickle holds.
    pub fn root(&self) -> &Object {
        self.get(self.root)
    }

    /// An object.
    pub fn get(&self, id: Id) -> &Object {
        // Numbers come from this arena only, which never shrinks.
        &self.arena[id.0 as usize]
    }

    /// Value of a text key of a dictionary; `None` too if `object` is not one. The last of equal keys counts, as in Python.
    pub fn value<'a>(&'a self, object: &'a Object, key: &str) -> Option<&'a Object> {
        self.items(object).filter(|(name, _)| *name == key).last().map(|(_, value)| value)
    }

    /// Items of a dictionary with text keys.
    pub fn items<'a>(&'a self, object: &'a Object) -> impl Iterator<Item = (&'a str, &'a Object)> {
        let pairs: &[(Id, Id)] = if let Object::Dict(pairs) = object { pairs } else { &[] };
        pairs.iter().filter_map(|(key, value)| match self.get(*key) {
            Object::Text(key) => Some((key.as_str(), self.get(*value))),
            _ => None,
        })
    }
}
