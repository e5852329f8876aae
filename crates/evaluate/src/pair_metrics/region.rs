//! The metrics of one region of a pair, group by group.

use super::reference::{Reference, RegionReference, sample};
use super::surface::{Surface, masked};
use super::{Promise, Region, RegionMetrics, RegionNumbers};
use crate::aligned::{AlignedPair, Answers};
use crate::alignment::{self, Alignment, NoAlignment};
use crate::calibration::{calibration, sparsification};
use crate::cloud::{Cloud, CloudError, compare};
use crate::depth_error::depth_error;
use crate::hazard::{LIMITS_DEG, hazard};
use crate::point_error::{PointError, point_error};
use crate::profile;
use crate::slope::neighbour_normals::neighbour_normals;
use crate::ssim::ssim;
use nalgebra::{Point3, Vector3};
use selenograph_raster::Raster;
use selenograph_reconstruct::Fill;

/// A prediction made ready: what does not depend on the region.
pub(super) struct Subject<'a> {
    answers: &'a [Answers; 2],
    /// Normals of A's points, in the prediction's frame.
    normals: Raster<Vector3<f64>>,
    is_metric: bool,
}

impl<'a> Subject<'a> {
    pub fn new(reference: &Reference, answers: &'a [Answers; 2], promise: Promise) -> Self {
        let normals = neighbour_normals(&answers[0].points, reference.settings.normals_stride);
        Self { answers, normals, is_metric: promise == Promise::MetricPoints }
    }
}

/// A region under measurement.
struct Measured<'a> {
    reference: &'a Reference,
    region: &'a RegionReference,
    aligned: AlignedPair,
    /// True points at the answered pixels of the region, both views.
    truth: Vec<Point3<f64>>,
    out: &'a mut RegionMetrics,
}

pub(super) fn measure_region(
    reference: &Reference,
    region: &RegionReference,
    subject: Option<&Subject<'_>>,
    promise: Promise,
    no_points: &str,
) -> RegionMetrics {
    let mut out = RegionMetrics::default();
    facts(reference, region, &mut out.numbers);
    let why = if region.masks[0].data.contains(&true) {
        match subject {
            None if promise == Promise::Pose => no_points.to_owned(),
            None => {
                unanswered(reference, region, &mut out.numbers);
                no_points.to_owned()
            }
            Some(subject) => match measured(reference, region, subject, &mut out) {
                Ok(()) => "no answered pixel to compare, or a constant map".to_owned(),
                Err(error) => {
                    unanswered(reference, region, &mut out.numbers);
                    coverage(region, subject.answers, &mut out.numbers);
                    error.to_string()
                }
            },
        }
    } else {
        "no pixel in the region".to_owned()
    };
    out.numbers.keep_finite();
    for (key, value) in out.numbers.iter() {
        if value.is_none() {
            out.missing.entry(key.to_owned()).or_insert_with(|| why.clone());
        }
    }
    out
}

/// What the truth gives by itself.
fn facts(reference: &Reference, region: &RegionReference, numbers: &mut RegionNumbers) {
    let num_pixels = region.masks.iter().flat_map(|mask| &mask.data).filter(|keep| **keep).count();
    numbers.num_pixels = Some(num_pixels as f64);
    numbers.median_depth_z_m = region.median_depth_z_m;
    let plane = plane_errors(reference, region).and_then(|plane| relative(region, plane.mean));
    numbers.point_error_plane_rel = plane;
    if let Some(ceiling) = region.ceiling {
        [
            numbers.slope_corr_code_ceiling,
            numbers.slope_corr_gsd_ceiling,
            numbers.slope_corr_normals_ceiling,
            numbers.slope_corr_true_ceiling,
        ] = ceiling.correlation;
        [
            numbers.slope_mae_code_floor_deg,
            numbers.slope_mae_gsd_floor_deg,
            numbers.slope_mae_normals_floor_deg,
            numbers.slope_mae_floor_deg,
        ] = ceiling.mean_abs_deg;
    }
    if let Some(floor) = region.floor {
        let [accuracy, completeness, chamfer] = in_units(reference, region, floor);
        [
            numbers.accuracy_10k_floor_m,
            numbers.accuracy_10k_floor_pct_bbox,
            numbers.accuracy_10k_floor_pct_depth_z,
        ] = accuracy;
        [
            numbers.completeness_10k_floor_m,
            numbers.completeness_10k_floor_pct_bbox,
            numbers.completeness_10k_floor_pct_depth_z,
        ] = completeness;
        [
            numbers.chamfer_10k_floor_m,
            numbers.chamfer_10k_floor_pct_bbox,
            numbers.chamfer_10k_floor_pct_depth_z,
        ] = chamfer;
        numbers.chamfer_floor_m = Some(0.0);
    }
}

