//! The truth of a pair made ready, so that many predictions are measured against it without doing its part again.

use super::region::{Subject, measure_region};
use super::surface::{SlopeScores, Surface};
use super::{PairMetrics, PairNumbers, Promise, Region, Settings};
use crate::Error;
use crate::aligned::{AlignedPair, Answers};
use crate::alignment::{self, NoAlignment, draw};
use crate::cloud::{Cloud, CloudError, box_diagonal, compare};
use crate::pose_error::pose_error;
use crate::slope::neighbour_normals::neighbour_normals;
use crate::truth::covisible::covisible;
use crate::truth::plane::Plane;
use crate::truth::{Precision, TruthPair};
use nalgebra::{Point3, Vector3};
use selenograph_dataset::photometric::dequantise::dequantise;
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::Prediction;
use std::collections::BTreeMap;

/// The truth of a pair, made ready.
#[derive(Debug, Clone)]
pub struct Reference {
    pub(super) truth: TruthPair,
    pub(super) settings: Settings,
    /// True points of A and of B in camera A's frame, metres; NaN where absent.
    pub(super) points_in_cam_a: [Raster<Point3<f64>>; 2],
    /// For each pixel of A, what no answer counts as, metres; NaN where there is no truth.
    pub(super) plane_error_m: Raster<f64>,
    pub(super) surface: Option<Surface>,
    pub(super) overlap: RegionReference,
    pub(super) full: RegionReference,
    numbers: PairNumbers,
}

/// What a region's truth gives by itself.
#[derive(Debug, Clone)]
pub(super) struct RegionReference {
    pub region: Region,
    pub masks: [Raster<bool>; 2],
    pub median_depth_z_m: Option<f64>,
    /// True points of both views.
    pub cloud: Cloud,
    /// The paper's draw from it.
    pub sampled: Cloud,
    /// Of another draw against it.
    pub floor: Option<CloudError>,
    /// Of the dequantised surface against the stored one; `None` where the truth is not quantised.
    pub ceiling: Option<SlopeScores>,
}

impl Reference {
    /// Prepares a truth.
    ///
    /// # Errors
    /// [`Error::Geometry`] if `settings.central_rows` is 0.
    pub fn new(truth: &TruthPair, settings: &Settings) -> Result<Self, Error> {
        let truth = match settings.central_rows {
            Some(rows) => truth.central_rows(rows)?,
            None => truth.clone(),
        };
        let cam_a_from_cam_b = truth.cam_b_from_cam_a().inverse();
        let points_in_cam_a = [
            truth.views[0].points_in_cam(),
            truth.views[1].points_in_cam().map(|p| cam_a_from_cam_b.point(p)),
        ];
        let [a, b] = &truth.views;
        let seen = [covisible(a, b), covisible(b, a)];
        let present = points_in_cam_a.each_ref().map(|points| points.map(|p| p.z.is_finite()));
        let numbers = pair_numbers(&truth, &points_in_cam_a, &seen);
        let footprint_m = numbers.footprint_m;
        let (surface, dequantised) = rayon::join(
            || footprint_m.map(|m| true_surface(&truth, &points_in_cam_a[0], m, settings)),
            || footprint_m.and_then(|m| dequantised_surface(&truth, m, settings)),
        );
        let plane = Plane::fit(points_in_cam_a[0].data.iter());
        let plane_error_m =
            points_in_cam_a[0].map(|p| plane.map_or(f64::NAN, |plane| plane.error_of(p)) + 0.0 * p.z);
        let region = |region: Region, masks: [Raster<bool>; 2]| {
            let surfaces = surface.as_ref().zip(dequantised.as_ref());
            let ceiling = surfaces.map(|(stored, smooth)| smooth.scores(stored, &masks[0]));
            RegionReference::new(region, masks, &points_in_cam_a, settings, ceiling)
        };
        let (overlap, full) = rayon::join(|| region(Region::Overlap, seen), || region(Region::Full, present));
        let settings = settings.clone();
        Ok(Self { truth, settings, points_in_cam_a, plane_error_m, surface, overlap, full, numbers })
    }

    /// The truth, cropped as the settings ask.
    pub fn truth(&self) -> &TruthPair {
        &self.truth
    }

    /// True points of A and of B in camera A's frame, metres; NaN where absent.
    pub fn points_in_cam_a(&self) -> &[Raster<Point3<f64>>; 2] {
        &self.points_in_cam_a
    }

