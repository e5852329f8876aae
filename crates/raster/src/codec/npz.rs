//! NPZ: named numpy arrays in a ZIP archive, stored without compression as `numpy.savez` does.

use super::decoded::{bytes_of, cannot_encode, malformed};
use crate::Error;
use npyz::WriterBuilder as _;
use npyz::npz::{NpzArchive, NpzWriter, array_name_from_file_name};
use npyz::zip::{CompressionMethod, DateTime, write::FileOptions};
use npyz::{DType, NpyFile, Order, TypeChar};
use std::collections::BTreeMap;
use std::io::{Cursor, Read as _};
use std::path::Path;

const FORMAT: &str = "NPZ";

/// Larger arrays are refused: no file of this kind comes near, and a forged size must not exhaust the memory.
const MAX_ARRAY_BYTES: u64 = 1 << 30;

/// What an archive may hold however short it is, and how much more than its length beyond: real arrays do not shrink further.
const ALWAYS_BYTES: u64 = 64 << 20;
const MAX_EXPANSION: u64 = 64;

/// An array's elements. Integers of every width are read as [`Values::I64`], except bytes.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// `float32`.
    F32(Vec<f32>),
    /// `float64`.
    F64(Vec<f64>),
    /// `int64`.
    I64(Vec<i64>),
    /// `uint8` and `bool`.
    U8(Vec<u8>),
    /// Unicode text.
    Text(Vec<String>),
}

impl Values {
    /// Number of elements.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
            Self::I64(v) => v.len(),
            Self::U8(v) => v.len(),
            Self::Text(v) => v.len(),
        }
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// An array with its shape, last index fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Length along each axis.
    pub shape: Vec<usize>,
    /// The elements.
    pub values: Values,
}

impl Array {
    /// An array of a shape.
    pub fn new(shape: &[usize], values: Values) -> Self {
        Self { shape: shape.to_vec(), values }
    }

