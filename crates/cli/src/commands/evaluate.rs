//! `evaluate`: methods against the truth of a dataset.

use super::clock::{instant, now_utc};
use super::data_check::convention;
use super::network::{self, builtin};
use crate::args::evaluate::{CrossLight, Evaluate};
use crate::exit::{Outcome, refuse};
use crate::settings::key_and_value;
use crate::ui::Ui;
use selenograph_dataset::pair::Trajectory;
use selenograph_evaluate::dataset_source::{Choice, LightChoice, Source};
use selenograph_evaluate::method::Method;
use selenograph_evaluate::method::network::Network;
use selenograph_evaluate::pair_metrics::Promise;
use selenograph_evaluate::run::{self, EVALUATION, Overrides, Progress, RunOptions, Settings};
use selenograph_evaluate::summary::{
    Contents, MethodLines, Overview, Results, overview, overview_text, page, summary_json,
};
use selenograph_evaluate::{ItemFigures, plots, worst};
use selenograph_files::HeldFolder;
use selenograph_network::Checkpoint;
use selenograph_reconstruct::evidence::FocalKnowledge;
use std::path::Path;

/// Items whose figures stand in the page; those of the others are in files only.
const MAX_IN_PAGE: usize = 12;

/// Evaluates, writes lines, tables and the report, and prints which method is how good and where it fails.
///
/// # Errors
/// Those of [`score`].
pub fn run(args: &Evaluate, ui: &Ui) -> anyhow::Result<Outcome> {
    let Some(Scores { overview, summary, outcome }) = score(args, ui)? else { return Ok(Outcome::Done) };
    if ui.json {
        ui.data_json(&summary)?;
    } else {
        ui.data(overview_text(&overview).trim_end())?;
    }
    let out = args.target.out.display();
    ui.note(&format!("evaluation: {out}; every number in {out}/tables, pictures in {out}/report.html"));
    Ok(outcome)
}

/// What an evaluation comes to.
pub struct Scores {
    /// A row and a sentence for each method.
    pub overview: Vec<Overview>,
    summary: serde_json::Value,
    /// With what was skipped.
    pub outcome: Outcome,
}

/// Evaluates, and writes lines, tables and the report; `None` after a dry run.
///
/// # Errors
/// An unknown method, a folder without pairs or without truth, an output folder of something else.
pub fn score(args: &Evaluate, ui: &Ui) -> anyhow::Result<Option<Scores>> {
    let methods = methods(&args.methods)?;
    let choice = choice(args)?;
    let mut set = Overrides::default();
    for assignment in &args.set {
        let (key, value) = key_and_value(assignment, "shading.estimate_weights=false")?;
        set.set(key, &value)?;
    }
    let folder = if args.network.dry_run { None } else { Some(args.target.held(&EVALUATION)?) };
    let source = ui.timed("look at the dataset", || Source::open(&args.dataset, &choice))?;
    if let Some(told) = &source.pixels.told {
        ui.note(&format!("note: {told}"));
    }
    let checkpoint = open_network(&methods, &source, args, ui)?;
    let Some(folder) = folder else { return Ok(None) };
    let network = checkpoint.map(|checkpoint| load_network(&checkpoint, args, ui)).transpose()?;
    let settings = Settings {
        lights: choice.lights,
        methods: methods.clone(),
        set,
        network: network.as_ref().map(|network| network.record().clone()),
        ..Settings::default()
    };
    let (completed, lines) = evaluate(&source, &settings, network.as_ref(), &folder, ui)?;
    let methods: Vec<MethodLines> = methods
        .into_iter()
        .zip(lines)
        .map(|(method, lines)| MethodLines { method, settings: settings.line_of(method), lines })
        .collect();
    let results = ui.timed("tables", || Results::new(&methods));
    results.write(&args.target.out.join("tables"))?;
    let overview = overview(&methods, &completed);
    let summary = summary_json(&source, &completed, &methods);
    write(&args.target.out.join("summary.json"), &(serde_json::to_string_pretty(&summary)? + "\n"))?;
    ui.timed("figures and report", || {
        write_report(&source, &completed, &methods, &results, (&settings, network.as_ref()), args, ui)
    })?;
    let outcome =
        if completed.skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(completed.skipped) };
    Ok(Some(Scores { overview, summary, outcome }))
}

