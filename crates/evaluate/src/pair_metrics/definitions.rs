//! Every number of a pair: its key, unit, direction, where it comes from and its definition, in one table that makes the fields
//! and fills them.

use super::measured::{Found, MeasuredPair, MeasuredRegion, Number};
use super::surface::{CODE, GSD, NORMALS, TRUE};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Which way is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Better {
    /// More is better.
    Up,
    /// Less is better.
    Down,
    /// It describes, it does not judge.
    None,
}

/// Where a key stands in a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scope {
    /// At the top.
    Pair,
    /// Under `overlap` and under `full`.
    Region,
}

/// What a key means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Definition {
    /// The key.
    pub key: &'static str,
    /// Where it stands.
    pub scope: Scope,
    /// Its unit (`1` for shares and ratios).
    pub unit: &'static str,
    /// Which way is better.
    pub better: Better,
    /// In one line.
    pub text: &'static str,
}

/// Every key, in the order of a record.
pub fn definitions() -> impl Iterator<Item = &'static Definition> {
    PairNumbers::DEFINITIONS.iter().chain(RegionNumbers::DEFINITIONS)
}

/// The definition of a key.
pub fn definition(key: &str) -> Option<&'static Definition> {
    definitions().find(|definition| definition.key == key)
}

/// A number that is finite; the reason is kept for any other.
fn keep<'a>(
    key: &str,
    number: impl FnOnce() -> Number<'a>,
    why: &str,
    missing: &mut BTreeMap<String, String>,
) -> Option<f64> {
    let finite = number().and_then(|value| value.is_finite().then_some(value).number());
    finite.map_err(|own| missing.insert(key.into(), own.unwrap_or(why).into())).ok()
}

/// A struct of numbers, each row with its key, unit, direction, how it is taken from what was measured, and its meaning.
macro_rules! numbers {
    (#[doc = $doc:literal] $name:ident, $scope:ident, |$m:ident: &$measured:ty|;
     $($key:ident, $unit:literal, $better:ident, $number:expr, $text:literal;)*) => {
        #[doc = $doc]
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default)]
        pub struct $name {
            $(
                #[doc = concat!($text, " (unit: `", $unit, "`).")]
                pub $key: Option<f64>,
            )*
        }

        impl $name {
            /// What each key means.
            pub const DEFINITIONS: &'static [Definition] = &[$(
                Definition {
                    key: stringify!($key),
                    scope: Scope::$scope,
                    unit: $unit,
                    better: Better::$better,
                    text: $text,
                },
            )*];

            /// Every number that there is, and for every other key why there is none.
            pub(super) fn of($m: &$measured) -> (Self, BTreeMap<String, String>) {
                let mut missing = BTreeMap::new();
                let numbers = Self {
                    $($key: keep(stringify!($key), || Found::number($number), $m.why, &mut missing)),*
                };
                (numbers, missing)
            }

            /// Keys and values, in the order of the definitions.
            pub fn iter(&self) -> impl Iterator<Item = (&'static str, Option<f64>)> {
                [$((stringify!($key), self.$key)),*].into_iter()
            }

            /// The value of a key; `None` for a null as for an unknown key.
            pub fn get(&self, key: &str) -> Option<f64> {
                self.iter().find(|(name, _)| *name == key)?.1
            }
        }
    };
}

numbers! {
    /// The numbers of a pair as a whole.
    PairNumbers, Pair, |m: &MeasuredPair<'_>|;
    rra_deg, "deg", Down, m.pose?.rra_deg, "angle between estimated and true relative rotation; null where the method gives no pose";
    rta_deg, "deg", Down, m.rta_deg(), "angle between estimated and true translation in camera B, 0 to 180, sign kept; null where the method gives no pose";
    bbox_diagonal_m, "m", None, m.truth.bbox_diagonal_m, "diagonal of the axis-aligned box, in the world's axes, around the true points of both views";
    footprint_m, "m", None, m.truth.footprint_m, "median true z-depth of view A over the focal length: one pixel on the ground";
    baseline_m, "m", None, m.truth.baseline_m, "distance between the two true camera positions";
    covisible_share_a, "1", None, m.truth.covisible_shares[0], "share of A's pixels with truth whose true point is seen by B (depths agree within 0.5 % both ways)";
    covisible_share_b, "1", None, m.truth.covisible_shares[1], "share of B's pixels with truth whose true point is seen by A";
}