    /// The pixels of a region, in A and in B.
    pub fn masks(&self, region: Region) -> &[Raster<bool>; 2] {
        &self.region(region).masks
    }

    /// Carries a prediction into metres by the robust similarity of a region; `None` where it has no points, and the reason
    /// where there is no similarity. For figures: [`Reference::measure`] does it by itself.
    ///
    /// # Errors
    /// [`Error::Raster`] if a view has not the size of the truth.
    pub fn align(
        &self,
        prediction: &Prediction,
        region: Region,
    ) -> Result<Option<Result<AlignedPair, NoAlignment>>, Error> {
        let Some(answers) = Answers::of_prediction(prediction, &self.truth)? else { return Ok(None) };
        let (predicted, truth) = self.correspondences(&answers, region);
        Ok(Some(alignment::robust(&predicted, &truth).map(|fit| AlignedPair::new(&answers, fit))))
    }

    /// Every metric of a prediction.
    ///
    /// # Errors
    /// [`Error::Raster`] if a view is not as wide as the truth, or has fewer rows.
    pub fn measure(&self, prediction: &Prediction, promise: Promise) -> Result<PairMetrics, Error> {
        let answers = match promise {
            Promise::Pose => None,
            Promise::Points | Promise::MetricPoints => Answers::of_prediction(prediction, &self.truth)?,
        };
        let no_points = match (promise, &prediction.cam_b_from_cam_a) {
            (Promise::Pose, _) => "the method gives a pose only".into(),
            (_, Err(cannot_say)) => format!("no points: {cannot_say}"),
            (_, Ok(_)) => "no points".into(),
        };
        let subject = answers.as_ref().map(|answers| Subject::new(self, answers, promise));
        let region =
            |which: &RegionReference| measure_region(self, which, subject.as_ref(), promise, &no_points);
        let (overlap, full) = rayon::join(|| region(&self.overlap), || region(&self.full));
        let mut metrics =
            PairMetrics { numbers: self.numbers.clone(), overlap, full, ..PairMetrics::default() };
        metrics.pose_failed = pose(&self.truth, prediction, &mut metrics.numbers, &mut metrics.missing);
        metrics.numbers.keep_finite();
        for (key, value) in metrics.numbers.iter() {
            if value.is_none() {
                metrics.missing.entry(key.into()).or_insert_with(|| "no truth".into());
            }
        }
        Ok(metrics)
    }

    pub(super) fn region(&self, region: Region) -> &RegionReference {
        match region {
            Region::Overlap => &self.overlap,
            Region::Full => &self.full,
        }
    }

    /// Footprint of a pixel, metres; `None` without truth in A.
    pub(super) fn footprint_m(&self) -> Option<f64> {
        self.numbers.footprint_m
    }

    /// Diagonal of the box around the truth, metres.
    pub(super) fn bbox_diagonal_m(&self) -> Option<f64> {
        self.numbers.bbox_diagonal_m
    }

    /// The world's Z axis in camera A's frame.
    pub(super) fn z_axis_in_cam_a(&self) -> Vector3<f64> {
        z_axis_in_cam_a(&self.truth)
    }

    /// Answers and truth of the region's pixels in both views that have both.
    pub(super) fn correspondences(
        &self,
        answers: &[Answers; 2],
        region: Region,
    ) -> (Vec<Point3<f64>>, Vec<Point3<f64>>) {
        let masks = self.masks(region);
        let of_view = |view_idx: usize| {
            let (view, truth) = (&answers[view_idx], &self.points_in_cam_a[view_idx]);
            let wanted = move |idx: &usize| masks[view_idx].data[*idx] && view.is_answered(*idx);
            (0..truth.data.len()).filter(wanted).map(move |idx| (view.points.data[idx], truth.data[idx]))
        };
        of_view(0).chain(of_view(1)).unzip()
    }
}

impl RegionReference {
    fn new(
        region: Region,
        masks: [Raster<bool>; 2],
        points: &[Raster<Point3<f64>>; 2],
        settings: &Settings,
        ceiling: Option<SlopeScores>,
    ) -> Self {
        let of_view = |idx: usize| {
            points[idx].data.iter().zip(&masks[idx].data).filter(|(_, keep)| **keep).map(|(p, _)| *p)
        };
        let median_depth_z_m = statistics::median(of_view(0).map(|p| p.z));
        let cloud = Cloud::new(of_view(0).chain(of_view(1)).collect());
        let [sampled, again] =
            ["truth cloud", "predicted cloud"].map(|purpose| sample(&cloud.points, settings, purpose));
        let floor = compare(&again, &sampled);
        Self { region, masks, median_depth_z_m, cloud, sampled, floor, ceiling }
    }
}