/// Plots, figures, and the page that shows them.
fn write_report(
    source: &Source,
    completed: &run::Completed,
    methods: &[MethodLines],
    results: &Results,
    (settings, network): (&Settings, Option<&Network>),
    args: &Evaluate,
    ui: &Ui,
) -> anyhow::Result<()> {
    let options = settings.set.options()?;
    let out = &args.target.out;
    let plots = plots(methods);
    make_folder(&out.join("plots"))?;
    for plot in &plots {
        write(&out.join("plots").join(format!("{}.svg", plot.id)), &plot.chart.svg())?;
    }
    let ranked = methods.iter().find(|m| m.method.promise() != Promise::Pose && m.method.looks_at_pictures());
    let worst_items: Vec<Item> = ranked
        .map(|m| worst(m).iter().map(|w| Item::of(w.line, vec![m.method])).collect())
        .unwrap_or_default();
    let all: Vec<Method> = methods.iter().map(|m| m.method).collect();
    let of_pairs: Vec<Item> = if args.figures { one_per_pair(methods, &all) } else { Vec::new() };
    let bar = ui.bar((worst_items.len() + of_pairs.len()) as u64, "figures");
    let draw = |items: &[Item], folder: &str| -> anyhow::Result<Vec<ItemFigures>> {
        let mut shown = Vec::new();
        for (k, item) in items.iter().enumerate() {
            let drawn = ItemFigures::draw(source, &item.methods, network, &options, &item.pair, item.lights)?;
            bar.inc(1);
            let Some(drawn) = drawn else { continue };
            drawn.write(&out.join(folder).join(item.pair.replace('/', "_")))?;
            if k < MAX_IN_PAGE {
                shown.push(drawn);
            }
        }
        Ok(shown)
    };
    let (worst, figures) = (draw(&worst_items, "worst")?, draw(&of_pairs, "figures")?);
    bar.finish_and_clear();
    let contents =
        Contents { source, completed, methods, results, plots: &plots, worst: &worst, figures: &figures };
    write(&out.join("report.html"), &page(&contents)?)
}

/// An item to draw, and whose answers.
struct Item {
    pair: String,
    lights: [u64; 2],
    methods: Vec<Method>,
}

impl Item {
    fn of(line: &run::Line, methods: Vec<Method>) -> Self {
        Self { pair: line.item.pair.clone(), lights: [line.item.light_a, line.item.light_b], methods }
    }
}

/// The first item of each pair.
fn one_per_pair(methods: &[MethodLines], all: &[Method]) -> Vec<Item> {
    let lines = methods.first().map(|m| m.lines.as_slice()).unwrap_or_default();
    let mut items: Vec<Item> = Vec::new();
    for line in lines {
        if items.last().is_none_or(|item| item.pair != line.item.pair) {
            items.push(Item::of(line, all.to_vec()));
        }
    }
    items
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    Ok(selenograph_files::write(path, text)?)
}

fn make_folder(path: &Path) -> anyhow::Result<()> {
    Ok(std::fs::create_dir_all(path).map_err(selenograph_files::Error::io("make the folder", path))?)
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

/// The network's checkpoint, where a method needs one; says what it will take.
fn open_network(
    methods: &[Method],
    source: &Source,
    args: &Evaluate,
    ui: &Ui,
) -> anyhow::Result<Option<Checkpoint>> {
    if !methods.iter().any(|method| method.needs_network()) {
        return network::unused(&args.network).map(|()| None);
    }
    // The pictures are not read yet: larger inputs there are none.
    let pictures = [[network::max_side(&args.network)?; 2]; 2];
    let task = network::Task { pictures, focal: FocalKnowledge::Known, num_pairs: source.num_items() };
    network::open(&args.network, &network::options(&args.network)?, &task, ui).map(Some)
}

fn load_network(checkpoint: &Checkpoint, args: &Evaluate, ui: &Ui) -> anyhow::Result<Network> {
    let predictor = network::load(checkpoint, &network::options(&args.network)?, ui)?;
    Ok(Network::new(predictor, ui.timed("checksum of the weights", || builtin::checksum(checkpoint))?))
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
        no_verify: args.no_verify,
    })
}

/// Runs behind a progress bar, and says how long it took.
fn evaluate(
    source: &Source,
    settings: &Settings,
    network: Option<&Network>,
    folder: &HeldFolder,
    ui: &Ui,
) -> anyhow::Result<(run::Completed, Vec<Vec<run::Line>>)> {
    let bar = ui.bar((source.num_items() * settings.methods.len()) as u64, "items");
    let start = instant();
    let tell = |progress: Progress| {
        if progress.num_done == 0 {
            // Items found in the files say nothing about how fast this run is.
            bar.set_position(progress.num_resumed as u64);
            bar.reset_eta();
        }
        bar.set_position((progress.num_resumed + progress.num_done) as u64);
    };
    let options = RunOptions {
        out: folder,
        started: Some(now_utc()),
        progress: &tell,
        clock: &|| start.elapsed().as_secs_f64(),
        network,
    };
    let (completed, lines) = ui.timed("evaluate", || run::evaluate(source, settings, &options))?;
    bar.finish_and_clear();
    let times: Vec<String> = settings
        .methods
        .iter()
        .zip(&completed.seconds_per_item)
        .filter_map(|(method, seconds)| Some(format!("{} {:.2} s", method.as_str(), (*seconds)?)))
        .collect();
    let times = if times.is_empty() { String::new() } else { format!("; an item: {}", times.join(", ")) };
    ui.note(&format!(
        "{} pairs, {} items, {} of them there already, {} left out; {:.1} s{times}",
        source.entries.len(),
        completed.num_items,
        completed.num_resumed,
        completed.skipped.len(),
        start.elapsed().as_secs_f64()
    ));
    Ok((completed, lines))
}
