//! Plans: which pairs a campaign holds, with every number that was drawn for them.
//!
//! A row is a pure function of the campaign, the terrain and the pair's number: the shard, the order and the number of
//! threads change nothing.

mod campaign;
pub(crate) mod coverage;
mod flight;
pub(crate) mod ground;
pub(crate) mod interval;
mod lighting;
pub mod preset;
pub(crate) mod rendering;
mod sections;
mod site;
mod table;

pub use campaign::{Campaign, Placement};
pub use coverage::Refusal;
pub use interval::Interval;
pub use lighting::{Light, SunAngles};
pub use preset::PRESETS;
pub use table::{PlacedPair, Plan, PoseRow, Row};

use crate::Error;
use crate::pair::{RelativeGeometry, Trajectory};
use crate::rng::{Stream, rng};
use flight::{Aim, Parameters};
use ground::Footprint;
use rayon::prelude::*;
use selenograph_geometry::{Camera, Geodetic};
use selenograph_render::{Tracer, Viewpoint};
use selenograph_terrain::Terrain;
use site::SiteSampler;
use std::collections::BTreeMap;

/// Makes the rows of a campaign on a terrain.
pub struct Planner<'a> {
    campaign: &'a Campaign,
    tracer: &'a Tracer<'a>,
    camera: Camera,
    samplers: Vec<(Trajectory, SiteSampler<'a>)>,
}

/// What a pair's number says before anything is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Slot {
    trajectory: Trajectory,
    pair_in_trajectory: u64,
    pair_in_level: u64,
    level_m: f64,
}

impl<'a> Planner<'a> {
    /// For a campaign and a terrain; `tracer` must interpolate as the campaign renders.
    ///
    /// # Errors
    /// As [`Campaign::check`].
    pub fn new(campaign: &'a Campaign, tracer: &'a Tracer<'a>) -> Result<Self, Error> {
        campaign.check()?;
        let camera = campaign.camera.camera()?;
        let terrain: &'a Terrain = tracer.terrain();
        let samplers =
            Trajectory::ALL.map(|t| (t, SiteSampler::new(campaign, terrain, t))).into_iter().collect();
        Ok(Self { campaign, tracer, camera, samplers })
    }

    /// Number of pairs of the campaign; their numbers run from 0.
    pub fn num_pairs(&self) -> u64 {
        self.campaign.num_pairs()
    }

