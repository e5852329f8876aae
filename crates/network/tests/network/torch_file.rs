//! Writes what `torch.save` writes, right or wrong.

/// A zip archive of stored entries.
#[derive(Clone, Default)]
pub struct Zip {
    pub entries: Vec<(String, Vec<u8>)>,
    /// Compression method that the directory tells.
    pub method: u16,
    /// Added to the length that the directory tells of each entry's content.
    pub lie: u32,
    /// With a 64-bit directory.
    pub wide: bool,
}

impl Zip {
    pub fn bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        let mut directory = Vec::new();
        for (name, data) in &self.entries {
            let start = out.len() as u32;
            let sizes = [data.len() as u32, data.len() as u32 + self.lie];
            out.extend(header(0x0403_4b50, &[20, 0, self.method, 0, 0], sizes));
            out.extend_from_slice(&(name.len() as u16).to_le_bytes());
            out.extend_from_slice(&0u16.to_le_bytes());
            out.extend_from_slice(name.as_bytes());
            out.extend_from_slice(data);
            directory.extend(header(0x0201_4b50, &[20, 20, 0, self.method, 0, 0], sizes));
            for value in [name.len() as u16, 0, 0, 0, 0, 0, 0] {
                directory.extend_from_slice(&value.to_le_bytes());
            }
            directory.extend_from_slice(&start.to_le_bytes());
            directory.extend_from_slice(name.as_bytes());
        }
        let start = out.len() as u64;
        out.extend_from_slice(&directory);
        self.end(&mut out, start, directory.len() as u64);
        out
    }

    fn end(&self, out: &mut Vec<u8>, start: u64, len: u64) {
        let count = self.entries.len() as u64;
        if self.wide {
            let record = out.len() as u64;
            out.extend_from_slice(&0x0606_4b50u32.to_le_bytes());
            out.extend_from_slice(&44u64.to_le_bytes());
            out.extend_from_slice(&[0; 12]);
            for value in [count, count, len, start] {
                out.extend_from_slice(&value.to_le_bytes());
            }
            out.extend_from_slice(&0x0706_4b50u32.to_le_bytes());
            out.extend_from_slice(&0u32.to_le_bytes());
            out.extend_from_slice(&record.to_le_bytes());
            out.extend_from_slice(&1u32.to_le_bytes());
        }
        let narrow = |value: u64, limit: u64| if self.wide { limit } else { value };
        out.extend_from_slice(&0x0605_4b50u32.to_le_bytes());
        out.extend_from_slice(&[0; 4]);
        for _ in 0..2 {
            out.extend_from_slice(&(narrow(count, 0xffff) as u16).to_le_bytes());
        }
        out.extend_from_slice(&(narrow(len, 0xffff_ffff) as u32).to_le_bytes());
        out.extend_from_slice(&(narrow(start, 0xffff_ffff) as u32).to_le_bytes());
        out.extend_from_slice(&[0; 2]);
    }
}

/// Signature, versions, flags, method, time and date, checksum, sizes; the lengths of names follow.
fn header(signature: u32, shorts: &[u16], sizes: [u32; 2]) -> Vec<u8> {
    let mut out = signature.to_le_bytes().to_vec();
    for value in shorts {
        out.extend_from_slice(&value.to_le_bytes());
    }
    out.extend_from_slice(&0u32.to_le_bytes());
    for size in sizes {
        out.extend_from_slice(&size.to_le_bytes());
    }
    out
}

/// A tensor to be written.
#[derive(Clone)]
pub struct Tensor {
    pub name: String,
    pub class: &'static str,
    pub key: String,
    pub storage_len: usize,
    pub offset: usize,
    pub shape: Vec<usize>,
    pub strides: Vec<usize>,
}

impl Tensor {
    /// A contiguous tensor in a storage of its own.
    pub fn new(name: &str, class: &'static str, key: &str, shape: &[usize]) -> Self {
        let strides = (0..shape.len()).map(|side| shape[side + 1..].iter().product()).collect();
        Self {
            name: name.into(),
            class,
            key: key.into(),
            storage_len: shape.iter().product(),
            offset: 0,
            shape: shape.to_vec(),
            strides,
        }
    }
}

fn text(out: &mut Vec<u8>, text: &str) {
    out.push(b'X');
    out.extend_from_slice(&(text.len() as u32).to_le_bytes());
    out.extend_from_slice(text.as_bytes());
}

fn int(out: &mut Vec<u8>, value: usize) {
    out.extend_from_slice(&[0x8a, 8]);
    out.extend_from_slice(&(value as u64).to_le_bytes());
}

/// The pickle of `{'args': Namespace(model=…), 'model': OrderedDict(…)}`.
pub fn pickle(model: Option<&str>, tensors: &[Tensor]) -> Vec<u8> {
    let mut out = b"\x80\x02}(".to_vec();
    if let Some(model) = model {
        text(&mut out, "args");
        out.extend_from_slice(b"cargparse\nNamespace\n)\x81}");
        text(&mut out, "model");
        text(&mut out, model);
        out.extend_from_slice(b"sb");
    }
    text(&mut out, "model");
    out.extend_from_slice(b"ccollections\nOrderedDict\n)R(");
    for tensor in tensors {
        text(&mut out, &tensor.name);
        out.extend_from_slice(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        text(&mut out, "storage");
        out.extend_from_slice(format!("ctorch\n{}\n", tensor.class).as_bytes());
        text(&mut out, &tensor.key);
        text(&mut out, "cuda:0");
        int(&mut out, tensor.storage_len);
        out.extend_from_slice(b"tQ");
        int(&mut out, tensor.offset);
        for sizes in [&tensor.shape, &tensor.strides] {
            out.push(b'(');
            sizes.iter().for_each(|size| int(&mut out, *size));
            out.push(b't');
        }
        out.extend_from_slice(b"\x89ccollections\nOrderedDict\n)RtR");
    }
    out.extend_from_slice(b"uu.");
    out
}

/// The archive of a pickle and its storages.
pub fn archive(pickle: Vec<u8>, storages: &[(&str, Vec<u8>)]) -> Zip {
    let mut entries =
        vec![("model/data.pkl".to_owned(), pickle), ("model/byteorder".to_owned(), b"little".to_vec())];
    entries.extend(storages.iter().map(|(key, data)| (format!("model/data/{key}"), data.clone())));
    Zip { entries, ..Zip::default() }
}
