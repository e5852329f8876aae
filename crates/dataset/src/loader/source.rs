//! Where pairs come from: our own folders, the paper's triplets, and a campaign that is flown while training.

use super::flight::Flight;
use super::order::Draw;
use crate::Error;
use crate::augment::{Augmentation, Draft};
use crate::correspondence::MatchRule;
use crate::covisibility::Sight;
use crate::import::stereolunar::{self, Triplet};
use crate::import::{self, RawView, absent_as_nan, selenograph};
use crate::pair::{
    CameraRecord, PAIR_NAME, PairRecord, ViewName, camera_name, image_name, list_pairs, read_json, truth_name,
};
use crate::plan::Campaign;
use crate::sample::ViewTruth;
use selenograph_geometry::{Camera, PixelConvention};
use selenograph_raster::Raster;
use selenograph_raster::codec::{Picture, jpeg, png};
use selenograph_terrain::Terrain;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A source of training pairs.
#[derive(Debug)]
pub struct Source {
    /// Its name, in messages and provenance.
    pub name: String,
    /// Its share of an epoch, relative to the other sources'.
    pub weight: f64,
    /// Whether a network is asked for metres.
    pub is_metric: bool,
    /// Name of the world whose ground it shows; sources of other worlds share no ground with it.
    pub world: String,
    pub(super) kind: Kind,
}

#[derive(Debug)]
pub(super) enum Kind {
    /// Numbers and folders of our own pairs.
    Pairs(Vec<(u64, PathBuf)>),
    Triplets(Vec<TripletItem>, PixelConvention),
    Flight(Box<Flight>),
}

/// A pair of triplets: its geometry, and its pictures under each light.
#[derive(Debug)]
pub(super) struct TripletItem {
    pub pair_id: u64,
    /// Depth and camera files of A and B.
    pub geometry: [[PathBuf; 2]; 2],
    lights: Vec<[PathBuf; 2]>,
}

/// What decides how a pair is fetched.
pub(super) struct Request<'a> {
    pub augmentation: &'a Augmentation,
    pub match_rule: MatchRule,
    pub size: [usize; 2],
    pub seed: u64,
    pub position: u64,
}

/// A pair on its way.
pub(super) struct Fetched {
    pub pair_id: u64,
    pub lights: [usize; 2],
    pub drafts: [Draft; 2],
    /// Whether depth was read; poses may be known without.
    pub has_depth: bool,
    /// What the terrain says each view sees of the other, for views that already have their final shape.
    pub sights: Option<[Vec<Sight>; 2]>,
    pub is_shaped: bool,
}

/// A pair that cannot be used.
pub(super) fn unusable(what: impl Into<String>, why: impl Into<String>) -> Error {
    Error::Unusable { what: what.into(), why: why.into() }
}

impl Source {
    fn new(name: &str, kind: Kind) -> Self {
        Self { name: name.into(), weight: 1.0, is_metric: false, world: "moon".into(), kind }
    }

    /// The pairs of a dataset folder, or those of them with the numbers given.
    ///
    /// # Errors
    /// [`Error::Io`], and [`Error::Unusable`] if there is none.
    pub fn pairs(name: &str, folder: &Path, only: Option<&[u64]>) -> Result<Self, Error> {
        let mut found = list_pairs(folder)?;
        found.retain(|(id, _)| only.is_none_or(|only| only.contains(id)));
        if found.is_empty() {
            return Err(unusable(folder.display().to_string(), "it holds no pair of those asked for"));
        }
        Ok(Self::new(name, Kind::Pairs(found)))
    }

    /// The paper's triplets: the pairs of a split file, each under its own light, or all that lie in the folder, each under
    /// every light.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Raster`] and [`Error::Format`] for a broken split file, [`Error::Unusable`] if there is no
    /// pair, or half of one.
    pub fn triplets(
        name: &str,
        root: &Path,
        split: Option<&Path>,
        k_convention: PixelConvention,
    ) -> Result<Self, Error> {
        let items = match split {
            Some(path) => split_items(root, path)?,
            None => folder_items(root)?,
        };
        if items.is_empty() {
            return Err(unusable(root.display().to_string(), "it holds no whole pair of triplets"));
        }
        Ok(Self::new(name, Kind::Triplets(items, k_convention)))
    }

    /// The pairs of a campaign, rendered when they are asked for. The first pass gives the pairs that `generate` would write;
    /// each further one new pairs.
    ///
    /// # Errors
    /// Those of [`Campaign::check`].
    pub fn flight(name: &str, campaign: Campaign, terrain: Arc<Terrain>) -> Result<Self, Error> {
        campaign.check()?;
        Ok(Self::new(name, Kind::Flight(Box::new(Flight::new(campaign, terrain)))))
    }

