//! The records of a pair against what they are derived from: the code that writes them, run again on poses, plan and pictures.
//!
//! What needs the terrain or the radiance is held between the bounds that the pair itself gives, and kept as told within
//! them: a camera's altitude over the terrain ([`nadir`](super::nadir), where a view sees the ground straight below), the gain
//! and offset of an exposure ([`exposure`](super::exposure)), and which of the ground in the other frame is hidden.

use super::dataset::Dataset;
use super::nadir;
use super::report::{Code, Finding, Severity};
use super::reprojection::{Carrier, DepthView};
use crate::Error;
use crate::generate::scene::OVERLAP_STRIDE;
use crate::import::triplets as import;
use crate::pair::{
    CameraRecord, ImportedSuns, OverlapRecord, PAIR_NAME, PairRecord, SunRecord, ViewMeasures, ViewName,
    camera_name, correspondence_name,
};
use crate::photometric;
use crate::plan::coverage::in_frame;
use crate::plan::{Campaign, PlacedPair, Row};
use crate::stored::triplets::trajectory_of;
use crate::stored::{OpenPair, RawView, StoredPair};
use selenograph_geometry::{BodyFixed, Cam, Camera, Geodetic, Point2, Rigid3, pixel};
use selenograph_raster::Raster;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeSet;

/// What is told of a pair, and what it is held against.
pub(super) struct Told<'a> {
    pub stored: &'a StoredPair,
    pub open: &'a OpenPair<'a>,
    pub record: &'a PairRecord,
    pub cameras: [CameraRecord; 2],
    /// A and B as they are stored.
    pub views: [&'a RawView; 2],
    /// Their z-depth, metres.
    pub depths: [&'a Raster<f32>; 2],
    pub dataset: Option<&'a Dataset>,
}

/// A camera and its pose.
type Posed = (Camera, Rigid3<BodyFixed, Cam>);

/// Every number of the three records that is not what it is derived from: one finding for each record.
pub(super) fn check(told: &Told<'_>) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut compare = |file: &str, differing: Result<Vec<String>, Error>| {
        let place = told.stored.place.path(file).display().to_string();
        let message = match differing {
            Ok(differing) if differing.is_empty() => return,
            Ok(differing) => {
                let more = differing.len().saturating_sub(SHOWN);
                let more = if more == 0 { String::new() } else { format!("; and {more} more") };
                let shown = differing[..differing.len().min(SHOWN)].join("; ");
                format!("not what poses, plan and pictures give: {shown}{more}")
            }
            Err(error) => format!("cannot be derived again: {error}"),
        };
        findings.push(
            Finding::new(Severity::Error, Code::Record, place, message)
                .hint("delete the pair's folder and run the same `generate` again, or import it again"),
        );
    };
    for (idx, view) in ViewName::BOTH.into_iter().enumerate() {
        let again = told.camera(idx).and_then(|again| differences(&told.cameras[idx], &again));
        compare(&camera_name(view), again);
    }
    compare(PAIR_NAME, told.pair().and_then(|again| differences(told.record, &again)));
    findings
}

/// Differences of one record that are shown; the rest is counted.
const SHOWN: usize = 3;

