//! What is evaluated: pairs of a dataset of ours or of the paper's triplets, as items of one light for A and one for B.

mod entry;
mod half_pixel;
pub(crate) mod load;
mod pixel_fault;

pub use entry::Entry;
pub use load::LoadedPair;
pub use pixel_fault::PixelFault;

use crate::Error;
use entry::spread;
use selenograph_dataset::pair::Trajectory;
use selenograph_dataset::stored::{self, ReadOptions, StoredPair, Triplet};
use selenograph_geometry::PixelConvention;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Which lights make an item of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightChoice {
    /// Both views under the same light.
    #[default]
    Same,
    /// View A under one light, view B under another: every ordered two.
    Cross,
    /// Both kinds.
    Both,
}

/// What to take of a folder.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Choice {
    /// Where the triplets' camera matrices put the first pixel's centre; `None` finds out from their depth.
    pub k_convention: Option<PixelConvention>,
    /// Only pairs flown like this; empty takes all.
    pub trajectories: Vec<Trajectory>,
    /// Only pairs of these names or numbers; empty takes all.
    pub pairs: Vec<String>,
    /// At most this many pairs, spread over what is left.
    pub limit: Option<usize>,
    /// Which lights.
    pub lights: LightChoice,
    /// Whether files are taken as they are, without comparing them with their checksums.
    pub no_verify: bool,
}

/// The pairs of a folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// The folder.
    pub root: PathBuf,
    /// What is evaluated, in order.
    pub entries: Vec<Entry>,
    /// Pairs whose description cannot be read, with the reason.
    pub broken: Vec<(String, String)>,
    /// Where the camera matrices are measured from, and what is mended.
    pub pixels: PixelFault,
    /// BLAKE3 over the names, descriptions and file sizes of all pairs there are, whatever was chosen of them.
    pub fingerprint: String,
}

impl Source {
    /// Lists the pairs of a folder, and finds out whether their principal points are where they are told to be.
    ///
    /// # Errors
    /// [`Error::NoPairs`] if there is nothing to evaluate, or a filter leaves nothing; [`Error::Dataset`] if a folder cannot
    /// be read.
    pub fn open(root: &Path, choice: &Choice) -> Result<Self, Error> {
        let k_convention = choice.k_convention.unwrap_or(PixelConvention::Corner);
        let (mut entries, mut broken, mut hash) = (Vec::new(), Vec::new(), blake3::Hasher::new());
        for pair in stored::find(root, ReadOptions { k_convention, verify: !choice.no_verify })? {
            match entry(&pair, &mut hash) {
                Ok(entry) => entries.push(entry),
                Err(error) => broken.push((pair.name, error.to_string())),
            }
        }
        if entries.is_empty() && broken.is_empty() {
            let why = "neither `pairs/…` nor `im_NNNNN.jpg/.exr/.npz` here or below".into();
            return Err(Error::NoPairs { path: root.to_owned(), why });
        }
        for entry in &mut entries {
            entry.lights = chosen_lights(&entry.lights, choice.lights);
        }
        let num_found = entries.len();
        entries.retain(|entry| is_chosen(entry, choice));
        if let Some(limit) = choice.limit.filter(|limit| *limit < entries.len()) {
            entries = spread(entries, limit);
        }
        if entries.is_empty() && (num_found > 0 || broken.is_empty()) {
            let why = format!("the filters leave none of {num_found} pairs with items");
            return Err(Error::NoPairs { path: root.to_owned(), why });
        }
        let pixels = half_pixel::find(&entries, choice.k_convention.is_some());
        hash.update(format!("{:?}", pixels.shift_half_pixels).as_bytes());
        let fingerprint = hash.finalize().to_hex().to_string();
        Ok(Self { root: root.to_owned(), entries, broken, pixels, fingerprint })
    }

    /// Number of items.
    pub fn num_items(&self) -> usize {
        self.entries.iter().map(|entry| entry.lights.len()).sum()
    }
}

