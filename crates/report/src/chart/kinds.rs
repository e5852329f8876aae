//! Plots that reports use again and again.

use super::{Axis, Chart};
use crate::color::{self, PREDICTION, QUIET, TRUTH};

/// Share of cases with an error up to `x`, one curve per name. A case without an answer has the error `f64::INFINITY` or NaN: it
/// counts among all and is never below.
pub fn cumulative(title: &str, x: Axis, curves: &[(String, Vec<f64>)]) -> Chart {
    let mut chart = Chart::new(title, x, Axis::new("share of pairs").between(0.0, 1.0));
    for (k, (name, errors)) in curves.iter().enumerate() {
        let mut sorted: Vec<f64> = errors.iter().copied().filter(|e| e.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let share = |count: usize| count as f64 / errors.len().max(1) as f64;
        let mut points = Vec::with_capacity(2 * sorted.len() + 2);
        if let (Some(first), super::Scale::Linear) = (sorted.first(), chart.x.scale) {
            points.push([first.min(0.0), 0.0]);
        }
        for (index, error) in sorted.iter().enumerate() {
            points.push([*error, share(index)]);
            points.push([*error, share(index + 1)]);
        }
        if let (Some([_, end]), Some(last)) = (chart.x.range, sorted.last())
            && *last < end
        {
            points.push([end, share(sorted.len())]);
        }
        chart = chart.line(name.clone(), color::series(k), points);
    }
    chart
}

/// Observed against expected, with the diagonal of a sigma that tells the truth.
pub fn reliability(title: &str, x: Axis, y: Axis, curves: &[(String, Vec<[f64; 2]>)]) -> Chart {
    let all = || curves.iter().flat_map(|(_, points)| points.iter().flatten().copied());
    let [low, high] = x.ends(all());
    let mut chart = Chart::new(title, x.between(low, high), y.between(low, high)).size(440.0, 440.0).dashed(
        "ideal",
        QUIET,
        vec![[low, low], [high, high]],
    );
    for (k, (name, points)) in curves.iter().enumerate() {
        chart = chart.line(name.clone(), color::series(k), points.clone()).dots(
            "",
            color::series(k),
            points.clone(),
        );
    }
    chart
}

/// What a profile shows, one value per place.
#[derive(Debug, Clone, Default)]
pub struct Profile<'a> {
    /// Where along the line.
    pub distance: &'a [f64],
    /// The truth, where there is one.
    pub truth: Option<&'a [f64]>,
    /// The prediction.
    pub prediction: &'a [f64],
    /// One standard deviation of the prediction.
    pub sigma: Option<&'a [f64]>,
    /// Where the prediction is completed from its surroundings and nothing was measured.
    pub completed: Option<&'a [bool]>,
}

/// A profile: truth in blue, prediction in orange with a band of one sigma, dashed where it is completed. NaN breaks the lines.
pub fn profile(title: &str, x: Axis, y: Axis, profile: &Profile<'_>) -> Chart {
    let along = |values: &[f64]| -> Vec<[f64; 2]> {
        profile.distance.iter().zip(values).map(|(d, v)| [*d, *v]).collect()
    };
    let mut chart = Chart::new(title, x, y).size(900.0, 320.0);
    if let Some(sigma) = profile.sigma {
        let pieces = profile.distance.iter().zip(profile.prediction).zip(sigma);
        let band: Vec<[f64; 3]> = pieces.map(|((d, v), s)| [*d, v - s, v + s]).collect();
        // A band is one outline: a gap in it is a new band.
        let is_whole = |piece: &[f64; 3]| piece.iter().all(|v| v.is_finite());
        for (k, run) in band.split(|piece| !is_whole(piece)).filter(|run| run.len() > 1).enumerate() {
            chart = chart.band(if k == 0 { "± one sigma" } else { "" }, PREDICTION, run.to_vec());
        }
    }
    if let Some(truth) = profile.truth {
        chart = chart.line("truth", TRUTH, along(truth));
    }
    let Some(completed) = profile.completed else {
        return chart.line("prediction", PREDICTION, along(profile.prediction));
    };
    let [measured, completed] = [false, true].map(|which| -> Vec<f64> {
        let kept = profile.prediction.iter().zip(completed);
        kept.map(|(value, is_completed)| if *is_completed == which { *value } else { f64::NAN }).collect()
    });
    if completed.iter().any(|value| value.is_finite()) {
        chart = chart.dashed("completed", PREDICTION, along(&completed));
    }
    chart.line("prediction", PREDICTION, along(&measured))
}

/// The strip below a profile: prediction minus truth, which the profile hides where both coincide; `None` without a truth.
pub fn residual(x: Axis, y: Axis, profile: &Profile<'_>) -> Option<Chart> {
    let off = profile.prediction.iter().zip(profile.truth?).map(|(prediction, truth)| prediction - truth);
    let points: Vec<[f64; 2]> = profile.distance.iter().zip(off).map(|(d, v)| [*d, v]).collect();
    let ends = [profile.distance.first(), profile.distance.last()].map(|end| end.copied().unwrap_or(0.0));
    let chart = Chart::new("prediction − truth", x, y).size(900.0, 150.0);
    Some(chart.dashed("", QUIET, ends.map(|end| [end, 0.0]).to_vec()).line("", PREDICTION, points))
}
