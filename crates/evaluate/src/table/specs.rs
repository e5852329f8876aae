//! The tables there are, and what stands in them.

use super::{Column, Form, Spec};
use crate::pair_metrics::{Better, Region, definition};
use crate::paper;
use crate::summary::{Failures, Frame, PoseAngle, Quantity};

/// Thresholds of the paper's pose table, degrees.
const THRESHOLDS_DEG: [f64; 4] = [2.0, 5.0, 15.0, 30.0];
/// Thresholds of the areas, degrees.
const AREAS_DEG: [f64; 3] = [5.0, 10.0, 20.0];
/// Limits of the hazard maps, degrees, as the keys have them.
const HAZARDS: [&str; 12] = [
    "hazard_agree_5deg",
    "hazard_false_alarm_5deg",
    "hazard_miss_5deg",
    "hazard_agree_10deg",
    "hazard_false_alarm_10deg",
    "hazard_miss_10deg",
    "hazard_agree_15deg",
    "hazard_false_alarm_15deg",
    "hazard_miss_15deg",
    "hazard_agree_20deg",
    "hazard_false_alarm_20deg",
    "hazard_miss_20deg",
];

fn percent(head: String, better: Better, quantity: Quantity, definition: String) -> Column {
    Column {
        head,
        unit: "%",
        better,
        factor: 100.0,
        form: Form::Fixed(1),
        quantity,
        anchor: None,
        definition,
        has_reduction: false,
    }
}

fn angle_name(angle: PoseAngle) -> &'static str {
    match angle {
        PoseAngle::Rra => "RRA",
        PoseAngle::Rta => "RTA",
        PoseAngle::Worse => "max(RRA, RTA)",
    }
}

fn below(frame: Frame, angle: PoseAngle, threshold: f64, failures: Failures) -> Column {
    let of = match failures {
        Failures::Counted => "of all items; an item without a pose is a failure at every threshold",
        Failures::LeftOut => "of the items with a pose; an item without one leaves the denominator",
    };
    let definition = format!("share of items with {} below {threshold}°, {of}", angle_name(angle));
    let head = format!("{}@{threshold}", angle_name(angle));
    percent(head, Better::Up, Quantity::Below(frame, angle, threshold, failures), definition)
}

fn failed(frame: Frame) -> Column {
    let definition = "share of items for which the method gives no pose".into();
    percent("failed".into(), Better::Down, Quantity::Failed(frame), definition)
}

fn median_error(frame: Frame, angle: PoseAngle) -> Column {
    let what = match angle {
        PoseAngle::Rra => "angle between estimated and true relative rotation",
        PoseAngle::Rta | PoseAngle::Worse => {
            "angle between estimated and true translation (sign kept, 0 to 180°)"
        }
    };
    Column {
        head: format!("median {}", angle_name(angle)),
        unit: "°",
        better: Better::Down,
        factor: 1.0,
        form: Form::Significant(3),
        quantity: Quantity::MedianError(frame, angle),
        anchor: None,
        definition: format!("median over the items with a pose of the {what}"),
        has_reduction: true,
    }
}

/// A number of a region by its key; its definition is that of the key.
fn region(
    frame: Frame,
    region: Region,
    key: &'static str,
    head: &str,
    anchor: Option<&'static str>,
) -> Column {
    let known = definition(key);
    let unit = match known.map_or("1", |d| d.unit) {
        "1" | "px" => "",
        "deg" => "°",
        unit => unit,
    };
    let better = known.map_or(Better::None, |d| d.better);
    let is_share = ["coverage", "hazard", "align_inlier"].iter().any(|start| key.starts_with(start));
    Column {
        head: head.to_owned(),
        unit: if is_share { "%" } else { unit },
        better,
        factor: if is_share { 100.0 } else { 1.0 },
        form: if is_share { Form::Fixed(1) } else { Form::Significant(3) },
        quantity: Quantity::Region(frame, region, key),
        anchor: anchor.map(|anchor| Quantity::Region(frame, region, anchor)),
        definition: format!("`{key}`: {}", known.map_or("", |d| d.text)),
        has_reduction: better == Better::Down && !is_share,
    }
}

