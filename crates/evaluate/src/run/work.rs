//! One pair: read once, its truth prepared once, every method and light measured.

use super::lines::Line;
use super::options::RunOptions;
use super::record::Settings;
use crate::Error;
use crate::dataset_source::load::ItemRecord;
use crate::dataset_source::{Entry, LoadedPair, Source};
use crate::method::network::Session;
use crate::method::{Answer, Item, Lighting, Method};
use crate::pair_metrics::{PairMetrics, PreparedTruth, Promise};
use selenograph_reconstruct::{Prediction, View, pipeline};
use std::collections::BTreeSet;

/// Keys of the items that are in a file.
pub type Done = BTreeSet<(String, u64, u64)>;

/// What one pair gave: new lines and seconds of each method, and what was left out.
#[derive(Debug, Default)]
pub struct PairResult {
    pub lines: Vec<Vec<Line>>,
    pub seconds: Vec<f64>,
    pub skipped: Vec<String>,
    /// Whether it was skipped because it has no truth.
    pub lacks_truth: bool,
}

/// Evaluates what is missing of a pair; also returns how many items it tried.
pub fn evaluate_pair(
    entry: &Entry,
    source: &Source,
    settings: &Settings,
    done: &[Done],
    options: &RunOptions<'_>,
) -> (PairResult, usize) {
    let is_missing =
        |method_idx: usize, [a, b]: [u64; 2]| !done[method_idx].contains(&(entry.name.clone(), a, b));
    let missing: Vec<Vec<[u64; 2]>> = (0..settings.methods.len())
        .map(|idx| entry.lights.iter().copied().filter(|lights| is_missing(idx, *lights)).collect())
        .collect();
    let num_missing = missing.iter().map(Vec::len).sum();
    let mut result = PairResult { skipped: entry.left_out.clone(), ..PairResult::default() };
    if num_missing > 0 {
        let mut measured = || -> Result<(), Error> {
            let pair = LoadedPair::read(entry, &source.pixels)?;
            result.skipped.extend(pair.left_out.iter().cloned());
            let lights: Vec<[u64; 2]> = entry
                .lights
                .iter()
                .copied()
                .filter(|lights| missing.iter().any(|m| m.contains(lights)))
                .collect();
            measure_pair(&pair, &lights, settings, &missing, options, &mut result)
        };
        if let Err(error) = measured() {
            // What one method has measured of a pair is not kept without the others: they are compared on the same items.
            result.lines.clear();
            result.lacks_truth = result.skipped.is_empty() && error.lacks_truth();
            result.skipped.push(format!("{}: {error}", entry.name));
        }
    }
    result.lines.resize(settings.methods.len(), Vec::new());
    (result, num_missing)
}

/// The truth made ready, in full and in the reference protocol's rows.
struct Truths {
    full: PreparedTruth,
    rows: Option<PreparedTruth>,
}

fn measure_pair(
    pair: &LoadedPair,
    lights: &[[u64; 2]],
    settings: &Settings,
    missing: &[Vec<[u64; 2]>],
    options: &RunOptions<'_>,
    result: &mut PairResult,
) -> Result<(), Error> {
    let truth = &pair.truth;
    let truths = Truths {
        full: PreparedTruth::new(truth, &settings.metrics)?,
        rows: settings.reference_frame.as_ref().map(|rows| PreparedTruth::new(truth, rows)).transpose()?,
    };
    let session = options.network.map(Session::new);
    let methods = settings.set.options()?;
    result.lines = vec![Vec::new(); settings.methods.len()];
    result.seconds = vec![0.0; settings.methods.len()];
    // Item by item, not method by method: what a network said of an item serves all methods that ask it.
    for item in pair.items(lights) {
        let lights = [item.light_a, item.light_b];
        let Some(views) = pair.views(lights) else { continue };
        let lighting = Lighting::of(pair, lights);
        for (n, &method) in settings.methods.iter().enumerate().filter(|(n, _)| missing[*n].contains(&lights))
        {
            let start = (options.clock)();
            let line = match result.lines[n].first() {
                // An anchor says the same under every light.
                Some(line) if !method.looks_at_pictures() => Line { item: item.clone(), ..line.clone() },
                _ => {
                    let with = (&methods, session.as_ref());
                    measure_item(method, item.clone(), (&views, lighting), &truths, with)?
                }
            };
            result.lines[n].push(line);
            result.seconds[n] += (options.clock)() - start;
        }
    }
    Ok(())
}

fn measure_item(
    method: Method,
    item: ItemRecord,
    (views, lighting): (&[View; 2], Lighting),
    truths: &Truths,
    (options, network): (&pipeline::Options, Option<&Session<'_>>),
) -> Result<Line, Error> {
    let lights = [item.light_a, item.light_b];
    let answer =
        method.answer(&Item { views, lights, lighting, options, truth: truths.full.truth(), network })?;
    let metrics = truths.full.measure(&answer.prediction, method.promise())?;
    let in_rows =
        truths.rows.as_ref().map(|rows| measure_rows(rows, &answer, method.promise())).transpose()?;
    let cannot_say = answer.prediction.cam_b_from_cam_a.as_ref().err().map(ToString::to_string);
    Ok(Line { method: method.as_str().into(), item, cannot_say, metrics, reference_frame: in_rows })
}

/// The reference protocol: the pose estimated from the central rows with its settings, the points inside them.
fn measure_rows(rows: &PreparedTruth, answer: &Answer, promise: Promise) -> Result<PairMetrics, Error> {
    let prediction = match &answer.reference_pose {
        Some(pose) => Prediction { cam_b_from_cam_a: pose.clone(), ..answer.prediction.clone() },
        None => answer.prediction.clone(),
    };
    rows.measure(&prediction, promise)
}
