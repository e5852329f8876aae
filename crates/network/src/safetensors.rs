//! The safetensors format: a header in JSON, then the tensors as they lie in memory.
//!
//! Written here rather than taken from the format's crate: that one wants the whole file in one slice (a memory map, and
//! with it unsafe code), keeps the last of two tensors of one name in silence, and writes all tensors from memory.
//!
//! # Source
//! Hugging Face, "safetensors", section "Format": 8 bytes of header length (little-endian), header, data without gaps.

use crate::Error;
use crate::element::ElementType;
use crate::zip::{ReadAt, Span};
use selenograph_files::FileDraft;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Longest header that is read: the format's own limit is 100 MB; a full network's takes 0.1 MB.
const MAX_HEADER: u64 = 16 << 20;
/// Key of the texts in a header.
const METADATA: &str = "__metadata__";
/// Values converted at a time.
const CHUNK: usize = 1 << 16;

/// A tensor in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// Type of its elements.
    pub element: ElementType,
    /// Sizes, the slowest first.
    pub shape: Vec<usize>,
}

impl Entry {
    fn num_bytes(&self) -> Option<u64> {
        let elements = self.shape.iter().try_fold(1u64, |total, size| total.checked_mul(*size as u64))?;
        elements.checked_mul(self.element.size() as u64)
    }
}

/// What the header of a file says.
#[derive(Debug)]
pub(crate) struct Header {
    pub metadata: BTreeMap<String, String>,
    pub tensors: Vec<(Entry, Span)>,
}

#[derive(Serialize, Deserialize)]
struct Described {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [u64; 2],
}

/// Items of the header in their order, with all that share a name.
#[derive(Default)]
struct Items {
    metadata: BTreeMap<String, String>,
    tensors: Vec<(String, Described)>,
}

impl<'de> Deserialize<'de> for Items {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ItemsVisitor;
        impl<'de> Visitor<'de> for ItemsVisitor {
            type Value = Items;
            fn expecting(&self, formatter: &mut std::fmt::Formatter) -> std::fmt::Result {
                formatter.write_str("an object with a tensor for each name")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Items, A::Error> {
                let mut items = Items::default();
                while let Some(name) = map.next_key::<String>()? {
                    if name == METADATA {
                        items.metadata = map.next_value()?;
                    } else {
                        items.tensors.push((name, map.next_value()?));
                    }
                }
                Ok(items)
            }
        }
        deserializer.deserialize_map(ItemsVisitor)
    }
}

/// Reads a header.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Truncated`], [`Error::Refused`] for a header that is damaged or too long.
pub(crate) fn read_header(file: &dyn ReadAt, path: &Path) -> Result<Header, Error> {
    let mut len = [0; 8];
    file.read_at(0, &mut len).map_err(Error::io("read", path))?;
    let len = u64::from_le_bytes(len);
    if len > MAX_HEADER {
        return Err(Error::Refused {
            path: path.to_owned(),
            what: "its header takes",
            found: format!("{len} bytes"),
            allowed: "headers up to 16 MiB are read",
        });
    }
    if 8 + len > file.len() {
        return Err(Error::Truncated {
            path: path.to_owned(),
            what: "its header".into(),
            expected: 8 + len,
            found: file.len(),
        });
    }
    let mut text = vec![0; len as usize];
    file.read_at(8, &mut text).map_err(Error::io("read", path))?;
    let malformed = |error: serde_json::Error| {
        Error::malformed(path, "header", "JSON that describes tensors", error.to_string())
    };
    let items: Items = serde_json::from_slice(&text).map_err(malformed)?;
    let mut tensors = Vec::new();
    for (name, described) in items.tensors {
        tensors.push(place(name, described, 8 + len, file.len(), path)?);
    }
    check_overlap(&tensors, path)?;
    Ok(Header { metadata: items.metadata, tensors })
}

/// Two names for the same bytes are no part of the format, and would let a small file become a large network.
fn check_overlap(tensors: &[(Entry, Span)], path: &Path) -> Result<(), Error> {
    let mut spans: Vec<(Span, &str)> =
        tensors.iter().map(|(entry, span)| (*span, entry.name.as_str())).collect();
    spans.retain(|(span, _)| span.len > 0);
    spans.sort_by_key(|(span, _)| span.start);
    for pair in spans.windows(2) {
        if pair[0].0.start + pair[0].0.len > pair[1].0.start {
            let found = format!("bytes that `{}` has too", pair[1].1);
            return Err(Error::malformed(path, format!("tensor `{}`", pair[0].1), "bytes of its own", found));
        }
    }
    Ok(())
}

fn place(
    name: String,
    described: Described,
    data_start: u64,
    file_len: u64,
    path: &Path,
) -> Result<(Entry, Span), Error> {
    let what = || format!("tensor `{name}`");
    let element = element_of(&described.dtype).ok_or_else(|| {
        Error::malformed(path, what(), "F16, BF16, F32, F64 or integers", described.dtype.clone())
    })?;
    let entry = Entry { name: name.clone(), element, shape: described.shape };
    let [start, end] = described.data_offsets;
    let len = end.checked_sub(start);
    if len.is_none() || len != entry.num_bytes() || entry.shape.len() > 8 {
        let expected = format!("the bytes of {:?} {}", entry.shape, element.name());
        return Err(Error::malformed(path, what(), expected, format!("bytes {start} to {end}")));
    }
    let file_end = data_start.saturating_add(end);
    if file_end > file_len {
        return Err(Error::Truncated {
            path: path.to_owned(),
            what: what(),
            expected: file_end,
            found: file_len,
        });
    }
    Ok((entry, Span { start: data_start + start, len: end - start }))
}

