//! Where pairs come from: our own folders, the paper's triplets, and a campaign that is flown while training.

use super::fetch::{Fetched, Request, unusable};
use super::flight::Flight;
use super::order::Draw;
use crate::Error;
use crate::augment::UndevelopedView;
use crate::pair::ViewName;
use crate::plan::Campaign;
use crate::sample::ViewTruth;
use crate::stored::{self, ReadOptions, StoredPair};
use selenograph_geometry::PixelConvention;
use selenograph_raster::Raster;
use selenograph_raster::codec::Picture;
use selenograph_terrain::Terrain;
use std::path::Path;
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
    /// Pairs of ours or triplets, each with its number in the source.
    Stored(Vec<(u64, StoredPair)>),
    Flight(Box<Flight>),
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
        let mut found = stored::own(folder, ReadOptions::default())?;
        found.retain(|pair| only.is_none_or(|only| only.contains(&pair.pair_id)));
        if found.is_empty() {
            return Err(unusable(folder.display().to_string(), "it holds no pair of those asked for"));
        }
        Ok(Self::new(name, Kind::Stored(found.into_iter().map(|pair| (pair.pair_id, pair)).collect())))
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
        let reading = ReadOptions::with_convention(k_convention);
        let mut found = match split {
            Some(path) => stored::of_split(root, path, reading)?,
            None => stored::find(root, reading)?,
        };
        found.retain(|pair| pair.triplets().is_some());
        if found.is_empty() {
            return Err(unusable(root.display().to_string(), "it holds no whole pair of triplets"));
        }
        for pair in &found {
            if pair.open()?.lights().is_empty() || ViewName::BOTH.iter().any(|view| !pair.has_depth(*view)) {
                return Err(unusable(
                    format!("pair {} in `{}`", pair.pair_id, pair.place.root().display()),
                    "a view of it is missing, or has no picture, depth or camera",
                ));
            }
        }
        // In a folder of folders, numbers come more than once.
        Ok(Self::new(name, Kind::Stored((0..).zip(found).collect())))
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

    /// The same source, whose files are not compared with their checksums as they are read.
    #[must_use]
    pub fn unverified(mut self) -> Self {
        if let Kind::Stored(pairs) = &mut self.kind {
            *pairs = std::mem::take(pairs).into_iter().map(|(id, pair)| (id, pair.verified(false))).collect();
        }
        self
    }

    /// Number of pairs of one pass.
    pub fn num_pairs(&self) -> u64 {
        match &self.kind {
            Kind::Stored(pairs) => pairs.len() as u64,
            Kind::Flight(flight) => flight.num_pairs(),
        }
    }

    /// Whether any of its pairs has depth.
    pub fn has_truth(&self) -> bool {
        match &self.kind {
            Kind::Stored(pairs) => pairs.iter().any(|(_, pair)| pair.has_depth(ViewName::A)),
            Kind::Flight(_) => true,
        }
    }

    /// Looks whether every picture and every camera is there, without reading them.
    ///
    /// # Errors
    /// [`Error::Unusable`] for the first that is missing, [`Error::Io`] and [`Error::Format`] for a broken `pair.json`.
    pub fn check_files(&self) -> Result<(), Error> {
        let Kind::Stored(pairs) = &self.kind else { return Ok(()) };
        for (id, pair) in pairs {
            if let Some(path) = pair.open()?.missing() {
                let what = format!("pair {id} of `{}`", self.name);
                return Err(unusable(what, format!("`{}` is missing", path.display())));
            }
        }
        Ok(())
    }

    /// The pair's name in messages.
    pub(super) fn label(&self, draw: &Draw) -> String {
        let id = match &self.kind {
            Kind::Stored(pairs) => pairs[draw.item_idx as usize].0,
            Kind::Flight(flight) => draw.pass * flight.num_pairs() + draw.item_idx,
        };
        format!("pair {id} of `{}`", self.name)
    }

    pub(super) fn fetch(&self, draw: &Draw, request: &Request<'_>) -> Result<Fetched, Error> {
        let fetched = match &self.kind {
            Kind::Stored(pairs) => {
                let (pair_id, pair) = &pairs[draw.item_idx as usize];
                fetch_stored(*pair_id, pair, request)?
            }
            Kind::Flight(flight) => flight.fetch(draw, request)?,
        };
        for (view, name) in fetched.views.iter().zip(["a", "b"]) {
            if !view.camera.distortion.is_none() {
                return Err(unusable(
                    self.label(draw),
                    format!("view {name} has lens distortion; rectify it first"),
                ));
            }
            if fetched.has_depth && !view.truth.has_depth() {
                return Err(unusable(self.label(draw), format!("view {name} has no pixel with depth")));
            }
        }
        Ok(fetched)
    }
}

fn fetch_stored(pair_id: u64, stored: &StoredPair, request: &Request<'_>) -> Result<Fetched, Error> {
    let pair = stored.open()?;
    let numbers = pair.lights();
    let here = || stored.place.root().display().to_string();
    if numbers.is_empty() {
        return Err(unusable(here(), "it has no picture"));
    }
    let lights = request.augmentation.lights(numbers.len(), request.seed, request.position);
    let [has_depth, other] = ViewName::BOTH.map(|view| stored.has_depth(view));
    if has_depth != other {
        return Err(unusable(here(), "one view has depth and the other has none"));
    }
    let fetch = |name: ViewName| {
        let raw = if has_depth { Some(pair.raw_view(name)?) } else { None };
        let (camera, world_from_cam) = match (pair.camera_record(name)?, &raw) {
            (Some(record), _) => (record.camera()?, record.world_from_cam()),
            (None, Some(raw)) => (raw.camera()?, raw.world_from_cam()?),
            (None, None) => return Err(unusable(here(), "it has no camera")),
        };
        let size = (camera.width, camera.height);
        let levels = levels(&pair.picture(name, numbers[lights[name as usize]], size)?);
        let depth_z = raw.map_or_else(|| Raster::filled(size.0, size.1, f32::NAN), |raw| raw.depth_or_nan());
        Ok::<_, Error>(UndevelopedView { levels, camera, truth: ViewTruth { depth_z, world_from_cam } })
    };
    let views = [fetch(ViewName::A)?, fetch(ViewName::B)?];
    Ok(Fetched { pair_id, lights, views, has_depth, sights: None, is_shaped: false })
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
