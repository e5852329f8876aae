//! A stored pair, and what can be read of it.

use super::own;
use super::place::{Files, Place};
use super::triplets::{self, TripletPair};
use super::view::{RawView, StereoPair, StereoView, grey8};
use crate::Error;
use crate::pair::{
    CameraRecord, PAIR_NAME, PairRecord, Trajectory, ViewName, camera_name, image_name, parse_json,
    truth_name,
};
use selenograph_geometry::PixelConvention;
use selenograph_raster::Raster;
use selenograph_raster::codec::Picture;
use std::path::{Path, PathBuf};

/// How stored pairs are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// Where the camera matrices of triplets put the first pixel's centre; ours say it themselves.
    pub k_convention: PixelConvention,
    /// Whether every file that is read is compared with its checksum in the pair's record; triplets have none.
    pub verify: bool,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { k_convention: PixelConvention::Corner, verify: true }
    }
}

impl ReadOptions {
    /// Of triplets whose camera matrices are measured like this.
    pub fn with_convention(k_convention: PixelConvention) -> Self {
        Self { k_convention, ..Self::default() }
    }
}

/// How the files of a pair are named.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Layout {
    /// As ours are.
    Own,
    /// As the paper's triplets are.
    Triplets(TripletPair),
}

/// A pair as it is stored: found, not yet read.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredPair {
    /// Number in its folder.
    pub pair_id: u64,
    /// Its name below the folder that was looked through: `000012`, or with its folder `nadir_1/im_00594`.
    pub name: String,
    /// Its files.
    pub layout: Layout,
    /// Where they lie.
    pub place: Place,
    pub(super) reading: ReadOptions,
}

impl StoredPair {
    /// The same pair, its files compared with their checksums as they are read, or not.
    #[must_use]
    pub fn verified(mut self, verify: bool) -> Self {
        self.reading.verify = verify;
        self
    }

    /// The triplets that it is, if it is no pair of ours.
    pub fn triplets(&self) -> Option<&TripletPair> {
        match &self.layout {
            Layout::Own => None,
            Layout::Triplets(pair) => Some(pair),
        }
    }

    /// Whether the depth of a view is stored.
    pub fn has_depth(&self, view: ViewName) -> bool {
        match &self.layout {
            Layout::Own => self.place.has(&truth_name(view)),
            Layout::Triplets(pair) => pair.geometry(view).is_some(),
        }
    }

    /// Reads its record, if it has one.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Format`] for a record of ours that is missing or broken.
    pub fn open(&self) -> Result<OpenPair<'_>, Error> {
        let record = match &self.layout {
            Layout::Own => Some(parse_json(&self.place.read(PAIR_NAME)?, &self.place.path(PAIR_NAME))?),
            Layout::Triplets(_) => None,
        };
        Ok(OpenPair { pair: self, record })
    }
}

/// A pair whose record has been read: the rest is read as it is asked for.
#[derive(Debug)]
pub struct OpenPair<'a> {
    pair: &'a StoredPair,
    /// What the two views have in common; triplets have no record.
    pub record: Option<PairRecord>,
}

