//! What is measured of a pair and of a region: whole groups, or why there are none. The definitions take their numbers from here.

use super::prepared::{RegionTruth, TruthFacts};
use super::surface::SlopeScores;
use crate::alignment::Alignment;
use crate::calibration::Calibration;
use crate::cloud::CloudError;
use crate::depth_error::DepthError;
use crate::hazard::{HazardAgreement, LIMITS_DEG};
use crate::point_error::PointError;
use crate::pose_error::PoseError;
use crate::profile::ProfileError;

/// Something measured, or why it was not; no reason of its own is the reason of the whole region or pair.
pub(super) type Group<'a, T> = Result<T, Option<&'a str>>;
/// A number, or why there is none.
pub(super) type Number<'a> = Group<'a, f64>;

/// What a definition may take its number from.
pub(super) trait Found<'a> {
    fn number(self) -> Number<'a>;
}

impl<'a> Found<'a> for f64 {
    fn number(self) -> Number<'a> {
        Ok(self)
    }
}

impl<'a> Found<'a> for Option<f64> {
    fn number(self) -> Number<'a> {
        self.ok_or(None)
    }
}

impl<'a> Found<'a> for Number<'a> {
    fn number(self) -> Self {
        self
    }
}

/// A pair as a whole.
pub(super) struct MeasuredPair<'a> {
    pub truth: &'a TruthFacts,
    pub pose: Group<'a, PoseError>,
    pub pose_failed: bool,
    /// Why a number is missing that says nothing else.
    pub why: &'a str,
}

impl MeasuredPair<'_> {
    /// The angle between the translations.
    pub fn rta_deg(&self) -> Number<'_> {
        self.pose?.rta_deg.ok_or(Some(match self.pose_failed {
            true => "the estimated translation has no direction",
            false => "the true translation has no direction",
        }))
    }
}

/// A region of a pair; what a method does not answer stays at its `Err`.
pub(super) struct MeasuredRegion<'a> {
    /// Why a number is missing that says nothing else.
    pub why: &'a str,
    bbox_diagonal_m: Option<f64>,
    pub median_depth_z_m: Option<f64>,
    pub num_pixels: usize,
    pub coverage: Group<'a, Coverage>,
    pub fit: Group<'a, Alignment>,
    pub ransac: Group<'a, Alignment>,
    /// Of the plane in place of the terrain, of the answers, under the paper's alignment, under none.
    pub plane: Group<'a, PointError>,
    pub points: Group<'a, PointError>,
    pub points_ransac: Group<'a, PointError>,
    pub points_unaligned: Group<'a, PointError>,
    /// At full density, thinned as in the paper, thinned under its alignment, and the truth against itself thinned.
    pub cloud: Group<'a, CloudError>,
    pub cloud_10k: Group<'a, CloudError>,
    pub cloud_10k_ransac: Group<'a, CloudError>,
    pub floor: Group<'a, CloudError>,
    pub slopes: Group<'a, SlopeScores>,
    pub ceiling: Group<'a, SlopeScores>,
    pub hazards: [Group<'a, HazardAgreement>; LIMITS_DEG.len()],
    pub world_z: Group<'a, MapScores>,
    pub depth_map: Group<'a, MapScores>,
    pub depth_z: Group<'a, DepthError>,
    pub sigma: Group<'a, Calibration>,
    pub sigma_ause: Number<'a>,
    pub confidence_ause: Number<'a>,
}

/// Shares of a region's pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coverage {
    /// Of A and of B with an answer.
    pub answered: [Option<f64>; 2],
    /// Of A with a measured one.
    pub measured: Option<f64>,
}

/// How a map agrees with the true one.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapScores {
    pub ssim: Option<f64>,
    /// The same where it needs no mask.
    pub ssim_whole: Number<'static>,
    pub central: Group<'static, ProfileError>,
    pub spaced: Group<'static, ProfileError>,
}

impl<'a> MeasuredRegion<'a> {
    /// What the truth gives by itself.
    pub fn of_truth(region: &RegionTruth, bbox_diagonal_m: Option<f64>, plane: Option<PointError>) -> Self {
        Self {
            why: "",
            bbox_diagonal_m,
            median_depth_z_m: region.median_depth_z_m,
            num_pixels: region.masks.iter().flat_map(|mask| &mask.data).filter(|keep| **keep).count(),
            coverage: Err(None),
            fit: Err(None),
            ransac: Err(None),
            plane: plane.ok_or(None),
            points: Err(None),
            points_ransac: Err(None),
            points_unaligned: Err(None),
            cloud: Err(None),
            cloud_10k: Err(None),
            cloud_10k_ransac: Err(None),
            floor: region.floor.ok_or(None),
            slopes: Err(None),
            ceiling: region.ceiling.ok_or(None),
            hazards: [Err(None); LIMITS_DEG.len()],
            world_z: Err(None),
            depth_map: Err(None),
            depth_z: Err(None),
            sigma: Err(None),
            sigma_ause: Err(None),
            confidence_ause: Err(None),
        }
    }

    /// Every pixel without an answer: coverage 0, the plane's error.
    pub fn unanswered(&mut self) {
        self.coverage = Ok(Coverage { answered: [Some(0.0); 2], measured: Some(0.0) });
        self.points = self.plane;
    }

    /// An error in metres over the region's depth.
    pub fn over_depth(&self, error_m: f64) -> Number<'a> {
        self.median_depth_z_m.map(|z| error_m / z).number()
    }

    /// A distance in percent of the region's depth.
    pub fn pct_depth_z(&self, distance_m: f64) -> Number<'a> {
        self.median_depth_z_m.map(|z| 100.0 * distance_m / z).number()
    }

    /// A distance in percent of the box around the truth.
    pub fn pct_bbox(&self, distance_m: f64) -> Number<'a> {
        self.bbox_diagonal_m.map(|diagonal| 100.0 * distance_m / diagonal).number()
    }
}