    /// The same source with another weight.
    pub fn with_weight(mut self, weight: f64) -> Self {
        self.weight = weight;
        self
    }

    /// Number of pairs of one pass.
    pub fn num_pairs(&self) -> u64 {
        match &self.kind {
            Kind::Pairs(pairs) => pairs.len() as u64,
            Kind::Triplets(items, _) => items.len() as u64,
            Kind::Flight(flight) => flight.num_pairs(),
        }
    }

    /// Whether any of its pairs has depth.
    pub fn has_truth(&self) -> bool {
        match &self.kind {
            Kind::Pairs(pairs) => {
                pairs.iter().any(|(_, folder)| folder.join(truth_name(ViewName::A)).is_file())
            }
            Kind::Triplets(..) | Kind::Flight(_) => true,
        }
    }

    /// Looks whether every picture and every camera is there, without reading them.
    ///
    /// # Errors
    /// [`Error::Unusable`] for the first that is missing, [`Error::Io`] and [`Error::Format`] for a broken `pair.json`.
    pub fn check_files(&self) -> Result<(), Error> {
        let there = |id: u64, path: PathBuf| {
            let why = || format!("`{}` is missing", path.display());
            if path.is_file() {
                Ok(())
            } else {
                Err(unusable(format!("pair {id} of `{}`", self.name), why()))
            }
        };
        match &self.kind {
            Kind::Pairs(pairs) => {
                for (id, folder) in pairs {
                    let record: PairRecord = read_json(&folder.join(PAIR_NAME))?;
                    for view in ViewName::BOTH {
                        there(*id, folder.join(camera_name(view)))?;
                        for light_idx in 0..record.suns.len() {
                            there(*id, folder.join(image_name(view, light_idx)))?;
                        }
                    }
                }
            }
            Kind::Triplets(items, _) => {
                for item in items {
                    for path in item.geometry.iter().chain(&item.lights).flatten() {
                        there(item.pair_id, path.clone())?;
                    }
                }
            }
            Kind::Flight(_) => {}
        }
        Ok(())
    }

    /// The pair's name in messages.
    pub(super) fn label(&self, draw: &Draw) -> String {
        let id = match &self.kind {
            Kind::Pairs(pairs) => pairs[draw.item_idx as usize].0,
            Kind::Triplets(items, _) => items[draw.item_idx as usize].pair_id,
            Kind::Flight(flight) => draw.pass * flight.num_pairs() + draw.item_idx,
        };
        format!("pair {id} of `{}`", self.name)
    }

    pub(super) fn fetch(&self, draw: &Draw, request: &Request<'_>) -> Result<Fetched, Error> {
        let fetched = match &self.kind {
            Kind::Pairs(pairs) => {
                let (pair_id, folder) = &pairs[draw.item_idx as usize];
                fetch_pair(*pair_id, folder, request)?
            }
            Kind::Triplets(items, k) => fetch_triplets(&items[draw.item_idx as usize], *k, request)?,
            Kind::Flight(flight) => flight.fetch(draw, request)?,
        };
        for (draft, name) in fetched.drafts.iter().zip(["a", "b"]) {
            if !draft.camera.distortion.is_none() {
                return Err(unusable(
                    self.label(draw),
                    format!("view {name} has lens distortion; rectify it first"),
                ));
            }
            if fetched.has_depth && !draft.truth.as_ref().is_some_and(ViewTruth::has_depth) {
                return Err(unusable(self.label(draw), format!("view {name} has no pixel with depth")));
            }
        }
        Ok(fetched)
    }
}

fn fetch_pair(pair_id: u64, folder: &Path, request: &Request<'_>) -> Result<Fetched, Error> {
    let record: PairRecord = read_json(&folder.join(PAIR_NAME))?;
    if record.suns.is_empty() {
        return Err(unusable(folder.display().to_string(), "it has no picture"));
    }
    let lights = request.augmentation.lights(record.suns.len(), request.seed, request.position);
    let has_truth = ViewName::BOTH.map(|view| folder.join(truth_name(view)).is_file());
    if has_truth[0] != has_truth[1] {
        return Err(unusable(folder.display().to_string(), "one view has depth and the other has none"));
    }
    let draft = |view: ViewName, light_idx: usize| {
        let levels = levels(&png::read(&folder.join(image_name(view, light_idx)))?);
        let (depth_z, record) = if has_truth[0] {
            let (raw, record) = selenograph::read_raw_view(folder, view)?;
            (absent_as_nan(&raw.depth_z), record)
        } else {
            let record: CameraRecord = read_json(&folder.join(camera_name(view)))?;
            (Raster::filled(levels.width, levels.height, f32::NAN), record)
        };
        let truth = ViewTruth { depth_z, world_from_cam: record.world_from_cam() };
        checked(folder, levels, record.camera()?, truth)
    };
    let drafts = [draft(ViewName::A, lights[0])?, draft(ViewName::B, lights[1])?];
    let has_depth = has_truth[0];
    Ok(Fetched { pair_id, lights, drafts, has_depth, sights: None, is_shaped: false })
}

