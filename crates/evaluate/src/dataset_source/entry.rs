//! Pairs that may be evaluated.

use selenograph_dataset::pair::Trajectory;
use selenograph_dataset::stored::StoredPair;

/// A pair that may be evaluated, not yet read.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Its name in every file of the evaluation: `000012`, or with its folder `nadir_1/im_00594`.
    pub name: String,
    /// How it was flown, as far as the files or the folder's name tell.
    pub trajectory: Option<Trajectory>,
    /// Its files.
    pub pair: StoredPair,
    /// Numbers of the lights of A and B that make items.
    pub lights: Vec<[u64; 2]>,
    /// Lights that cannot make items, each with the reason.
    pub left_out: Vec<String>,
}

/// `count` entries evenly out of all, in order.
pub(super) fn spread<T>(entries: Vec<T>, count: usize) -> Vec<T> {
    let num = entries.len();
    let wanted: Vec<usize> = (0..count).map(|k| k * num / count.max(1)).collect();
    entries.into_iter().enumerate().filter(|(idx, _)| wanted.contains(idx)).map(|(_, entry)| entry).collect()
}
