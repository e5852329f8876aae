//! The evaluation itself: every item of every method, once, in an order that depends on nothing; stopped and gone on with.

pub(crate) mod lines;
mod options;
mod overrides;
mod record;
mod work;

pub use lines::Line;
pub use options::{Progress, RunOptions};
pub use overrides::Overrides;
pub use record::{Completed, EVALUATION, Settings};

use crate::Error;
use crate::dataset_source::Source;
use crate::method::Method;
use lines::{Appender, METRICS_NAME, read_mended};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use work::{Done, PairResult};

/// Where the lines of a method are: in the folder itself if it is the only one, else in a folder of its name.
fn metrics_path(out: &Path, methods: &[Method], method: Method) -> PathBuf {
    match methods {
        [_] => out.join(METRICS_NAME),
        _ => out.join(method.as_str()).join(METRICS_NAME),
    }
}

/// Evaluates what is not yet in the files, and returns what was done with the lines of every method in the order of the
/// source's items (as far as they were chosen).
///
/// Pairs run beside each other, as many as there are threads; lines are written in the order of the source.
///
/// # Errors
/// [`Error::NoNetwork`] for a method that needs one; [`Error::OtherEvaluation`] for a folder of something else, [`Error::NoTruth`] and [`Error::NoPairs`] if not one pair can be
/// evaluated, [`Error::Io`] in writing. Pairs that are broken are in the completed.
pub fn evaluate(
    source: &Source,
    settings: &Settings,
    options: &RunOptions<'_>,
) -> Result<(Completed, Vec<Vec<Line>>), Error> {
    if options.network.is_none() && settings.methods.iter().any(|method| method.needs_network()) {
        return Err(Error::NoNetwork);
    }
    let out = options.out.path();
    let is_new = record::begin(options.out, settings, source)?;
    let paths: Vec<PathBuf> =
        settings.methods.iter().map(|method| metrics_path(out, &settings.methods, *method)).collect();
    let found = paths.iter().map(|path| read_mended(path)).collect::<Result<Vec<_>, _>>()?;
    record::write(out, settings, source, options.started.as_deref(), None)?;
    let done: Vec<Done> = found.iter().map(|lines| lines.iter().map(Line::key).collect()).collect();
    let results = run_pairs(source, settings, options, &paths, &done)?;
    let all_lack_truth = source.broken.is_empty() && results.iter().all(|result| result.lacks_truth);
    let (completed, lines) = gather(source, settings, found, results);
    if lines.iter().all(Vec::is_empty) {
        if is_new {
            // Nothing is kept: the next attempt finds nothing in its way.
            let _ = std::fs::remove_file(out.join(selenograph_files::record::RUN_NAME));
        }
        return Err(nothing_measured(source, &completed, all_lack_truth));
    }
    record::write(out, settings, source, options.started.as_deref(), Some(&completed))?;
    Ok((completed, lines))
}

/// Results in the order of the pairs, written as soon as all earlier ones are.
struct OrderedWriter<'a> {
    paths: &'a [PathBuf],
    appenders: Vec<Option<Appender>>,
    next: usize,
    waiting: BTreeMap<usize, PairResult>,
    written: Vec<PairResult>,
}

impl OrderedWriter<'_> {
    fn take(&mut self, pair_idx: usize, result: PairResult) -> Result<(), Error> {
        self.waiting.insert(pair_idx, result);
        while let Some(result) = self.waiting.remove(&self.next) {
            for (method_idx, lines) in result.lines.iter().enumerate() {
                for line in lines {
                    self.appender(method_idx)?.append(line)?;
                }
            }
            self.next += 1;
            self.written.push(result);
        }
        Ok(())
    }

    fn appender(&mut self, method_idx: usize) -> Result<&mut Appender, Error> {
        let slot = &mut self.appenders[method_idx];
        if slot.is_none() {
            *slot = Some(Appender::open(&self.paths[method_idx])?);
        }
        slot.as_mut().ok_or_else(|| Error::Format {
            path: self.paths[method_idx].clone(),
            expected: "an open file".into(),
            found: "none".into(),
        })
    }
}

