//! Losses, one file each, and their sum.

mod confidence;
mod epipolar;
mod matching;
mod normals;
mod precision;
mod reduce;
mod regression;
mod slope;
#[cfg(test)]
mod tests;

pub(crate) use confidence::confidence_weighted;
pub use epipolar::epipolar;
pub use matching::{MatchingLoss, MatchingSettings, info_nce, matching};
pub use normals::normals;
pub use precision::{average_precision, reciprocal_ranks};
pub use regression::{Normalised, PixelLoss, normalise, regression};
pub use slope::slope;

use crate::batch::{Targets, ViewOutput};
use burn_tensor::{Int, Tensor};
use reduce::masked_mean;
use serde::{Deserialize, Serialize};

/// Which losses, and their weights. A weight of zero switches a loss off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossSettings {
    /// Weight of the logarithm of the confidence in the regression loss.
    pub confidence_alpha: f64,
    /// Regression loss of a pixel of the sky.
    pub sky: f64,
    /// Descriptors.
    pub matching: MatchingSettings,
    /// Weight of the slope loss.
    pub slope_weight: f64,
    /// Weight of the loss of normals.
    pub normals_weight: f64,
    /// Weight of the epipolar residual.
    pub epipolar_weight: f64,
}

impl Default for LossSettings {
    fn default() -> Self {
        Self {
            confidence_alpha: 0.2,
            sky: 2.0,
            matching: MatchingSettings::default(),
            slope_weight: 0.0,
            normals_weight: 0.0,
            epipolar_weight: 0.0,
        }
    }
}

/// Names of the terms, in the order in which they are reported.
pub mod term {
    /// Regression loss of view A, plain.
    pub const REGRESSION_A: &str = "regression_a";
    /// Regression loss of view B, plain.
    pub const REGRESSION_B: &str = "regression_b";
    /// Regression loss of view A, weighted by confidence.
    pub const CONFIDENCE_A: &str = "confidence_a";
    /// Regression loss of view B, weighted by confidence.
    pub const CONFIDENCE_B: &str = "confidence_b";
    /// InfoNCE, plain.
    pub const MATCHING: &str = "matching";
    /// InfoNCE, weighted by confidence.
    pub const MATCHING_CONFIDENCE: &str = "matching_confidence";
    /// Slope loss.
    pub const SLOPE: &str = "slope";
    /// Loss of normals.
    pub const NORMALS: &str = "normals";
    /// Epipolar residual.
    pub const EPIPOLAR: &str = "epipolar";
    /// Average precision of the descriptors.
    pub const PRECISION: &str = "average_precision";
}

/// A loss and what it is made of.
#[derive(Debug, Clone)]
pub struct Loss {
    /// What is minimised.
    pub total: Tensor<1>,
    /// Its terms before their weights, detached.
    pub terms: Vec<(&'static str, Tensor<1>)>,
}

/// The training loss of a batch.
pub fn training_loss(output: &[ViewOutput; 2], targets: &Targets, settings: &LossSettings) -> Loss {
    let points = normalise(output, targets);
    let [pixels_a, pixels_b] = regression(&points, targets, Some(settings.sky));
    let alpha = settings.confidence_alpha;
    let weighted_a = confidence_weighted(&pixels_a, output[0].confidence.clone(), alpha);
    let weighted_b = confidence_weighted(&pixels_b, output[1].confidence.clone(), alpha);
    let mut sum = Sum::new(weighted_a.clone() + weighted_b.clone());
    sum.report(term::REGRESSION_A, masked_mean(pixels_a.loss, pixels_a.mask));
    sum.report(term::REGRESSION_B, masked_mean(pixels_b.loss, pixels_b.mask));
    sum.report(term::CONFIDENCE_A, weighted_a);
    sum.report(term::CONFIDENCE_B, weighted_b);
    if let Some(matches) = targets.matches.as_ref().filter(|_| settings.matching.weight > 0.0) {
        let MatchingLoss { weighted, plain } = matching(output, matches, &settings.matching);
        sum.report(term::MATCHING, plain);
        sum.add(term::MATCHING_CONFIDENCE, weighted, settings.matching.weight);
    }
    if settings.slope_weight > 0.0 {
        sum.add(term::SLOPE, slope(&points, targets), settings.slope_weight);
    }
    if settings.normals_weight > 0.0 {
        sum.add(term::NORMALS, normals(&points, targets), settings.normals_weight);
    }
    if let Some(planes) = targets.epipolar_normals.as_ref().filter(|_| settings.epipolar_weight > 0.0) {
        sum.add(term::EPIPOLAR, epipolar(output, planes), settings.epipolar_weight);
    }
    sum.0
}

/// The test criterion of a batch: regression at valid pixels of both views minus the average precision of the
/// descriptors, with the pixels `padding` (B × p) of view B as further candidates.
pub fn test_criterion(output: &[ViewOutput; 2], targets: &Targets, padding: Option<&Tensor<2, Int>>) -> Loss {
    let points = normalise(output, targets);
    let [first, second] =
        regression(&points, targets, None).map(|pixels| masked_mean(pixels.loss, pixels.mask));
    let mut sum = Sum::new(first.clone() + second.clone());
    sum.report(term::REGRESSION_A, first);
    sum.report(term::REGRESSION_B, second);
    if let Some(matches) = &targets.matches {
        sum.add(term::PRECISION, average_precision(output, matches, padding), -1.0);
    }
    sum.0
}

struct Sum(Loss);

impl Sum {
    fn new(total: Tensor<1>) -> Self {
        Self(Loss { total, terms: Vec::new() })
    }

    fn report(&mut self, name: &'static str, value: Tensor<1>) {
        self.0.terms.push((name, value.detach()));
    }

    fn add(&mut self, name: &'static str, value: Tensor<1>, weight: f64) {
        self.0.total = self.0.total.clone() + value.clone() * weight;
        self.report(name, value);
    }
}
