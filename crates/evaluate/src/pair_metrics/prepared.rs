//! The truth of a pair made ready, so that many predictions are measured against it without doing its part again.

use super::surface::{SlopeScores, Surface};
use super::{Region, Settings};
use crate::Error;
use crate::aligned::{AlignedPair, Answers};
use crate::alignment::{self, NoAlignment, draw};
use crate::cloud::{Cloud, CloudError, box_diagonal, compare};
use crate::slope::neighbour_normals::neighbour_normals;
use crate::truth::covisible::covisible;
use crate::truth::plane::Plane;
use crate::truth::{Precision, TruthPair};
use selenograph_dataset::photometric::dequantise::dequantise;
use selenograph_geometry::{Point3, Vector3};
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::Prediction;

/// The truth of a pair, made ready.
#[derive(Debug, Clone)]
pub struct PreparedTruth {
    pub(super) truth: TruthPair,
    pub(super) settings: Settings,
    /// True points of A and of B in camera A's frame, metres; NaN where absent.
    pub(super) points_in_cam_a: [Raster<Point3<f64>>; 2],
    /// For each pixel of A, what no answer counts as, metres; NaN where there is no truth.
    pub(super) plane_error_m: Raster<f64>,
    pub(super) surface: Option<Surface>,
    pub(super) overlap: RegionTruth,
    pub(super) full: RegionTruth,
    pub(super) facts: TruthFacts,
}

/// What the truth of a pair gives by itself.
#[derive(Debug, Clone)]
pub(super) struct TruthFacts {
    /// Diagonal of the box around the truth, metres.
    pub bbox_diagonal_m: Option<f64>,
    /// Footprint of a pixel, metres; `None` without truth in A.
    pub footprint_m: Option<f64>,
    pub baseline_m: f64,
    /// Shares of A's and of B's pixels whose ground the other sees.
    pub covisible_shares: [Option<f64>; 2],
}

/// What a region's truth gives by itself.
#[derive(Debug, Clone)]
pub(super) struct RegionTruth {
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

impl PreparedTruth {
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
        let facts = TruthFacts::new(&truth, &points_in_cam_a, &seen);
        let footprint_m = facts.footprint_m;
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
            RegionTruth::new(region, masks, &points_in_cam_a, settings, ceiling)
        };
        let (overlap, full) = rayon::join(|| region(Region::Overlap, seen), || region(Region::Full, present));
        let settings = settings.clone();
        Ok(Self { truth, settings, points_in_cam_a, plane_error_m, surface, overlap, full, facts })
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
    /// where there is no similarity. For figures: [`PreparedTruth::measure`] does it by itself.
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

    pub(super) fn region(&self, region: Region) -> &RegionTruth {
        match region {
            Region::Overlap => &self.overlap,
            Region::Full => &self.full,
        }
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

impl TruthFacts {
    fn new(truth: &TruthPair, points: &[Raster<Point3<f64>>; 2], seen: &[Raster<bool>; 2]) -> Self {
        let world_from_cam_a = truth.world_from_cam_a();
        let in_world = points.iter().flat_map(|view| view.data.iter().map(|p| world_from_cam_a.point(p)));
        let share = |idx: usize| {
            let count = |values: &mut dyn Iterator<Item = bool>| values.filter(|v| *v).count() as f64;
            let all = count(&mut points[idx].data.iter().map(|p| p.z.is_finite()));
            Some(count(&mut seen[idx].data.iter().copied()) / all).filter(|share| share.is_finite())
        };
        let view = &truth.views[0];
        Self {
            bbox_diagonal_m: box_diagonal(in_world),
            footprint_m: view.median_depth_z_m().map(|z| view.camera.gsd_m(z)),
            baseline_m: truth.cam_b_from_cam_a().origin().coords.norm(),
            covisible_shares: [share(0), share(1)],
        }
    }
}

impl RegionTruth {
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
