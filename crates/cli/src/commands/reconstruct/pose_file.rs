//! The relative pose for people, and as the file `pose.json` that later commands accept.

use selenograph_geometry::{CamA, CamB, Rigid3, mean_focal_px};
use selenograph_reconstruct::evidence::PoseSource;
use selenograph_reconstruct::pipeline::Reconstruction;
use selenograph_reconstruct::transform_file::PairPose;
use serde::Serialize;

/// The relative pose for people and for files.
#[derive(Debug, Clone, Serialize)]
pub struct PoseRecord {
    /// `estimated`, `given` or `points`.
    pub source: &'static str,
    /// Whether the translation is in metres; else its length means nothing.
    pub metric: bool,
    /// 3×4, rows first.
    pub cam_b_from_cam_a: [[f64; 4]; 3],
    /// Angle of the rotation between the views.
    pub rotation_deg: f64,
    /// Length of the translation: metres, or 1.
    pub baseline: f64,
    /// Standard deviation of the rotation, root of the sum of its three variances.
    pub rotation_sigma_deg: Option<f64>,
    /// Standard deviation of the translation's direction, root of the sum of its two variances.
    pub direction_sigma_deg: Option<f64>,
    /// Matches that agree, and all matches that were judged; points where the pose comes from points.
    pub inliers: [usize; 2],
    /// Root mean square Sampson distance of those that agree, pixels.
    pub residual_px: f64,
    /// Share of the inliers that one plane explains as well.
    pub plane_share: Option<f64>,
}

impl PoseRecord {
    /// `None` where there is no pose.
    pub fn new(found: &Reconstruction) -> Option<Self> {
        let metric = found.placement.metric;
        let unit = found.placement.cam_a_from_pred.scale();
        let motion = scaled(found, unit);
        let baseline = motion.origin().coords.norm();
        let cosine = 0.5 * (motion.rotation().trace() - 1.0);
        let inliers = [found.matches.iter().filter(|m| m.inlier).count(), found.matches.len()];
        let (source, inliers, residual_px, sigmas, plane_share) = match &found.pose {
            PoseSource::Estimated(pose) => {
                let variance = |k: std::ops::Range<usize>| k.map(|i| pose.covariance[(i, i)]).sum::<f64>();
                let sigmas = [variance(0..3), variance(3..5)].map(|v| v.sqrt().to_degrees());
                (
                    "estimated",
                    inliers,
                    pose.residual_rms * mean_focal_px(found.cameras.each_ref()),
                    Some(sigmas),
                    Some(pose.plane_share),
                )
            }
            PoseSource::Given { residual_px, .. } => ("given", inliers, *residual_px, None, None),
            PoseSource::Points { agreeing, points, residual_px } => {
                ("points", [*agreeing, *points], *residual_px, None, None)
            }
            PoseSource::Nothing => return None,
        };
        Some(Self {
            source,
            metric,
            cam_b_from_cam_a: motion.rows_3x4(),
            rotation_deg: cosine.clamp(-1.0, 1.0).acos().to_degrees(),
            baseline,
            rotation_sigma_deg: sigmas.map(|s| s[0]),
            direction_sigma_deg: sigmas.map(|s| s[1]),
            inliers,
            residual_px,
            plane_share,
        })
    }

    /// In one line.
    pub fn sentence(&self) -> String {
        let sigma = match (self.rotation_sigma_deg, self.direction_sigma_deg) {
            (Some(rotation), Some(direction)) => {
                format!(" (sigma {rotation:.4}° in rotation, {direction:.4}° in direction)")
            }
            _ => String::new(),
        };
        let baseline = if self.metric {
            format!("baseline {:.3} m", self.baseline)
        } else {
            "no scale (metric: false)".to_owned()
        };
        let [inliers, judged] = self.inliers;
        let what = if self.source == "points" { "points" } else { "matches" };
        format!(
            "pose {}: turned by {:.3}°{sigma}, {baseline}; {inliers} of {judged} {what} agree to {:.3} px",
            self.source, self.rotation_deg, self.residual_px
        )
    }
}

/// The relative pose as a file that later commands accept.
pub fn transform(found: &Reconstruction) -> PairPose {
    let metric = found.placement.metric;
    let unit = found.placement.cam_a_from_pred.scale();
    let covariance = match &found.pose {
        PoseSource::Estimated(pose) => Some(selenograph_geometry::DMatrix::from_fn(5, 5, |i, j| {
            0.5 * (pose.covariance[(i, j)] + pose.covariance[(j, i)])
        })),
        PoseSource::Given { .. } | PoseSource::Points { .. } | PoseSource::Nothing => None,
    };
    let covariance = covariance.filter(|m| m.iter().all(|v| v.is_finite()));
    PairPose { cam_b_from_cam_a: scaled(found, unit), metric, covariance }
}

/// The relative pose with its translation in units of the placement.
fn scaled(found: &Reconstruction, unit: f64) -> Rigid3<CamB, CamA> {
    let Ok(motion) = &found.prediction.cam_b_from_cam_a else { return Rigid3::identity() };
    let [w, x, y, z] = motion.quaternion_wxyz();
    Rigid3::from_quaternion(w, x, y, z, motion.origin() * unit)
}
