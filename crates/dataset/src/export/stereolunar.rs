//! The StereoLunar triplets out: `im_NNNNN.jpg`, `.exr`, `.npz` in one folder per scene, and split files.
//!
//! Ours differ from the public samples where those lose truth: float32 depth, float64 poses, and by default a
//! principal point measured from the first pixel's centre, because the paper's own loader back-projects whole numbers.

use crate::Error;
use crate::pair::Trajectory;
use crate::split::Split;
use crate::stored::triplets::{LIGHTS_PER_PAIR, stem};
use crate::stored::{self, ReadOptions, SplitTable, StereoPair, StereoView, StoredPair, encode_split};
use selenograph_geometry::PixelConvention;
use selenograph_raster::codec::exr::{Attribute, Channel, ExrImage};
use selenograph_raster::codec::npz::{Array, Values};
use selenograph_raster::codec::{exr, jpeg, npz};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Folder of pairs whose trajectory is not known.
const UNTOLD_SCENE: &str = "other";

/// How triplets are written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExportOptions {
    /// Where `intrinsics` has the first pixel's centre: `center` for the paper's loader, `corner` as the samples.
    pub k_convention: PixelConvention,
    /// Quality of the JPEG pictures.
    pub jpeg_quality: u8,
    /// Whether every file that is read is compared with its checksum.
    pub verify: bool,
}

impl Default for ExportOptions {
    fn default() -> Self {
        Self { k_convention: PixelConvention::Center, jpeg_quality: jpeg::QUALITY, verify: true }
    }
}

/// What an export has written.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct ExportSummary {
    /// Number of pairs.
    pub num_pairs: usize,
    /// Number of images (triplets).
    pub num_images: usize,
    /// The scene folders.
    pub scenes: Vec<String>,
    /// The split files beside them.
    pub split_files: Vec<String>,
}

/// Writes the triplets of one pair into a folder that exists, each file whole or not at all, and returns the stems
/// of A and B under each light. Pair numbers above the format's three lights take further pair numbers:
/// `pair_number` is the first one used.
///
/// # Errors
/// [`Error::Io`] and [`Error::Raster`].
pub fn write_pair(
    folder: &Path,
    pair_number: u64,
    pair: &StereoPair,
    options: &ExportOptions,
) -> Result<Vec<[String; 2]>, Error> {
    let num_lights = pair.views.iter().map(|view| view.images.len()).min().unwrap_or(0);
    let geometry = [depth_and_camera(&pair.views[0], options)?, depth_and_camera(&pair.views[1], options)?];
    let mut stems = Vec::with_capacity(num_lights);
    for light_idx in 0..num_lights {
        let names = [0, 1].map(|view| stem(2 * (pair_number * LIGHTS_PER_PAIR + light_idx as u64) + view));
        for ((view, name), (depth_z, camera)) in pair.views.iter().zip(&names).zip(&geometry) {
            let picture = jpeg::encode_grey_as_rgb(&view.images[light_idx], options.jpeg_quality)?;
            for (extension, bytes) in [("jpg", &picture), ("exr", depth_z), ("npz", camera)] {
                selenograph_files::write(&folder.join(format!("{name}.{extension}")), bytes)?;
            }
        }
        stems.push(names);
    }
    Ok(stems)
}

/// The bytes of a view's `.exr` and `.npz`.
fn depth_and_camera(view: &StereoView, options: &ExportOptions) -> Result<(Vec<u8>, Vec<u8>), Error> {
    // The samples mark absent depth by infinity, and readers of the format look for what is not finite.
    let samples = view.depth_z.data.iter().map(|&z| if z.is_finite() { z } else { f32::INFINITY }).collect();
    let depth_z = exr::encode(&ExrImage {
        width: view.depth_z.width,
        height: view.depth_z.height,
        channels: vec![Channel::float("Y", samples)],
        attributes: BTreeMap::from([
            ("kind".to_owned(), Attribute::Text("depth_z".to_owned())),
            ("unit".to_owned(), Attribute::Text("m".to_owned())),
        ]),
    })?;
    let k = view.camera.k(options.k_convention);
    let mut pose: Vec<f64> = view.world_from_cam.rows_3x4().concat();
    pose.extend([0.0, 0.0, 0.0, 1.0]);
    let camera = npz::encode(&BTreeMap::from([
        ("cam2world".to_owned(), Array::new(&[4, 4], Values::F64(pose))),
        ("intrinsics".to_owned(), Array::new(&[3, 3], Values::F64(k.transpose().as_slice().to_vec()))),
    ]))?;
    Ok((depth_z, camera))
}

/// Writes one of our datasets as triplets: `out/<trajectory>/im_NNNNN.*` and `out/all.npz`, with `train.npz` and
/// `val.npz` where a split is given. `out` is made if it is not there; `progress` hears of each pair.
///
/// # Errors
/// [`Error::Format`] if the dataset has no pair, and those of reading and writing.
pub fn export_dataset(
    dataset: &Path,
    out: &Path,
    split: Option<&Split>,
    options: &ExportOptions,
    mut progress: impl FnMut(usize, usize),
) -> Result<ExportSummary, Error> {
    let reading = ReadOptions { verify: options.verify, ..ReadOptions::default() };
    let pairs = stored::own(dataset, reading)?;
    if pairs.is_empty() {
        return Err(Error::Format {
            path: dataset.to_owned(),
            expected: "a dataset with complete pairs".to_owned(),
            found: "none".to_owned(),
        });
    }
    write_scenes(&pairs, out, split, options, &mut progress)
}

