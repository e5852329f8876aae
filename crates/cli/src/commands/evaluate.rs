//! `evaluate`: methods against the truth of a dataset.

use super::clock::now_utc;
use super::data_check::convention;
use crate::args::evaluate::{CrossLight, Evaluate};
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_dataset::pair::Trajectory;
use selenograph_evaluate::dataset_source::{Choice, LightChoice, Source};
use selenograph_evaluate::method::Method;
use selenograph_evaluate::run::{self, Existing, Progress, RunOptions, Settings};
use selenograph_evaluate::summary::{MethodLines, Results, summary_json};
use std::time::Instant;

/// Tables that are printed; the others are in the files.
const PRINTED: [&str; 4] = ["pose", "terrain_overlap", "terrain_paper", "hard_cases"];

/// Evaluates, and writes lines, tables and the report.
///
/// # Errors
/// An unknown method, a folder without pairs or without truth, an output folder of something else.
pub fn run(args: &Evaluate, ui: &Ui) -> anyhow::Result<Outcome> {
    let methods = methods(&args.methods)?;
    let choice = choice(args)?;
    let source = ui.timed("look at the dataset", || Source::open(&args.dataset, &choice))?;
    if let Some(told) = &source.pixels.told {
        ui.note(&format!("note: {told}"));
    }
    let settings = Settings { lights: choice.lights, methods: methods.clone(), ..Settings::default() };
    let (outcome, lines) = evaluate(&source, &settings, args, ui)?;
    let methods: Vec<MethodLines> =
        methods.into_iter().zip(lines).map(|(method, lines)| MethodLines { method, lines }).collect();
    let results = ui.timed("tables", || Results::new(&methods));
    results.write(&args.target.out.join("tables"))?;
    let summary = summary_json(&source, &outcome, &methods);
    let path = args.target.out.join("summary.json");
    std::fs::write(&path, serde_json::to_string_pretty(&summary)? + "\n")?;
    if ui.json {
        ui.data_json(&summary)?;
    } else {
        for table in results.all().filter(|table| PRINTED.contains(&table.spec.id.as_str())) {
            ui.data(&table.text())?;
        }
    }
    ui.note(&format!("evaluation: {}", args.target.out.display()));
    Ok(if outcome.skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(outcome.skipped) })
}

/// The methods by name, each once.
fn methods(names: &[String]) -> anyhow::Result<Vec<Method>> {
    let mut methods = Vec::new();
    for name in names {
        let method = Method::from_name(name)?;
        if !methods.contains(&method) {
            methods.push(method);
        }
    }
    Ok(methods)
}

/// What to take of the dataset.
fn choice(args: &Evaluate) -> anyhow::Result<Choice> {
    let trajectories = args.trajectory.iter().map(|name| {
        Trajectory::from_name(name).ok_or_else(|| {
            let known = Trajectory::ALL.map(Trajectory::as_str).join(", ");
            refuse(format!("no trajectory `{name}`"), format!("known are {known}"))
        })
    });
    Ok(Choice {
        k_convention: args.k_convention.map(convention),
        trajectories: trajectories.collect::<Result<_, _>>()?,
        pairs: args.pairs.clone(),
        limit: args.limit,
        lights: match args.cross_light {
            None => LightChoice::Same,
            Some(CrossLight::Only) => LightChoice::Cross,
            Some(CrossLight::Beside) => LightChoice::Both,
        },
    })
}

/// Runs behind a progress bar, and says how long it took.
fn evaluate(
    source: &Source,
    settings: &Settings,
    args: &Evaluate,
    ui: &Ui,
) -> anyhow::Result<(run::Outcome, Vec<Vec<run::Line>>)> {
    let bar = ui.bar((source.num_items() * settings.methods.len()) as u64, "items");
    let start = Instant::now();
    let tell = |progress: Progress| {
        if progress.num_done == 0 {
            // Items found in the files say nothing about how fast this run is.
            bar.set_position(progress.num_resumed as u64);
            bar.reset_eta();
        }
        bar.set_position((progress.num_resumed + progress.num_done) as u64);
    };
    let options = RunOptions {
        out: &args.target.out,
        existing: if args.target.force { Existing::Replace } else { Existing::Resume },
        started: Some(now_utc()),
        progress: &tell,
        clock: &|| start.elapsed().as_secs_f64(),
    };
    let (outcome, lines) = ui.timed("evaluate", || run::evaluate(source, settings, &options))?;
    bar.finish_and_clear();
    let times: Vec<String> = settings
        .methods
        .iter()
        .zip(&outcome.seconds_per_item)
        .filter_map(|(method, seconds)| Some(format!("{} {:.2} s", method.as_str(), (*seconds)?)))
        .collect();
    let times = if times.is_empty() { String::new() } else { format!("; an item: {}", times.join(", ")) };
    ui.note(&format!(
        "{} pairs, {} items, {} of them there already, {} left out; {:.1} s{times}",
        source.entries.len(),
        outcome.num_items,
        outcome.num_resumed,
        outcome.skipped.len(),
        start.elapsed().as_secs_f64()
    ));
    Ok((outcome, lines))
}