/// The paper's thinned cloud. Its draws differ for prediction and truth.
pub(super) fn sample(points: &[Point3<f64>], settings: &Settings, purpose: &str) -> Cloud {
    let drawn = draw(points.len(), settings.num_sampled, settings.seed, purpose);
    Cloud::new(drawn.into_iter().map(|idx| points[idx]).collect())
}

fn z_axis_in_cam_a(truth: &TruthPair) -> Vector3<f64> {
    truth.world_from_cam_a().inverse().vector(&Vector3::z())
}

fn true_surface(
    truth: &TruthPair,
    points: &Raster<Point3<f64>>,
    footprint_m: f64,
    settings: &Settings,
) -> Surface {
    let normals = neighbour_normals(points, settings.normals_stride);
    Surface::new(points, &truth.world_from_cam_a(), footprint_m, &normals, &z_axis_in_cam_a(truth))
}

/// The surface behind half-float steps; `None` where there are none.
fn dequantised_surface(truth: &TruthPair, footprint_m: f64, settings: &Settings) -> Option<Surface> {
    let view = &truth.views[0];
    if view.precision != Precision::Half {
        return None;
    }
    let (smooth, rays) = (dequantise(&view.depth_z), view.rays_z1());
    let data = rays.data.iter().zip(&smooth.data).map(|(ray, z)| Point3::from(ray * *z)).collect();
    let points = Raster { width: rays.width, height: rays.height, data };
    Some(true_surface(truth, &points, footprint_m, settings))
}

fn pair_numbers(
    truth: &TruthPair,
    points: &[Raster<Point3<f64>>; 2],
    seen: &[Raster<bool>; 2],
) -> PairNumbers {
    let world_from_cam_a = truth.world_from_cam_a();
    let in_world = points.iter().flat_map(|view| view.data.iter().map(|p| world_from_cam_a.point(p)));
    let share = |idx: usize| {
        let count = |values: &mut dyn Iterator<Item = bool>| values.filter(|v| *v).count() as f64;
        let all = count(&mut points[idx].data.iter().map(|p| p.z.is_finite()));
        Some(count(&mut seen[idx].data.iter().copied()) / all).filter(|share| share.is_finite())
    };
    let view = &truth.views[0];
    PairNumbers {
        bbox_diagonal_m: box_diagonal(in_world),
        footprint_m: view.median_depth_z_m().map(|z| view.camera.gsd_m(z)),
        baseline_m: Some(truth.cam_b_from_cam_a().origin().coords.norm()),
        covisible_share_a: share(0),
        covisible_share_b: share(1),
        ..PairNumbers::default()
    }
}

/// The pose's errors, or why there are none; returns whether the method failed.
fn pose(
    truth: &TruthPair,
    prediction: &Prediction,
    numbers: &mut PairNumbers,
    missing: &mut BTreeMap<String, String>,
) -> bool {
    let cam_b_from_cam_a = truth.cam_b_from_cam_a();
    match &prediction.cam_b_from_cam_a {
        Ok(estimate) => {
            let error = pose_error(&cam_b_from_cam_a, estimate);
            numbers.rra_deg = Some(error.rra_deg);
            numbers.rta_deg = error.rta_deg;
            let has_direction = |t: Point3<f64>| t.coords.try_normalize(0.0).is_some();
            let failed = !has_direction(estimate.origin()) || !error.rra_deg.is_finite();
            if error.rta_deg.is_none() {
                let whose = if failed { "estimated" } else { "true" };
                missing.insert("rta_deg".into(), format!("the {whose} translation has no direction"));
            }
            failed
        }
        Err(cannot_say) => {
            for key in ["rra_deg", "rta_deg"] {
                missing.insert(key.into(), cannot_say.to_string());
            }
            true
        }
    }
}

/// Every metric of one prediction; prepare a [`Reference`] once where there are several.
///
/// # Errors
/// Those of [`Reference::new`] and [`Reference::measure`].
pub fn measure(
    truth: &TruthPair,
    prediction: &Prediction,
    promise: Promise,
    settings: &Settings,
) -> Result<PairMetrics, Error> {
    Reference::new(truth, settings)?.measure(prediction, promise)
}
