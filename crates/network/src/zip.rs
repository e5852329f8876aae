//! The directory of a zip archive whose entries are stored as they are, as `torch.save` writes them.
//!
//! Compressed entries are refused: no checkpoint has any, so nothing here can unfold to more than the file holds.
//!
//! # Source
//! PKWARE, ".ZIP File Format Specification" (APPNOTE) 6.3.10, §4.3: end record, its 64-bit form, central and local headers.

use crate::Error;
use std::collections::BTreeMap;
use std::path::Path;

const END: u32 = 0x0605_4b50;
const END_64: u32 = 0x0606_4b50;
const END_64_LOCATOR: u32 = 0x0706_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const LOCAL: u32 = 0x0403_4b50;
/// End record and the longest comment after it.
const END_SEARCH: u64 = 22 + 65535;
/// A full training checkpoint has some 3000 entries of some 100 bytes.
const MAX_DIRECTORY: u64 = 64 << 20;

/// Random access to a file's bytes.
pub(crate) trait ReadAt {
    /// Number of bytes.
    fn len(&self) -> u64;
    /// Fills `buffer` from `offset` on.
    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> std::io::Result<()>;
}

/// Where an entry's bytes lie in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Span {
    /// First byte.
    pub start: u64,
    /// Number of bytes.
    pub len: u64,
}

/// Entries by name.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Truncated`] for a damaged archive; [`Error::Refused`] for compressed, encrypted,
/// duplicated or overlapping entries.
pub fn entries(file: &dyn ReadAt, path: &Path) -> Result<BTreeMap<String, Span>, Error> {
    let archive = Archive { file, path };
    let (start, len, count) = archive.directory()?;
    if len > MAX_DIRECTORY {
        return Err(archive.refused("its directory takes", format!("{len} bytes")));
    }
    let bytes = archive.bytes(start, len, "the directory of its archive")?;
    let mut rest = &bytes[..];
    let mut found = BTreeMap::new();
    let mut total = 0u64;
    for _ in 0..count {
        let (name, span) = archive.entry(&mut rest)?;
        total = total.saturating_add(span.len);
        if found.insert(name.clone(), span).is_some() {
            return Err(archive.refused("it holds twice the entry", name));
        }
    }
    // Stored entries that do not overlap are together no longer than the file.
    if total > file.len() {
        let found = format!("{total} bytes in a file of {}", file.len());
        return Err(archive.refused("its entries overlap:", found));
    }
    Ok(found)
}

struct Archive<'a> {
    file: &'a dyn ReadAt,
    path: &'a Path,
}

