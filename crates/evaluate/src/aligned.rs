//! A prediction carried into metres beside the truth: the maps that are measured, and drawn.

use crate::alignment::{Alignment, Carry};
use crate::truth::TruthPair;
use crate::{Error, slope};
use selenograph_geometry::Point3;
use selenograph_raster::Raster;
use selenograph_reconstruct::{Fill, PredictedView, Prediction};

/// What a method answers for one view, in the prediction's frame and unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Answers {
    /// Points in `PredA`; NaN where there is no answer.
    pub points: Raster<Point3<f64>>,
    /// Confidence in `[0, 1]`.
    pub confidence: Raster<f32>,
    /// Standard deviation along the ray, in the prediction's unit.
    pub sigma: Option<Raster<f32>>,
    /// Where each answer comes from; absent where there is none.
    pub fill: Raster<Fill>,
}

impl Answers {
    /// From a predicted view, of whose rows the central ones are taken if it has more than the truth.
    ///
    /// # Errors
    /// [`Error::Raster`] if its rasters differ in size or are not as wide and at least as high as the truth.
    pub fn new(view: &PredictedView, width: usize, height: usize) -> Result<Self, Error> {
        let size = (view.points.width, view.points.height);
        let sigma_size = view.sigma.as_ref().map_or(size, |s| (s.width, s.height));
        let others = [
            (view.confidence.width, view.confidence.height),
            (view.fill.width, view.fill.height),
            sigma_size,
        ];
        if size.0 != width || size.1 < height || others.iter().any(|other| *other != size) {
            return Err(Error::Raster(selenograph_raster::Error::SizeMismatch {
                what: "predicted view",
                expected: format!("{width}×{height} pixels, as the truth has"),
                found: format!("{}×{}", size.0, size.1),
            }));
        }
        let top = (size.1 - height) / 2;
        let first = top * width;
        let is_answer = |p: &[f32; 3], fill: Fill| fill != Fill::Absent && p.iter().all(|c| c.is_finite());
        let crop = |raster: &Raster<f32>| crate::truth::crop_rows(raster, top, height);
        let mut fill = crate::truth::crop_rows(&view.fill, top, height);
        let points = view.points.data[first..first + width * height]
            .iter()
            .zip(&mut fill.data)
            .map(|(p, fill)| {
                if is_answer(p, *fill) {
                    Point3::from(p.map(f64::from))
                } else {
                    *fill = Fill::Absent;
                    Point3::from([f64::NAN; 3])
                }
            })
            .collect();
        Ok(Self {
            points: Raster { width, height, data: points },
            confidence: crop(&view.confidence),
            sigma: view.sigma.as_ref().map(crop),
            fill,
        })
    }

    /// Both views of a prediction as large as the truth; `None` where it has no points at all.
    ///
    /// # Errors
    /// Those of [`Answers::new`].
    pub fn of_prediction(prediction: &Prediction, truth: &TruthPair) -> Result<Option<[Self; 2]>, Error> {
        let Some(views) = &prediction.views else { return Ok(None) };
        let new = |idx: usize| {
            let depth_z = &truth.views[idx].depth_z;
            Self::new(&views[idx], depth_z.width, depth_z.height)
        };
        Ok(Some([new(0)?, new(1)?]))
    }

    /// Whether there is an answer at a pixel.
    pub fn is_answered(&self, idx: usize) -> bool {
        self.fill.data[idx] != Fill::Absent
    }
}

/// Both views' answers in camera A's frame, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct AlignedPair {
    /// How they were brought there; `None` for metric points taken as they are.
    pub alignment: Option<Alignment>,
    /// Points of A and of B in camera A's frame, metres; NaN where there is no answer.
    pub points_in_cam_a: [Raster<Point3<f64>>; 2],
}

impl AlignedPair {
    /// Carries the answers of both views.
    pub fn new(answers: &[Answers; 2], alignment: Alignment) -> Self {
        let carry = Carry::new(&alignment.cam_a_from_pred);
        let points_in_cam_a = answers.each_ref().map(|view| view.points.map(|p| carry.point(p)));
        Self { alignment: Some(alignment), points_in_cam_a }
    }

    /// Metric answers as they are.
    pub fn unaligned(answers: &[Answers; 2]) -> Self {
        Self { alignment: None, points_in_cam_a: answers.each_ref().map(|view| view.points.clone()) }
    }

    /// World Z of a view's answers, metres.
    pub fn world_z_m(&self, truth: &TruthPair, view_idx: usize) -> Raster<f64> {
        slope::world_z(&self.points_in_cam_a[view_idx], &truth.world_from_cam_a())
    }

    /// z-depth of a view's answers in its own camera, metres.
    pub fn depth_z_m(&self, truth: &TruthPair, view_idx: usize) -> Raster<f64> {
        let points = &self.points_in_cam_a[view_idx];
        if view_idx == 0 {
            return points.map(|p| p.z);
        }
        let cam_b_from_cam_a = truth.cam_b_from_cam_a();
        let row = cam_b_from_cam_a.rotation().row(2).transpose();
        let origin = cam_b_from_cam_a.origin().z;
        points.map(|p| row.dot(&p.coords) + origin)
    }

    /// Slope against the local vertical (see [`slope::true_slope`]) of a view's answers, radians.
    pub fn slope_rad(&self, truth: &TruthPair, view_idx: usize) -> Raster<f64> {
        slope::true_slope(&self.points_in_cam_a[view_idx], &truth.world_from_cam_a())
    }

    /// Distance of every answer of a view to the true point of its pixel, metres.
    pub fn error_m(&self, truth_in_cam_a: &Raster<Point3<f64>>, view_idx: usize) -> Raster<f64> {
        let points = &self.points_in_cam_a[view_idx];
        let data = points.data.iter().zip(&truth_in_cam_a.data).map(|(p, t)| (p - t).norm()).collect();
        Raster { width: points.width, height: points.height, data }
    }
}
