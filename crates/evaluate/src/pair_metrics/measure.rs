//! A prediction against a prepared truth: the metrics of the pair and of its regions.

use super::measured::MeasuredPair;
use super::prepared::{PreparedTruth, RegionTruth};
use super::region::{Measuring, Subject, coverage, of_truth};
use super::{Curves, PairMetrics, PairNumbers, Promise, RegionMetrics, RegionNumbers, Settings};
use crate::Error;
use crate::aligned::Answers;
use crate::pose_error::pose_error;
use crate::truth::TruthPair;
use selenograph_geometry::Point3;
use selenograph_reconstruct::Prediction;

/// Every metric of one prediction; make a [`PreparedTruth`] once where there are several.
///
/// # Errors
/// Those of [`PreparedTruth::new`] and [`PreparedTruth::measure`].
pub fn measure(
    truth: &TruthPair,
    prediction: &Prediction,
    promise: Promise,
    settings: &Settings,
) -> Result<PairMetrics, Error> {
    PreparedTruth::new(truth, settings)?.measure(prediction, promise)
}

impl PreparedTruth {
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
        let region = |which: &RegionTruth| self.measure_region(which, subject.as_ref(), promise, &no_points);
        let (overlap, full) = rayon::join(|| region(&self.overlap), || region(&self.full));
        let cannot_say = prediction.cam_b_from_cam_a.as_ref().err().map(ToString::to_string);
        let pose = prediction.cam_b_from_cam_a.as_ref().map_err(|_| cannot_say.as_deref());
        let pose = pose.map(|estimate| {
            let has_direction = |t: Point3<f64>| t.coords.try_normalize(0.0).is_some();
            (pose_error(&self.truth.cam_b_from_cam_a(), estimate), has_direction(estimate.origin()))
        });
        let pose_failed = !pose.is_ok_and(|(error, is_directed)| is_directed && error.rra_deg.is_finite());
        let pose = pose.map(|(error, _)| error);
        let pair = MeasuredPair { truth: &self.facts, pose, pose_failed, why: "no truth" };
        let (numbers, missing) = PairNumbers::of(&pair);
        Ok(PairMetrics { numbers, pose_failed, overlap, full, missing })
    }

    fn measure_region(
        &self,
        region: &RegionTruth,
        subject: Option<&Subject<'_>>,
        promise: Promise,
        no_points: &str,
    ) -> RegionMetrics {
        let mut curves = Curves::default();
        let mut measured = of_truth(self, region);
        let no_alignment;
        if !region.masks[0].data.contains(&true) {
            measured.why = "no pixel in the region";
        } else if let Some(subject) = subject {
            match Measuring::new(self, region, subject) {
                Ok(measuring) => measuring.measure(&mut measured, &mut curves),
                Err(error) => {
                    no_alignment = error.to_string();
                    measured.why = &no_alignment;
                    measured.unanswered();
                    measured.coverage = Ok(coverage(region, subject.answers));
                }
            }
        } else {
            measured.why = no_points;
            if promise != Promise::Pose {
                measured.unanswered();
            }
        }
        let (numbers, missing) = RegionNumbers::of(&measured);
        RegionMetrics { numbers, curves, missing }
    }
}