/// What may be evaluated of a pair; its name, its description and the sizes of its files go into the hash.
fn entry(pair: &StoredPair, hash: &mut blake3::Hasher) -> Result<Entry, Error> {
    let name = pair.name.clone();
    hash.update(name.as_bytes());
    let open = pair.open()?;
    if let Some(record) = &open.record {
        // The record holds the checksum of every other file of the pair.
        hash.update(format!("{:?}", record.files).as_bytes());
    }
    let (lights, mut left_out) = (open.lights(), Vec::new());
    if let Some(triplets) = pair.triplets() {
        for file in triplets.lights.values().flatten().flatten().flat_map(Triplet::files) {
            hash.update(format!("{:?} {}", Some(file), pair.place.size(file)).as_bytes());
        }
        let lacking = triplets.lights.keys().filter(|light| !lights.contains(light));
        left_out.extend(lacking.map(|light| format!("{name} light {light}: a picture is missing")));
    }
    Ok(Entry {
        name,
        trajectory: open.trajectory(),
        lights: lights.into_iter().map(|light| [light; 2]).collect(),
        left_out,
        pair: pair.clone(),
    })
}

/// The lights of the items, out of the same light for both views.
fn chosen_lights(same: &[[u64; 2]], choice: LightChoice) -> Vec<[u64; 2]> {
    let lights = || same.iter().map(|[light, _]| *light);
    let all = lights().flat_map(|a| lights().map(move |b| [a, b]));
    all.filter(|[a, b]| match choice {
        LightChoice::Same => a == b,
        LightChoice::Cross => a != b,
        LightChoice::Both => true,
    })
    .collect()
}

fn is_chosen(entry: &Entry, choice: &Choice) -> bool {
    let flown = choice.trajectories.is_empty()
        || entry.trajectory.is_some_and(|trajectory| choice.trajectories.contains(&trajectory));
    let named = choice.pairs.is_empty() || choice.pairs.iter().any(|pair| is_name_of(pair, &entry.name));
    flown && named && !entry.lights.is_empty()
}

/// Whether what was typed means this pair: its name, the end of it, its number, or its folder.
fn is_name_of(typed: &str, name: &str) -> bool {
    let last = name.rsplit('/').next().unwrap_or(name);
    let number = |text: &str| text.trim_start_matches("im_").parse::<u64>().ok();
    typed == name
        || typed == last
        || name.strip_prefix(typed).is_some_and(|rest| rest.starts_with('/'))
        || (number(typed).is_some() && number(typed) == number(last))
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_dataset::pair::PAIR_NAME;

    #[test]
    fn lights_make_items() {
        let same = [[0, 0], [2, 2]];
        assert_eq!(chosen_lights(&same, LightChoice::Same), same);
        assert_eq!(chosen_lights(&same, LightChoice::Cross), [[0, 2], [2, 0]]);
        assert_eq!(chosen_lights(&same, LightChoice::Both), [[0, 0], [0, 2], [2, 0], [2, 2]]);
        assert!(chosen_lights(&same[..1], LightChoice::Cross).is_empty());
    }

    #[test]
    fn pairs_are_named_by_number_end_and_folder() {
        for typed in ["nadir_1/im_00594", "im_00594", "594", "nadir_1"] {
            assert!(is_name_of(typed, "nadir_1/im_00594"), "{typed}");
        }
        for typed in ["nadir", "59", "im_00595"] {
            assert!(!is_name_of(typed, "nadir_1/im_00594"), "{typed}");
        }
        assert!(is_name_of("12", "000012") && is_name_of("000012", "000012"));
    }

    #[test]
    fn a_limit_spreads() {
        assert_eq!(spread((0..10).collect(), 4), [0, 2, 5, 7]);
        assert_eq!(spread((0..3).collect(), 3), [0, 1, 2]);
    }

    #[test]
    fn a_folder_without_pairs_is_told_apart_from_one_with_a_broken_pair() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(Source::open(dir.path(), &Choice::default()), Err(Error::NoPairs { .. })));
        let folder = dir.path().join("deep/pairs/000/000007");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(PAIR_NAME), "{").unwrap();
        let source = Source::open(dir.path(), &Choice::default()).unwrap();
        assert_eq!(source.broken.len(), 1);
        assert_eq!(source.broken[0].0, "deep/000007");
    }
}
