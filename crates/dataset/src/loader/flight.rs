//! A campaign flown while training: pairs planned and rendered in memory, at the size that is wanted.
//!
//! Roll is given to the cameras before anything is rendered, so that no pixel is resampled, and what one view sees of the
//! other is decided by rays.

use super::fetch::{Fetched, Request, unusable};
use super::order::Draw;
use crate::Error;
use crate::augment::{Augmentation, UndevelopedView};
use crate::correspondence::MatchRule;
use crate::covisibility;
use crate::generate::scene;
use crate::plan::{Campaign, PlacedPair, Planner};
use crate::rng::rng;
use crate::sample::ViewTruth;
use crate::split::{Footprint, footprint_of_views, share_ground};
use selenograph_geometry::{Projection, lookat};
use selenograph_raster::Raster;
use selenograph_render::{Error as RenderError, Exposure, Sun, Tracer, Truth, Viewpoint, radiance};
use selenograph_terrain::Terrain;
use std::sync::Arc;

/// A campaign over a terrain.
pub(super) struct Flight {
    campaign: Campaign,
    pub terrain: Arc<Terrain>,
    /// Ground that no pair may see, and the map it is told on.
    keep_out: Option<(Projection, Vec<Footprint>)>,
}

impl std::fmt::Debug for Flight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Flight").field("campaign", &self.campaign.name).finish_non_exhaustive()
    }
}

impl Flight {
    pub fn new(campaign: Campaign, terrain: Arc<Terrain>) -> Self {
        Self { campaign, terrain, keep_out: None }
    }

    pub fn num_pairs(&self) -> u64 {
        self.campaign.num_pairs()
    }

    pub fn keep_out(&mut self, map: Projection, ground: Vec<Footprint>) {
        self.keep_out = Some((map, ground));
    }

    /// The ground that a pair of the first pass sees, if it has a place and is not kept out of it.
    pub fn footprint(&self, pair_id: u64, map: &Projection) -> Result<Option<Footprint>, Error> {
        let tracer = Tracer::new(&self.terrain, self.campaign.render.surface);
        let row = Planner::new(&self.campaign, &tracer)?.row(pair_id);
        let Some(placed) = row.placed else { return Ok(None) };
        let views = placed.views();
        if self.is_kept_out(&tracer, &views, pair_id) {
            return Ok(None);
        }
        Ok(footprint_of_views(&tracer, &views, map, pair_id))
    }

    fn is_kept_out(&self, tracer: &Tracer<'_>, views: &[Viewpoint; 2], pair_id: u64) -> bool {
        let Some((map, ground)) = &self.keep_out else { return false };
        let footprint = footprint_of_views(tracer, views, map, pair_id);
        footprint.is_some_and(|own| ground.iter().any(|other| share_ground(&own, other)))
    }

    /// Latitude of the first pair that finds a place.
    pub fn site_latitude_deg(&self) -> Result<Option<f64>, Error> {
        let tracer = Tracer::new(&self.terrain, self.campaign.render.surface);
        let planner = Planner::new(&self.campaign, &tracer)?;
        let placed = (0..self.num_pairs()).find_map(|id| planner.row(id).placed);
        Ok(placed.map(|placed| placed.site.lat_rad.to_degrees()))
    }

    /// The campaign of a pass at a size.
    fn resized(&self, pass: u64, [width, height]: [usize; 2]) -> Campaign {
        let mut campaign = self.campaign.clone();
        if pass > 0 {
            campaign.seed = rng(self.campaign.seed, "campaign", pass, "pass").next_u64();
        }
        let camera = &mut campaign.camera;
        let scale = width as f64 / camera.width_px as f64;
        camera.focal_px = camera.focal_px.map(|focal| focal * scale);
        let down = height as f64 / camera.height_px as f64;
        camera.principal_point_px = camera.principal_point_px.map(|[x, y]| [x * scale, y * down]);
        (camera.width_px, camera.height_px) = (width, height);
        campaign
    }

