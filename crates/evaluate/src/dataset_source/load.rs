//! A pair in memory: cameras, poses, truth, pictures under the lights asked for, and what describes an item.

use super::entry::Entry;
use super::pixel_fault::PixelFault;
use crate::Error;
use crate::truth::{Precision, TruthPair, TruthView};
use selenograph_dataset::check::Ground;
use selenograph_dataset::check::reprojection::{DepthView, OUTLIER, warp};
use selenograph_dataset::pair::{PairRecord, RelativeGeometry, Trajectory, ViewName};
use selenograph_dataset::photometric::{self, SiteRule};
use selenograph_dataset::stored::OpenPair;
use selenograph_geometry::{Body, Geodetic, Point3, Vector3};
use selenograph_raster::codec::exr::SampleType;
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::View;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Every this many pixels across and down are warped for the overlap.
const OVERLAP_STEP: usize = 2;

/// Cameras, poses and depth of a pair as the metrics take them, a half-pixel fault mended; and whether depth was stored in 11
/// significant bits.
///
/// # Errors
/// [`Error::Dataset`] for files that are missing, broken or contradict each other, and for a view without depth.
pub fn read_truth(pair: &OpenPair<'_>, pixels: &PixelFault) -> Result<(TruthPair, bool), Error> {
    let view = |name: ViewName| {
        let raw = pair.agreed_view(name)?;
        let depth_z = raw.depth_or_nan();
        if depth_z.data.iter().all(|z| z.is_nan()) {
            let expected = "depth in at least one pixel";
            return Err(selenograph_dataset::Error::NoTruth { path: raw.path, expected });
        }
        let (camera, world_from_cam) = (pixels.mended(&raw.camera()?), raw.world_from_cam()?);
        let precision = Precision::of(&depth_z);
        Ok((TruthView { camera, world_from_cam, depth_z, precision }, raw.depth_stored == SampleType::Half))
    };
    let ((a, half_a), (b, half_b)) = (view(ViewName::A)?, view(ViewName::B)?);
    Ok((TruthPair { views: [a, b] }, half_a || half_b))
}

/// A view as depth is warped from it and into it.
pub(super) fn depth_view(view: &TruthView) -> DepthView<'_> {
    DepthView { camera: &view.camera, world_from_cam: &view.world_from_cam, depth_z: &view.depth_z }
}

/// What describes an item, whatever the method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ItemRecord {
    /// Name of the pair: items of one pair share their geometry.
    pub pair: String,
    /// How it was flown; null where nothing tells.
    pub trajectory: Option<Trajectory>,
    /// Number of the light of view A.
    pub light_a: u64,
    /// Number of the light of view B.
    pub light_b: u64,
    /// Angle between the two Suns, degrees; null where a Sun is not known and the lights differ.
    pub illumination_difference_deg: Option<f64>,
    /// Azimuth (clockwise from north) and elevation of A's Sun at the site, degrees; null where it is not known.
    pub sun_a_deg: Option<[f64; 2]>,
    /// The same of B.
    pub sun_b_deg: Option<[f64; 2]>,
    /// Mean of the two cameras' heights over the middle height of the ground that A sees, metres.
    pub altitude_m: f64,
    /// Median of `depth_z / f` of view A, metres per pixel.
    pub gsd_m: f64,
    /// Share of A's pixels whose ground B sees.
    pub overlap_share: f64,
    /// Distance between the cameras over the mean of their altitudes over the site, as in `pair.json`.
    pub baseline_over_height: f64,
    /// Angle of the rotation between the cameras, degrees.
    pub relative_rotation_deg: f64,
    /// Whether the truth was stored in 11 significant bits: slopes then have a ceiling.
    pub truth_is_half_float: bool,
}

/// A pair in memory.
#[derive(Debug, Clone)]
pub struct LoadedPair {
    /// Its name.
    pub name: String,
    /// How it was flown.
    pub trajectory: Option<Trajectory>,
    /// The body.
    pub body: Body,
    /// The ground that it was aimed at, where a record tells it.
    pub site: Option<Geodetic>,
    /// Cameras, poses, depth.
    pub truth: TruthPair,
    /// Whether depth was stored in 11 significant bits.
    pub is_half_float: bool,
    /// The pictures of A and B as fractions of white, by the number of their light.
    pub pictures: BTreeMap<u64, [Raster<f32>; 2]>,
    /// Lights whose pictures cannot be read, each with the reason.
    pub left_out: Vec<String>,
    /// Azimuth and elevation of the Sun at the site, degrees, by the number of the light.
    pub suns_deg: BTreeMap<u64, [f64; 2]>,
    /// Unit vectors to the Suns in the body's frame, by the number of the light; of triplets those of the authors' scripts.
    pub suns: BTreeMap<u64, Vector3<f64>>,
    /// Standard deviation of their directions, radians; 0 where the pictures were rendered with them.
    pub sun_sigma_rad: f64,
    /// Whether the pictures' grey levels were stretched from black to white: their zero is not that of light.
    pub is_stretched: bool,
}

