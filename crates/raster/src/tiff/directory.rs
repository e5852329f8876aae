//! Image file directories of TIFF 6 and BigTIFF.
//!
//! Written here rather than taken from a crate because georeferenced files need arbitrary tags, any sample type and
//! planar layouts, and because no byte of a corrupt file may cause a panic or an allocation larger than the file.

use crate::Error;
use crate::sample::ByteOrder;
use selenograph_files::regular;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// More entries than any real directory has.
const MAX_ENTRIES: u64 = 4096;

/// Where a tag's values lie.
#[derive(Debug, Clone, Copy)]
struct Entry {
    kind: u16,
    count: u64,
    offset: u64,
}

/// One directory; values are read from the file when they are asked for.
#[derive(Debug)]
pub(crate) struct Directory {
    entries: BTreeMap<u16, Entry>,
    /// Offset of the next directory; 0 after the last.
    pub(crate) next: u64,
}

impl Directory {
    /// Whether the tag is there.
    pub(crate) fn has(&self, tag: u16) -> bool {
        self.entries.contains_key(&tag)
    }
}

/// A TIFF file and how to read its numbers.
#[derive(Debug)]
pub(crate) struct TiffFile {
    pub(crate) file: File,
    pub(crate) path: PathBuf,
    pub(crate) len: u64,
    pub(crate) order: ByteOrder,
    pub(crate) big: bool,
    pub(crate) first_directory: u64,
}

impl TiffFile {
    pub(crate) fn open(path: &Path) -> Result<Self, Error> {
        let (file, len) = regular::open(path).map_err(Error::io("open", path))?;
        let mut tiff = Self {
            file,
            path: path.to_owned(),
            len,
            order: ByteOrder::Little,
            big: false,
            first_directory: 0,
        };
        let head = tiff.bytes_at(0, 8, "the TIFF header")?;
        tiff.order = if head.starts_with(b"MM") { ByteOrder::Big } else { ByteOrder::Little };
        tiff.big = tiff.unsigned(&head[2..4]) == 43;
        tiff.first_directory = if tiff.big {
            let head = tiff.bytes_at(0, 16, "the BigTIFF header")?;
            tiff.unsigned(&head[8..16])
        } else {
            tiff.unsigned(&head[4..8])
        };
        Ok(tiff)
    }

    /// `size` bytes from `offset`; never allocates more than the file holds.
    pub(crate) fn bytes_at(&mut self, offset: u64, size: u64, what: &str) -> Result<Vec<u8>, Error> {
        let end = offset.saturating_add(size);
        if end > self.len {
            return Err(Error::Truncated {
                path: self.path.clone(),
                what: what.to_owned(),
                expected: end,
                found: self.len,
            });
        }
        let mut bytes = vec![0; size as usize];
        self.file.seek(SeekFrom::Start(offset)).map_err(Error::io("read", &self.path))?;
        self.file.read_exact(&mut bytes).map_err(Error::io("read", &self.path))?;
        Ok(bytes)
    }

    fn unsigned(&self, bytes: &[u8]) -> u64 {
        let join = |sum: u64, &byte: &u8| (sum << 8) | u64::from(byte);
        match self.order {
            ByteOrder::Little => bytes.iter().rev().fold(0, join),
            ByteOrder::Big => bytes.iter().fold(0, join),
        }
    }

    pub(crate) fn malformed(&self, what: &str, expected: impl Into<String>, found: impl ToString) -> Error {
        Error::Malformed {
            path: self.path.clone(),
            what: what.to_owned(),
            expected: expected.into(),
            found: found.to_string(),
        }
    }

