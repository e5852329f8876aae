//! Which pairs a folder or a split file holds.

use super::open::{Layout, ReadOptions, StoredPair};
use super::own::list;
use super::place::{Place, folders};
use super::split_table::read_split;
use super::triplets::{self, Triplet, TripletPair};
use crate::Error;
use crate::pair::ViewName;
use std::path::{Path, PathBuf};

/// Folders are looked for this deep below the one that is given.
const MAX_FOLDERS_DEEP: usize = 4;

/// Every pair of a folder, ours or triplets, or else of the folders in it, by name.
///
/// # Errors
/// [`Error::Io`] if a folder cannot be read. A folder may hold none.
pub fn find(root: &Path, reading: ReadOptions) -> Result<Vec<StoredPair>, Error> {
    let mut found = Vec::new();
    look_below(root, root, 0, reading, &mut found)?;
    Ok(found)
}

/// The complete pairs of the dataset of ours in a folder, by number.
///
/// # Errors
/// [`Error::Io`] if a folder cannot be read. A folder without `pairs` has none.
pub fn own(root: &Path, reading: ReadOptions) -> Result<Vec<StoredPair>, Error> {
    own_below(root, root, reading)
}

/// The pairs of triplets that a split file names, one a row, each under its own light. Whether their files are there is not
/// looked at.
///
/// # Errors
/// Those of [`read_split`].
pub fn of_split(root: &Path, split: &Path, reading: ReadOptions) -> Result<Vec<StoredPair>, Error> {
    let table = read_split(split)?;
    let pair = |(row, [scene, a, b, _]): (usize, &[i64; 4])| {
        let scene = &table.scenes[*scene as usize];
        let triplet = |image: i64| {
            let stem = table.images[image as usize].clone();
            let file = |end: &str| Some(Path::new(&stem).with_extension(end).to_string_lossy().into_owned());
            Some(Triplet { jpg: file("jpg"), exr: file("exr"), npz: file("npz"), stem })
        };
        let pair_id = row as u64;
        StoredPair {
            pair_id,
            name: format!("{scene}/{}", table.images[*a as usize]),
            layout: Layout::Triplets(TripletPair { pair_id, lights: [(0, [*a, *b].map(triplet))].into() }),
            place: Place::folder(&root.join(scene)),
            reading,
        }
    };
    Ok(table.pairs.iter().enumerate().map(pair).collect())
}

fn look_below(
    root: &Path,
    folder: &Path,
    level: usize,
    reading: ReadOptions,
    found: &mut Vec<StoredPair>,
) -> Result<(), Error> {
    let num_before = found.len();
    found.extend(own_below(root, folder, reading)?);
    if found.len() == num_before {
        found.extend(triplets::scan(folder)?.into_iter().map(|pair| StoredPair {
            pair_id: pair.pair_id,
            name: name_below(root, folder, &pair.stem(0, ViewName::A)),
            layout: Layout::Triplets(pair),
            place: Place::folder(folder),
            reading,
        }));
    }
    if found.len() > num_before || level == MAX_FOLDERS_DEEP {
        return Ok(());
    }
    folders(folder)?.iter().try_for_each(|below| look_below(root, below, level + 1, reading, found))
}

fn own_below(root: &Path, dataset: &Path, reading: ReadOptions) -> Result<Vec<StoredPair>, Error> {
    let pair = |(pair_id, folder): (u64, PathBuf)| StoredPair {
        pair_id,
        name: name_below(root, dataset, &format!("{pair_id:06}")),
        layout: Layout::Own,
        place: Place::folder(&folder),
        reading,
    };
    Ok(list(dataset)?.into_iter().map(pair).collect())
}

/// A name below the root: `sub/name`, or `name` alone.
fn name_below(root: &Path, folder: &Path, name: &str) -> String {
    let parts = folder.strip_prefix(root).unwrap_or(folder).iter().map(|part| part.to_string_lossy());
    parts.map(std::borrow::Cow::into_owned).chain([name.to_owned()]).collect::<Vec<_>>().join("/")
}
