//! `train run|resume|presets`: networks that learn.

mod progress;
mod request;
mod sources;

use super::clock::since_1970;
use crate::args::train::{Presets, Resume, Run, TrainCommand};
use crate::exit::{Outcome, refuse};
use crate::target::is_occupied;
use crate::ui::Ui;
use anyhow::Context;
use progress::Teller;
use request::Request;
use selenograph_dataset::loader::Mixture;
use selenograph_model::device;
use selenograph_train::batch::HostBatch;
use selenograph_train::network::PairNetwork;
use selenograph_train::run::feed::{LoaderFeed, held_out};
use selenograph_train::run::memory::MemoryEstimate;
use selenograph_train::run::page::{page, sample};
use selenograph_train::run::preset::{PRESETS, preset_text};
use selenograph_train::run::{Hands, Trainer, Validate, checkpoints, metrics, metrics_path, validation};
use std::path::Path;
use std::sync::Arc;

/// The page of a run.
const PAGE: &str = "training.html";

/// Trains, goes on training, or lists settings.
///
/// # Errors
/// Settings, weights or pairs that cannot be used, a loss that is no number, a disk that is full at the end.
pub fn run(command: &TrainCommand, ui: &Ui) -> anyhow::Result<Outcome> {
    match command {
        TrainCommand::Run(args) => start(args, ui),
        TrainCommand::Resume(args) => resume(args, ui),
        TrainCommand::Presets(args) => presets(args, ui),
    }
}

fn presets(args: &Presets, ui: &Ui) -> anyhow::Result<Outcome> {
    match &args.name {
        Some(name) => ui.data(preset_text(name)?.trim_end())?,
        None => {
            for (name, text) in PRESETS {
                let about = text.lines().next().unwrap_or_default().trim_start_matches("# ");
                ui.data(&format!("{name:<24} {about}"))?;
            }
        }
    }
    Ok(Outcome::Done)
}

fn start(args: &Run, ui: &Ui) -> anyhow::Result<Outcome> {
    if is_occupied(&args.out) {
        return Err(refuse(
            format!("`{}` exists", args.out.display()),
            "`selenograph train resume` goes on with a run; or pass another --out",
        ));
    }
    let request = Request::from_args(args)?;
    if args.dry_run {
        ui.data(request.to_toml()?.trim_end())?;
        return Ok(Outcome::Done);
    }
    let weights = request.first_weights.clone();
    carry_out(&request, weights.as_deref(), &args.out, false, ui)
}

fn resume(args: &Resume, ui: &Ui) -> anyhow::Result<Outcome> {
    let request = Request::read(&args.run)?;
    let weights = checkpoints(&args.run, &request.settings.learning).last_weights()?;
    carry_out(&request, Some(&weights), &args.run, true, ui)
}

fn carry_out(
    request: &Request,
    weights: Option<&Path>,
    folder: &Path,
    resumes: bool,
    ui: &Ui,
) -> anyhow::Result<Outcome> {
    let settings = &request.settings;
    let device = device::parse(&request.device)?;
    let mut network = request.network(weights, &device, ui)?;
    let teacher = request.teacher(&device, ui)?;
    let assembly = request.assembly();
    let (learn, judge) = sources::mixtures(request, ui)?;
    foresee(&network, request, ui)?;
    let held: Vec<HostBatch> = match &judge {
        Some(mixture) => held_out(mixture, settings.learning.validation.pairs, &assembly)?,
        None => Vec::new(),
    };
    if !resumes {
        request.write(folder)?;
    }
    let first = if resumes { checkpoints(folder, &settings.learning).last_state()?.batches } else { 0 };
    let learn: Arc<Mixture> = Arc::new(learn);
    let complain = ui.without_notes();
    let tell = move |reason: &str| complain.detail(&format!("left out: {reason}"));
    let mut feed = LoaderFeed::start(learn, first, assembly, Box::new(tell))?;
    let mut teller = Teller::new(ui);
    let mut judge = |network: &dyn PairNetwork, step: u64| validation::judge(network, &held, step);
    let validate: Option<Box<Validate<'_>>> = if held.is_empty() { None } else { Some(Box::new(&mut judge)) };
    let began = since_1970();
    let since = std::time::Instant::now();
    let hands = Hands {
        network: &mut network,
        source: &mut feed,
        teacher: teacher.as_ref().map(|teacher| teacher as &dyn PairNetwork),
        at_a_time: at_a_time(request),
        validate,
        clock: &|| began + since.elapsed(),
        budget_s: request.budget_s,
        stops: &|| false,
        observer: &mut |event| teller.tell(&event),
    };
    let learning = &settings.learning;
    let trainer = if resumes {
        Trainer::resume(folder, learning, hands)?
    } else {
        Trainer::start(folder, learning, hands)?
    };
    let ended = trainer.run();
    teller.finish();
    let records = metrics::read(&metrics_path(folder))?;
    let samples = match held.first() {
        Some(batch) => sample(&network, batch)?,
        None => Vec::new(),
    };
    let title = format!("Training: {}", folder.display());
    let path = folder.join(PAGE);
    std::fs::write(&path, page(&title, &request.to_toml()?, &records, &samples))
        .with_context(|| format!("cannot write `{}`", path.display()))?;
    let state = ended?;
    ui.note(&format!(
        "{} steps in {:.0} s; weights: {}; curves: {}",
        state.step,
        state.elapsed_s,
        checkpoints(folder, learning).last_weights()?.display(),
        path.display()
    ));
    Ok(Outcome::Done)
}

/// Batches of a step at the same time: a graphics card fills itself, cores are filled by more batches.
fn at_a_time(request: &Request) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    if request.device == "cpu" { cores } else { 1 }
}

/// Refuses, before time is spent, what would not fit into this machine's memory.
fn foresee(network: &dyn PairNetwork, request: &Request, ui: &Ui) -> anyhow::Result<()> {
    let loader = &request.settings.loader;
    let Some([width, height]) = loader.sizes.iter().max_by_key(|[width, height]| width * height) else {
        return Ok(());
    };
    let estimate = MemoryEstimate::new(
        network,
        &request.settings.learning,
        [*height, *width],
        loader.num_matches,
        at_a_time(request),
    );
    let needed = estimate.bytes(loader.batch_size) as f64 / f64::from(1 << 30);
    ui.note(&format!("memory: about {needed:.1} GiB"));
    if request.device == "cpu"
        && let Some(available) = available_bytes()
    {
        estimate.check(loader.batch_size, available)?;
    }
    Ok(())
}

/// Memory that is free, where the system tells.
fn available_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}