impl Told<'_> {
    fn row(&self) -> Option<&Row> {
        self.dataset?.row(self.stored.pair_id)
    }

    fn placed(&self) -> Option<&PlacedPair> {
        self.row()?.placed.as_ref()
    }

    pub(super) fn campaign(&self) -> Option<&Campaign> {
        self.dataset?.campaign.as_ref()
    }

    /// The plan's camera and pose, or else the record's own.
    fn posed(&self, idx: usize) -> Result<Posed, Error> {
        match self.placed() {
            Some(placed) => {
                let view = placed.views()[idx].clone();
                Ok((view.camera, view.world_from_cam))
            }
            None => Ok((self.cameras[idx].camera()?, self.cameras[idx].world_from_cam())),
        }
    }

    fn camera(&self, idx: usize) -> Result<CameraRecord, Error> {
        let told = &self.cameras[idx];
        let (camera, world_from_cam) = self.posed(idx)?;
        let derived = ViewMeasures::of_depth(self.depths[idx].data.iter().map(|z| f64::from(*z)), &camera);
        let measures = ViewMeasures {
            altitude_over_terrain_m: self.altitude_over_terrain_m(idx)?,
            gsd_m: derived.gsd_m.map(|gsd_m| kept(told.gsd_m, gsd_m, F32_STEP * gsd_m)),
            ..derived
        };
        let told_pitch = told.sensor.width_mm / told.sensor.width_px.max(1) as f64;
        let pitch = self.campaign().map_or(told_pitch, |campaign| campaign.camera.pixel_pitch_mm);
        let view = ViewName::BOTH[idx];
        let again = CameraRecord::new(view, &self.record.body, &camera, &world_from_cam, pitch, measures);
        let k = camera.k(told.k_pixel_convention);
        let k = std::array::from_fn(|i| std::array::from_fn(|j| k[(i, j)]));
        Ok(CameraRecord { k, k_pixel_convention: told.k_pixel_convention, ..again })
    }

    /// As it is told where it agrees with the ground that a view sees straight below. Where none does, a camera of a campaign
    /// keeps the campaign's clearance, and any camera is above ground.
    fn altitude_over_terrain_m(&self, idx: usize) -> Result<Option<f64>, Error> {
        // An import has no terrain to ask.
        if self.record.source.is_some() {
            return Ok(None);
        }
        let told = self.cameras[idx].altitude_over_terrain_m;
        let posed = [self.posed(0)?, self.posed(1)?];
        let [own, other] = [idx, 1 - idx].map(|idx| self.depth_view(idx, &posed));
        let position = own.world_from_cam.origin();
        let body = &self.record.body;
        Ok(match nadir::below(&position, body, [&own, &other]) {
            Some(ground) => Some(kept(told, body.height_m(&position) - ground.height_m, ground.tolerance_m)),
            None => {
                let least = self.campaign().map_or(0.0, |campaign| campaign.limits.min_clearance_m);
                told.map(|told| told.max(least))
            }
        })
    }

    fn depth_view<'b>(&'b self, idx: usize, posed: &'b [Posed; 2]) -> DepthView<'b> {
        DepthView { camera: &posed[idx].0, world_from_cam: &posed[idx].1, depth_z: self.depths[idx] }
    }

    fn pair(&self) -> Result<PairRecord, Error> {
        let record = self.record;
        let posed = [self.posed(0)?, self.posed(1)?];
        let [a, b] = [0, 1].map(|idx| self.depth_view(idx, &posed));
        let (mut trajectory, mut site, mut overlap) =
            (record.trajectory, record.site.place(), self.overlap([&a, &b]));
        if let Some(source) = &record.source {
            trajectory = trajectory_of(&source.scene);
            site = import::site(trajectory, [&a, &b], &record.body)?;
            overlap = import::overlap([&a, &b]);
        } else if let (Some(row), Some(placed)) = (self.row(), self.placed()) {
            trajectory = Some(row.trajectory);
            site = placed.site;
        }
        let poses = [a.world_from_cam, b.world_from_cam];
        Ok(PairRecord {
            trajectory,
            suns: self.suns(&site),
            exposures: self.exposures()?,
            overlap,
            files: self.files(),
            source: record.source.clone(),
            ..PairRecord::new(self.stored.pair_id, &record.body, &site, poses)
        })
    }

    fn suns(&self, site: &Geodetic) -> Vec<Option<SunRecord>> {
        let body = &self.record.body;
        if let Some(placed) = self.placed() {
            let radius_deg = |told: Option<&Option<SunRecord>>| match (self.campaign(), told) {
                (Some(campaign), _) => campaign.render.sun_angular_radius_deg,
                (None, Some(Some(told))) => told.angular_radius_deg,
                (None, _) => 0.0,
            };
            let again = placed.suns.iter().enumerate();
            return again
                .map(|(n, sun)| Some(SunRecord::new(sun, body, site, radius_deg(self.record.suns.get(n)))))
                .collect();
        }
        let scripts = photometric::Settings::default().suns;
        let source = self.record.source.as_ref().filter(|source| source.suns == ImportedSuns::Scripts);
        let of_script = |n: usize| scripts.get(usize::try_from(*source?.lights.get(n)?).ok()?).copied();
        let told = self.record.suns.iter().enumerate();
        told.map(|(n, told)| {
            let told = (*told)?;
            let angles = of_script(n).unwrap_or_else(|| told.angles());
            Some(SunRecord::new(&angles, body, site, told.angular_radius_deg))
        })
        .collect()
    }

    /// Of a rendered pair.
    fn overlap(&self, [a, b]: [&DepthView<'_>; 2]) -> OverlapRecord {
        let told = &self.record.overlap;
        let stride = match self.stored.place.has(&correspondence_name(ViewName::A)) {
            true => 1,
            false => OVERLAP_STRIDE,
        };
        let share = |from: &DepthView<'_>, to: &DepthView<'_>, told: f64| {
            let (share, num_sampled) = share_in_frame(from, to, stride);
            kept(Some(told), share, EDGE_SHARE + EDGE_PIXELS / num_sampled)
        };
        let (a_in_b, b_in_a) = (share(a, b, told.a_in_b), share(b, a, told.b_in_a));
        OverlapRecord {
            a_in_b,
            b_in_a,
            a_seen_by_b: told.a_seen_by_b.clamp(0.0, a_in_b),
            b_seen_by_a: told.b_seen_by_a.clamp(0.0, b_in_a),
        }
    }

    /// With every file that a pair of its kind has, and none that is not there.
    fn files(&self) -> std::collections::BTreeMap<String, String> {
        let told = &self.record.files;
        let wanted: BTreeSet<String> = self.open.named_files().into_iter().collect();
        let unnamed = wanted.into_iter().filter(|file| !told.contains_key(file));
        let unnamed = unnamed.map(|file| (file, "the checksum of a file of this pair".to_owned()));
        told.clone().into_iter().chain(unnamed).collect()
    }
}

