//! The metrics of one region of a pair, group by group.

use super::measured::{Coverage, Group, MapScores, MeasuredRegion};
use super::prepared::{PreparedTruth, RegionTruth, sample};
use super::surface::{Surface, TRUE, masked};
use super::{Curves, Promise, Region};
use crate::aligned::{AlignedPair, Answers};
use crate::alignment::{self, Alignment};
use crate::calibration::{calibration, sparsification};
use crate::cloud::{Cloud, CloudError, compare};
use crate::depth_error::{DepthError, depth_error};
use crate::hazard::{LIMITS_DEG, hazard};
use crate::point_error::{PointError, point_error};
use crate::profile;
use crate::slope::neighbour_normals::neighbour_normals;
use crate::ssim::ssim;
use selenograph_geometry::{Point3, Vector3};
use selenograph_raster::Raster;
use selenograph_reconstruct::Fill;

/// A prediction made ready: what does not depend on the region.
pub(super) struct Subject<'a> {
    pub answers: &'a [Answers; 2],
    /// Normals of A's points, in the prediction's frame.
    normals: Raster<Vector3<f64>>,
    is_metric: bool,
}

impl<'a> Subject<'a> {
    pub fn new(truth: &PreparedTruth, answers: &'a [Answers; 2], promise: Promise) -> Self {
        let normals = neighbour_normals(&answers[0].points, truth.settings.normals_stride);
        Self { answers, normals, is_metric: promise == Promise::MetricPoints }
    }
}

/// A region under measurement.
pub(super) struct Measuring<'a> {
    truth: &'a PreparedTruth,
    region: &'a RegionTruth,
    subject: &'a Subject<'a>,
    fit: Alignment,
    ransac: Option<Alignment>,
    aligned: AlignedPair,
    /// True points at the answered pixels of the region, both views.
    true_points: Vec<Point3<f64>>,
}

/// What the truth of a region gives by itself.
pub(super) fn of_truth<'a>(truth: &PreparedTruth, region: &RegionTruth) -> MeasuredRegion<'a> {
    let errors = truth.plane_error_m.data.iter().zip(&region.masks[0].data);
    let plane = point_error(errors.filter(|(_, keep)| **keep).map(|(error, _)| (f64::NAN, *error)));
    MeasuredRegion::of_truth(region, truth.facts.bbox_diagonal_m, plane)
}

/// How much of a region is answered.
pub(super) fn coverage(region: &RegionTruth, answers: &[Answers; 2]) -> Coverage {
    let share = |view_idx: usize, counts: &dyn Fn(Fill) -> bool| {
        let fills = answers[view_idx].fill.data.iter().zip(&region.masks[view_idx].data);
        let (all, counted) = fills
            .filter(|(_, keep)| **keep)
            .fold((0usize, 0usize), |(all, n), (fill, _)| (all + 1, n + usize::from(counts(*fill))));
        (all > 0).then(|| counted as f64 / all as f64)
    };
    Coverage {
        answered: [0, 1].map(|view_idx| share(view_idx, &|fill| fill != Fill::Absent)),
        measured: share(0, &|fill| fill == Fill::Measured),
    }
}

impl<'a> Measuring<'a> {
    /// Carries a prediction into metres.
    ///
    /// # Errors
    /// The reason where there is no similarity.
    pub fn new(
        truth: &'a PreparedTruth,
        region: &'a RegionTruth,
        subject: &'a Subject<'a>,
    ) -> Result<Self, alignment::NoAlignment> {
        let (predicted, true_points) = truth.correspondences(subject.answers, region.region);
        let fit = alignment::robust(&predicted, &true_points)?;
        let ransac = alignment::ransac_paper(&predicted, &true_points, truth.settings.seed).ok();
        let aligned = AlignedPair::new(subject.answers, fit);
        Ok(Self { truth, region, subject, fit, ransac, aligned, true_points })
    }