numbers! {
    /// The numbers of one region of a pair: the same keys under `overlap` and under `full`.
    RegionNumbers, Region, |m: &MeasuredRegion<'_>|;
    num_pixels, "px", None, m.num_pixels as f64, "pixels of the region, both views";
    coverage, "1", Up, m.coverage?.answered[0], "share of the region's pixels of view A that have an answer, completed ones included";
    coverage_measured, "1", Up, m.coverage?.measured, "share of the region's pixels of view A whose answer was measured, not completed";
    coverage_b, "1", Up, m.coverage?.answered[1], "`coverage` of view B";
    median_depth_z_m, "m", None, m.median_depth_z_m, "median true z-depth over the region's pixels of view A";
    align_scale, "m", None, m.fit?.cam_a_from_pred.scale(), "metres per unit of the prediction: scale of the similarity fitted to all answers of both views in the region by least squares, refitted without residuals above 3 medians until the choice stands";
    align_inlier_share, "1", Up, m.fit?.inlier_share, "share of those answers that the last fit keeps";
    align_residual_median_m, "m", Down, m.fit?.residual_median_m, "median distance of all those answers to the truth after it";
    align_ransac_scale, "m", None, m.ransac?.cam_a_from_pred.scale(), "scale of the paper's form: RANSAC over 5000 random correspondences, samples of 4, threshold 100 km (so that all agree and it stops at once)";
    align_ransac_inlier_share, "1", None, m.ransac?.inlier_share, "its inlier share";
    point_error_rel, "1", Down, m.over_depth(m.points?.mean), "mean distance aligned to true over all the region's pixels of view A, over their median true z-depth; a pixel without answer counts with the error of the plane fitted to A's truth";
    point_error_m, "m", Down, m.points?.mean, "the same mean in metres";
    point_error_median_m, "m", Down, m.points?.median, "the median in place of the mean";
    point_error_rmse_m, "m", Down, m.points?.rmse, "the root mean square in place of the mean";
    point_error_answered_rel, "1", Down, m.over_depth(m.points?.mean_answered.number()?), "`point_error_rel` over answered pixels only";
    point_error_plane_rel, "1", None, m.over_depth(m.plane?.mean), "`point_error_rel` of the plane itself: the lower anchor";
    point_error_ransac_rel, "1", Down, m.over_depth(m.points_ransac?.mean), "`point_error_rel` under the paper's RANSAC alignment";
    point_error_unaligned_rel, "1", Down, m.over_depth(m.points_unaligned?.mean), "`point_error_rel` without any alignment, for predictions in metres";
    point_error_unaligned_m, "m", Down, m.points_unaligned?.mean, "`point_error_m` without any alignment, for predictions in metres";
    accuracy_m, "m", Down, m.cloud?.accuracy, "mean distance from an aligned point to the nearest true one, clouds of both views; metres";
    accuracy_pct_bbox, "%", Down, m.pct_bbox(m.cloud?.accuracy), "mean distance from an aligned point to the nearest true one, clouds of both views; percent of `bbox_diagonal_m`";
    accuracy_pct_depth_z, "%", Down, m.pct_depth_z(m.cloud?.accuracy), "mean distance from an aligned point to the nearest true one, clouds of both views; percent of `median_depth_z_m`";
    completeness_m, "m", Down, m.cloud?.completeness, "mean distance from a true point to the nearest aligned one, clouds of both views; metres";
    completeness_pct_bbox, "%", Down, m.pct_bbox(m.cloud?.completeness), "mean distance from a true point to the nearest aligned one, clouds of both views; percent of `bbox_diagonal_m`";
    completeness_pct_depth_z, "%", Down, m.pct_depth_z(m.cloud?.completeness), "mean distance from a true point to the nearest aligned one, clouds of both views; percent of `median_depth_z_m`";
    chamfer_m, "m", Down, m.cloud?.chamfer(), "mean of accuracy and completeness, clouds of both views; metres";
    chamfer_pct_bbox, "%", Down, m.pct_bbox(m.cloud?.chamfer()), "mean of accuracy and completeness, clouds of both views; percent of `bbox_diagonal_m`";
    chamfer_pct_depth_z, "%", Down, m.pct_depth_z(m.cloud?.chamfer()), "mean of accuracy and completeness, clouds of both views; percent of `median_depth_z_m`";
    accuracy_10k_m, "m", Down, m.cloud_10k?.accuracy, "mean distance from an aligned point to the nearest true one, clouds of both views, 10 000 random points of each cloud (paper's form); metres";
    accuracy_10k_pct_bbox, "%", Down, m.pct_bbox(m.cloud_10k?.accuracy), "mean distance from an aligned point to the nearest true one, clouds of both views, 10 000 random points of each cloud (paper's form); percent of `bbox_diagonal_m`";
    accuracy_10k_pct_depth_z, "%", Down, m.pct_depth_z(m.cloud_10k?.accuracy), "mean distance from an aligned point to the nearest true one, clouds of both views, 10 000 random points of each cloud (paper's form); percent of `median_depth_z_m`";
    completeness_10k_m, "m", Down, m.cloud_10k?.completeness, "mean distance from a true point to the nearest aligned one, clouds of both views, 10 000 random points of each cloud (paper's form); metres";
    completeness_10k_pct_bbox, "%", Down, m.pct_bbox(m.cloud_10k?.completeness), "mean distance from a true point to the nearest aligned one, clouds of both views, 10 000 random points of each cloud (paper's form); percent of `bbox_diagonal_m`";
    completeness_10k_pct_depth_z, "%", Down, m.pct_depth_z(m.cloud_10k?.completeness), "mean distance from a true point to the nearest aligned one, clouds of both views, 10 000 random points of each cloud (paper's form); percent of `median_depth_z_m`";
    chamfer_10k_m, "m", Down, m.cloud_10k?.chamfer(), "mean of accuracy and completeness, clouds of both views, 10 000 random points of each cloud (paper's form); metres";
    chamfer_10k_pct_bbox, "%", Down, m.pct_bbox(m.cloud_10k?.chamfer()), "mean of accuracy and completeness, clouds of both views, 10 000 random points of each cloud (paper's form); percent of `bbox_diagonal_m`";
    chamfer_10k_pct_depth_z, "%", Down, m.pct_depth_z(m.cloud_10k?.chamfer()), "mean of accuracy and completeness, clouds of both views, 10 000 random points of each cloud (paper's form); percent of `median_depth_z_m`";
    accuracy_10k_floor_m, "m", None, m.floor?.accuracy, "`accuracy_10k_m` of the truth against itself under the same draws: what a perfect answer scores";
    accuracy_10k_floor_pct_bbox, "%", None, m.pct_bbox(m.floor?.accuracy), "`accuracy_10k_pct_bbox` of the truth against itself under the same draws: what a perfect answer scores";
    accuracy_10k_floor_pct_depth_z, "%", None, m.pct_depth_z(m.floor?.accuracy), "`accuracy_10k_pct_depth_z` of the truth against itself under the same draws: what a perfect answer scores";
    completeness_10k_floor_m, "m", None, m.floor?.completeness, "`completeness_10k_m` of the truth against itself under the same draws: what a perfect answer scores";
    completeness_10k_floor_pct_bbox, "%", None, m.pct_bbox(m.floor?.completeness), "`completeness_10k_pct_bbox` of the truth against itself under the same draws: what a perfect answer scores";
    completeness_10k_floor_pct_depth_z, "%", None, m.pct_depth_z(m.floor?.completeness), "`completeness_10k_pct_depth_z` of the truth against itself under the same draws: what a perfect answer scores";
    chamfer_10k_floor_m, "m", None, m.floor?.chamfer(), "`chamfer_10k_m` of the truth against itself under the same draws: what a perfect answer scores";
    chamfer_10k_floor_pct_bbox, "%", None, m.pct_bbox(m.floor?.chamfer()), "`chamfer_10k_pct_bbox` of the truth against itself under the same draws: what a perfect answer scores";
    chamfer_10k_floor_pct_depth_z, "%", None, m.pct_depth_z(m.floor?.chamfer()), "`chamfer_10k_pct_depth_z` of the truth against itself under the same draws: what a perfect answer scores";
    chamfer_floor_m, "m", None, m.floor.map(|_| 0.0), "`chamfer_m` of the truth against itself: 0, for at full density a perfect answer has every true point";
    chamfer_10k_ransac_m, "m", Down, m.cloud_10k_ransac?.chamfer(), "`chamfer_10k_m` under the paper's RANSAC alignment";
    slope_corr_code, "1", Up, m.slopes?.correlation[CODE], "Pearson correlation of slopes in view A: the authors' code: arctangent of the Sobel gradient of world Z over 8, per pixel (pixel size 1)";
    slope_corr_code_ceiling, "1", None, m.ceiling?.correlation[CODE], "`slope_corr_code` of dequantised against stored truth: what a perfect answer scores; null where the truth is not quantised";
    slope_corr_gsd, "1", Up, m.slopes?.correlation[GSD], "Pearson correlation of slopes in view A: Sobel gradient of world Z over 8 footprints (`footprint_m`), mask eroded by 4 px";
    slope_corr_gsd_ceiling, "1", None, m.ceiling?.correlation[GSD], "`slope_corr_gsd` of dequantised against stored truth: what a perfect answer scores; null where the truth is not quantised";
    slope_corr_normals, "1", Up, m.slopes?.correlation[NORMALS], "Pearson correlation of slopes in view A: normals from 30 nearest neighbours in view A's cloud, against world Z";
    slope_corr_normals_ceiling, "1", None, m.ceiling?.correlation[NORMALS], "`slope_corr_normals` of dequantised against stored truth: what a perfect answer scores; null where the truth is not quantised";
    slope_corr_true, "1", Up, m.slopes?.correlation[TRUE], "Pearson correlation of slopes in view A: normals by central differences over ±2 px of the points, against the local vertical";
    slope_corr_true_ceiling, "1", None, m.ceiling?.correlation[TRUE], "`slope_corr_true` of dequantised against stored truth: what a perfect answer scores; null where the truth is not quantised";
    slope_mae_code_deg, "deg", Down, m.slopes?.mean_abs_deg[CODE], "mean absolute difference of the slopes of `slope_corr_code`";
    slope_mae_code_floor_deg, "deg", None, m.ceiling?.mean_abs_deg[CODE], "`slope_mae_code_deg` of dequantised against stored truth; null where the truth is not quantised";
    slope_mae_gsd_deg, "deg", Down, m.slopes?.mean_abs_deg[GSD], "mean absolute difference of the slopes of `slope_corr_gsd`";
    slope_mae_gsd_floor_deg, "deg", None, m.ceiling?.mean_abs_deg[GSD], "`slope_mae_gsd_deg` of dequantised against stored truth; null where the truth is not quantised";
    slope_mae_normals_deg, "deg", Down, m.slopes?.mean_abs_deg[NORMALS], "mean absolute difference of the slopes of `slope_corr_normals`";
    slope_mae_normals_floor_deg, "deg", None, m.ceiling?.mean_abs_deg[NORMALS], "`slope_mae_normals_deg` of dequantised against stored truth; null where the truth is not quantised";
    slope_mae_deg, "deg", Down, m.slopes?.mean_abs_deg[TRUE], "mean absolute difference of the slopes of `slope_corr_true`";
    slope_mae_floor_deg, "deg", None, m.ceiling?.mean_abs_deg[TRUE], "`slope_mae_deg` of dequantised against stored truth; null where the truth is not quantised";
    hazard_agree_5deg, "1", Up, m.hazards[0]?.agree, "share of pixels on the same side of 5° in both slopes (as `slope_corr_true`)";
    hazard_false_alarm_5deg, "1", Down, m.hazards[0]?.false_alarm, "share of pixels steeper than 5° in the prediction only";
    hazard_miss_5deg, "1", Down, m.hazards[0]?.miss, "share of pixels steeper than 5° in the truth only";
    hazard_agree_10deg, "1", Up, m.hazards[1]?.agree, "share of pixels on the same side of 10° in both slopes (as `slope_corr_true`)";
    hazard_false_alarm_10deg, "1", Down, m.hazards[1]?.false_alarm, "share of pixels steeper than 10° in the prediction only";
    hazard_miss_10deg, "1", Down, m.hazards[1]?.miss, "share of pixels steeper than 10° in the truth only";
    hazard_agree_15deg, "1", Up, m.hazards[2]?.agree, "share of pixels on the same side of 15° in both slopes (as `slope_corr_true`)";
    hazard_false_alarm_15deg, "1", Down, m.hazards[2]?.false_alarm, "share of pixels steeper than 15° in the prediction only";
    hazard_miss_15deg, "1", Down, m.hazards[2]?.miss, "share of pixels steeper than 15° in the truth only";
    hazard_agree_20deg, "1", Up, m.hazards[3]?.agree, "share of pixels on the same side of 20° in both slopes (as `slope_corr_true`)";
    hazard_false_alarm_20deg, "1", Down, m.hazards[3]?.false_alarm, "share of pixels steeper than 20° in the prediction only";
    hazard_miss_20deg, "1", Down, m.hazards[3]?.miss, "share of pixels steeper than 20° in the truth only";
    ssim_world_z, "1", Up, m.world_z?.ssim, "SSIM of the map of world Z of view A over 7×7 windows that lie in the region and are answered (uniform window, sample covariance, K1 0.01, K2 0.03, data range of both maps together)";
    ssim_world_z_paper, "1", Up, m.world_z?.ssim_whole, "SSIM of the map of world Z of view A as scikit-image has it, without a mask; only in `full` and where all pixels have truth and answer";
    profile_world_z_mae_m, "m", Down, m.world_z?.central?.mean_abs, "mean absolute difference along the central row of the map of world Z of view A";
    profile_world_z_corr, "1", Up, m.world_z?.central?.correlation, "Pearson correlation along the central row of the map of world Z of view A";
    profiles_world_z_mae_m, "m", Down, m.world_z?.spaced?.mean_abs, "mean over every 50th row of the absolute difference, the map of world Z of view A";
    profiles_world_z_corr, "1", Up, m.world_z?.spaced?.correlation, "mean over every 50th row of the Pearson correlation, the map of world Z of view A";
    ssim_depth_z, "1", Up, m.depth_map?.ssim, "SSIM of the map of z-depth of view A over 7×7 windows that lie in the region and are answered (uniform window, sample covariance, K1 0.01, K2 0.03, data range of both maps together)";
    ssim_depth_z_paper, "1", Up, m.depth_map?.ssim_whole, "SSIM of the map of z-depth of view A as scikit-image has it, without a mask; only in `full` and where all pixels have truth and answer";
    profile_depth_z_mae_m, "m", Down, m.depth_map?.central?.mean_abs, "mean absolute difference along the central row of the map of z-depth of view A";
    profile_depth_z_corr, "1", Up, m.depth_map?.central?.correlation, "Pearson correlation along the central row of the map of z-depth of view A";
    profiles_depth_z_mae_m, "m", Down, m.depth_map?.spaced?.mean_abs, "mean over every 50th row of the absolute difference, the map of z-depth of view A";
    profiles_depth_z_corr, "1", Up, m.depth_map?.spaced?.correlation, "mean over every 50th row of the Pearson correlation, the map of z-depth of view A";
    depth_z_abs_rel, "1", Down, m.depth_z?.abs_rel, "mean of |z − z true| / z true over answered pixels of both views, each in its own camera";
    depth_z_rmse_m, "m", Down, m.depth_z?.rmse, "root mean square of z − z true";
    depth_z_silog, "1", Down, m.depth_z?.silog, "standard deviation of ln z − ln z true (scale-invariant logarithmic error)";
    depth_z_delta_1_25, "1", Up, m.depth_z?.deltas[0], "share of answered pixels with max(z / z true, z true / z) below 1.25";
    depth_z_delta_1_25_2, "1", Up, m.depth_z?.deltas[1], "share of answered pixels with max(z / z true, z true / z) below 1.25²";
    depth_z_delta_1_25_3, "1", Up, m.depth_z?.deltas[2], "share of answered pixels with max(z / z true, z true / z) below 1.25³";
    depth_z_delta_1_01, "1", Up, m.depth_z?.deltas[3], "share of answered pixels with max(z / z true, z true / z) below 1.01";
    depth_z_delta_1_001, "1", Up, m.depth_z?.deltas[4], "share of answered pixels with max(z / z true, z true / z) below 1.001";
    sigma_calibration_error, "1", Down, m.sigma?.calibration_error, "mean absolute difference between expected and observed coverage of the central intervals of `curves.reliability` (errors along the ray, Gaussian sigma)";
    sigma_sharpness_m, "m", Down, m.sigma?.sharpness, "median predicted sigma";
    sigma_z_mean_abs, "1", None, m.sigma?.mean_abs, "mean of |error along the ray| / sigma; 0.798 for a Gaussian of that sigma";
    sigma_z_rms, "1", None, m.sigma?.rms, "root mean square of error along the ray / sigma; 1 for a Gaussian of that sigma";
    sigma_ause, "1", Down, m.sigma_ause, "area between the sparsification curve by sigma and by the error itself, both over the mean error";
    confidence_ause, "1", Down, m.confidence_ause, "area between the sparsification curve by confidence and by the error itself, both over the mean error";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_unique_and_found() {
        let keys: std::collections::BTreeSet<_> = definitions().map(|d| d.key).collect();
        assert_eq!(keys.len(), definitions().count());
        assert_eq!(definition("point_error_rel").map(|d| (d.unit, d.better)), Some(("1", Better::Down)));
        let numbers = RegionNumbers { coverage: Some(0.5), ..RegionNumbers::default() };
        assert_eq!((numbers.get("coverage"), numbers.get("nothing")), (Some(0.5), None));
        assert!(definitions().all(|d| !d.text.is_empty() && !d.text.ends_with('.')));
    }
}