/// Half a step of f32, relative: depth is stored in it, and measured before.
const F32_STEP: f64 = 1e-6;
/// Pixels at the frame's edge, as a share and as a number: depth rounded to f32 may carry them to its other side.
const EDGE_SHARE: f64 = 1e-3;
const EDGE_PIXELS: f64 = 2.0;

/// The number that is told where it is near enough to the derived one.
pub(super) fn kept(told: Option<f64>, derived: f64, tolerance: f64) -> f64 {
    told.filter(|told| (told - derived).abs() <= tolerance).unwrap_or(derived)
}

/// Share of the pixels whose ground lies in the other frame, hidden or not, and how many were looked at.
pub(super) fn share_in_frame(from: &DepthView<'_>, to: &DepthView<'_>, stride: usize) -> (f64, f64) {
    let carrier = Carrier::new(from, to);
    let (mut num_inside, mut num_sampled) = (0usize, 0usize);
    for y in (0..from.depth_z.height).step_by(stride) {
        for x in (0..from.depth_z.width).step_by(stride) {
            num_sampled += 1;
            let center = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let landing = from.depth_at(x, y).and_then(|depth_z| carrier.carry(&center, depth_z));
            num_inside +=
                usize::from(landing.is_some_and(|landing| in_frame(to.camera, Some(landing.pixel))));
        }
    }
    let num_sampled = num_sampled.max(1) as f64;
    (num_inside as f64 / num_sampled, num_sampled)
}

/// Tolerances: rounding in f64 at the Moon's radius, and of an arc cosine near 0 for angles.
const MAX_DIFFERENCE: f64 = 1e-6;
const MAX_RELATIVE: f64 = 1e-9;
const MAX_DIFFERENCE_DEG: f64 = 1e-5;

/// Every value of a record that is another one when it is derived again.
fn differences(told: &impl Serialize, again: &impl Serialize) -> Result<Vec<String>, Error> {
    let value = |record: Result<Value, serde_json::Error>| {
        record.map_err(|error| Error::unexpected(PAIR_NAME.as_ref(), "finite numbers", error.to_string()))
    };
    let mut found = Vec::new();
    walk(&value(serde_json::to_value(told))?, &value(serde_json::to_value(again))?, "", &mut found);
    Ok(found)
}

fn walk(told: &Value, again: &Value, key: &str, found: &mut Vec<String>) {
    match (told, again) {
        (Value::Object(a), Value::Object(b)) => {
            let names: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for name in names {
                let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                let [a, b] = [a, b].map(|map| map.get(name).unwrap_or(&Value::Null));
                walk(a, b, &key, found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (n, (a, b)) in a.iter().zip(b).enumerate() {
                walk(a, b, &format!("{key}[{n}]"), found);
            }
        }
        (Value::Array(a), Value::Array(b)) => {
            found.push(format!("`{key}` has {} entries, derived {}", a.len(), b.len()));
        }
        _ if is_same(told, again, key) => {}
        _ => found.push(format!("`{key}` is {told}, derived {again}")),
    }
}

fn is_same(told: &Value, again: &Value, key: &str) -> bool {
    let (Some(told_number), Some(number)) = (told.as_f64(), again.as_f64()) else { return told == again };
    let difference = (told_number - number).abs();
    if key.ends_with("_deg") {
        return difference.min((360.0 - difference).abs()) <= MAX_DIFFERENCE_DEG;
    }
    difference <= MAX_DIFFERENCE + MAX_RELATIVE * number.abs()
}