/// The pose table: the full frames, failures as failures.
pub fn pose() -> Spec {
    let frame = Frame::Full;
    let mut columns = vec![failed(frame)];
    for angle in [PoseAngle::Rra, PoseAngle::Rta] {
        columns.extend(THRESHOLDS_DEG.map(|t| below(frame, angle, t, Failures::Counted)));
    }
    columns.extend(AREAS_DEG.map(|t| {
        let definition = format!(
            "area under the curve of shares of items with max(RRA, RTA) below a threshold, up to {t}°, over {t}°; the exact \
             integral, failures counted"
        );
        percent(format!("AUC@{t}"), Better::Up, Quantity::Auc(frame, PoseAngle::Worse, t), definition)
    }));
    columns.extend([PoseAngle::Rra, PoseAngle::Rta].map(|angle| median_error(frame, angle)));
    Spec {
        id: "pose".into(),
        title: "Relative pose, honest form: full frames, failures counted as failures".into(),
        notes: vec![],
        columns,
        published: &[],
    }
}

/// The paper's pose table in its own form.
pub fn pose_paper() -> Spec {
    let frame = Frame::ReferenceRows;
    let mut columns = vec![failed(frame)];
    for angle in [PoseAngle::Rra, PoseAngle::Rta] {
        columns.extend(THRESHOLDS_DEG.map(|t| below(frame, angle, t, Failures::LeftOut)));
    }
    columns.extend(AREAS_DEG.map(|t| {
        let definition = format!(
            "area under the curve of shares of items with max(RRA, RTA) below a threshold, up to {t}°, over {t}°; bins of 0.1° \
             and trapezoids, failures counted, as in the paper's code"
        );
        percent(format!("AUC@{t}"), Better::Up, Quantity::AucInBins(frame, PoseAngle::Worse, t), definition)
    }));
    columns.extend([PoseAngle::Rra, PoseAngle::Rta].map(|angle| median_error(frame, angle)));
    Spec {
        id: "pose_paper".into(),
        title: "Relative pose, paper-compatible form: central 384 rows, failed items left out of the shares".into(),
        notes: vec![
            "Reference protocol: pictures cropped to their central 384 of 512 rows, the 2000 best matches of each method, plain five-point RANSAC (inliers within 1 px, nothing refined), signed translation: it judges the matches, not the method's own estimate."
                .into(),
        ],
        columns,
        published: &[],
    }
}

/// The paper's 3-D table in its own form.
pub fn terrain_paper() -> Spec {
    let column = |key, head: &str, anchor| region(Frame::ReferenceRows, Region::Full, key, head, anchor);
    Spec {
        id: "terrain_paper".into(),
        title: "3-D reconstruction, paper-compatible form: central 384 rows, 10 000 random points of each cloud".into(),
        notes: vec![
            "All pixels with truth of both views; clouds thinned to 10 000 points each, so that a perfect answer scores the floor, not 0."
                .into(),
            "Published rows: other pairs (the authors' whole test set, 3.5 to 30.5 km), metres scale with altitude; which slope their correlation is of is not published."
                .into(),
        ],
        columns: vec![
            column("accuracy_10k_m", "accuracy", Some("accuracy_10k_floor_m")),
            column("completeness_10k_m", "completeness", Some("completeness_10k_floor_m")),
            column("chamfer_10k_m", "Chamfer", Some("chamfer_10k_floor_m")),
            column("chamfer_10k_pct_bbox", "Chamfer of box", Some("chamfer_10k_floor_pct_bbox")),
            column("chamfer_10k_ransac_m", "Chamfer, RANSAC", None),
            column("slope_corr_code", "slope corr.", Some("slope_corr_code_ceiling")),
            column("slope_mae_code_deg", "slope MAE", Some("slope_mae_code_floor_deg")),
            column("ssim_world_z_paper", "SSIM", None),
            column("profile_world_z_mae_m", "profile MAE", None),
            column("profile_world_z_corr", "profile corr.", None),
        ],
        published: &paper::TERRAIN,
    }
}

/// The honest 3-D table of a region.
pub fn terrain(of: Region) -> Spec {
    let column = |key, head: &str, anchor| region(Frame::Full, of, key, head, anchor);
    let (id, title, note) = match of {
        Region::Overlap => (
            "terrain_overlap",
            "3-D reconstruction, honest form: what both views see, full density",
            "Pixels of the full frames whose true point both views see; a pixel without an answer counts with the plane's error in the point error.",
        ),
        Region::Full => (
            "terrain_full",
            "3-D reconstruction, honest form: the whole image with completion, full density",
            "All pixels with truth; a pixel without an answer counts with the plane's error in the point error.",
        ),
    };
    Spec {
        id: id.into(),
        title: title.into(),
        notes: vec![note.into()],
        columns: vec![
            column("point_error_rel", "point error", None),
            column("coverage", "coverage", None),
            column("coverage_measured", "measured", None),
            column("accuracy_pct_depth_z", "accuracy of z", None),
            column("completeness_pct_depth_z", "completeness of z", None),
            column("chamfer_m", "Chamfer", Some("chamfer_floor_m")),
            column("chamfer_pct_bbox", "Chamfer of box", None),
            column("slope_corr_gsd", "slope corr. GSD", Some("slope_corr_gsd_ceiling")),
            column("slope_corr_normals", "slope corr. normals", Some("slope_corr_normals_ceiling")),
            column("slope_corr_true", "slope corr. true", Some("slope_corr_true_ceiling")),
            column("slope_mae_deg", "slope MAE", Some("slope_mae_floor_deg")),
            column("ssim_world_z", "SSIM of Z", None),
            column("profiles_world_z_mae_m", "profiles MAE", None),
            column("profiles_world_z_corr", "profiles corr.", None),
        ],
        published: &[],
    }
}

