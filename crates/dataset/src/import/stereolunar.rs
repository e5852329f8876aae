//! The StereoLunar dataset of the paper: flat folders of `im_NNNNN.jpg`, `.exr`, `.npz`, and its split file.
//!
//! The number of an image is `6·pair + 2·light + camera`. A triplet with a missing file is read as far as it can be:
//! the geometry of a view is the same under every light.

use super::{RawView, StereoPair, StereoView, absent_as_nan, unexpected};
use crate::Error;
use nalgebra::{Matrix3, Matrix4};
use selenograph_geometry::{Distortion, PixelConvention};
use selenograph_raster::Raster;
use selenograph_raster::codec::npz::{self, Values};
use selenograph_raster::codec::{Picture, exr, jpeg};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Lights per pair in the numbering of the images.
pub const LIGHTS_PER_PAIR: u64 = 3;

/// The channel of z-depth.
pub const DEPTH_CHANNEL: &str = "Y";

/// The files of one image.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Triplet {
    /// Number in the name.
    pub number: u64,
    /// Name without extension, for example `im_00432`.
    pub stem: String,
    /// The picture.
    pub jpg: Option<PathBuf>,
    /// The depth.
    pub exr: Option<PathBuf>,
    /// The camera.
    pub npz: Option<PathBuf>,
}

impl Triplet {
    /// The extensions that are missing.
    pub fn missing(&self) -> Vec<&'static str> {
        let parts = [("jpg", &self.jpg), ("exr", &self.exr), ("npz", &self.npz)];
        parts.into_iter().filter(|(_, path)| path.is_none()).map(|(extension, _)| extension).collect()
    }
}

/// The images of one pair: for each light, A and B.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TripletPair {
    /// Number of the pair in its folder.
    pub pair_id: u64,
    /// The lights found, by their index, each with what is there of A and B.
    pub lights: BTreeMap<u64, [Option<Triplet>; 2]>,
}

/// The name of image `number`.
pub fn stem(number: u64) -> String {
    format!("im_{number:05}")
}

/// The number in a file stem such as `im_00432`.
fn number_of(stem: &str) -> Option<u64> {
    stem.strip_prefix("im_").filter(|digits| !digits.is_empty()).and_then(|digits| digits.parse().ok())
}

/// The pairs of a flat folder, in order. A folder without triplets has none.
///
/// # Errors
/// [`Error::Io`] if the folder cannot be read.
pub fn scan(folder: &Path) -> Result<Vec<TripletPair>, Error> {
    let mut triplets: BTreeMap<u64, Triplet> = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io("read", folder))? {
        let path = entry.map_err(Error::io("read", folder))?.path();
        let Some(stem) = path.file_stem().and_then(|stem| stem.to_str()) else { continue };
        let Some(number) = number_of(stem) else { continue };
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if !["jpg", "jpeg", "exr", "npz"].contains(&extension.as_str()) {
            continue;
        }
        let triplet = triplets.entry(number).or_default();
        (triplet.number, triplet.stem) = (number, stem.to_owned());
        match extension.as_str() {
            "exr" => triplet.exr = Some(path),
            "npz" => triplet.npz = Some(path),
            _ => triplet.jpg = Some(path),
        }
    }
    let mut pairs: BTreeMap<u64, TripletPair> = BTreeMap::new();
    for (number, triplet) in triplets {
        let pair_id = number / (2 * LIGHTS_PER_PAIR);
        let pair = pairs.entry(pair_id).or_insert_with(|| TripletPair { pair_id, lights: BTreeMap::new() });
        let light = pair.lights.entry(number / 2 % LIGHTS_PER_PAIR).or_insert([None, None]);
        light[(number % 2) as usize] = Some(triplet);
    }
    Ok(pairs.into_values().collect())
}

