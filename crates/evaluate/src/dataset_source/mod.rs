//! What is evaluated: pairs of a dataset of ours or of the paper's triplets, as items of one light for A and one for B.

mod half_pixel;
pub(crate) mod load;

pub use half_pixel::PixelFault;
pub use load::LoadedPair;

use crate::Error;
use selenograph_dataset::import::stereolunar::{self, Triplet, TripletPair};
use selenograph_dataset::pair::{PAIR_NAME, PairRecord, Trajectory, list_pairs, read_json};
use selenograph_dataset::photometric::SiteRule;
use selenograph_geometry::PixelConvention;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Folders are looked for this deep below the one that is given.
const MAX_FOLDERS_DEEP: usize = 4;

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
}

/// Where a pair's files are.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// A pair folder of ours.
    Own(PathBuf),
    /// Triplets in a scene's folder.
    Triplets(PathBuf, TripletPair),
}

/// A pair that may be evaluated, not yet read.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Its name in every file of the evaluation: `000012`, or with its folder `nadir_1/im_00594`.
    pub name: String,
    /// How it was flown, as far as the files or the folder's name tell.
    pub trajectory: Option<Trajectory>,
    /// Where it is.
    pub place: Place,
    /// Numbers of the lights of A and B that make items.
    pub lights: Vec<[u64; 2]>,
    /// Lights that cannot make items, each with the reason.
    pub left_out: Vec<String>,
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
        let mut found = Found::default();
        look_below(root, root, 0, &mut found)?;
        let Found { mut entries, broken, mut hash } = found;
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
        let pixels = half_pixel::find(&entries, choice.k_convention);
        hash.update(format!("{:?}", pixels.shift_half_pixels).as_bytes());
        let fingerprint = hash.finalize().to_hex().to_string();
        Ok(Self { root: root.to_owned(), entries, broken, pixels, fingerprint })
    }

    /// Number of items.
    pub fn num_items(&self) -> usize {
        self.entries.iter().map(|entry| entry.lights.len()).sum()
    }
}

/// What a walk has found.
#[derive(Default)]
struct Found {
    entries: Vec<Entry>,
    broken: Vec<(String, String)>,
    hash: blake3::Hasher,
}

/// Collects the pairs of `folder` and of the folders in it, by name.
fn look_below(root: &Path, folder: &Path, level: usize, found: &mut Found) -> Result<(), Error> {
    let own = list_pairs(folder)?;
    if !own.is_empty() {
        add_own(root, folder, own, found);
        return Ok(());
    }
    let triplets = stereolunar::scan(folder)?;
    if !triplets.is_empty() {
        add_triplets(root, folder, triplets, found);
        return Ok(());
    }
    if level == MAX_FOLDERS_DEEP {
        return Ok(());
    }
    let mut below: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(Error::io("read", folder))?
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.is_dir())
        .collect();
    below.sort();
    below.iter().try_for_each(|path| look_below(root, path, level + 1, found))
}

/// A name below the root: `sub/name`, or `name` alone.
fn name_below(root: &Path, folder: &Path, name: &str) -> String {
    let parts = folder.strip_prefix(root).unwrap_or(folder).iter().map(|part| part.to_string_lossy());
    parts.map(std::borrow::Cow::into_owned).chain([name.to_owned()]).collect::<Vec<_>>().join("/")
}

fn add_own(root: &Path, dataset: &Path, pairs: Vec<(u64, PathBuf)>, found: &mut Found) {
    for (pair_id, folder) in pairs {
        let name = name_below(root, dataset, &format!("{pair_id:06}"));
        let path = folder.join(PAIR_NAME);
        found.hash.update(name.as_bytes());
        match read_json::<PairRecord>(&path) {
            Ok(record) => {
                // The record holds the checksum of every other file of the pair.
                found.hash.update(format!("{:?}", record.files).as_bytes());
                found.entries.push(Entry {
                    name,
                    trajectory: record.trajectory,
                    place: Place::Own(folder),
                    lights: (0..record.suns.len() as u64).map(|light| [light; 2]).collect(),
                    left_out: Vec::new(),
                });
            }
            Err(error) => found.broken.push((name, error.to_string())),
        }
    }
}

fn add_triplets(root: &Path, scene: &Path, pairs: Vec<TripletPair>, found: &mut Found) {
    for pair in pairs {
        let first = 2 * stereolunar::LIGHTS_PER_PAIR * pair.pair_id;
        let name = name_below(root, scene, &stereolunar::stem(first));
        found.hash.update(name.as_bytes());
        let files = pair.lights.values().flatten().flatten();
        for path in files.flat_map(|t| [&t.jpg, &t.exr, &t.npz]).flatten() {
            let size = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
            found.hash.update(format!("{:?} {size}", path.file_name()).as_bytes());
        }
        let has_pictures =
            |views: &[Option<Triplet>; 2]| views.iter().all(|v| v.as_ref().is_some_and(|t| t.jpg.is_some()));
        let (whole, lacking): (Vec<_>, Vec<_>) =
            pair.lights.iter().partition(|(_, views)| has_pictures(views));
        found.entries.push(Entry {
            trajectory: trajectory_of(scene),
            lights: whole.iter().map(|(light, _)| [**light; 2]).collect(),
            left_out: lacking
                .iter()
                .map(|(light, _)| format!("{name} light {light}: a picture is missing"))
                .collect(),
            name,
            place: Place::Triplets(scene.to_owned(), pair),
        });
    }
}

/// How a folder of triplets was flown, by its name.
fn trajectory_of(scene: &Path) -> Option<Trajectory> {
    let name = scene.file_name()?.to_string_lossy().to_ascii_lowercase();
    match SiteRule::of_folder(scene) {
        Some(SiteRule::BelowFirstCamera) => Some(Trajectory::Nadir),
        Some(SiteRule::AxesCrossing) => Some(Trajectory::Oblique),
        // `landing` is what the authors' folders call dynamic pairs.
        None if name.starts_with("dynamic") || name.starts_with("landing") => Some(Trajectory::Dynamic),
        None => Trajectory::ALL.into_iter().find(|trajectory| name.starts_with(trajectory.as_str())),
    }
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

/// `count` entries evenly out of all, in order.
pub(crate) fn spread<T>(entries: Vec<T>, count: usize) -> Vec<T> {
    let num = entries.len();
    let wanted: Vec<usize> = (0..count).map(|k| k * num / count.max(1)).collect();
    entries.into_iter().enumerate().filter(|(idx, _)| wanted.contains(idx)).map(|(_, entry)| entry).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn folders_of_triplets_tell_their_trajectory() {
        let of = |name: &str| trajectory_of(Path::new(name));
        assert_eq!(of("pitch_clean_0_90"), Some(Trajectory::Oblique));
        assert_eq!(of("landingimages"), Some(Trajectory::Dynamic));
        assert_eq!(of("descent_2"), Some(Trajectory::Descent));
        assert_eq!(of("holiday"), None);
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
