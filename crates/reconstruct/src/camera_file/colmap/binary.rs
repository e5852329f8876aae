//! COLMAP's lists as binary files: little-endian numbers without gaps.

use super::models::MODELS;
use super::{CameraRow, Image, Unexpected, checked};
use crate::Error;
use selenograph_files::regular;
use std::io::{BufReader, Read};
use std::path::Path;

/// Bytes of a point in the list of images: two coordinates and the number of a point in space.
const POINT: u64 = 24;
/// Longest name of a picture, bytes.
const LONGEST_NAME: usize = 4096;

/// The cameras of a list; every byte must belong to one.
pub(super) fn cameras(bytes: &[u8]) -> Result<Vec<CameraRow>, Unexpected> {
    let mut rest = bytes;
    let count = u64::from_le_bytes(take(&mut rest)?);
    let mut rows = Vec::new();
    for _ in 0..count {
        let id = u32::from_le_bytes(take(&mut rest)?).into();
        let number = i32::from_le_bytes(take(&mut rest)?);
        let model = MODELS.iter().find(|model| model.id == number).ok_or_else(|| {
            ("a camera model of COLMAP (0 to 17)".to_owned(), format!("model number {number}"))
        })?;
        let [width, height] = [take(&mut rest)?, take(&mut rest)?].map(u64::from_le_bytes);
        let [width, height] = [size(width)?, size(height)?];
        let params: Result<Vec<f64>, _> =
            (0..model.num_params).map(|_| take(&mut rest).map(f64::from_le_bytes)).collect();
        rows.push(CameraRow { id, model, width, height, params: checked(model, params?)? });
    }
    if rest.is_empty() && !rows.is_empty() {
        return Ok(rows);
    }
    let found = format!("{} bytes after {count} cameras", rest.len());
    Err(("a list of cameras as COLMAP's binary".to_owned(), found))
}

fn size(pixels: u64) -> Result<usize, Unexpected> {
    let size = usize::try_from(pixels).ok().filter(|size| *size <= u32::MAX as usize);
    size.ok_or_else(|| ("a size in pixels".to_owned(), pixels.to_string()))
}

fn take<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], Unexpected> {
    let Some((head, tail)) = rest.split_first_chunk::<N>() else {
        return Err((
            "a list of cameras as COLMAP's binary".to_owned(),
            "its end inside a camera".to_owned(),
        ));
    };
    *rest = tail;
    Ok(*head)
}

/// Tells of every picture of a list.
pub(super) fn images(path: &Path, each: &mut dyn FnMut(&str, Image)) -> Result<(), Error> {
    let (list, length) = regular::open(path).map_err(Error::io("read", path))?;
    let mut list = List { reader: BufReader::new(list), left: length, path };
    let count = u64::from_le_bytes(list.take()?);
    for _ in 0..count {
        let _image_id: [u8; 4] = list.take()?;
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = f64::from_le_bytes(list.take()?);
        }
        let camera_id = u32::from_le_bytes(list.take()?).into();
        let name = list.name()?;
        let num_points = u64::from_le_bytes(list.take()?);
        list.skip(num_points.checked_mul(POINT))?;
        let [w, x, y, z, tx, ty, tz] = numbers;
        each(&name, Image { wxyz: [w, x, y, z], translation: [tx, ty, tz], camera_id });
    }
    Ok(())
}

/// A file of which nothing is read that it does not have.
struct List<'a> {
    reader: BufReader<std::fs::File>,
    /// Bytes not yet read.
    left: u64,
    path: &'a Path,
}

impl List<'_> {
    fn bad(&self, found: &str) -> Error {
        Error::Format {
            path: self.path.to_owned(),
            expected: "a list of images as COLMAP's binary".to_owned(),
            found: found.to_owned(),
        }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        self.left = self.left.checked_sub(N as u64).ok_or_else(|| self.bad("its end inside an image"))?;
        let mut bytes = [0; N];
        self.reader.read_exact(&mut bytes).map_err(Error::io("read", self.path))?;
        Ok(bytes)
    }

    fn name(&mut self) -> Result<String, Error> {
        let mut bytes = Vec::new();
        loop {
            match self.take::<1>()? {
                [0] => return Ok(String::from_utf8_lossy(&bytes).into_owned()),
                _ if bytes.len() == LONGEST_NAME => return Err(self.bad("a name without end")),
                [byte] => bytes.push(byte),
            }
        }
    }

    fn skip(&mut self, bytes: Option<u64>) -> Result<(), Error> {
        let left = bytes.and_then(|bytes| self.left.checked_sub(bytes));
        let (Some(bytes), Some(left)) = (bytes, left) else {
            return Err(self.bad("more points than it has bytes"));
        };
        self.left = left;
        // What is left of a file is less than an i64 can say.
        self.reader.seek_relative(bytes as i64).map_err(Error::io("read", self.path))
    }
}