    /// The numbers as `f64`, `None` for text.
    pub fn to_f64(&self) -> Option<Vec<f64>> {
        Some(match &self.values {
            Values::F32(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Values::F64(v) => v.clone(),
            Values::I64(v) => v.iter().map(|&x| x as f64).collect(),
            Values::U8(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Values::Text(_) => return None,
        })
    }
}

/// Encodes the arrays in alphabetical order. The same arrays give the same bytes.
///
/// # Errors
/// [`Error::Encode`] if a shape does not fit its number of elements.
pub fn encode(arrays: &BTreeMap<String, Array>) -> Result<Vec<u8>, Error> {
    let mut writer = NpzWriter::new(Cursor::new(Vec::new()));
    for (name, array) in arrays {
        if array.shape.iter().product::<usize>() != array.values.len() {
            return Err(cannot_encode(
                FORMAT,
                format!("array `{name}` has {} elements for shape {:?}", array.values.len(), array.shape),
            ));
        }
        write_array(&mut writer, name, array).map_err(|e| cannot_encode(FORMAT, e))?;
    }
    let cursor = writer.zip_writer().finish().map_err(|e| cannot_encode(FORMAT, e))?;
    Ok(cursor.into_inner())
}

type Writer = NpzWriter<Cursor<Vec<u8>>>;

fn write_array(writer: &mut Writer, name: &str, array: &Array) -> std::io::Result<()> {
    match &array.values {
        Values::F32(v) => write_values(writer, name, &array.shape, "<f4", v.iter()),
        Values::F64(v) => write_values(writer, name, &array.shape, "<f8", v.iter()),
        Values::I64(v) => write_values(writer, name, &array.shape, "<i8", v.iter()),
        Values::U8(v) => write_values(writer, name, &array.shape, "|u1", v.iter()),
        Values::Text(v) => {
            let longest = v.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
            write_values(writer, name, &array.shape, &format!("<U{longest}"), v.iter().map(String::as_str))
        }
    }
}

fn write_values<'a, T: npyz::Serialize + ?Sized + 'a>(
    writer: &mut Writer,
    name: &str,
    shape: &[usize],
    type_text: &str,
    values: impl Iterator<Item = &'a T>,
) -> std::io::Result<()> {
    // A fixed date: the archive's bytes depend on its content only.
    let options = FileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default());
    let shape: Vec<u64> = shape.iter().map(|&side| side as u64).collect();
    let type_str = type_text.parse().map_err(std::io::Error::other)?;
    let mut out = writer.array::<T>(name, options)?.dtype(DType::Plain(type_str)).shape(&shape).begin_nd()?;
    for value in values {
        out.push(value)?;
    }
    out.finish()
}

/// Decodes every array of an archive.
///
/// # Errors
/// [`Error::Malformed`] for a broken archive or an element type that is not listed in [`Values`]; arrays of Python
/// objects (pickles) are refused, because reading them would run the file's code.
pub fn decode(bytes: &[u8], origin: &Path) -> Result<BTreeMap<String, Array>, Error> {
    let bad = |what: String| malformed(FORMAT, origin, what);
    let mut archive = NpzArchive::new(Cursor::new(bytes)).map_err(|e| bad(e.to_string()))?;
    let zip = archive.zip_archive();
    let mut arrays = BTreeMap::new();
    let mut left = (bytes.len() as u64).saturating_mul(MAX_EXPANSION).max(ALWAYS_BYTES);
    for idx in 0..zip.len() {
        let entry = zip.by_index(idx).map_err(|e| bad(e.to_string()))?;
        let Some(name) = array_name_from_file_name(entry.name()).map(str::to_owned) else { continue };
        let mut content = Vec::new();
        let most = MAX_ARRAY_BYTES.min(left);
        entry.take(most + 1).read_to_end(&mut content).map_err(|e| bad(format!("`{name}`: {e}")))?;
        if content.len() as u64 > most {
            let length = bytes.len();
            return Err(bad(format!("array `{name}` of more than {most} bytes in an archive of {length}")));
        }
        left -= content.len() as u64;
        let array = read_array(&content).map_err(|what| bad(format!("array `{name}`: {what}")))?;
        arrays.insert(name, array);
    }
    Ok(arrays)
}

/// Reads a file.
///
/// # Errors
/// [`Error::Io`], and those of [`decode`].
pub fn read(path: &Path) -> Result<BTreeMap<String, Array>, Error> {
    decode(&bytes_of(path)?, path)
}

/// Whether the numbers of an array's header multiply to something that can be: the library multiplies unchecked.
fn sizes_are_possible(content: &[u8]) -> bool {
    let header = &content[..content.iter().position(|&byte| byte == b'\n').unwrap_or(content.len())];
    header
        .split(|byte| !byte.is_ascii_digit())
        .skip_while(|digits| digits.is_empty())
        .filter_map(|digits| std::str::from_utf8(digits).ok().filter(|text| !text.is_empty()))
        .try_fold(1u64, |product, text| product.checked_mul(text.parse::<u64>().ok()?.max(1)))
        .is_some_and(|product| product <= 8 * MAX_ARRAY_BYTES)
}

fn read_array(content: &[u8]) -> Result<Array, String> {
    if !sizes_are_possible(content) {
        return Err("its header's sizes are larger than any file".to_owned());
    }
    let npy = NpyFile::new(content).map_err(|e| e.to_string())?;
    if npy.uses_pickled_array() {
        return Err("it holds Python objects; save it again with a plain dtype (dtype=str or int)".to_owned());
    }
    let DType::Plain(type_str) = npy.dtype() else { return Err("structured arrays are not read".to_owned()) };
    let shape: Vec<usize> = npy.shape().iter().map(|&side| side as usize).collect();
    let count = npy.shape().iter().try_fold(1u64, |product, &side| product.checked_mul(side));
    let item = npy.dtype().num_bytes().unwrap_or(usize::MAX) as u64;
    // Text of length 0 has items of 0 bytes, whose number nothing else limits.
    if count.and_then(|count| count.checked_mul(item.max(1))).is_none_or(|bytes| bytes > content.len() as u64)
    {
        return Err(format!("shape {shape:?} is larger than the file"));
    }
    let order = npy.order();
    let size = type_str.size_field();
    let fail = |e: std::io::Error| e.to_string();
    let ints = |values: Vec<i64>| Values::I64(values);
    let values = match (type_str.type_char(), size) {
        (TypeChar::Float, 4) => Values::F32(npy.into_vec().map_err(fail)?),
        (TypeChar::Float, 8) => Values::F64(npy.into_vec().map_err(fail)?),
        (TypeChar::Int, 8) => ints(npy.into_vec().map_err(fail)?),
        (TypeChar::Int, 4) => ints(widen(npy.into_vec::<i32>().map_err(fail)?)),
        (TypeChar::Int, 2) => ints(widen(npy.into_vec::<i16>().map_err(fail)?)),
        (TypeChar::Int, 1) => ints(widen(npy.into_vec::<i8>().map_err(fail)?)),
        (TypeChar::Uint, 4) => ints(widen(npy.into_vec::<u32>().map_err(fail)?)),
        (TypeChar::Uint, 2) => ints(widen(npy.into_vec::<u16>().map_err(fail)?)),
        (TypeChar::Uint, 1) => Values::U8(npy.into_vec().map_err(fail)?),
        (TypeChar::Bool, _) => {
            Values::U8(npy.into_vec::<bool>().map_err(fail)?.into_iter().map(u8::from).collect())
        }
        (TypeChar::UnicodeStr, _) => Values::Text(npy.into_vec().map_err(fail)?),
        _ => return Err(format!("element type {type_str} is not read")),
    };
    let values = if order == Order::Fortran { values.into_last_index_fastest(&shape) } else { values };
    Ok(Array { shape, values })
}

fn widen<T: Into<i64>>(values: Vec<T>) -> Vec<i64> {
    values.into_iter().map(Into::into).collect()
}

impl Values {
    fn into_last_index_fastest(self, shape: &[usize]) -> Self {
        match self {
            Self::F32(v) => Self::F32(reordered(&v, shape)),
            Self::F64(v) => Self::F64(reordered(&v, shape)),
            Self::I64(v) => Self::I64(reordered(&v, shape)),
            Self::U8(v) => Self::U8(reordered(&v, shape)),
            Self::Text(v) => Self::Text(reordered(&v, shape)),
        }
    }
}

/// First index fastest → last index fastest.
fn reordered<T: Clone>(values: &[T], shape: &[usize]) -> Vec<T> {
    (0..values.len())
        .map(|to| {
            // The position `to` has the indices (i0, i1, …), last fastest; rebuild it with the first fastest.
            let (mut rest, mut from, mut stride) = (to, 0, values.len());
            for &side in shape.iter().rev() {
                stride /= side;
                from += (rest % side) * stride;
                rest /= side;
            }
            values[from].clone()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> BTreeMap<String, Array> {
        let text = |v: &[&str]| Values::Text(v.iter().map(|&s| s.to_owned()).collect());
        BTreeMap::from([
            ("cam2world".to_owned(), Array::new(&[2, 2], Values::F64(vec![1.0, -2.5e6, 1e-17, 0.0]))),
            ("intrinsics".to_owned(), Array::new(&[1, 3], Values::F32(vec![618.0387, 0.0, 255.5]))),
            ("mask".to_owned(), Array::new(&[3], Values::U8(vec![0, 1, 255]))),
            ("pairs".to_owned(), Array::new(&[2, 2], Values::I64(vec![0, 1, -5, i64::MAX]))),
            ("images".to_owned(), Array::new(&[3], text(&["im_00000", "im_00001", "é"]))),
            ("scenes".to_owned(), Array::new(&[0], text(&[]))),
        ])
    }

    #[test]
    fn round_trip_is_exact_and_repeatable() {
        let bytes = encode(&sample()).unwrap();
        assert_eq!(decode(&bytes, Path::new("memory")).unwrap(), sample());
        assert_eq!(encode(&sample()).unwrap(), bytes);
    }

    #[test]
    fn column_order_is_turned() {
        let shape = [2, 3, 2];
        // Element (i, j, k) = 100 i + 10 j + k, first index fastest.
        let columns: Vec<i64> =
            (0..12).map(|n| i64::from(100 * (n % 2) + 10 * (n / 2 % 3) + n / 6)).collect();
        let rows = reordered(&columns, &shape);
        let expected: Vec<i64> =
            (0..12).map(|n| i64::from(100 * (n / 6) + 10 * (n / 2 % 3) + n % 2)).collect();
        assert_eq!(rows, expected);
    }

    #[test]
    fn an_archive_that_unfolds_to_many_times_its_size_is_refused() {
        let mut writer = NpzWriter::new(Cursor::new(Vec::new()));
        let options = FileOptions::default().compression_method(CompressionMethod::Deflated);
        let type_str = "|u1".parse().unwrap();
        let side = ALWAYS_BYTES + 1;
        let mut out = writer
            .array::<u8>("a", options)
            .unwrap()
            .dtype(DType::Plain(type_str))
            .shape(&[side])
            .begin_nd()
            .unwrap();
        for _ in 0..side {
            out.push(&0u8).unwrap();
        }
        out.finish().unwrap();
        let bytes = writer.zip_writer().finish().unwrap().into_inner();
        assert!(bytes.len() < 1 << 20);
        let error = decode(&bytes, Path::new("memory")).unwrap_err().to_string();
        assert!(error.contains("`a` of more than"), "{error}");
    }

    #[test]
    fn a_changed_byte_is_found_by_its_checksum() {
        let bytes = encode(&sample()).unwrap();
        let at = bytes.windows(4).position(|part| part == [0, 1, 255, b'P']).unwrap();
        let mut damaged = bytes;
        damaged[at] ^= 1;
        assert!(decode(&damaged, Path::new("memory")).is_err());
    }

    #[test]
    fn broken_archives_and_wrong_shapes_are_errors() {
        let bytes = encode(&sample()).unwrap();
        for end in (0..bytes.len()).step_by(11) {
            assert!(decode(&bytes[..end], Path::new("memory")).is_err(), "truncated at {end}");
        }
        let wrong = BTreeMap::from([("a".to_owned(), Array::new(&[4], Values::I64(vec![1])))]);
        assert!(encode(&wrong).is_err());
        for forgery in [
            "'<f8', 'fortran_order': False, 'shape': (99999999999, 9999999999)",
            "'<U99999999999999999999', 'shape': (1,)",
        ] {
            let mut forged = b"\x93NUMPY\x01\x00\x76\x00{'descr': ".to_vec();
            forged.extend_from_slice(forgery.as_bytes());
            forged.resize(10 + 0x75, b' ');
            forged.push(b'\n');
            assert!(read_array(&forged).is_err());
        }
    }
}
