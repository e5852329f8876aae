//! The tables there are, and what stands in them.

use crate::pair_metrics::{Better, Region, definition, definitions};
use crate::paper::{self, Published};
use crate::summary::{Failures, Frame, PoseAngle, Quantity};

/// How a number is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// So many decimals.
    Fixed(usize),
    /// So many significant digits.
    Significant(usize),
}

/// A column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Heading without unit and arrow.
    pub head: String,
    /// Unit; empty for ratios.
    pub unit: &'static str,
    /// Which way is better.
    pub better: Better,
    /// Values are multiplied by this: 100 for percent.
    pub factor: f64,
    /// How its numbers are written.
    pub form: Form,
    /// What is shown.
    pub quantity: Quantity,
    /// What a perfect answer scores, where that is not what the definition would suggest.
    pub anchor: Option<Quantity>,
    /// What it means.
    pub definition: String,
    /// Whether the reduction against the first method is told.
    pub has_reduction: bool,
}

/// What a table shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Spec {
    /// Name of its files.
    pub id: String,
    /// Heading.
    pub title: String,
    /// What the reader has to know.
    pub notes: Vec<String>,
    /// Its columns.
    pub columns: Vec<Column>,
    /// Published rows with numbers for some of its columns, by column heading.
    pub published: &'static [Published],
}

/// Thresholds of the paper's pose table, degrees.
const THRESHOLDS_DEG: [f64; 4] = [2.0, 5.0, 15.0, 30.0];
/// Thresholds of the areas, degrees.
const AREAS_DEG: [f64; 3] = [5.0, 10.0, 20.0];
const ANGLES: [PoseAngle; 2] = [PoseAngle::Rra, PoseAngle::Rta];

impl Spec {
    fn new(id: impl Into<String>, title: impl Into<String>, columns: Vec<Column>) -> Self {
        Self { id: id.into(), title: title.into(), notes: Vec::new(), columns, published: &[] }
    }

    fn note(mut self, note: &str) -> Self {
        self.notes.push(note.into());
        self
    }
}

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

/// Area under the curve of shares; `how` says how it is integrated.
fn area(frame: Frame, threshold: f64, area: fn(Frame, PoseAngle, f64) -> Quantity, how: &str) -> Column {
    let definition = format!(
        "area under the curve of shares of items with max(RRA, RTA) below a threshold, up to {threshold}°, over {threshold}°; {how}"
    );
    percent(format!("AUC@{threshold}"), Better::Up, area(frame, PoseAngle::Worse, threshold), definition)
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

/// What a perfect answer scores, where a key of the truth says so: `…_floor…` or `…_ceiling`.
fn anchor(key: &str) -> Option<&'static str> {
    let is_of = |anchor: &str| {
        anchor.strip_suffix("_ceiling") == Some(key)
            || anchor.split_once("_floor").is_some_and(|(start, end)| key.strip_prefix(start) == Some(end))
    };
    definitions().map(|d| d.key).find(|anchor| is_of(anchor))
}

/// Numbers of a region by their keys, each with its heading; the definition is that of the key.
fn of_region<'a>(
    frame: Frame,
    region: Region,
    columns: impl IntoIterator<Item = (&'static str, &'a str)>,
) -> Vec<Column> {
    let column = |(key, head): (&'static str, &str)| {
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
            anchor: anchor(key).map(|anchor| Quantity::Region(frame, region, anchor)),
            definition: format!("`{key}`: {}", known.map_or("", |d| d.text)),
            has_reduction: better == Better::Down && !is_share,
        }
    };
    columns.into_iter().map(column).collect()
}

/// What both pose tables show.
fn pose_columns(
    frame: Frame,
    failures: Failures,
    integrated: fn(Frame, PoseAngle, f64) -> Quantity,
    how: &str,
) -> Vec<Column> {
    let shares = ANGLES.iter().flat_map(|&angle| THRESHOLDS_DEG.map(|t| below(frame, angle, t, failures)));
    let areas = AREAS_DEG.map(|t| area(frame, t, integrated, how));
    let medians = ANGLES.map(|angle| median_error(frame, angle));
    std::iter::once(failed(frame)).chain(shares).chain(areas).chain(medians).collect()
}

/// The pose table: the full frames, failures as failures.
pub fn pose() -> Spec {
    let how = "the exact integral, failures counted";
    let columns = pose_columns(Frame::Full, Failures::Counted, Quantity::Auc, how);
    Spec::new("pose", "Relative pose, honest form: full frames, failures counted as failures", columns)
}

/// The paper's pose table in its own form.
pub fn pose_paper() -> Spec {
    let how = "bins of 0.1° and trapezoids, failures counted, as in the paper's code";
    let columns = pose_columns(Frame::ReferenceRows, Failures::LeftOut, Quantity::AucInBins, how);
    let title = "Relative pose, paper-compatible form: central 384 rows, failed items left out of the shares";
    Spec::new("pose_paper", title, columns)
        .note("Reference protocol: pictures cropped to their central 384 of 512 rows, the 2000 best matches of each method, plain five-point RANSAC (inliers within 1 px, nothing refined), signed translation: it judges the matches, not the method's own estimate.")
}

