//! The test criterion on held-out pairs.

use super::metrics::ValidationRecord;
use crate::Error;
use crate::batch::HostBatch;
use crate::loss::{term, test_criterion};
use crate::network::PairNetwork;
use std::collections::BTreeMap;

/// Pixels of the second view among which a match must stand out, besides the other matches.
///
/// # Source
/// Leroy et al. 2024, "MASt3R": the padding of its test loss.
const PADDING_PX: usize = 12_288;

/// The test criterion over `batches`; the score is its median, as the published runs choose their best weights.
///
/// # Errors
/// What the network says.
pub fn judge(network: &dyn PairNetwork, batches: &[HostBatch], step: u64) -> Result<ValidationRecord, Error> {
    let device = network.device();
    let mut totals = Vec::new();
    let mut values = BTreeMap::new();
    for batch in batches {
        let output = network.forward(&batch.images)?;
        let padding = batch.padding(PADDING_PX, &device);
        let loss = test_criterion(&output, &batch.targets(&device), padding.as_ref());
        totals.push(f64::from(loss.total.into_scalar::<f32>()));
        for (name, value) in loss.terms {
            *values.entry(name.to_owned()).or_insert(0.0) +=
                f64::from(value.into_scalar::<f32>()) / batches.len() as f64;
        }
    }
    if let [Some(a), Some(b)] = [term::REGRESSION_A, term::REGRESSION_B].map(|name| values.get(name)) {
        values.insert("regression".into(), a + b);
    }
    totals.sort_by(f64::total_cmp);
    let median = totals.get(totals.len() / 2).copied().unwrap_or(f64::INFINITY);
    Ok(ValidationRecord { step, score: median, values })
}
