//! `pair.json`: what two views have in common, and where an imported pair comes from.

use super::camera::PlaceRecord;
use super::json::RECORD_VERSION;
use super::name::{Trajectory, ViewName};
use crate::plan::SunAngles;
use selenograph_geometry::{Body, BodyFixed, Cam, Geodetic, PixelConvention, Point3, Rigid3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The name in [`PairRecord::format`].
const PAIR_FORMAT: &str = "selenograph.pair";

/// One Sun of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SunRecord {
    /// Clockwise from north at the pair's site, degrees in `[0, 360)`.
    pub azimuth_deg: f64,
    /// Above the site's horizon, degrees; below 0 the picture is dark.
    pub elevation_deg: f64,
    /// Unit vector towards the Sun, in the world frame.
    pub direction: [f64; 3],
    /// Angular radius of the disc, degrees (0: a point).
    pub angular_radius_deg: f64,
}

impl SunRecord {
    /// The Sun at a place in the sky of a site.
    pub fn new(angles: &SunAngles, body: &Body, site: &Geodetic, angular_radius_deg: f64) -> Self {
        Self {
            azimuth_deg: angles.azimuth_deg,
            elevation_deg: angles.elevation_deg,
            direction: angles.direction(body, site).into(),
            angular_radius_deg,
        }
    }

    /// Its place in the sky.
    pub fn angles(&self) -> SunAngles {
        SunAngles { azimuth_deg: self.azimuth_deg, elevation_deg: self.elevation_deg }
    }
}

/// How radiance became grey levels, one per image: `full_scale × clip(gain × radiance_factor + offset, 0, 1)`, rounded to
/// the nearest level with 16 bits and down with 8 bits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureRecord {
    /// Which Sun (index into [`PairRecord::suns`]).
    pub light_idx: usize,
    /// Which view.
    pub view: ViewName,
    /// `pair-gain` (both views alike) or `min-max` (each image by itself).
    pub tone: String,
    /// Full scales per unit of radiance factor (I/F).
    pub gain: f64,
    /// Share of full scale at no radiance.
    pub offset: f64,
    /// Bits per grey level.
    pub bits: u8,
    /// Share of pixels above full scale.
    pub saturated_share: f64,
    /// Share of the valid pixels that the Sun's centre lights.
    pub lit_share: f64,
}

/// How much of one view the other one sees: shares of the view's pixels, `[0, 1]`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OverlapRecord {
    /// Pixels of A whose ground lies inside B's frame (occlusion left aside).
    pub a_in_b: f64,
    /// The same from B.
    pub b_in_a: f64,
    /// Pixels of A whose ground B really sees.
    pub a_seen_by_b: f64,
    /// The same from B.
    pub b_seen_by_a: f64,
}

/// `pair.json`: what two views have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PairRecord {
    /// Always `selenograph.pair`.
    pub format: String,
    /// [`RECORD_VERSION`].
    pub version: u32,
    /// Number in the plan.
    pub pair_id: u64,
    /// How it was flown; absent where the source of an imported pair does not tell.
    pub trajectory: Option<Trajectory>,
    /// The body; its `frame` names the world of every vector here.
    pub body: Body,
    /// The ground that the pair was aimed at; azimuths and elevations are told here.
    pub site: PlaceRecord,
    /// From A's centre of projection to B's, world axes, metres.
    pub baseline_vector_m: [f64; 3],
    /// Its length, metres.
    pub baseline_m: f64,
    /// Baseline over the mean of the two altitudes over the site's height.
    pub baseline_over_height: f64,
    /// Altitude of B over that of A, both over the site's height.
    pub altitude_ratio: f64,
    /// `[R | t]` of B's camera frame from A's, rows first, metres.
    pub cam_b_from_cam_a: [[f64; 4]; 3],
    /// Angle of that rotation, degrees.
    pub relative_rotation_deg: f64,
    /// Angle at the site between the directions to the two cameras, degrees.
    pub convergence_deg: f64,
    /// The lights, in file order; null where the source of an imported pair does not tell its Sun.
    pub suns: Vec<Option<SunRecord>>,
    /// One per image: lights in order, A before B. Empty for imported pairs.
    pub exposures: Vec<ExposureRecord>,
    /// Overlap both ways.
    pub overlap: OverlapRecord,
    /// Every file of the pair beside this one, with its BLAKE3 checksum (hex).
    pub files: BTreeMap<String, String>,
    /// Where an imported pair comes from; absent for pairs that were rendered here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<SourceRecord>,
}