fn fetch_triplets(item: &TripletItem, k: PixelConvention, request: &Request<'_>) -> Result<Fetched, Error> {
    let lights = request.augmentation.lights(item.lights.len(), request.seed, request.position);
    let draft = |view: usize| {
        let path = &item.lights[lights[view]][view];
        let levels = levels(&jpeg::read(path)?);
        let [exr, npz] = &item.geometry[view];
        let raw: RawView = stereolunar::read_raw_view(exr, npz, k)?;
        let truth = ViewTruth { depth_z: absent_as_nan(&raw.depth_z), world_from_cam: raw.world_from_cam()? };
        checked(path, levels, raw.camera()?, truth)
    };
    Ok(Fetched {
        pair_id: item.pair_id,
        lights,
        drafts: [draft(0)?, draft(1)?],
        has_depth: true,
        sights: None,
        is_shaped: false,
    })
}

/// A view whose picture is as large as its camera says.
fn checked(path: &Path, levels: Raster<f32>, camera: Camera, truth: ViewTruth) -> Result<Draft, Error> {
    if (levels.width, levels.height) != (camera.width, camera.height) {
        return Err(import::unexpected(
            path,
            format!("a picture of {}×{} pixels, as its depth or camera", camera.width, camera.height),
            format!("{}×{}", levels.width, levels.height),
        ));
    }
    Ok(Draft { levels, camera, truth: Some(truth) })
}

/// Grey levels, 255 at full scale.
fn levels(picture: &Picture) -> Raster<f32> {
    match picture {
        Picture::Grey8(grey) => grey.map(|level| f32::from(*level)),
        // 65 535 is 255 · 257.
        Picture::Grey16(grey) => grey.map(|level| f32::from(*level) / 257.0),
        // Lunar pictures are grey: their channels are equal.
        Picture::Rgb8(colour) => colour.map(|[red, _, _]| f32::from(*red)),
    }
}

/// Every pair of a folder of triplets, or of those directly inside it.
fn folder_items(root: &Path) -> Result<Vec<TripletItem>, Error> {
    let mut items = Vec::new();
    for scene in stereolunar::scenes(root)? {
        for pair in stereolunar::scan(&scene)? {
            let files = |view: usize| {
                let mut triplets = pair.lights.values().filter_map(|light| light[view].as_ref());
                // Depth and camera are the same under every light.
                let exr = triplets.clone().find_map(|t: &Triplet| t.exr.clone())?;
                Some([exr, triplets.find_map(|t| t.npz.clone())?])
            };
            let both = |light: &[Option<Triplet>; 2]| {
                let [a, b] = light.each_ref().map(|t| t.as_ref().and_then(|t| t.jpg.clone()));
                Some([a?, b?])
            };
            let lights: Vec<[PathBuf; 2]> = pair.lights.values().filter_map(both).collect();
            let (Some(a), Some(b), false) = (files(0), files(1), lights.is_empty()) else {
                return Err(unusable(
                    format!("pair {} in `{}`", pair.pair_id, scene.display()),
                    "a view of it is missing, or has no picture, depth or camera",
                ));
            };
            items.push(TripletItem { pair_id: items.len() as u64, geometry: [a, b], lights });
        }
    }
    Ok(items)
}

/// The rows of a split file.
fn split_items(root: &Path, path: &Path) -> Result<Vec<TripletItem>, Error> {
    let table = stereolunar::read_split(path)?;
    let item = |(row, [scene, a, b, _]): (usize, &[i64; 4])| {
        let folder = root.join(&table.scenes[*scene as usize]);
        let file = |image: i64, extension: &str| {
            folder.join(&table.images[image as usize]).with_extension(extension)
        };
        TripletItem {
            pair_id: row as u64,
            geometry: [*a, *b].map(|image| [file(image, "exr"), file(image, "npz")]),
            lights: vec![[file(*a, "jpg"), file(*b, "jpg")]],
        }
    };
    Ok(table.pairs.iter().enumerate().map(item).collect())
}