    pub(crate) fn directory(&mut self, offset: u64) -> Result<Directory, Error> {
        let (count_size, entry_size, field) = if self.big { (8, 20, 8) } else { (2, 12, 4) };
        let what = "a TIFF directory";
        let count = self.bytes_at(offset, count_size, what)?;
        let count = self.unsigned(&count);
        if count == 0 || count > MAX_ENTRIES {
            return Err(self.malformed(what, format!("1 to {MAX_ENTRIES} entries"), count));
        }
        let start = offset + count_size;
        let bytes = self.bytes_at(start, count * entry_size as u64 + field as u64, what)?;
        let (table, next) = bytes.split_at(count as usize * entry_size);
        let mut entries = BTreeMap::new();
        for (i, raw) in table.chunks_exact(entry_size).enumerate() {
            let kind = self.unsigned(&raw[2..4]) as u16;
            let values = self.unsigned(&raw[4..4 + field]);
            let inline = size_of_kind(kind).is_some_and(|size| values.saturating_mul(size) <= field as u64);
            let offset = if inline {
                start + (i * entry_size + 4 + field) as u64
            } else {
                self.unsigned(&raw[4 + field..])
            };
            entries.insert(self.unsigned(&raw[..2]) as u16, Entry { kind, count: values, offset });
        }
        Ok(Directory { entries, next: self.unsigned(next) })
    }

    fn raw(&mut self, directory: &Directory, tag: u16) -> Result<Option<(u16, Vec<u8>)>, Error> {
        let Some(entry) = directory.entries.get(&tag) else { return Ok(None) };
        let Some(size) = size_of_kind(entry.kind) else {
            return Err(self.malformed(&format!("TIFF tag {tag}"), "a known type", entry.kind));
        };
        let bytes =
            self.bytes_at(entry.offset, entry.count.saturating_mul(size), &format!("TIFF tag {tag}"))?;
        Ok(Some((entry.kind, bytes)))
    }

    /// Unsigned integers of any width.
    pub(crate) fn integers(&mut self, directory: &Directory, tag: u16) -> Result<Option<Vec<u64>>, Error> {
        let Some((kind, bytes)) = self.raw(directory, tag)? else { return Ok(None) };
        match kind {
            1 | 3 | 4 | 7 | 13 | 16 | 18 => {
                let size = size_of_kind(kind).unwrap_or(1) as usize;
                Ok(Some(bytes.chunks_exact(size).map(|raw| self.unsigned(raw)).collect()))
            }
            _ => Err(self.malformed(&format!("TIFF tag {tag}"), "unsigned integers", format!("type {kind}"))),
        }
    }

    /// The first of a tag's integers.
    pub(crate) fn integer(&mut self, directory: &Directory, tag: u16) -> Result<Option<u64>, Error> {
        Ok(self.integers(directory, tag)?.and_then(|values| values.first().copied()))
    }

    /// Floating-point numbers.
    pub(crate) fn doubles(&mut self, directory: &Directory, tag: u16) -> Result<Option<Vec<f64>>, Error> {
        let Some((kind, bytes)) = self.raw(directory, tag)? else { return Ok(None) };
        match kind {
            11 => Ok(Some(
                bytes
                    .chunks_exact(4)
                    .map(|raw| f64::from(f32::from_bits(self.unsigned(raw) as u32)))
                    .collect(),
            )),
            12 => Ok(Some(bytes.chunks_exact(8).map(|raw| f64::from_bits(self.unsigned(raw))).collect())),
            _ => Err(self.malformed(
                &format!("TIFF tag {tag}"),
                "floating-point numbers",
                format!("type {kind}"),
            )),
        }
    }

    /// Text, without its terminating zeros; a byte that is not UTF-8 is replaced.
    pub(crate) fn text(&mut self, directory: &Directory, tag: u16) -> Result<Option<String>, Error> {
        let Some((_, bytes)) = self.raw(directory, tag)? else { return Ok(None) };
        Ok(Some(String::from_utf8_lossy(&bytes).trim_end_matches('\0').to_owned()))
    }
}

/// Bytes of one value of a TIFF field type.
fn size_of_kind(kind: u16) -> Option<u64> {
    match kind {
        1 | 2 | 6 | 7 => Some(1),
        3 | 8 => Some(2),
        4 | 9 | 11 | 13 => Some(4),
        5 | 10 | 12 | 16 | 17 | 18 => Some(8),
        _ => None,
    }
}