/// The paper's 3-D table in its own form.
pub fn terrain_paper() -> Spec {
    let columns = of_region(
        Frame::ReferenceRows,
        Region::Full,
        [
            ("accuracy_10k_m", "accuracy"),
            ("completeness_10k_m", "completeness"),
            ("chamfer_10k_m", "Chamfer"),
            ("chamfer_10k_pct_bbox", "Chamfer of box"),
            ("chamfer_10k_ransac_m", "Chamfer, RANSAC"),
            ("slope_corr_code", "slope corr."),
            ("slope_mae_code_deg", "slope MAE"),
            ("ssim_world_z_paper", "SSIM"),
            ("profile_world_z_mae_m", "profile MAE"),
            ("profile_world_z_corr", "profile corr."),
        ],
    );
    let title =
        "3-D reconstruction, paper-compatible form: central 384 rows, 10 000 random points of each cloud";
    let spec = Spec::new("terrain_paper", title, columns)
        .note("All pixels with truth of both views; clouds thinned to 10 000 points each, so that a perfect answer scores the floor, not 0.")
        .note("Published rows: other pairs (the authors' whole test set, 3.5 to 30.5 km), metres scale with altitude; which slope their correlation is of is not published.");
    Spec { published: &paper::TERRAIN, ..spec }
}

/// The honest 3-D table of a region.
pub fn terrain(of: Region) -> Spec {
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
    let columns = of_region(
        Frame::Full,
        of,
        [
            ("point_error_rel", "point error"),
            ("coverage", "coverage"),
            ("coverage_measured", "measured"),
            ("accuracy_pct_depth_z", "accuracy of z"),
            ("completeness_pct_depth_z", "completeness of z"),
            ("chamfer_m", "Chamfer"),
            ("chamfer_pct_bbox", "Chamfer of box"),
            ("slope_corr_gsd", "slope corr. GSD"),
            ("slope_corr_normals", "slope corr. normals"),
            ("slope_corr_true", "slope corr. true"),
            ("slope_mae_deg", "slope MAE"),
            ("ssim_world_z", "SSIM of Z"),
            ("profiles_world_z_mae_m", "profiles MAE"),
            ("profiles_world_z_corr", "profiles corr."),
        ],
    );
    Spec::new(id, title, columns).note(note)
}

/// Depth in the cameras, and whether sigma and confidence tell the truth.
pub fn depth_and_sigma() -> Spec {
    let columns = of_region(
        Frame::Full,
        Region::Overlap,
        [
            ("depth_z_abs_rel", "abs. rel."),
            ("depth_z_rmse_m", "RMSE"),
            ("depth_z_delta_1_01", "δ<1.01"),
            ("depth_z_delta_1_001", "δ<1.001"),
            ("ssim_depth_z", "SSIM of z"),
            ("align_inlier_share", "align. inliers"),
            ("align_residual_median_m", "align. residual"),
            ("point_error_ransac_rel", "point error, RANSAC"),
            ("sigma_calibration_error", "calibration"),
            ("sigma_z_rms", "error / sigma"),
            ("sigma_sharpness_m", "sharpness"),
            ("sigma_ause", "AUSE sigma"),
            ("confidence_ause", "AUSE conf."),
        ],
    );
    let title = "Depth, alignment, calibration of sigma and confidence: what both views see";
    Spec::new("depth_and_sigma", title, columns)
}

/// Agreement of hazard maps.
pub fn hazards() -> Spec {
    // `hazard_false_alarm_15deg` is headed `false 15°`.
    let heads = definitions().filter_map(|d| {
        let (what, limit) = d.key.strip_prefix("hazard_")?.rsplit_once('_')?;
        Some((d.key, format!("{} {}", what.replace("false_alarm", "false"), limit.replace("deg", "°"))))
    });
    let heads: Vec<(&str, String)> = heads.collect();
    let columns = heads.iter().map(|(key, head)| (*key, head.as_str()));
    let columns = of_region(Frame::Full, Region::Overlap, columns);
    Spec::new("hazards", "Hazard maps by slope limit: what both views see", columns)
}

/// Pairs without an answer: no common ground, or the same view twice.
pub fn hard_cases() -> Spec {
    let definition = "share of items for which the method gives no pose: here the right answer".into();
    let columns = vec![percent("cannot say".into(), Better::Up, Quantity::Failed(Frame::Full), definition)];
    let title = "Pairs without parallax or common ground: the right answer is \"cannot say\"";
    Spec::new("hard_cases", title, columns).note("These items are in no other table.")
}

/// The numbers that a breakdown shows.
pub fn breakdown(name: &str) -> Spec {
    let frame = Frame::Full;
    let mut columns = vec![failed(frame)];
    columns.extend(ANGLES.map(|angle| below(frame, angle, 2.0, Failures::Counted)));
    columns.push(area(frame, 5.0, Quantity::Auc, "failures counted"));
    columns.extend(ANGLES.map(|angle| median_error(frame, angle)));
    columns.extend(of_region(
        frame,
        Region::Overlap,
        [
            ("point_error_rel", "point error"),
            ("coverage", "coverage"),
            ("chamfer_pct_bbox", "Chamfer of box"),
            ("slope_corr_gsd", "slope corr. GSD"),
            ("slope_mae_deg", "slope MAE"),
        ],
    ));
    Spec::new(format!("by_{name}"), format!("By {name}"), columns)
}