impl Archive<'_> {
    fn refused(&self, what: &'static str, found: String) -> Error {
        let allowed = "entries that are stored as they are, once each, are read";
        Error::Refused { path: self.path.to_owned(), what, found, allowed }
    }

    fn malformed(&self, what: &str, expected: &str, found: impl ToString) -> Error {
        Error::malformed(self.path, what, expected, found.to_string())
    }

    fn bytes(&self, start: u64, len: u64, what: &str) -> Result<Vec<u8>, Error> {
        let end = start.saturating_add(len);
        if end > self.file.len() {
            return Err(Error::Truncated {
                path: self.path.to_owned(),
                what: what.to_owned(),
                expected: end,
                found: self.file.len(),
            });
        }
        let mut buffer = vec![0; len as usize];
        self.file.read_at(start, &mut buffer).map_err(Error::io("read", self.path))?;
        Ok(buffer)
    }

    /// Start, length and number of entries of the central directory.
    fn directory(&self) -> Result<(u64, u64, u64), Error> {
        let tail_len = self.file.len().min(END_SEARCH);
        let tail_start = self.file.len() - tail_len;
        let tail = self.bytes(tail_start, tail_len, "its end")?;
        let at = (0..tail.len().saturating_sub(21)).rev().find(|&at| u32_at(&tail, at) == Some(END));
        let Some(at) = at else {
            return Err(Error::Truncated {
                path: self.path.to_owned(),
                what: "the directory at the end of its archive".into(),
                expected: self.file.len() + 22,
                found: self.file.len(),
            });
        };
        let field = |offset| u64::from(u32_at(&tail, at + offset).unwrap_or_default());
        let count = u64::from(u16_at(&tail, at + 10).unwrap_or_default());
        let (len, start) = (field(12), field(16));
        if count < 0xffff && len < 0xffff_ffff && start < 0xffff_ffff {
            return Ok((start, len, count));
        }
        let Some(locator) = at.checked_sub(20).filter(|&at| u32_at(&tail, at) == Some(END_64_LOCATOR)) else {
            return Err(self.malformed("archive", "the locator of its 64-bit directory", "none"));
        };
        let record =
            self.bytes(u64_at(&tail, locator + 8).unwrap_or(u64::MAX), 56, "its 64-bit directory")?;
        let field = |offset| u64_at(&record, offset).unwrap_or_default();
        if u32_at(&record, 0) != Some(END_64) {
            return Err(self.malformed("archive", "a 64-bit end record", "something else"));
        }
        Ok((field(48), field(40), field(32)))
    }

    fn entry(&self, rest: &mut &[u8]) -> Result<(String, Span), Error> {
        let cut = || self.malformed("archive", "an entry of its directory", "its end");
        let header = rest.get(..46).ok_or_else(cut)?;
        if u32_at(header, 0) != Some(CENTRAL) {
            return Err(self.malformed("archive", "an entry of its directory", "something else"));
        }
        let short = |at| u16_at(header, at).map_or(0, usize::from);
        let long = |at| u64::from(u32_at(header, at).unwrap_or_default());
        let (name_len, extra_len, comment_len) = (short(28), short(30), short(32));
        let name = rest.get(46..46 + name_len).ok_or_else(cut)?;
        let extra = rest.get(46 + name_len..46 + name_len + extra_len).ok_or_else(cut)?;
        let name = std::str::from_utf8(name)
            .map_err(|_| self.malformed("archive", "names in UTF-8", "other bytes"))?
            .to_owned();
        *rest = rest.get(46 + name_len + extra_len + comment_len..).ok_or_else(cut)?;
        if short(8) & 1 != 0 {
            return Err(self.refused("it holds the encrypted entry", name));
        }
        let mut wide = wide_fields(extra);
        let mut widen = |value: u64| if value == 0xffff_ffff { wide.next().unwrap_or(value) } else { value };
        let len = widen(long(24));
        let stored_len = widen(long(20));
        let header_start = widen(long(42));
        if short(10) != 0 || stored_len != len {
            return Err(self.refused("it holds the compressed entry", name));
        }
        let span = Span { start: self.data_start(header_start, &name)?, len };
        if span.start.saturating_add(len) > self.file.len() {
            return Err(Error::Truncated {
                path: self.path.to_owned(),
                what: format!("entry `{name}`"),
                expected: span.start.saturating_add(len),
                found: self.file.len(),
            });
        }
        Ok((name, span))
    }

    fn data_start(&self, header_start: u64, name: &str) -> Result<u64, Error> {
        let header = self.bytes(header_start, 30, &format!("the header of entry `{name}`"))?;
        if u32_at(&header, 0) != Some(LOCAL) {
            return Err(self.malformed(&format!("entry `{name}`"), "a local header", "something else"));
        }
        let skipped = [26, 28].map(|at| u16_at(&header, at).map_or(0, u64::from));
        Ok(header_start + 30 + skipped[0] + skipped[1])
    }
}

/// The 64-bit values of an entry's extra field, in their fixed order.
fn wide_fields(mut extra: &[u8]) -> impl Iterator<Item = u64> {
    let mut values = Vec::new();
    while let (Some(tag), Some(len)) = (u16_at(extra, 0), u16_at(extra, 2)) {
        let end = 4 + usize::from(len);
        let Some(body) = extra.get(4..end) else { break };
        if tag == 1 {
            values.extend(body.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes)));
        }
        extra = &extra[end..];
    }
    values.into_iter()
}

fn array_at<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..at.checked_add(N)?)?.try_into().ok()
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    array_at(bytes, at).map(u16::from_le_bytes)
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    array_at(bytes, at).map(u32::from_le_bytes)
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    array_at(bytes, at).map(u64::from_le_bytes)
}