    pub fn fetch(&self, draw: &Draw, request: &Request<'_>) -> Result<Fetched, Error> {
        let campaign = self.resized(draw.pass, request.size);
        let tracer = Tracer::new(&self.terrain, campaign.render.surface);
        let row = Planner::new(&campaign, &tracer)?.row(draw.item_idx);
        let pair_id = draw.pass * self.num_pairs() + draw.item_idx;
        let refuse = |why: &str| Err(unusable(format!("pair {pair_id} of `{}`", campaign.name), why));
        let Some(placed) = row.placed else { return refuse("it found no place on the terrain") };
        let views = rolled(&placed, request.augmentation, request.seed, request.position);
        if self.is_kept_out(&tracer, &views, pair_id) {
            return refuse("it sees ground that is held out");
        }
        let mut truths = Vec::with_capacity(2);
        for view in &views {
            match Truth::cast(&tracer, view) {
                Ok(truth) if truth.num_absent > 0 => return refuse("it sees beyond the terrain"),
                Ok(truth) => truths.push(truth),
                Err(RenderError::CameraBelowGround { .. }) => return refuse("a camera is below the ground"),
                Err(error) => return Err(error.into()),
            }
        }
        let lights = request.augmentation.lights(placed.suns.len(), request.seed, request.position);
        let suns = scene::suns(&self.terrain.body, &placed, &campaign.render)?;
        let pictures = pictures(&campaign, &tracer, pair_id, &views, &truths, lights.map(|n| &suns[n]))?;
        let sights = (request.match_rule == MatchRule::Seen).then(|| {
            [(0, 1), (1, 0)].map(|(from, to)| {
                covisibility::correspondence(&tracer, &views[from], &truths[from], &views[to], 1)
            })
        });
        let [a, b] = pictures;
        let make = |n: usize, levels: Raster<f32>| undeveloped(&views[n], &truths[n], levels);
        let views = [make(0, a)?, make(1, b)?];
        Ok(Fetched { pair_id, lights, views, has_depth: true, sights, is_shaped: true })
    }
}

/// The views of a pair, rolled as the sample's draws say.
fn rolled(placed: &PlacedPair, augmentation: &Augmentation, seed: u64, position: u64) -> [Viewpoint; 2] {
    let mut purposes = ["roll a", "roll b"].into_iter();
    placed.views().map(|mut view| {
        let mut stream = rng(seed, "sample", position, purposes.next().unwrap_or_default());
        if let Some(angle) = augmentation.roll_rad(&mut stream) {
            view.world_from_cam = lookat::rolled(&view.world_from_cam, angle);
        }
        view
    })
}

/// The grey levels of both views, each under its Sun: one exposure for both where it is the same Sun.
fn pictures(
    campaign: &Campaign,
    tracer: &Tracer<'_>,
    pair_id: u64,
    views: &[Viewpoint; 2],
    truths: &[Truth],
    suns: [&Sun; 2],
) -> Result<[Raster<f32>; 2], Error> {
    let render = |n: usize, name| {
        let settings = scene::radiance_settings(campaign, pair_id, name);
        let under = std::slice::from_ref(suns[n]);
        let mut pictures = radiance(tracer, &views[n], &truths[n], under, &settings)?;
        Ok::<_, Error>(pictures.swap_remove(0))
    };
    let (a, b) = (render(0, crate::pair::ViewName::A)?, render(1, crate::pair::ViewName::B)?);
    let tone = campaign.tone.tone();
    let exposures = if suns[0].direction == suns[1].direction {
        tone.exposures(&[&a, &b])
    } else {
        [tone.exposures(&[&a]), tone.exposures(&[&b])].concat()
    };
    let levels = |picture: &Raster<f32>, exposure: &Exposure| {
        // Not clipped at full scale: the camera that comes after may expose less.
        picture.map(|v| (255.0 * (exposure.gain * f64::from(*v) + exposure.offset)).max(0.0) as f32)
    };
    Ok([levels(&a, &exposures[0]), levels(&b, &exposures[1])])
}

fn undeveloped(view: &Viewpoint, truth: &Truth, levels: Raster<f32>) -> Result<UndevelopedView, Error> {
    // Nothing is absent here, so that a ray without a hit has gone past the terrain.
    let far = |z: &f64| if z.is_finite() { *z as f32 } else { f32::INFINITY };
    let depth_z = truth.depth_z.iter().map(far).collect();
    let depth_z = Raster::new(truth.width, truth.height, depth_z)?;
    let truth = ViewTruth { depth_z, world_from_cam: view.world_from_cam };
    Ok(UndevelopedView { levels, camera: view.camera.clone(), truth })
}