    /// Every group.
    pub fn measure(&self, m: &mut MeasuredRegion<'_>, curves: &mut Curves) {
        m.why = "no answered pixel to compare, or a constant map";
        m.fit = Ok(self.fit);
        m.ransac = self.ransac.ok_or(None);
        m.coverage = Ok(coverage(self.region, self.subject.answers));
        m.points = self.point_error(&self.aligned);
        if let Some(fit) = self.ransac {
            let aligned = AlignedPair::new(self.subject.answers, fit);
            m.points_ransac = self.point_error(&aligned);
            m.cloud_10k_ransac = self.thinned_cloud_error(&self.answered(&aligned));
        }
        m.points_unaligned = match self.subject.is_metric {
            true => self.point_error(&AlignedPair::unaligned(self.subject.answers)),
            false => Err(Some("the method's unit is its own")),
        };
        let points = self.answered(&self.aligned);
        m.cloud_10k = self.thinned_cloud_error(&points);
        m.cloud = self.cloud_error(points);
        self.surface(m);
        m.depth_z = self.depth_error();
        self.calibration(m, curves);
    }

    /// Errors over the region's pixels of view A under an alignment.
    fn point_error(&self, aligned: &AlignedPair) -> Group<'static, PointError> {
        let error_m = aligned.error_m(&self.truth.points_in_cam_a[0], 0);
        point_error(masked(&error_m, &self.truth.plane_error_m, &self.region.masks[0])).ok_or(None)
    }

    /// Aligned points of the region's pixels in both views, `None` where there is no answer.
    fn answers_of_truth<'s>(
        &'s self,
        aligned: &'s AlignedPair,
    ) -> impl Iterator<Item = Option<Point3<f64>>> + 's {
        let of_view = |idx: usize| {
            let points = aligned.points_in_cam_a[idx].data.iter().zip(&self.region.masks[idx].data);
            points.filter(|(_, keep)| **keep).map(|(p, _)| p.z.is_finite().then_some(*p))
        };
        of_view(0).chain(of_view(1))
    }

    /// Aligned points of the region's answered pixels in both views.
    fn answered(&self, aligned: &AlignedPair) -> Vec<Point3<f64>> {
        self.answers_of_truth(aligned).flatten().collect()
    }

    /// The paper's form.
    fn thinned_cloud_error(&self, points: &[Point3<f64>]) -> Group<'static, CloudError> {
        let thinned = sample(points, &self.truth.settings, "predicted cloud");
        compare(&thinned, &self.region.sampled).ok_or(None)
    }

    fn cloud_error(&self, points: Vec<Point3<f64>>) -> Group<'static, CloudError> {
        // The answer of a pixel is likely to be the nearest to its truth, and its truth to its answer.
        let accuracy =
            self.region.cloud.mean_distance_from(&points, |idx| self.true_points.get(idx).copied());
        let answers: Vec<_> = self.answers_of_truth(&self.aligned).collect();
        let predicted = Cloud::new(points);
        let completeness = predicted.mean_distance_from(&self.region.cloud.points, |idx| answers[idx]);
        Ok(CloudError { accuracy: accuracy.ok_or(None)?, completeness: completeness.ok_or(None)? })
    }

    /// Slopes, hazards, and the maps of world Z and z-depth.
    fn surface(&self, m: &mut MeasuredRegion<'_>) {
        let (Some(footprint_m), Some(truth)) = (self.truth.facts.footprint_m, &self.truth.surface) else {
            return;
        };
        let z_axis = self.fit.cam_a_from_pred.rotation().transpose() * self.truth.z_axis_in_cam_a();
        let world_from_cam_a = self.truth.truth.world_from_cam_a();
        let points = &self.aligned.points_in_cam_a[0];
        let surface = Surface::new(points, &world_from_cam_a, footprint_m, &self.subject.normals, &z_axis);
        let mask = &self.region.masks[0];
        m.slopes = Ok(surface.scores(truth, mask));
        m.ceiling = self.region.ceiling.ok_or(Some("the truth is not quantised"));
        m.hazards = LIMITS_DEG.map(|limit_deg| {
            let slopes = masked(&surface.slopes[TRUE], &truth.slopes[TRUE], mask);
            hazard(slopes, limit_deg.to_radians()).ok_or(None)
        });
        let depth_z_m = |points: &Raster<Point3<f64>>| points.map(|p| p.z);
        m.world_z = Ok(self.map_scores(&surface.world_z_m, &truth.world_z_m));
        m.depth_map = Ok(self.map_scores(&depth_z_m(points), &depth_z_m(&self.truth.points_in_cam_a[0])));
    }

    fn map_scores(&self, found: &Raster<f64>, truth: &Raster<f64>) -> MapScores {
        let under_mask = |map: &Raster<f64>| {
            let data = map.data.iter().zip(&self.region.masks[0].data);
            let data = data.map(|(v, keep)| if *keep { *v } else { f64::NAN }).collect();
            Raster { width: map.width, height: map.height, data }
        };
        let (found, truth) = (under_mask(found), under_mask(truth));
        let is_whole = [&found, &truth].into_iter().all(|map| map.data.iter().all(|v| v.is_finite()));
        let ssim = ssim(&found, &truth);
        MapScores {
            ssim,
            ssim_whole: match self.region.region {
                Region::Overlap => Err(Some("without a mask there is the full picture only")),
                Region::Full => ssim.filter(|_| is_whole).ok_or(Some("not every pixel has truth and answer")),
            },
            central: profile::central(&found, &truth).ok_or(None),
            spaced: profile::spaced(&found, &truth).ok_or(None),
        }
    }

    fn depth_error(&self) -> Group<'static, DepthError> {
        let truth = &self.truth.truth;
        let found = [0, 1].map(|idx| self.aligned.depth_z_m(truth, idx));
        let given = [0, 1].map(|idx| truth.views[idx].depth_z.map(|z| f64::from(*z)));
        let of_view = |idx: usize| masked(&found[idx], &given[idx], &self.region.masks[idx]);
        depth_error(of_view(0).chain(of_view(1))).ok_or(None)
    }

    fn calibration(&self, m: &mut MeasuredRegion<'_>, curves: &mut Curves) {
        let (mut along_ray, mut by_sigma, mut by_confidence) = (Vec::new(), Vec::new(), Vec::new());
        let origins = [Point3::origin(), self.truth.truth.cam_b_from_cam_a().inverse().origin()];
        for (view_idx, view) in self.subject.answers.iter().enumerate() {
            let points = &self.aligned.points_in_cam_a[view_idx].data;
            let truth = &self.truth.points_in_cam_a[view_idx].data;
            let mask = &self.region.masks[view_idx].data;
            for idx in (0..points.len()).filter(|&idx| mask[idx] && view.is_answered(idx)) {
                let off = points[idx] - truth[idx];
                by_confidence.push((off.norm(), -f64::from(view.confidence.data[idx])));
                if let Some(sigma) = &view.sigma {
                    let sigma_m = f64::from(sigma.data[idx]) * self.fit.cam_a_from_pred.scale();
                    let ray = (truth[idx] - origins[view_idx]).normalize();
                    along_ray.push((off.dot(&ray), sigma_m));
                    by_sigma.push((off.norm(), sigma_m));
                }
            }
        }
        let scores = calibration(&along_ray);
        let no_sigma = scores.is_none().then_some("the method gives no sigma");
        (m.sigma, curves.reliability) = split(scores, no_sigma);
        (m.sigma_ause, curves.sigma_sparsification) = split(sparsification(&by_sigma), no_sigma);
        (m.confidence_ause, curves.confidence_sparsification) = split(sparsification(&by_confidence), None);
    }
}

/// Scores and their curve apart.
fn split<T, C>(found: Option<(T, C)>, why: Option<&'static str>) -> (Group<'static, T>, Option<C>) {
    let (scores, curve) = found.unzip();
    (scores.ok_or(why), curve)
}