fn write_scenes(
    pairs: &[StoredPair],
    root: &Path,
    split: Option<&Split>,
    options: &ExportOptions,
    progress: &mut impl FnMut(usize, usize),
) -> Result<ExportSummary, Error> {
    let mut tables = BTreeMap::from([("all", SplitTable::default())]);
    if split.is_some() {
        tables.extend([("train", SplitTable::default()), ("val", SplitTable::default())]);
    }
    let mut next_number: BTreeMap<String, u64> = BTreeMap::new();
    let mut summary = ExportSummary { num_pairs: pairs.len(), ..ExportSummary::default() };
    std::fs::create_dir_all(root).map_err(Error::io("create", root))?;
    for (done, stored) in pairs.iter().enumerate() {
        let open = stored.open()?;
        let pair = open.stereo()?;
        let scene = open.trajectory().map_or(UNTOLD_SCENE, Trajectory::as_str).to_owned();
        let scene_folder = root.join(&scene);
        std::fs::create_dir_all(&scene_folder).map_err(Error::io("create", &scene_folder))?;
        let number = next_number.entry(scene.clone()).or_insert(0);
        let stems = write_pair(&scene_folder, *number, &pair, options)?;
        *number += (stems.len() as u64).div_ceil(LIGHTS_PER_PAIR).max(1);
        summary.num_images += 2 * stems.len();
        let overlap = open.record.map(|record| record.overlap).unwrap_or_default();
        let score = (100.0 * overlap.a_in_b.min(overlap.b_in_a)).round() as i64;
        let part = split.and_then(|split| split.part_of(stored.pair_id));
        for (name, table) in &mut tables {
            if *name == "all" || part.is_some_and(|part| part.as_str() == *name) {
                add_rows(table, &scene, &stems, score);
            }
        }
        progress(done + 1, pairs.len());
    }
    for (name, table) in &tables {
        selenograph_files::write(&root.join(format!("{name}.npz")), &encode_split(table)?)?;
        summary.split_files.push(format!("{name}.npz"));
    }
    summary.scenes = next_number.into_keys().collect();
    Ok(summary)
}

fn add_rows(table: &mut SplitTable, scene: &str, stems: &[[String; 2]], score: i64) {
    let scene_idx = table.scenes.iter().position(|name| name == scene).unwrap_or_else(|| {
        table.scenes.push(scene.to_owned());
        table.scenes.len() - 1
    });
    for [a, b] in stems {
        let first = table.images.len();
        table.images.extend([a.clone(), b.clone()]);
        table.pairs.push([scene_idx as i64, first as i64, first as i64 + 1, score]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::synthetic::{oblique_pair, write_own_pair};
    use crate::split::{Footprint, SplitOptions, footprints};
    use crate::stored::triplets::read_geometry;
    use crate::stored::{Place, grey8, read_split};

    #[test]
    fn a_dataset_comes_out_as_triplets_and_split_files() {
        let root = tempfile::tempdir().unwrap();
        let views = oblique_pair(32);
        for pair_id in 0..3 {
            write_own_pair(root.path(), pair_id, &views);
        }
        let found: Vec<Footprint> = footprints(root.path()).unwrap();
        assert!(found.len() == 3 && found[0].bounds_m[0] < found[0].bounds_m[2], "{found:?}");
        let split = Split {
            options: SplitOptions::default(),
            cell_m: 1.0,
            train: vec![0],
            val: vec![2],
            left_out: vec![1],
        };
        let out = root.path().join("out");
        let mut told = 0;
        let summary =
            export_dataset(root.path(), &out, Some(&split), &ExportOptions::default(), |done, _| told = done)
                .unwrap();
        assert_eq!((summary.num_pairs, summary.num_images, told), (3, 12, 3));
        assert_eq!(summary.split_files, ["all.npz", "train.npz", "val.npz"]);
        let val = read_split(&out.join("val.npz")).unwrap();
        assert_eq!(val.scenes, ["oblique"]);
        assert_eq!(val.images, ["im_00012", "im_00013", "im_00014", "im_00015"]);
        let record: serde_json::Value =
            serde_json::from_slice(&std::fs::read(root.path().join("pairs/000/000002/pair.json")).unwrap())
                .unwrap();
        let overlap = ["a_in_b", "b_in_a"].map(|key| record["overlap"][key].as_f64().unwrap());
        let score = (100.0 * overlap[0].min(overlap[1])).round() as i64;
        assert!((1..100).contains(&score));
        assert_eq!(val.pairs, [[0, 0, 1, score], [0, 2, 3, score]]);
        let scene = out.join("oblique");
        let files = ["im_00001.exr", "im_00001.npz"];
        let raw = read_geometry(&Place::folder(&scene), files, PixelConvention::Center).unwrap();
        assert_eq!((raw.k[(0, 2)], raw.k[(1, 2)]), (15.5, 15.5));
        // float64 to the last bit, through our own record's quaternion.
        assert!((raw.world_from_cam - views[1].pose_matrix()).amax() < 1e-9);
        assert_eq!((raw.depth_stored, &raw.depth_z), (exr::SampleType::Float, &views[1].depth_z));
        let image = grey8(&jpeg::read(&scene.join("im_00000.jpg")).unwrap());
        // 500·(x + y) of 65 535 as 8 bits, less what JPEG loses.
        assert!(image[(16, 16)].abs_diff(62) <= 3);
    }

    #[test]
    fn what_cannot_be_exported_is_an_error() {
        let root = tempfile::tempdir().unwrap();
        let folder = write_own_pair(root.path(), 0, &oblique_pair(16));
        std::fs::write(folder.join("b.l1.png"), b"no picture").unwrap();
        let out = root.path().join("out");
        assert!(export_dataset(root.path(), &out, None, &ExportOptions::default(), |_, _| ()).is_err());
        assert!(export_dataset(&out, &out, None, &ExportOptions::default(), |_, _| ()).is_err());
    }
}