fn element_of(dtype: &str) -> Option<ElementType> {
    ALL.into_iter().find(|(name, _)| *name == dtype).map(|(_, element)| element)
}

fn dtype_of(element: ElementType) -> &'static str {
    ALL.into_iter().find(|(_, other)| *other == element).map_or("", |(name, _)| name)
}

const ALL: [(&str, ElementType); 10] = [
    ("F16", ElementType::F16),
    ("BF16", ElementType::Bf16),
    ("F32", ElementType::F32),
    ("F64", ElementType::F64),
    ("I8", ElementType::I8),
    ("I16", ElementType::I16),
    ("I32", ElementType::I32),
    ("I64", ElementType::I64),
    ("U8", ElementType::U8),
    ("BOOL", ElementType::Bool),
];

/// Writes a file tensor by tensor, beside its target; [`Writer::finish`] moves it into place.
#[derive(Debug)]
pub struct Writer {
    target: PathBuf,
    file: BufWriter<FileDraft>,
    entries: Vec<Entry>,
    next: usize,
    buffer: Vec<u8>,
}

impl Writer {
    /// Begins a file of these tensors, which are then written in this order as f32 values.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Malformed`] for a name given twice or a type other than f32, bf16 and f16.
    pub fn create(
        target: &Path,
        entries: Vec<Entry>,
        metadata: &BTreeMap<String, String>,
    ) -> Result<Self, Error> {
        let header = header_text(&entries, metadata, target)?;
        let file = BufWriter::with_capacity(1 << 20, FileDraft::new(target)?);
        let mut writer = Self { target: target.to_owned(), file, entries, next: 0, buffer: Vec::new() };
        writer.bytes(&(header.len() as u64).to_le_bytes())?;
        writer.bytes(&header)?;
        Ok(writer)
    }

    /// Writes the next tensor.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Malformed`] for another number of values than announced, and for one that is too large for its
    /// type.
    pub fn write(&mut self, values: &[f32]) -> Result<(), Error> {
        let entry = self.entries.get(self.next);
        let expected = entry.map_or(0, |entry| entry.shape.iter().product());
        let Some(entry) = entry.filter(|_| values.len() == expected) else {
            let what = format!("tensor number {}", self.next + 1);
            return Err(Error::malformed(
                &self.target,
                what,
                format!("{expected} values"),
                format!("{}", values.len()),
            ));
        };
        let element = entry.element;
        self.next += 1;
        for chunk in values.chunks(CHUNK) {
            let mut buffer = std::mem::take(&mut self.buffer);
            buffer.clear();
            element.encode(chunk, &mut buffer).map_err(|value| {
                let what = format!("tensor `{}`", self.entries[self.next - 1].name);
                let expected = format!("values within the range of {}", element.name());
                Error::malformed(&self.target, what, expected, value.to_string())
            })?;
            self.bytes(&buffer)?;
            self.buffer = buffer;
        }
        Ok(())
    }

    /// Moves the file into place.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Malformed`] if tensors have not been written.
    pub fn finish(self) -> Result<(), Error> {
        if self.next != self.entries.len() {
            let expected = format!("{} written", self.entries.len());
            return Err(Error::malformed(&self.target, "tensors", expected, self.next.to_string()));
        }
        let refused = selenograph_files::Error::io("write", &self.target);
        let draft = self.file.into_inner().map_err(|error| refused(error.into_error()))?;
        draft.sync()?;
        Ok(draft.commit()?)
    }

    fn bytes(&mut self, bytes: &[u8]) -> Result<(), Error> {
        Ok(self.file.write_all(bytes).map_err(selenograph_files::Error::io("write", &self.target))?)
    }
}

fn header_text(
    entries: &[Entry],
    metadata: &BTreeMap<String, String>,
    target: &Path,
) -> Result<Vec<u8>, Error> {
    let mut header = BTreeMap::new();
    let mut start = 0u64;
    let unwritable = |what: String, found: String| {
        Error::malformed(target, what, "f32, bf16 or f16, each name once", found)
    };
    for entry in entries {
        let len = entry.num_bytes().filter(|_| entry.element.is_written());
        let len =
            len.ok_or_else(|| unwritable(format!("tensor `{}`", entry.name), entry.element.name().into()))?;
        let described = Described {
            dtype: dtype_of(entry.element).to_owned(),
            shape: entry.shape.clone(),
            data_offsets: [start, start + len],
        };
        start += len;
        if header.insert(entry.name.as_str(), described).is_some() {
            return Err(unwritable(format!("tensor `{}`", entry.name), "it twice".into()));
        }
    }
    #[derive(Serialize)]
    struct File<'a> {
        #[serde(rename = "__metadata__")]
        metadata: &'a BTreeMap<String, String>,
        #[serde(flatten)]
        tensors: BTreeMap<&'a str, Described>,
    }
    let mut text = serde_json::to_vec(&File { metadata, tensors: header })
        .map_err(|error| Error::malformed(target, "header", "what JSON can hold", error.to_string()))?;
    // Data begins at a multiple of 64 bytes; blanks after the JSON are part of the format.
    while !(text.len() + 8).is_multiple_of(64) {
        text.push(b' ');
    }
    Ok(text)
}
