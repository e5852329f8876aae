//! The truth of a pair made ready, so that many predictions are measured against it without doing its part again.

use super::{PairMetrics, PairNumbers, Promise, Settings};
use crate::Error;
use crate::pose_error::pose_error;
use crate::truth::TruthPair;
use selenograph_reconstruct::Prediction;
use std::collections::BTreeMap;

/// The truth of a pair, made ready.
#[derive(Debug, Clone)]
pub struct Reference {
    truth: TruthPair,
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
        Ok(Self { truth })
    }

    /// The truth, cropped as the settings ask.
    pub fn truth(&self) -> &TruthPair {
        &self.truth
    }

    /// Every metric of a prediction.
    ///
    /// # Errors
    /// [`Error::Raster`] if a view has neither the size of the truth nor of its central rows.
    pub fn measure(&self, prediction: &Prediction, promise: Promise) -> Result<PairMetrics, Error> {
        let mut metrics = PairMetrics::default();
        let _ = promise;
        pose(&self.truth, prediction, &mut metrics.numbers, &mut metrics.missing);
        metrics.pose_failed = metrics.numbers.rta_deg.is_none();
        Ok(metrics)
    }
}

/// The pose's errors, or why there are none.
fn pose(
    truth: &TruthPair,
    prediction: &Prediction,
    numbers: &mut PairNumbers,
    missing: &mut BTreeMap<String, String>,
) {
    let cam_b_from_cam_a = truth.cam_b_from_cam_a();
    numbers.baseline_m = Some(cam_b_from_cam_a.origin().coords.norm());
    match &prediction.cam_b_from_cam_a {
        Ok(estimate) => {
            let error = pose_error(&cam_b_from_cam_a, estimate);
            numbers.rra_deg = Some(error.rra_deg);
            numbers.rta_deg = error.rta_deg;
            if error.rta_deg.is_none() {
                missing.insert("rta_deg".into(), "one of the translations is zero".into());
            }
        }
        Err(cannot_say) => {
            for key in ["rra_deg", "rta_deg"] {
                missing.insert(key.into(), cannot_say.to_string());
            }
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