/// Which Suns the records of triplets get: the files hold none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ImportedSuns {
    /// None: absent.
    #[default]
    Unknown,
    /// The three of the authors' scripts, in the frame of the site, for nadir and oblique folders.
    Scripts,
}

/// Where an imported pair comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceRecord {
    /// Always `stereolunar`.
    pub format: String,
    /// The folder of the triplets.
    pub scene: String,
    /// Number of the pair there.
    pub pair_id: u64,
    /// Numbers of its lights there, one per light here.
    pub lights: Vec<u64>,
    /// What the camera matrices were taken for.
    pub k_pixel_convention: PixelConvention,
    /// How the source stores depth: `half` (11 significant bits) or `float`.
    pub depth_stored: String,
    /// Where the Suns here are from.
    pub suns: ImportedSuns,
    /// The files read, with their BLAKE3 checksums (hex).
    pub files: BTreeMap<String, String>,
}

impl PairRecord {
    /// What follows from two poses over a site; the rest is absent or empty.
    pub fn new(
        pair_id: u64,
        body: &Body,
        site: &Geodetic,
        [world_from_a, world_from_b]: [&Rigid3<BodyFixed, Cam>; 2],
    ) -> Self {
        let relative = RelativeGeometry::new(body, site, world_from_a, world_from_b);
        Self {
            format: PAIR_FORMAT.into(),
            version: RECORD_VERSION,
            pair_id,
            trajectory: None,
            body: body.clone(),
            site: PlaceRecord::from_place(site),
            baseline_vector_m: relative.baseline_vector_m.into(),
            baseline_m: relative.baseline_vector_m.norm(),
            baseline_over_height: relative.baseline_over_height,
            altitude_ratio: relative.altitude_ratio,
            cam_b_from_cam_a: relative.cam_b_from_cam_a.rows_3x4(),
            relative_rotation_deg: relative.relative_rotation_rad.to_degrees(),
            convergence_deg: relative.convergence_rad.to_degrees(),
            suns: Vec::new(),
            exposures: Vec::new(),
            overlap: OverlapRecord::default(),
            files: BTreeMap::new(),
            source: None,
        }
    }
}

/// Baseline, rotation and angles of two poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeGeometry {
    /// From A to B, world axes, metres.
    pub baseline_vector_m: Vector3<f64>,
    /// Baseline over mean altitude over the site.
    pub baseline_over_height: f64,
    /// Altitude of B over that of A.
    pub altitude_ratio: f64,
    /// B's camera frame from A's.
    pub cam_b_from_cam_a: Rigid3<selenograph_geometry::CamB, selenograph_geometry::CamA>,
    /// Angle of the rotation, radians.
    pub relative_rotation_rad: f64,
    /// Angle at the site, radians.
    pub convergence_rad: f64,
}

impl RelativeGeometry {
    /// Of two poses over a site.
    pub fn new(
        body: &Body,
        site: &Geodetic,
        world_from_a: &Rigid3<BodyFixed, Cam>,
        world_from_b: &Rigid3<BodyFixed, Cam>,
    ) -> Self {
        let (a, b) = (world_from_a.origin(), world_from_b.origin());
        let ground = body.point(site);
        let altitude = |p: &Point3<f64>| body.height_m(p) - site.height_m;
        let baseline_vector_m = b - a;
        let cam_b_from_cam_a = (&world_from_b.inverse() * world_from_a).relabel();
        Self {
            baseline_vector_m,
            baseline_over_height: baseline_vector_m.norm() / (0.5 * (altitude(&a) + altitude(&b))),
            altitude_ratio: altitude(&b) / altitude(&a),
            cam_b_from_cam_a,
            relative_rotation_rad: cam_b_from_cam_a.rotation_angle_rad(),
            convergence_rad: (a - ground).angle(&(b - ground)),
        }
    }
}