impl OpenPair<'_> {
    fn place(&self) -> &Place {
        &self.pair.place
    }

    /// Its files, compared with their checksums as they are read if that was asked for.
    fn files(&self) -> Files<'_> {
        Files { verify: self.pair.reading.verify, ..self.files_to_verify() }
    }

    /// Its files, each compared with its checksum as it is read.
    pub(crate) fn files_to_verify(&self) -> Files<'_> {
        Files { place: self.place(), sums: self.record.as_ref().map(|record| &record.files), verify: true }
    }

    /// How it was flown, as far as its record or its folder's name tells.
    pub fn trajectory(&self) -> Option<Trajectory> {
        match &self.record {
            Some(record) => record.trajectory,
            None => triplets::trajectory_of(&self.place().name()),
        }
    }

    /// Numbers of the lights under which both views have pictures.
    pub fn lights(&self) -> Vec<u64> {
        match (&self.record, &self.pair.layout) {
            (Some(record), _) => (0..record.suns.len() as u64).collect(),
            (None, Layout::Triplets(pair)) => {
                pair.lights.keys().copied().filter(|light| pair.pictures(*light).is_some()).collect()
            }
            (None, Layout::Own) => Vec::new(),
        }
    }

    /// The files of which one is not there, though a picture or a camera should be in it.
    pub(crate) fn missing(&self) -> Option<PathBuf> {
        let files = self.named_files();
        files.iter().find(|file| !self.place().has(file)).map(|file| self.place().path(file))
    }

    /// The files that hold its pictures and cameras.
    pub(crate) fn named_files(&self) -> Vec<String> {
        let lights = self.lights();
        match &self.pair.layout {
            Layout::Own => {
                let images = |view| lights.iter().map(move |light| image_name(view, *light as usize));
                ViewName::BOTH.into_iter().flat_map(|view| images(view).chain([camera_name(view)])).collect()
            }
            Layout::Triplets(pair) => {
                let geometry = ViewName::BOTH.into_iter().filter_map(|view| pair.geometry(view));
                let pictures = lights.iter().filter_map(|light| pair.pictures(*light));
                geometry.chain(pictures).flatten().map(str::to_owned).collect()
            }
        }
    }

    /// The mask of a view's lit pixels under a light, if it is there; triplets have none.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Raster`] for a mask that is broken.
    pub(crate) fn lit(&self, view: ViewName, light: u64) -> Result<Option<Raster<u8>>, Error> {
        Ok(own::read_lit(&self.files(), view, &[light])?.pop())
    }

    /// The camera's own record of a view; triplets have none.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Format`] if it is missing or broken.
    pub fn camera_record(&self, view: ViewName) -> Result<Option<CameraRecord>, Error> {
        match &self.pair.layout {
            Layout::Own => self.files().json(&camera_name(view)).map(Some),
            Layout::Triplets(_) => Ok(None),
        }
    }

    /// Depth, camera and pose of a view.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Raster`] and [`Error::Format`] for files that are missing, broken or of another size.
    pub fn raw_view(&self, view: ViewName) -> Result<RawView, Error> {
        Ok(self.raw_view_and_slope(view)?.0)
    }

    fn raw_view_and_slope(&self, view: ViewName) -> Result<(RawView, Option<Raster<f32>>), Error> {
        let Layout::Triplets(pair) = &self.pair.layout else { return own::read_truth(&self.files(), view) };
        let Some(files) = pair.geometry(view) else {
            let expected = "an .exr and an .npz under at least one light";
            return Err(Error::NoTruth { path: self.place().path(&pair.stem(0, view)), expected });
        };
        Ok((triplets::read_geometry(self.place(), files, self.pair.reading.k_convention)?, None))
    }

    /// The same, where every light repeats it: lights whose files differ are an error.
    ///
    /// # Errors
    /// Those of [`OpenPair::raw_view`], and [`Error::Format`] for the first file that differs.
    pub fn agreed_view(&self, view: ViewName) -> Result<RawView, Error> {
        let raw = self.raw_view(view)?;
        let Some((pair, files)) = self.pair.triplets().and_then(|pair| Some((pair, pair.geometry(view)?)))
        else {
            return Ok(raw);
        };
        let read =
            |files: [&str; 2]| Ok::<_, Error>([self.place().read(files[0])?, self.place().read(files[1])?]);
        let bytes = read(files)?;
        for triplet in pair.triplets(view) {
            let others =
                [triplet.exr.as_deref().unwrap_or(files[0]), triplet.npz.as_deref().unwrap_or(files[1])];
            // Files that are the same need no decoding.
            if others == files || read(others)? == bytes {
                continue;
            }
            let other = triplets::read_geometry(self.place(), others, self.pair.reading.k_convention)?;
            if !raw.is_same_geometry(&other) {
                let expected = format!("the depth, pose and camera of {}", raw.path.display());
                let found = "another one: the lights of a pair share their geometry";
                return Err(Error::unexpected(&other.path, expected, found));
            }
        }
        Ok(raw)
    }

    /// The picture of a view under a light, which has to have the size of the view's depth or camera.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Raster`] and [`Error::Format`] for a picture that is missing, broken or of another size.
    pub fn picture(&self, view: ViewName, light: u64, size: (usize, usize)) -> Result<Picture, Error> {
        let pair = match &self.pair.layout {
            Layout::Own => return own::read_picture(&self.files(), view, light, size),
            Layout::Triplets(pair) => pair,
        };
        let Some(files) = pair.pictures(light) else {
            let expected = format!("pictures of both views under light {light}");
            return Err(Error::unexpected(Path::new(&self.pair.name), expected, "one is missing"));
        };
        triplets::read_picture(self.place(), files[view as usize], size)
    }

    /// Both views with every picture that both have.
    ///
    /// # Errors
    /// Those of [`OpenPair::raw_view`] and [`OpenPair::picture`], for every file of the pair.
    pub fn stereo(&self) -> Result<StereoPair, Error> {
        let lights = self.lights();
        let [a, b] = ViewName::BOTH.map(|view| self.stereo_view(view, &lights));
        Ok(StereoPair { pair_id: self.pair.pair_id, views: [a?, b?] })
    }

    fn stereo_view(&self, view: ViewName, lights: &[u64]) -> Result<StereoView, Error> {
        let (raw, slope_rad) = self.raw_view_and_slope(view)?;
        let size = (raw.depth_z.width, raw.depth_z.height);
        let image = |light: &u64| Ok::<_, Error>(grey8(&self.picture(view, *light, size)?));
        let (name, lit) = match &self.pair.layout {
            Layout::Own => {
                let name = format!("{:06} {}", self.pair.pair_id, view.as_str());
                (name, own::read_lit(&self.files(), view, lights)?)
            }
            Layout::Triplets(pair) => {
                let first = pair.triplets(view).next();
                (first.map_or_else(|| pair.stem(0, view), |triplet| triplet.stem.clone()), Vec::new())
            }
        };
        Ok(StereoView {
            name,
            camera: raw.camera()?,
            world_from_cam: raw.world_from_cam()?,
            depth_z: raw.depth_or_nan(),
            images: lights.iter().map(image).collect::<Result<_, _>>()?,
            slope_rad,
            lit,
        })
    }
}