/// Depth in the cameras, and whether sigma and confidence tell the truth.
pub fn depth_and_sigma() -> Spec {
    let column = |key, head: &str| region(Frame::Full, Region::Overlap, key, head, None);
    Spec {
        id: "depth_and_sigma".into(),
        title: "Depth, alignment, calibration of sigma and confidence: what both views see".into(),
        notes: vec![],
        columns: vec![
            column("depth_z_abs_rel", "abs. rel."),
            column("depth_z_rmse_m", "RMSE"),
            column("depth_z_delta_1_01", "δ<1.01"),
            column("depth_z_delta_1_001", "δ<1.001"),
            column("ssim_depth_z", "SSIM of z"),
            column("align_inlier_share", "align. inliers"),
            column("align_residual_median_m", "align. residual"),
            column("point_error_ransac_rel", "point error, RANSAC"),
            column("sigma_calibration_error", "calibration"),
            column("sigma_z_rms", "error / sigma"),
            column("sigma_sharpness_m", "sharpness"),
            column("sigma_ause", "AUSE sigma"),
            column("confidence_ause", "AUSE conf."),
        ],
        published: &[],
    }
}

/// Agreement of hazard maps.
pub fn hazards() -> Spec {
    let head = |key: &str| {
        let parts: Vec<&str> = key.trim_start_matches("hazard_").rsplitn(2, '_').collect();
        format!("{} {}", parts[1].replace("false_alarm", "false"), parts[0].replace("deg", "°"))
    };
    Spec {
        id: "hazards".into(),
        title: "Hazard maps by slope limit: what both views see".into(),
        notes: vec![],
        columns: HAZARDS
            .iter()
            .map(|key| region(Frame::Full, Region::Overlap, key, &head(key), None))
            .collect(),
        published: &[],
    }
}

/// Pairs without an answer: no common ground, or the same view twice.
pub fn hard_cases() -> Spec {
    let definition = "share of items for which the method gives no pose: here the right answer".into();
    Spec {
        id: "hard_cases".into(),
        title: "Pairs without parallax or common ground: the right answer is \"cannot say\"".into(),
        notes: vec!["These items are in no other table.".into()],
        columns: vec![percent("cannot say".into(), Better::Up, Quantity::Failed(Frame::Full), definition)],
        published: &[],
    }
}

/// The numbers that a breakdown shows.
pub fn breakdown(name: &str) -> Spec {
    let column = |key, head: &str, anchor| region(Frame::Full, Region::Overlap, key, head, anchor);
    let pose = |angle, t| below(Frame::Full, angle, t, Failures::Counted);
    let area = percent(
        "AUC@5".into(),
        Better::Up,
        Quantity::Auc(Frame::Full, PoseAngle::Worse, 5.0),
        "area under the curve of shares of items with max(RRA, RTA) below a threshold, up to 5°, over 5°; failures counted".into(),
    );
    Spec {
        id: format!("by_{name}"),
        title: format!("By {name}"),
        notes: vec![],
        columns: vec![
            failed(Frame::Full),
            pose(PoseAngle::Rra, 2.0),
            pose(PoseAngle::Rta, 2.0),
            area,
            median_error(Frame::Full, PoseAngle::Rra),
            median_error(Frame::Full, PoseAngle::Rta),
            column("point_error_rel", "point error", None),
            column("coverage", "coverage", None),
            column("chamfer_pct_bbox", "Chamfer of box", None),
            column("slope_corr_gsd", "slope corr. GSD", Some("slope_corr_gsd_ceiling")),
            column("slope_mae_deg", "slope MAE", Some("slope_mae_floor_deg")),
        ],
        published: &[],
    }
}