    /// All rows, in order. `progress` is told after each pair how many are done (from several threads).
    pub fn plan(&self, progress: &(dyn Fn(u64) + Sync)) -> Plan {
        let done = std::sync::atomic::AtomicU64::new(0);
        let ids: Vec<u64> = (0..self.num_pairs()).collect();
        let rows = ids
            .into_par_iter()
            .map(|id| {
                let row = self.row(id);
                progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1);
                row
            })
            .collect();
        Plan { rows }
    }

    fn slot(&self, pair_id: u64) -> Slot {
        let mut left = pair_id;
        for (trajectory, pairs) in self.campaign.pairs_by_trajectory() {
            if left >= pairs {
                left -= pairs;
                continue;
            }
            let levels = self.campaign.altitude_levels_m(trajectory);
            let num_levels = levels.len() as u64;
            // The scripts fly level after level; otherwise the levels take turns, so that every part of a campaign
            // has them all.
            let (level_idx, pair_in_level) = match self.campaign.sites.placement {
                Placement::ScriptGrid => {
                    let level = left * num_levels / pairs;
                    (level, left - (level * pairs).div_ceil(num_levels))
                }
                Placement::Area | Placement::Layers => (left % num_levels, left / num_levels),
            };
            return Slot {
                trajectory,
                pair_in_trajectory: left,
                pair_in_level,
                level_m: levels[level_idx as usize],
            };
        }
        // Numbers beyond the campaign do not come from its plan; they read as a pair of the first section.
        Slot { trajectory: Trajectory::Nadir, pair_in_trajectory: left, pair_in_level: left, level_m: 1.0 }
    }

    /// The row of one pair.
    pub fn row(&self, pair_id: u64) -> Row {
        let slot = self.slot(pair_id);
        let seed = self.campaign.seed;
        let mut sites = rng(seed, "pair", pair_id, "site");
        let mut flights = rng(seed, "pair", pair_id, "flight");
        let mut suns = rng(seed, "pair", pair_id, "sun");
        let mut refusals = BTreeMap::new();
        for attempt in 0..self.campaign.limits.max_attempts {
            match self.attempt(&slot, attempt, &mut sites, &mut flights, &mut suns) {
                Ok(placed) => {
                    return Row {
                        pair_id,
                        trajectory: slot.trajectory,
                        level_m: slot.level_m,
                        attempts: attempt + 1,
                        refusals,
                        placed: Some(placed),
                    };
                }
                Err(refusal) => *refusals.entry(refusal).or_insert(0) += 1,
            }
        }
        let attempts = self.campaign.limits.max_attempts;
        Row { pair_id, trajectory: slot.trajectory, level_m: slot.level_m, attempts, refusals, placed: None }
    }

    fn attempt(
        &self,
        slot: &Slot,
        attempt: u32,
        sites: &mut Stream,
        flights: &mut Stream,
        suns: &mut Stream,
    ) -> Result<PlacedPair, Refusal> {
        let terrain = self.tracer.terrain();
        let body = &terrain.body;
        let site = self.site(slot, attempt, sites)?;
        let aim = Aim {
            body,
            site,
            level_m: slot.level_m,
            pair_in_level: slot.pair_in_level,
            footprint_per_m: self.footprint_per_m(),
        };
        let mut drawn = Parameters::new();
        let poses = flight::poses(self.campaign, slot.trajectory, &aim, flights, &mut drawn)
            .map_err(|_| Refusal::Degenerate)?;
        let low_light = slot.trajectory == Trajectory::LowLight;
        let elevation = low_light.then_some(self.campaign.low_light.elevation_deg);
        let suns = lighting::draw_suns(&self.campaign.lights, elevation, suns);
        // Through the row's own numbers, so that what is checked is what a reader of the table renders.
        let [a, b] = poses.map(|pose| PoseRow::from_pose(&pose));
        let placed =
            PlacedPair { site, a, b, camera: self.camera.clone(), suns, parameters: drawn_map(&drawn) };
        self.check(slot.trajectory, &placed)?;
        Ok(placed)
    }

    /// Width of the ground that a camera sees from one metre, straight down.
    fn footprint_per_m(&self) -> f64 {
        self.camera.width as f64 / self.camera.fx
    }

    /// A site with the median height of the ground round it.
    fn site(&self, slot: &Slot, attempt: u32, stream: &mut Stream) -> Result<Geodetic, Refusal> {
        let terrain = self.tracer.terrain();
        let width = self.campaign.sites.footprint_m.unwrap_or(self.footprint_per_m() * slot.level_m);
        let gsd_m = slot.level_m / self.camera.fx;
        let sampler = self.samplers.iter().find(|(t, _)| *t == slot.trajectory);
        let mut draw = |attempt: u32| -> Result<(Geodetic, Footprint), Refusal> {
            let place = sampler.and_then(|(_, s)| s.draw(slot.pair_in_trajectory, attempt, gsd_m, stream));
            let place = place.ok_or(Refusal::NoFineLayer)?;
            let ground = ground::footprint(terrain, &place, width).ok_or(Refusal::TerrainAbsent)?;
            Ok((place, ground))
        };
        let first = draw(attempt);
        let (place, ground) = if slot.trajectory == Trajectory::LowLight {
            // The flattest of several, among those that the terrain carries.
            let others = (1..self.campaign.low_light.candidates).map(|_| draw(attempt)).collect::<Vec<_>>();
            std::iter::once(first)
                .chain(others)
                .flatten()
                .min_by(|x, y| x.1.relief_m.total_cmp(&y.1.relief_m))
                .ok_or(first.err().unwrap_or(Refusal::TerrainAbsent))?
        } else {
            first?
        };
        Ok(Geodetic { height_m: ground.median_m, ..place })
    }

    fn check(&self, trajectory: Trajectory, placed: &PlacedPair) -> Result<(), Refusal> {
        let body = &self.tracer.terrain().body;
        let views = placed.views();
        if trajectory == Trajectory::Descent {
            let [a, b] = &views;
            if !coverage::epipole_inside(&a.camera, &a.world_from_cam, &b.origin())
                || !coverage::epipole_inside(&b.camera, &b.world_from_cam, &a.origin())
            {
                return Err(Refusal::Epipole);
            }
        }
        if trajectory == Trajectory::Oblique {
            let [a, b] = [&placed.a, &placed.b].map(PoseRow::pose);
            let b_over_h = RelativeGeometry::new(body, &placed.site, &a, &b).baseline_over_height;
            if b_over_h < self.campaign.oblique.min_b_over_h {
                return Err(Refusal::Baseline);
            }
        }
        let min_overlap = match trajectory {
            Trajectory::NoOverlap => 0.0,
            _ => self.campaign.limits.min_overlap,
        };
        let suns: Vec<_> = placed.suns.iter().map(|s| s.direction(body, &placed.site)).collect();
        let sigma = self.campaign.render.psf_sigma_px;
        coverage::check_pair(self.tracer, &views, &self.campaign.limits, sigma, min_overlap, &suns)
    }
}

fn drawn_map(drawn: &Parameters) -> BTreeMap<String, f64> {
    drawn.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

impl PlacedPair {
    /// The two views to render.
    pub fn views(&self) -> [Viewpoint; 2] {
        [&self.a, &self.b].map(|pose| Viewpoint { camera: self.camera.clone(), world_from_cam: pose.pose() })
    }
}

#[cfg(test)]
mod tests;