/// The folders with triplets at `root`: itself, or those directly inside it, by name.
///
/// # Errors
/// [`Error::Io`] if a folder cannot be read.
pub fn scenes(root: &Path) -> Result<Vec<PathBuf>, Error> {
    if !scan(root)?.is_empty() {
        return Ok(vec![root.to_owned()]);
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root).map_err(Error::io("read", root))? {
        let path = entry.map_err(Error::io("read", root))?.path();
        if path.is_dir() && !scan(&path)?.is_empty() {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// The geometry in one image's `.exr` and `.npz`.
///
/// # Errors
/// [`Error::Io`], [`Error::Raster`] and [`Error::Format`] for files that are broken or lack their arrays.
pub fn read_raw_view(exr: &Path, npz: &Path, k_convention: PixelConvention) -> Result<RawView, Error> {
    let (depth_z, depth_stored) = read_depth(exr)?;
    let (k, world_from_cam) = read_camera(npz)?;
    Ok(RawView {
        path: exr.to_owned(),
        k,
        k_convention,
        distortion: Distortion::default(),
        world_from_cam,
        depth_z,
        depth_stored,
    })
}

/// The depth of one image, as stored, and its sample type.
///
/// # Errors
/// [`Error::Raster`] for a broken file, [`Error::Format`] if there is no channel `Y`.
pub fn read_depth(path: &Path) -> Result<(Raster<f32>, exr::SampleType), Error> {
    let image = exr::read(path)?;
    let (width, height) = (image.width, image.height);
    let channel = image.channels.into_iter().find(|channel| channel.name == DEPTH_CHANNEL);
    let channel =
        channel.ok_or_else(|| unexpected(path, format!("a channel `{DEPTH_CHANNEL}`"), "other channels"))?;
    Ok((Raster { width, height, data: channel.samples }, channel.stored))
}

/// Camera matrix and pose of one image, as stored.
///
/// # Errors
/// [`Error::Raster`] for a broken file, [`Error::Format`] if an array is missing or of another shape.
pub fn read_camera(path: &Path) -> Result<(Matrix3<f64>, Matrix4<f64>), Error> {
    let arrays = npz::read(path)?;
    let numbers = |name: &str, side: usize| {
        let array = arrays
            .get(name)
            .ok_or_else(|| unexpected(path, format!("an array `{name}`"), format!("{:?}", arrays.keys())))?;
        array.to_f64().filter(|values| array.shape == [side, side] && values.len() == side * side).ok_or_else(
            || unexpected(path, format!("`{name}` of {side}×{side} numbers"), format!("{:?}", array.shape)),
        )
    };
    let k = Matrix3::from_row_slice(&numbers("intrinsics", 3)?);
    Ok((k, Matrix4::from_row_slice(&numbers("cam2world", 4)?)))
}

/// Both views of a pair with every picture that is there, and what is missing.
///
/// # Errors
/// Those of [`read_raw_view`] and [`Error::Format`] if no light has both files of a view's geometry.
pub fn read_pair(
    pair: &TripletPair,
    k_convention: PixelConvention,
) -> Result<(StereoPair, Vec<String>), Error> {
    let mut defects = Vec::new();
    let a = read_view(pair, 0, k_convention, &mut defects)?;
    let b = read_view(pair, 1, k_convention, &mut defects)?;
    Ok((StereoPair { pair_id: pair.pair_id, views: [a, b] }, defects))
}

fn read_view(
    pair: &TripletPair,
    view_idx: usize,
    k_convention: PixelConvention,
    defects: &mut Vec<String>,
) -> Result<StereoView, Error> {
    let triplets: Vec<&Triplet> = pair.lights.values().filter_map(|light| light[view_idx].as_ref()).collect();
    let first = pair.pair_id * 2 * LIGHTS_PER_PAIR + view_idx as u64;
    // Depth and pose may come from different lights: both are the same under all of them.
    let (Some(exr), Some(npz)) =
        (triplets.iter().find_map(|t| t.exr.as_ref()), triplets.iter().find_map(|t| t.npz.as_ref()))
    else {
        let place = PathBuf::from(stem(first));
        return Err(Error::NoTruth { path: place, expected: "an .exr and an .npz under at least one light" });
    };
    let raw = read_raw_view(exr, npz, k_convention)?;
    let mut images = Vec::new();
    for light in pair.lights.values() {
        let [Some(a), Some(b)] = light else {
            defects.push(format!("a light of pair {} has one view only and is left out", pair.pair_id));
            continue;
        };
        let triplet = if view_idx == 0 { a } else { b };
        for extension in triplet.missing() {
            defects.push(format!("{}.{extension} is missing", triplet.stem));
        }
        // Lists of pictures stay parallel: a light counts only where both views have one.
        if let (Some(_), Some(_), Some(jpg)) = (&a.jpg, &b.jpg, &triplet.jpg) {
            images.push(read_image(jpg, raw.depth_z.width, raw.depth_z.height)?);
        }
    }
    Ok(StereoView {
        name: triplets.first().map_or_else(|| stem(first), |t| t.stem.clone()),
        camera: raw.camera()?,
        world_from_cam: raw.world_from_cam()?,
        depth_z: absent_as_nan(&raw.depth_z),
        images,
        slope_rad: None,
        lit: Vec::new(),
    })
}

/// A picture as grey: the first of its three equal channels.
///
/// # Errors
/// [`Error::Raster`] for a broken file, [`Error::Format`] if it is not as large as the depth.
pub fn read_image(path: &Path, width: usize, height: usize) -> Result<Raster<u8>, Error> {
    let picture = jpeg::read(path)?;
    if picture.size() != (width, height) {
        return Err(unexpected(
            path,
            format!("{width}×{height} pixels, as the depth has"),
            format!("{}×{}", picture.size().0, picture.size().1),
        ));
    }
    match picture {
        Picture::Grey8(grey) => Ok(grey),
        Picture::Rgb8(colour) => Ok(colour.map(|&[red, _, _]| red)),
        Picture::Grey16(_) => Err(unexpected(path, "8 bits", "16 bits")),
    }
}

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
        arrays.remove(name).ok_or_else(|| unexpected(path, format!("an array `{name}`"), "none of that name"))
    };
    let text = |name: &str, array: npz::Array| match array.values {
        Values::Text(text) => Ok(text),
        _ => Err(unexpected(path, format!("text in `{name}`"), "numbers")),
    };
    let scenes = text("scenes", take("scenes")?)?;
    let images = text("images", take("images")?)?;
    let pairs = take("pairs")?;
    let (Some(numbers), [_, 4]) = (pairs.to_f64(), pairs.shape.as_slice()) else {
        return Err(unexpected(path, "`pairs` of N×4 numbers", format!("{:?}", pairs.shape)));
    };
    let rows: Vec<[i64; 4]> =
        numbers.chunks_exact(4).map(|row| std::array::from_fn(|i| row[i].round() as i64)).collect();
    let inside = |idx: i64, list: &[String]| usize::try_from(idx).is_ok_and(|idx| idx < list.len());
    if let Some(row) =
        rows.iter().find(|[s, a, b, _]| !(inside(*s, &scenes) && inside(*a, &images) && inside(*b, &images)))
    {
        return Err(unexpected(path, "positions inside `scenes` and `images`", format!("{row:?}")));
    }
    Ok(SplitTable { scenes, images, pairs: rows })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_stems() {
        assert_eq!(stem(432), "im_00432");
        assert_eq!(number_of("im_01199"), Some(1199));
        assert_eq!(number_of("im_"), None);
        assert_eq!(number_of("image_1"), None);
    }

    #[test]
    fn images_are_sorted_into_pairs_and_lights() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["im_00013.jpg", "im_00012.exr", "im_00017.npz", "im_00003.JPG", "notes.txt", "im_1.png"]
        {
            std::fs::write(folder.path().join(name), b"").unwrap();
        }
        let pairs = scan(folder.path()).unwrap();
        assert_eq!(pairs.iter().map(|p| p.pair_id).collect::<Vec<_>>(), [0, 2]);
        let [a, b] = &pairs[1].lights[&0];
        assert_eq!(a.as_ref().unwrap().missing(), ["jpg", "npz"]);
        assert_eq!(b.as_ref().unwrap().missing(), ["exr", "npz"]);
        assert!(pairs[1].lights[&2][0].is_none());
        assert_eq!(scenes(folder.path()).unwrap(), [folder.path()]);
        assert_eq!(
            scenes(folder.path().parent().unwrap()).map(|s| s.contains(&folder.path().to_owned())).ok(),
            Some(true)
        );
    }
}
