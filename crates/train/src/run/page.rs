//! `training.html`: curves of a run and what its network makes of a held-out pair, in one file.

use super::checkpoint::host_values;
use super::metrics::{Record, StepRecord, ValidationRecord};
use crate::Error;
use crate::batch::HostBatch;
use crate::loss::normalise;
use crate::network::PairNetwork;
use burn_tensor::Tensor;
use selenograph_raster::Raster;
use selenograph_raster::colormap::Colormap;
use selenograph_report::figure::{ColorBar, Panel};
use selenograph_report::{Axis, Chart, Figure, Page, Picture, color};
use std::collections::BTreeSet;

/// Points of a curve; more are thinned out.
const MAX_POINTS: usize = 600;
/// Width of a picture, CSS pixels.
const PANEL: usize = 300;

/// The page: curves of `records`, and `samples` below them.
pub fn page(title: &str, settings: &str, records: &[Record], samples: &[Figure]) -> String {
    let mut steps = Vec::new();
    let mut validations = Vec::new();
    for record in records {
        match record {
            Record::Step(step) => steps.push(step),
            Record::Validation(validation) => validations.push(validation),
        }
    }
    let mut page = Page::new(title);
    if let Some(last) = steps.last() {
        page.lead(&format!(
            "{} steps, {:.2} epochs, {:.0} s: loss {:.4}, {:.2} pairs a second, {:.1} % of the last step waiting for data",
            last.step,
            last.epoch,
            last.elapsed_s,
            last.loss,
            last.pairs_per_s,
            100.0 * last.data_wait_share
        ));
    }
    page.section("Loss");
    page.figures(&curves(&steps));
    if !validations.is_empty() {
        page.section("Held-out pairs");
        page.figures(&validation_curves(&validations));
    }
    if !samples.is_empty() {
        page.section("What the network makes of a held-out pair");
        page.figures(samples);
    }
    page.section("Settings").listing("All settings", settings);
    page.finish()
}

fn thinned(points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let every = points.len().div_ceil(MAX_POINTS).max(1);
    points.into_iter().step_by(every).collect()
}

fn curves(steps: &[&StepRecord]) -> Vec<Figure> {
    let chart = |title: &str, unit: &str, of: &dyn Fn(&StepRecord) -> Option<f64>| {
        let points = steps.iter().filter_map(|step| Some([step.step as f64, of(step)?])).collect();
        let chart = Chart::new(title, Axis::new("step"), Axis::new(unit));
        Figure::svg(chart.line("", color::series(0), thinned(points)).svg(), "")
    };
    let mut figures = vec![
        chart("loss", "", &|step| Some(step.loss)),
        chart("learning rate", "", &|step| Some(step.learning_rate)),
        chart("length of the gradient", "", &|step| Some(step.gradient_norm)),
    ];
    let names: BTreeSet<&String> = steps.iter().flat_map(|step| step.terms.keys()).collect();
    figures.extend(names.into_iter().map(|name| chart(name, "", &|step| step.terms.get(name).copied())));
    figures.push(chart("pairs per second", "1/s", &|step| Some(step.pairs_per_s)));
    figures
}

fn validation_curves(validations: &[&ValidationRecord]) -> Vec<Figure> {
    let names: BTreeSet<&String> = validations.iter().flat_map(|one| one.values.keys()).collect();
    let chart = |name: &str| {
        let points = validations.iter().filter_map(|one| Some([one.step as f64, *one.values.get(name)?]));
        let chart = Chart::new(name, Axis::new("step"), Axis::new(""));
        let points: Vec<_> = points.collect();
        let chart = chart.line("", color::series(1), points.clone()).dots("", color::series(1), points);
        Figure::svg(chart.svg(), "")
    };
    names.into_iter().map(|name| chart(name)).collect()
}

/// View A of the first pair of a batch: picture, true and predicted depth on one scale, and the confidence.
///
/// # Errors
/// What the network says; [`Error::Report`].
pub fn sample(network: &dyn PairNetwork, batch: &HostBatch) -> Result<Vec<Figure>, Error> {
    let output = network.forward(&batch.images)?;
    let targets = batch.targets(&network.device());
    let points = normalise(&output, &targets);
    let [height, width] = batch.images.size;
    let scale_m = f64::from(host_values(&points.truth_scale_m)[0]);
    let valid = targets.views[0].valid.clone().narrow(0, 0, 1);
    let depth_z = |points: Tensor<4>, masked: bool| {
        let z = points.narrow(0, 0, 1).narrow(3, 2, 1).reshape([1, height, width]) * scale_m;
        let z = if masked { z.mask_fill(valid.clone().bool_not(), f32::NAN) } else { z };
        Raster { width, height, data: host_values(&z) }
    };
    let (predicted, truth) = points.views[0].clone();
    let (predicted, truth) = (depth_z(predicted, false), depth_z(truth, true));
    let [low, high] = limits(&truth.data);
    let bar = |label: &str, low, high| ColorBar { map: Colormap::Viridis, low, high, label: label.into() };
    let confidence =
        Raster { width, height, data: host_values(&output[0].confidence.clone().narrow(0, 0, 1)) };
    let [least, most] = limits(&confidence.data);
    let picture = Picture::exact(&rgb(batch))?;
    let panels = [
        Panel::new(picture, "view A"),
        Panel::of_values(&truth, "true z", bar("m", low, high))?,
        Panel::of_values(&predicted, "predicted z, scaled", bar("m", low, high))?,
        Panel::of_values(&confidence, "confidence", bar("", least, most))?,
    ];
    Ok(panels.into_iter().map(|panel| Figure::svg(panel.width(PANEL as f64).svg(), "")).collect())
}

/// The first picture of a batch.
fn rgb(batch: &HostBatch) -> Raster<[u8; 3]> {
    let [height, width] = batch.images.size;
    let len = height * width;
    let level = |at: usize| (127.5 * (batch.images.values[at] + 1.0)).round() as u8;
    Raster::from_fn(width, height, |x, y| [0, 1, 2].map(|channel| level(channel * len + y * width + x)))
}

fn limits(values: &[f32]) -> [f64; 2] {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = (finite().fold(f32::MAX, f32::min), finite().fold(f32::MIN, f32::max));
    if low < high { [low, high].map(f64::from) } else { [0.0, 1.0] }
}