/// Every pixel without an answer: coverage 0, the plane's error.
fn unanswered(reference: &Reference, region: &RegionReference, numbers: &mut RegionNumbers) {
    (numbers.coverage, numbers.coverage_b, numbers.coverage_measured) = (Some(0.0), Some(0.0), Some(0.0));
    if let Some(plane) = plane_errors(reference, region) {
        point_errors(region, plane, numbers);
    }
}

fn plane_errors(reference: &Reference, region: &RegionReference) -> Option<PointError> {
    let errors = reference.plane_error_m.data.iter().zip(&region.masks[0].data);
    point_error(errors.filter(|(_, keep)| **keep).map(|(error, _)| (f64::NAN, *error)))
}

fn point_errors(region: &RegionReference, error: PointError, numbers: &mut RegionNumbers) {
    numbers.point_error_m = Some(error.mean);
    numbers.point_error_median_m = Some(error.median);
    numbers.point_error_rmse_m = Some(error.rmse);
    numbers.point_error_rel = relative(region, error.mean);
    numbers.point_error_answered_rel = error.mean_answered.and_then(|mean| relative(region, mean));
}

fn relative(region: &RegionReference, error_m: f64) -> Option<f64> {
    region.median_depth_z_m.map(|z| error_m / z)
}

fn coverage(region: &RegionReference, answers: &[Answers; 2], numbers: &mut RegionNumbers) {
    let share = |view_idx: usize, counts: &dyn Fn(Fill) -> bool| {
        let fills = answers[view_idx].fill.data.iter().zip(&region.masks[view_idx].data);
        let (all, counted) = fills
            .filter(|(_, keep)| **keep)
            .fold((0usize, 0usize), |(all, n), (fill, _)| (all + 1, n + usize::from(counts(*fill))));
        (all > 0).then(|| counted as f64 / all as f64)
    };
    numbers.coverage = share(0, &|fill| fill != Fill::Absent);
    numbers.coverage_b = share(1, &|fill| fill != Fill::Absent);
    numbers.coverage_measured = share(0, &|fill| fill == Fill::Measured);
}

/// Accuracy, completeness and Chamfer, each in metres, percent of the box and percent of the depth.
fn in_units(reference: &Reference, region: &RegionReference, error: CloudError) -> [[Option<f64>; 3]; 3] {
    [error.accuracy, error.completeness, error.chamfer()].map(|value| {
        [
            Some(value),
            reference.bbox_diagonal_m().map(|diagonal| 100.0 * value / diagonal),
            region.median_depth_z_m.map(|z| 100.0 * value / z),
        ]
    })
}

fn measured(
    reference: &Reference,
    region: &RegionReference,
    subject: &Subject<'_>,
    out: &mut RegionMetrics,
) -> Result<(), NoAlignment> {
    let (predicted, truth) = reference.correspondences(subject.answers, region.region);
    let fit = alignment::robust(&predicted, &truth)?;
    let ransac = alignment::ransac_paper(&predicted, &truth, reference.settings.seed);
    alignment_numbers(&fit, ransac.as_ref().ok(), &mut out.numbers);
    coverage(region, subject.answers, &mut out.numbers);
    let aligned = AlignedPair::new(subject.answers, fit);
    let mut measured = Measured { reference, region, aligned, truth, out };
    measured.points();
    measured.other_alignments(subject, ransac.ok());
    measured.clouds();
    measured.surface(subject, &fit);
    measured.depths();
    measured.calibration(subject, fit.cam_a_from_pred.scale());
    Ok(())
}

fn alignment_numbers(fit: &Alignment, ransac: Option<&Alignment>, numbers: &mut RegionNumbers) {
    numbers.align_scale = Some(fit.cam_a_from_pred.scale());
    numbers.align_inlier_share = Some(fit.inlier_share);
    numbers.align_residual_median_m = Some(fit.residual_median_m);
    numbers.align_ransac_scale = ransac.map(|fit| fit.cam_a_from_pred.scale());
    numbers.align_ransac_inlier_share = ransac.map(|fit| fit.inlier_share);
}