impl LoadedPair {
    /// Reads a pair with the pictures of its lights; a broken picture costs its light.
    ///
    /// # Errors
    /// [`Error::Dataset`] and [`Error::Raster`] if cameras or truth are missing, broken or of another size.
    pub fn read(entry: &Entry, pixels: &PixelFault) -> Result<Self, Error> {
        let pair = entry.pair.open()?;
        let (truth, is_half_float) = read_truth(&pair, pixels)?;
        let (mut pictures, mut left_out) = (BTreeMap::new(), Vec::new());
        let lights: BTreeSet<u64> = entry.lights.iter().flatten().copied().collect();
        for light in lights {
            match read_pictures(&pair, light, &truth) {
                Ok(both) => drop(pictures.insert(light, both)),
                Err(error) => left_out.push(format!("{} light {light}: {error}", entry.name)),
            }
        }
        let site = pair.record.as_ref().map(|record| record.site.place());
        let recorded = pair.record.iter().flat_map(|record| (0..).zip(&record.suns));
        let suns = recorded.filter_map(|(light, sun)| {
            let direction = Vector3::from(sun.as_ref()?.direction).try_normalize(0.0)?;
            Some((light, direction))
        });
        let (mut suns, mut sun_sigma_rad): (BTreeMap<_, _>, _) = (suns.collect(), 0.0);
        let foreign = pair.record.as_ref().is_none_or(|record| record.source.is_some());
        if foreign {
            sun_sigma_rad = scripts_sigma_rad(entry.trajectory);
        }
        if pair.record.is_none() {
            suns = scripts_suns(entry.trajectory, &truth);
        }
        let (body, suns_deg) = body_and_suns(pair.record);
        Ok(Self {
            name: entry.name.clone(),
            trajectory: entry.trajectory,
            body,
            site,
            truth,
            is_half_float,
            pictures,
            left_out,
            suns_deg,
            suns,
            sun_sigma_rad,
            is_stretched: foreign,
        })
    }

    /// The pictures of an item with their cameras; `None` for a light that was not read.
    pub fn views(&self, [light_a, light_b]: [u64; 2]) -> Option<[View; 2]> {
        let view = |light: u64, k: usize| {
            Some(View {
                image: self.pictures.get(&light)?[k].clone(),
                camera: self.truth.views[k].camera.clone(),
            })
        };
        Some([view(light_a, 0)?, view(light_b, 1)?])
    }

    /// Unit vectors to the Suns of an item, each in its camera's axes, where they are known.
    pub fn suns_in_cams(&self, [light_a, light_b]: [u64; 2]) -> [Option<Vector3<f64>>; 2] {
        let sun = |light: u64, k: usize| {
            Some(self.truth.views[k].world_from_cam.inverse().vector(self.suns.get(&light)?))
        };
        [sun(light_a, 0), sun(light_b, 1)]
    }

    /// What describes the items of the lights asked for.
    pub fn items(&self, lights: &[[u64; 2]]) -> Vec<ItemRecord> {
        let of_pair = self.pair_item();
        lights
            .iter()
            .map(|&[light_a, light_b]| {
                let [sun_a_deg, sun_b_deg] =
                    [light_a, light_b].map(|light| self.suns_deg.get(&light).copied());
                let angle_deg =
                    sun_a_deg.zip(sun_b_deg).map(|(a, b)| direction(a).angle(&direction(b)).to_degrees());
                ItemRecord {
                    light_a,
                    light_b,
                    illumination_difference_deg: if light_a == light_b { Some(0.0) } else { angle_deg },
                    sun_a_deg,
                    sun_b_deg,
                    ..of_pair.clone()
                }
            })
            .collect()
    }

