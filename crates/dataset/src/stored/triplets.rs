//! The StereoLunar dataset of the paper: flat folders of `im_NNNNN.jpg`, `.exr`, `.npz`.
//!
//! The number of an image is `6·pair + 2·light + camera`. A triplet with a missing file is read as far as it can be:
//! the geometry of a view is the same under every light.

use super::place::Place;
use super::view::{RawView, check_size, rigid};
use crate::Error;
use crate::pair::{Trajectory, ViewName};
use selenograph_geometry::{BodyFixed, Cam, Distortion, Matrix3, Matrix4, PixelConvention, Rigid3};
use selenograph_raster::Raster;
use selenograph_raster::codec::{Picture, exr, jpeg, npz};
use std::collections::BTreeMap;
use std::path::Path;

/// Lights per pair in the numbering of the images.
pub const LIGHTS_PER_PAIR: u64 = 3;

/// The channel of z-depth.
const DEPTH_CHANNEL: &str = "Y";

/// The files of one image, by their names.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Triplet {
    /// Name without extension, for example `im_00432`.
    pub stem: String,
    /// The picture.
    pub jpg: Option<String>,
    /// The depth.
    pub exr: Option<String>,
    /// The camera.
    pub npz: Option<String>,
}

impl Triplet {
    /// The extensions that are missing.
    pub fn missing(&self) -> Vec<&'static str> {
        let parts = [("jpg", &self.jpg), ("exr", &self.exr), ("npz", &self.npz)];
        parts.into_iter().filter(|(_, file)| file.is_none()).map(|(extension, _)| extension).collect()
    }

    /// The files that are there.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        [&self.jpg, &self.exr, &self.npz].into_iter().flatten().map(String::as_str)
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

impl TripletPair {
    /// The name that the numbering gives an image of the pair, whether it is there or not.
    pub fn stem(&self, light: u64, view: ViewName) -> String {
        stem(2 * (self.pair_id * LIGHTS_PER_PAIR + light) + view as u64)
    }

    /// What is there of a view, light after light.
    pub fn triplets(&self, view: ViewName) -> impl Iterator<Item = &Triplet> + Clone {
        self.lights.values().filter_map(move |views| views[view as usize].as_ref())
    }

    /// Depth and camera of a view: the first there are, as both are the same under every light.
    pub fn geometry(&self, view: ViewName) -> Option<[&str; 2]> {
        let exr = self.triplets(view).find_map(|triplet| triplet.exr.as_deref())?;
        Some([exr, self.triplets(view).find_map(|triplet| triplet.npz.as_deref())?])
    }

    /// The pictures of A and B under a light that has both.
    pub fn pictures(&self, light: u64) -> Option<[&str; 2]> {
        let [a, b] = self.lights.get(&light)?.each_ref().map(|triplet| triplet.as_ref()?.jpg.as_deref());
        Some([a?, b?])
    }
}

/// The name of image `number`.
pub fn stem(number: u64) -> String {
    format!("im_{number:05}")
}

/// The number in a file stem such as `im_00432`.
pub(super) fn number_of(stem: &str) -> Option<u64> {
    stem.strip_prefix("im_").filter(|digits| !digits.is_empty()).and_then(|digits| digits.parse().ok())
}

/// How a folder's pairs were flown, by its name (`nadir_1`, `oblique_3`, `dynamic_2`).
pub fn trajectory_of(scene: &str) -> Option<Trajectory> {
    let name = scene.to_ascii_lowercase();
    // `pitch` and `landing` are what the authors' folders call oblique and dynamic pairs.
    let told = [("pitch", Trajectory::Oblique), ("landing", Trajectory::Dynamic)];
    let all = Trajectory::ALL.map(|trajectory| (trajectory.as_str(), trajectory));
    told.into_iter().chain(all).find(|(prefix, _)| name.starts_with(prefix)).map(|(_, trajectory)| trajectory)
}