/// Runs every pair that lacks an item.
fn run_pairs(
    source: &Source,
    settings: &Settings,
    options: &RunOptions<'_>,
    paths: &[PathBuf],
    done: &[Done],
) -> Result<Vec<PairResult>, Error> {
    let num_items = source.num_items() * settings.methods.len();
    let num_resumed = source
        .entries
        .iter()
        .flat_map(|entry| entry.lights.iter().map(|[a, b]| (entry.name.clone(), *a, *b)))
        .map(|key| done.iter().filter(|done| done.contains(&key)).count())
        .sum();
    let tell = |num_done| (options.progress)(Progress { num_done, num_resumed, num_items });
    tell(0);
    let (next_pair, num_done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let writer = Mutex::new(OrderedWriter {
        paths,
        appenders: paths.iter().map(|_| None).collect(),
        next: 0,
        waiting: BTreeMap::new(),
        written: Vec::new(),
    });
    let failure: Mutex<Option<Error>> = Mutex::new(None);
    let worker = || loop {
        let pair_idx = next_pair.fetch_add(1, Ordering::Relaxed);
        let Some(entry) = source.entries.get(pair_idx) else { break };
        if failure.lock().unwrap_or_else(PoisonError::into_inner).is_some() {
            break;
        }
        let (result, num_tried) = work::evaluate_pair(entry, source, settings, done, options);
        tell(num_done.fetch_add(num_tried, Ordering::Relaxed) + num_tried);
        let taken = writer.lock().unwrap_or_else(PoisonError::into_inner).take(pair_idx, result);
        if let Err(error) = taken {
            failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
    };
    // Threads of their own, not tasks of the pool: what a pair does in parallel would otherwise begin other pairs inside it.
    let num_workers = rayon::current_num_threads().min(source.entries.len()).max(1);
    std::thread::scope(|scope| {
        for _ in 1..num_workers {
            scope.spawn(worker);
        }
        worker();
    });
    if let Some(error) = failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    Ok(writer.into_inner().unwrap_or_else(PoisonError::into_inner).written)
}

/// Lines of the files and of this run together, in the order of the source.
fn gather(
    source: &Source,
    settings: &Settings,
    found: Vec<Vec<Line>>,
    results: Vec<PairResult>,
) -> (Completed, Vec<Vec<Line>>) {
    let mut completed = Completed {
        skipped: source.broken.iter().map(|(name, reason)| format!("{name}: {reason}")).collect(),
        ..Completed::default()
    };
    let mut by_key: Vec<BTreeMap<(String, u64, u64), Line>> =
        found.into_iter().map(|lines| lines.into_iter().map(|line| (line.key(), line)).collect()).collect();
    let resumed: Vec<Done> = by_key.iter().map(|lines| lines.keys().cloned().collect()).collect();
    let mut seconds = vec![(0.0, 0usize); settings.methods.len()];
    for result in results {
        for (method_idx, lines) in result.lines.into_iter().enumerate() {
            seconds[method_idx].0 += result.seconds.get(method_idx).copied().unwrap_or(0.0);
            seconds[method_idx].1 += lines.len();
            by_key[method_idx].extend(lines.into_iter().map(|line| (line.key(), line)));
        }
        completed.skipped.extend(result.skipped);
    }
    completed.seconds_per_item =
        seconds.into_iter().map(|(sum, count)| (count > 0).then(|| sum / count as f64)).collect();
    let mut all = Vec::new();
    for (lines, resumed) in by_key.iter_mut().zip(&resumed) {
        let mut chosen = Vec::new();
        for entry in &source.entries {
            for [a, b] in &entry.lights {
                let key = (entry.name.clone(), *a, *b);
                completed.num_resumed += usize::from(resumed.contains(&key));
                chosen.extend(lines.remove(&key));
            }
        }
        completed.num_items += chosen.len();
        all.push(chosen);
    }
    (completed, all)
}

/// Why not one item could be measured.
fn nothing_measured(source: &Source, completed: &Completed, all_lack_truth: bool) -> Error {
    let path = source.root.clone();
    let found = completed.skipped.first().cloned().unwrap_or_else(|| "no reason".into());
    if all_lack_truth {
        Error::NoTruth { path, found }
    } else {
        Error::NoPairs { path, why: format!("every one is broken, the first: {found}") }
    }
}