    fn pair_item(&self) -> ItemRecord {
        let [a, b] = self.truth.views.each_ref().map(depth_view);
        let warped = warp(&a, &b, OVERLAP_STEP);
        let seen = warped.relative_errors.iter().filter(|error| error.abs() < OUTLIER).count();
        let along = |side: usize| (OVERLAP_STEP / 2..side).step_by(OVERLAP_STEP).count();
        let num_warped = (along(a.camera.width) * along(a.camera.height)).max(1);
        let depths = self.truth.views[0].depth_z.data.iter().map(|z| f64::from(*z));
        let median_z = statistics::median(depths).unwrap_or(f64::NAN);
        let ground = self.truth.views[0].world_from_cam.point(&Point3::new(0.0, 0.0, median_z));
        let ground_height = self.body.height_m(&ground);
        let [high_a, high_b] =
            [&a, &b].map(|view| self.body.height_m(&view.world_from_cam.origin()) - ground_height);
        let altitude_m = 0.5 * (high_a + high_b);
        let ground = Ground { body: &self.body, site: self.site, trajectory: self.trajectory };
        let relative =
            RelativeGeometry::new(&self.body, &ground.site([&a, &b]), a.world_from_cam, b.world_from_cam);
        ItemRecord {
            pair: self.name.clone(),
            trajectory: self.trajectory,
            light_a: 0,
            light_b: 0,
            illumination_difference_deg: None,
            sun_a_deg: None,
            sun_b_deg: None,
            altitude_m,
            gsd_m: a.camera.gsd_m(median_z),
            overlap_share: seen as f64 / num_warped as f64,
            baseline_over_height: relative.baseline_over_height,
            relative_rotation_deg: relative.relative_rotation_rad.to_degrees(),
            truth_is_half_float: self.is_half_float,
        }
    }
}

/// Standard deviation of the scripts' Suns, degrees: how far those fitted to the public samples lie from them where the poses tell the
/// site, and where it is only near what A looks at.
const SCRIPTS_SIGMA_DEG: [f64; 2] = [0.2, 1.5];

fn scripts_rule(trajectory: Option<Trajectory>) -> Option<SiteRule> {
    trajectory.and_then(SiteRule::of_trajectory)
}

fn scripts_sigma_rad(trajectory: Option<Trajectory>) -> f64 {
    let [sure, near] = SCRIPTS_SIGMA_DEG;
    if scripts_rule(trajectory).is_some() { sure.to_radians() } else { near.to_radians() }
}

/// The Suns of the authors' scripts in the body's frame: their angles in the sky of the pair's site, which the poses tell for nadir and
/// oblique pairs; for others it is the ground in the middle of A.
fn scripts_suns(trajectory: Option<Trajectory>, truth: &TruthPair) -> BTreeMap<u64, Vector3<f64>> {
    let scripts = photometric::Settings::default();
    let [a, b] = &truth.views;
    let middle = || {
        let ground = Point3::new(0.0, 0.0, a.median_depth_z_m()?);
        Some(scripts.body.place(&a.world_from_cam.point(&ground)))
    };
    let told = scripts_rule(trajectory)
        .and_then(|rule| photometric::site(rule, &[a.world_from_cam, b.world_from_cam], &scripts.body).ok());
    let Some(site) = told.or_else(middle) else { return BTreeMap::new() };
    let suns = (0..).zip(&scripts.suns);
    suns.map(|(light, sun)| (light, sun.direction(&scripts.body, &site))).collect()
}

/// Unit vector towards a Sun in the site's frame.
fn direction([azimuth_deg, elevation_deg]: [f64; 2]) -> Vector3<f64> {
    let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    Vector3::new(elevation.cos() * azimuth.sin(), elevation.cos() * azimuth.cos(), elevation.sin())
}

/// The body, and azimuth and elevation of each Sun that is known.
fn body_and_suns(record: Option<PairRecord>) -> (Body, BTreeMap<u64, [f64; 2]>) {
    match record {
        Some(record) => {
            let suns = (0..).zip(record.suns);
            let known = suns.filter_map(|(light, sun)| Some((light, sun?)));
            (record.body, known.map(|(light, sun)| (light, [sun.azimuth_deg, sun.elevation_deg])).collect())
        }
        // Triplets hold no Sun; those of the authors' scripts were confirmed on the samples' pictures.
        None => {
            let scripts = photometric::Settings::default();
            let suns = (0..).zip(&scripts.suns);
            let angles = suns.map(|(light, sun)| (light, [sun.azimuth_deg, sun.elevation_deg])).collect();
            (scripts.body, angles)
        }
    }
}

/// The pictures of A and B as fractions of white.
fn read_pictures(pair: &OpenPair<'_>, light: u64, truth: &TruthPair) -> Result<[Raster<f32>; 2], Error> {
    let read = |view: ViewName| {
        let depth_z = &truth.views[view as usize].depth_z;
        Ok::<_, Error>(pair.picture(view, light, (depth_z.width, depth_z.height))?.to_unit_grey())
    };
    Ok([read(ViewName::A)?, read(ViewName::B)?])
}