/// The pairs of a flat folder, in order. A folder without triplets has none.
pub(super) fn scan(folder: &Path) -> Result<Vec<TripletPair>, Error> {
    let mut triplets: BTreeMap<u64, Triplet> = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io("read", folder))? {
        let name = entry.map_err(Error::io("read", folder))?.file_name();
        let Some((name, path)) = name.to_str().map(|name| (name, Path::new(name))) else { continue };
        let Some(stem) = path.file_stem().and_then(|stem| stem.to_str()) else { continue };
        let Some(number) = number_of(stem) else { continue };
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if !["jpg", "jpeg", "exr", "npz"].contains(&extension.as_str()) {
            continue;
        }
        let triplet = triplets.entry(number).or_default();
        stem.clone_into(&mut triplet.stem);
        let file = match extension.as_str() {
            "exr" => &mut triplet.exr,
            "npz" => &mut triplet.npz,
            _ => &mut triplet.jpg,
        };
        *file = Some(name.to_owned());
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

/// The geometry in one image's `.exr` and `.npz`.
///
/// # Errors
/// [`Error::Io`], [`Error::Raster`] and [`Error::Format`] for files that are broken or lack their arrays.
pub fn read_geometry(
    place: &Place,
    [exr, npz]: [&str; 2],
    k_convention: PixelConvention,
) -> Result<RawView, Error> {
    let path = place.path(exr);
    let image = exr::decode(&place.read(exr)?, &path)?;
    let (width, height) = (image.width, image.height);
    let Some(channel) = image.channels.into_iter().find(|channel| channel.name == DEPTH_CHANNEL) else {
        return Err(Error::unexpected(&path, format!("a channel `{DEPTH_CHANNEL}`"), "other channels"));
    };
    let (k, world_from_cam) = read_camera(place, npz)?;
    Ok(RawView {
        path,
        k,
        k_convention,
        distortion: Distortion::default(),
        world_from_cam,
        depth_z: Raster { width, height, data: channel.samples },
        depth_stored: channel.stored,
    })
}

/// The pose of one image.
///
/// # Errors
/// [`Error::Io`], [`Error::Raster`] and [`Error::Format`] for a file that is broken or lacks its arrays, [`Error::Geometry`] for a matrix
/// that is no rigid motion.
pub(super) fn read_pose(place: &Place, npz: &str) -> Result<Rigid3<BodyFixed, Cam>, Error> {
    rigid(&read_camera(place, npz)?.1)
}

/// Camera matrix and pose of one image, as stored.
fn read_camera(place: &Place, npz: &str) -> Result<(Matrix3<f64>, Matrix4<f64>), Error> {
    let path = &place.path(npz);
    let arrays = npz::decode(&place.read(npz)?, path)?;
    let numbers = |name: &str, side: usize| {
        let lacks = || Error::unexpected(path, format!("an array `{name}`"), format!("{:?}", arrays.keys()));
        let array = arrays.get(name).ok_or_else(lacks)?;
        let expected = format!("`{name}` of {side}×{side} numbers");
        let values =
            array.to_f64().filter(|values| array.shape == [side, side] && values.len() == side * side);
        values.ok_or_else(|| Error::unexpected(path, expected, format!("{:?}", array.shape)))
    };
    let k = Matrix3::from_row_slice(&numbers("intrinsics", 3)?);
    Ok((k, Matrix4::from_row_slice(&numbers("cam2world", 4)?)))
}

/// One picture, which has to have the size of its depth.
///
/// # Errors
/// [`Error::Io`], [`Error::Raster`] and [`Error::Format`] for one that is missing, broken or of another size.
pub(crate) fn read_picture(place: &Place, jpg: &str, size: (usize, usize)) -> Result<Picture, Error> {
    let path = place.path(jpg);
    let picture = jpeg::decode(&place.read(jpg)?, &path)?;
    check_size(&picture, size, &path)?;
    Ok(picture)
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
    }

    #[test]
    fn folders_tell_their_trajectory() {
        assert_eq!(trajectory_of("pitch_clean_0_90"), Some(Trajectory::Oblique));
        assert_eq!(trajectory_of("landingimages"), Some(Trajectory::Dynamic));
        assert_eq!(trajectory_of("descent_2"), Some(Trajectory::Descent));
        assert_eq!(trajectory_of("holiday"), None);
    }
}
