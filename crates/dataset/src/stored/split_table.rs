//! The paper's split file, in and out.

use crate::Error;
use selenograph_raster::codec::npz::{self, Array, Values};
use std::collections::BTreeMap;
use std::path::Path;

/// The paper's split file: which images make pairs.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SplitTable {
    /// Folders under the root.
    pub scenes: Vec<String>,
    /// File stems.
    pub images: Vec<String>,
    /// Rows `[scene, image 1, image 2, score]`: positions in the two lists, and a score that readers ignore.
    pub pairs: Vec<[i64; 4]>,
}

/// Reads a split file with plain arrays.
///
/// # Errors
/// [`Error::Raster`] for a broken file or one with Python objects in it, [`Error::Format`] for missing arrays and
/// positions that no list has.
pub fn read_split(path: &Path) -> Result<SplitTable, Error> {
    let mut arrays = npz::read(path)?;
    let mut take = |name: &str| {
        arrays
            .remove(name)
            .ok_or_else(|| Error::unexpected(path, format!("an array `{name}`"), "none of that name"))
    };
    let text = |name: &str, array: Array| match array.values {
        Values::Text(text) => Ok(text),
        _ => Err(Error::unexpected(path, format!("text in `{name}`"), "numbers")),
    };
    let scenes = text("scenes", take("scenes")?)?;
    let images = text("images", take("images")?)?;
    let pairs = take("pairs")?;
    let (Some(numbers), [_, 4]) = (pairs.to_f64(), pairs.shape.as_slice()) else {
        return Err(Error::unexpected(path, "`pairs` of N×4 numbers", format!("{:?}", pairs.shape)));
    };
    let rows: Vec<[i64; 4]> =
        numbers.chunks_exact(4).map(|row| std::array::from_fn(|i| row[i].round() as i64)).collect();
    let inside = |idx: i64, list: &[String]| usize::try_from(idx).is_ok_and(|idx| idx < list.len());
    if let Some(row) =
        rows.iter().find(|[s, a, b, _]| !(inside(*s, &scenes) && inside(*a, &images) && inside(*b, &images)))
    {
        return Err(Error::unexpected(path, "positions inside `scenes` and `images`", format!("{row:?}")));
    }
    Ok(SplitTable { scenes, images, pairs: rows })
}

/// Bytes of a split file: plain arrays that `numpy.load` reads without unpickling.
///
/// # Errors
/// [`Error::Raster`] if the arrays cannot be encoded.
pub fn encode_split(table: &SplitTable) -> Result<Vec<u8>, Error> {
    let text = |list: &[String]| Array::new(&[list.len()], Values::Text(list.to_vec()));
    let pairs = Array::new(&[table.pairs.len(), 4], Values::I64(table.pairs.concat()));
    let arrays = BTreeMap::from([
        ("scenes".to_owned(), text(&table.scenes)),
        ("images".to_owned(), text(&table.images)),
        ("pairs".to_owned(), pairs),
    ]);
    Ok(npz::encode(&arrays)?)
}