impl Measured<'_> {
    /// Errors over the region's pixels of view A under an alignment.
    fn point_error_under(&self, aligned: &AlignedPair) -> Option<PointError> {
        let error_m = aligned.error_m(&self.reference.points_in_cam_a[0], 0);
        point_error(masked(&error_m, &self.reference.plane_error_m, &self.region.masks[0]))
    }

    fn points(&mut self) {
        if let Some(error) = self.point_error_under(&self.aligned) {
            point_errors(self.region, error, &mut self.out.numbers);
        }
    }

    fn other_alignments(&mut self, subject: &Subject<'_>, ransac: Option<Alignment>) {
        if let Some(fit) = ransac {
            let aligned = AlignedPair::new(subject.answers, fit);
            let error = self.point_error_under(&aligned);
            self.out.numbers.point_error_ransac_rel = error.and_then(|e| relative(self.region, e.mean));
            let cloud = self.sampled(&aligned);
            self.out.numbers.chamfer_10k_ransac_m =
                compare(&cloud, &self.region.sampled).map(|e| e.chamfer());
        }
        if subject.is_metric {
            let error = self.point_error_under(&AlignedPair::unaligned(subject.answers));
            self.out.numbers.point_error_unaligned_m = error.map(|e| e.mean);
            self.out.numbers.point_error_unaligned_rel = error.and_then(|e| relative(self.region, e.mean));
        } else {
            for key in ["point_error_unaligned_m", "point_error_unaligned_rel"] {
                self.out.missing.insert(key.into(), "the method's unit is its own".into());
            }
        }
    }

    /// Aligned points of the region's answered pixels in both views.
    fn answered(&self, aligned: &AlignedPair) -> Vec<Point3<f64>> {
        let of_view = |idx: usize| {
            let points = aligned.points_in_cam_a[idx].data.iter().zip(&self.region.masks[idx].data);
            points.filter(|(p, keep)| **keep && p.z.is_finite()).map(|(p, _)| *p)
        };
        of_view(0).chain(of_view(1)).collect()
    }

    /// The paper's thinned cloud of a prediction.
    fn sampled(&self, aligned: &AlignedPair) -> Cloud {
        sample(&self.answered(aligned), &self.reference.settings, "predicted cloud")
    }

    fn clouds(&mut self) {
        let points = self.answered(&self.aligned);
        let sampled = sample(&points, &self.reference.settings, "predicted cloud");
        // The answer of a pixel is likely to be the nearest to its truth, and its truth to its answer.
        let accuracy = self.region.cloud.mean_distance_from(&points, |idx| self.truth.get(idx).copied());
        let answers = self.answers_of_truth();
        let predicted = Cloud::new(points);
        let completeness = predicted.mean_distance_from(&self.region.cloud.points, |idx| answers[idx]);
        let numbers = &mut self.out.numbers;
        if let (Some(accuracy), Some(completeness)) = (accuracy, completeness) {
            let error = CloudError { accuracy, completeness };
            let [accuracy, completeness, chamfer] = in_units(self.reference, self.region, error);
            [numbers.accuracy_m, numbers.accuracy_pct_bbox, numbers.accuracy_pct_depth_z] = accuracy;
            [numbers.completeness_m, numbers.completeness_pct_bbox, numbers.completeness_pct_depth_z] =
                completeness;
            [numbers.chamfer_m, numbers.chamfer_pct_bbox, numbers.chamfer_pct_depth_z] = chamfer;
        }
        if let Some(error) = compare(&sampled, &self.region.sampled) {
            let [accuracy, completeness, chamfer] = in_units(self.reference, self.region, error);
            [numbers.accuracy_10k_m, numbers.accuracy_10k_pct_bbox, numbers.accuracy_10k_pct_depth_z] =
                accuracy;
            [
                numbers.completeness_10k_m,
                numbers.completeness_10k_pct_bbox,
                numbers.completeness_10k_pct_depth_z,
            ] = completeness;
            [numbers.chamfer_10k_m, numbers.chamfer_10k_pct_bbox, numbers.chamfer_10k_pct_depth_z] = chamfer;
        }
    }

    /// For every true point of the region, the aligned answer of its pixel.
    fn answers_of_truth(&self) -> Vec<Option<Point3<f64>>> {
        let of_view = |idx: usize| {
            let points = self.aligned.points_in_cam_a[idx].data.iter().zip(&self.region.masks[idx].data);
            points.filter(|(_, keep)| **keep).map(|(p, _)| p.z.is_finite().then_some(*p))
        };
        of_view(0).chain(of_view(1)).collect()
    }

    fn surface(&mut self, subject: &Subject<'_>, fit: &Alignment) {
        let (Some(footprint_m), Some(truth)) = (self.reference.footprint_m(), &self.reference.surface) else {
            return;
        };
        let z_axis = fit.cam_a_from_pred.rotation().transpose() * self.reference.z_axis_in_cam_a();
        let world_from_cam_a = self.reference.truth.world_from_cam_a();
        let points = &self.aligned.points_in_cam_a[0];
        let surface = Surface::new(points, &world_from_cam_a, footprint_m, &subject.normals, &z_axis);
        let scores = surface.scores(truth, &self.region.masks[0]);
        let numbers = &mut self.out.numbers;
        [
            numbers.slope_corr_code,
            numbers.slope_corr_gsd,
            numbers.slope_corr_normals,
            numbers.slope_corr_true,
        ] = scores.correlation;
        [
            numbers.slope_mae_code_deg,
            numbers.slope_mae_gsd_deg,
            numbers.slope_mae_normals_deg,
            numbers.slope_mae_deg,
        ] = scores.mean_abs_deg;
        self.hazards(&surface, truth);
        self.maps(&surface.world_z_m, &truth.world_z_m);
        if self.region.ceiling.is_none() {
            for (key, _) in self.out.numbers.iter() {
                if key.starts_with("slope_") && (key.ends_with("_ceiling") || key.ends_with("_floor_deg")) {
                    self.out.missing.insert(key.into(), "the truth is not quantised".into());
                }
            }
        }
    }

    fn hazards(&mut self, surface: &Surface, truth: &Surface) {
        let mask = &self.region.masks[0];
        let slopes = || masked(&surface.slopes[3], &truth.slopes[3], mask);
        let [at_5, at_10, at_15, at_20] = LIMITS_DEG.map(|limit| {
            let found = hazard(slopes(), limit.to_radians());
            [found.map(|h| h.agree), found.map(|h| h.false_alarm), found.map(|h| h.miss)]
        });
        let numbers = &mut self.out.numbers;
        [numbers.hazard_agree_5deg, numbers.hazard_false_alarm_5deg, numbers.hazard_miss_5deg] = at_5;
        [numbers.hazard_agree_10deg, numbers.hazard_false_alarm_10deg, numbers.hazard_miss_10deg] = at_10;
        [numbers.hazard_agree_15deg, numbers.hazard_false_alarm_15deg, numbers.hazard_miss_15deg] = at_15;
        [numbers.hazard_agree_20deg, numbers.hazard_false_alarm_20deg, numbers.hazard_miss_20deg] = at_20;
    }

    /// SSIM and profiles of world Z and z-depth.
    fn maps(&mut self, world_z_m: &Raster<f64>, true_world_z_m: &Raster<f64>) {
        let mask = &self.region.masks[0];
        let under_mask = |map: &Raster<f64>| {
            let data = map.data.iter().zip(&mask.data).map(|(v, keep)| if *keep { *v } else { f64::NAN });
            Raster { width: map.width, height: map.height, data: data.collect() }
        };
        let z = |points: &Raster<Point3<f64>>| under_mask(&points.map(|p| p.z));
        let pairs = [
            (under_mask(world_z_m), under_mask(true_world_z_m)),
            (z(&self.aligned.points_in_cam_a[0]), z(&self.reference.points_in_cam_a[0])),
        ];
        let is_whole = |map: &Raster<f64>| map.data.iter().all(|v| v.is_finite());
        let [world, depths] = pairs.map(|(found, truth)| {
            let value = ssim(&found, &truth);
            let whole = self.region.region == Region::Full && is_whole(&found) && is_whole(&truth);
            let (central, spaced) = (profile::central(&found, &truth), profile::spaced(&found, &truth));
            [
                value,
                value.filter(|_| whole),
                central.map(|p| p.mean_abs),
                central.and_then(|p| p.correlation),
                spaced.map(|p| p.mean_abs),
                spaced.and_then(|p| p.correlation),
            ]
        });
        let numbers = &mut self.out.numbers;
        [
            numbers.ssim_world_z,
            numbers.ssim_world_z_paper,
            numbers.profile_world_z_mae_m,
            numbers.profile_world_z_corr,
            numbers.profiles_world_z_mae_m,
            numbers.profiles_world_z_corr,
        ] = world;
        [
            numbers.ssim_depth_z,
            numbers.ssim_depth_z_paper,
            numbers.profile_depth_z_mae_m,
            numbers.profile_depth_z_corr,
            numbers.profiles_depth_z_mae_m,
            numbers.profiles_depth_z_corr,
        ] = depths;
        for key in ["ssim_world_z_paper", "ssim_depth_z_paper"] {
            let why = match self.region.region {
                Region::Overlap => "without a mask there is the full picture only",
                Region::Full => "not every pixel has truth and answer",
            };
            if self.out.numbers.get(key).is_none() {
                self.out.missing.insert(key.into(), why.into());
            }
        }
    }

    fn depths(&mut self) {
        let truth = &self.reference.truth;
        let found = [0, 1].map(|idx| self.aligned.depth_z_m(truth, idx));
        let given = [0, 1].map(|idx| truth.views[idx].depth_z.map(|z| f64::from(*z)));
        let of_view = |idx: usize| masked(&found[idx], &given[idx], &self.region.masks[idx]);
        let Some(error) = depth_error(of_view(0).chain(of_view(1))) else { return };
        let numbers = &mut self.out.numbers;
        numbers.depth_z_abs_rel = Some(error.abs_rel);
        numbers.depth_z_rmse_m = Some(error.rmse);
        numbers.depth_z_silog = Some(error.silog);
        [
            numbers.depth_z_delta_1_25,
            numbers.depth_z_delta_1_25_2,
            numbers.depth_z_delta_1_25_3,
            numbers.depth_z_delta_1_01,
            numbers.depth_z_delta_1_001,
        ] = error.deltas.map(Some);
    }

    fn calibration(&mut self, subject: &Subject<'_>, scale: f64) {
        let (mut along_ray, mut by_sigma, mut by_confidence) = (Vec::new(), Vec::new(), Vec::new());
        let origins = [Point3::origin(), self.reference.truth.cam_b_from_cam_a().inverse().origin()];
        for (view_idx, view) in subject.answers.iter().enumerate() {
            let points = &self.aligned.points_in_cam_a[view_idx].data;
            let truth = &self.reference.points_in_cam_a[view_idx].data;
            let mask = &self.region.masks[view_idx].data;
            for idx in (0..points.len()).filter(|&idx| mask[idx] && view.is_answered(idx)) {
                let off = points[idx] - truth[idx];
                by_confidence.push((off.norm(), -f64::from(view.confidence.data[idx])));
                if let Some(sigma) = &view.sigma {
                    let sigma_m = f64::from(sigma.data[idx]) * scale;
                    let ray = (truth[idx] - origins[view_idx]).normalize();
                    along_ray.push((off.dot(&ray), sigma_m));
                    by_sigma.push((off.norm(), sigma_m));
                }
            }
        }
        let (numbers, curves) = (&mut self.out.numbers, &mut self.out.curves);
        if let Some((curve, area)) = sparsification(&by_confidence) {
            (numbers.confidence_ause, curves.confidence_sparsification) = (Some(area), Some(curve));
        }
        if let Some((curve, area)) = sparsification(&by_sigma) {
            (numbers.sigma_ause, curves.sigma_sparsification) = (Some(area), Some(curve));
        }
        if let Some(found) = calibration(&along_ray) {
            numbers.sigma_calibration_error = Some(found.calibration_error);
            numbers.sigma_sharpness_m = Some(found.sharpness);
            numbers.sigma_z_mean_abs = Some(found.mean_abs);
            numbers.sigma_z_rms = Some(found.rms);
            curves.reliability = Some(found.reliability);
        } else {
            for (key, _) in self.out.numbers.iter().filter(|(key, _)| key.starts_with("sigma_")) {
                self.out.missing.insert(key.into(), "the method gives no sigma".into());
            }
        }
    }
}
