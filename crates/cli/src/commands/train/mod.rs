//! `train run|resume|presets`: networks that learn.

mod examination;
mod progress;
mod request;
mod sources;
mod stop;

use super::clock::{instant, since_1970};
use crate::args::train::{Presets, Resume, Run, TrainCommand};
use crate::exit::{Outcome, refuse};
use crate::target::say_complete_is_kept;
use crate::ui::Ui;
use examination::Examination;
use progress::Teller;
use request::Request;
use selenograph_files::{Existing, FolderKind, HeldFolder, Sharing, is_occupied, record};
use selenograph_model::device;
use selenograph_train::Error;
use selenograph_train::batch::HostBatch;
use selenograph_train::network::PairNetwork;
use selenograph_train::run::feed::{LoaderFeed, held_out};
use selenograph_train::run::memory::MemoryEstimate;
use selenograph_train::run::page::{page, sample};
use selenograph_train::run::preset::{PRESETS, preset_text};
use selenograph_train::run::{
    Trainer, TrainerContext, Validate, checkpoints, metrics, metrics_path, validation,
};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// A run's folder: gone on with, never replaced.
static TRAINING: FolderKind = FolderKind {
    command: request::COMMAND,
    what: "a run of training",
    is_own: |folder| record::is_of(folder, request::COMMAND),
    names: &[],
    parts: &[],
};

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
    let mut request = Request::from_args(args)?;
    if args.dry_run {
        ui.data(request.to_toml()?.trim_end())?;
        return Ok(Outcome::Done);
    }
    request.take_down_inputs()?;
    carry_out(&request, None, &args.out, Existing::Refuse, ui)
}

fn resume(args: &Resume, ui: &Ui) -> anyhow::Result<Outcome> {
    let request = Request::read(&args.run)?;
    for path in request.changed_inputs()? {
        ui.note(&format!("warning: `{path}` is not what the run began with"));
    }
    let saved = checkpoints(&args.run, &request.settings.learning);
    // One that was killed before its first checkpoint begins again.
    let last = if saved.list()?.is_empty() { None } else { Some(saved.last_weights()?) };
    carry_out(&request, last.as_deref(), &args.run, Existing::Resume, ui)
}

/// Runs from the weights of the last checkpoint, or from the beginning.
fn carry_out(
    request: &Request,
    last: Option<&Path>,
    folder: &Path,
    existing: Existing,
    ui: &Ui,
) -> anyhow::Result<Outcome> {
    let settings = &request.settings;
    let _held = HeldFolder::take(folder, &TRAINING, existing, Sharing::Alone)?;
    say_complete_is_kept(folder, format!("`selenograph train resume {}`", folder.display()));
    let device = device::parse(&request.device)?;
    let mut network = request.network(last.or(request.first_weights.as_deref()), &device, ui)?;
    let teacher = request.teacher(&device, ui)?;
    let assembly = request.assembly();
    let split = sources::own_split(request)?;
    let (learn, judge) = sources::mixtures(request, split.as_ref(), ui)?;
    foresee(&network, request, ui)?;
    let held: Vec<HostBatch> = match &judge {
        Some(mixture) => held_out(mixture, settings.learning.validation.pairs, &assembly)?,
        None => Vec::new(),
    };
    let first = match last {
        Some(_) => checkpoints(folder, &settings.learning).last_state()?.batches,
        None => 0,
    };
    let complain = ui.without_notes();
    let tell = move |reason: &str| complain.detail(&format!("left out: {reason}"));
    let mut feed = LoaderFeed::start(Arc::new(learn), first, assembly, Box::new(tell))?;
    let mut teller = Teller::new(ui);
    let examination = Examination::open(request, split.as_ref(), folder)?;
    let mut judge = |network: &dyn PairNetwork, step: u64| {
        let mut found = validation::judge(network, &held, step)?;
        match examination.as_ref().map(|examination| examination.hold(network, step, ui)).transpose() {
            Ok(values) => found.values.extend(values.into_iter().flatten()),
            // What was learnt is worth more than to know its worth now.
            Err(error) => ui.note(&format!("warning: held-out pairs were not evaluated: {error:#}")),
        }
        Ok(found)
    };
    let validate: Option<Box<Validate<'_>>> = if held.is_empty() { None } else { Some(Box::new(&mut judge)) };
    let began = since_1970();
    let since = instant();
    let asked = stop::on_request()?;
    let context = TrainerContext {
        network: &mut network,
        source: &mut feed,
        teacher: teacher.as_ref().map(|teacher| teacher as &dyn PairNetwork),
        at_a_time: at_a_time(request),
        validate,
        clock: &|| began + since.elapsed(),
        budget_s: request.budget_s,
        stops: &|| asked.load(Ordering::Relaxed),
        observer: &mut |event| teller.tell(&event),
    };
    if last.is_none() {
        request.write(folder)?;
    }
    let learning = &settings.learning;
    let trainer = match last {
        Some(_) => Trainer::resume(folder, learning, context),
        None => Trainer::start(folder, learning, context),
    };
    let ended = trainer.and_then(Trainer::run);
    teller.finish();
    let page = write_page(request, folder, &network, held.first());
    if let Err(error) = &ended
        && existing == Existing::Refuse
        && is_worthless(error, folder)
    {
        // It would only be in the way of the next.
        let _ = std::fs::remove_dir_all(folder);
    }
    let state = ended?;
    page?;
    let weights = checkpoints(folder, learning).last_weights()?;
    let (step, elapsed_s) = (state.step, state.elapsed_s);
    let page = folder.join(PAGE);
    let (weights, page) = (weights.display(), page.display());
    ui.note(&format!("{step} steps in {elapsed_s:.0} s; weights: {weights}; curves: {page}"));
    if asked.load(Ordering::Relaxed) {
        ui.note(&format!("stopped; `selenograph train resume {}` goes on", folder.display()));
    }
    Ok(Outcome::Done)
}

/// Batches of a step at the same time: a graphics card fills itself, cores are filled by more batches.
fn at_a_time(request: &Request) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let batches = request.settings.learning.accumulate;
    if request.device == "cpu" { cores.min(batches) } else { 1 }
}

/// Whether what a new run leaves behind, ending like this, is of use to nobody.
fn is_worthless(error: &Error, folder: &Path) -> bool {
    match error {
        Error::Diverged { .. } => false,
        Error::BudgetTooShort { .. } => true,
        _ => metrics::read(&metrics_path(folder)).is_ok_and(|records| records.is_empty()),
    }
}

/// Curves, settings and pictures of one held-out batch in one file.
fn write_page(
    request: &Request,
    folder: &Path,
    network: &dyn PairNetwork,
    held: Option<&HostBatch>,
) -> anyhow::Result<()> {
    let records = metrics::read(&metrics_path(folder))?;
    let samples = match held {
        Some(batch) => sample(network, batch)?,
        None => Vec::new(),
    };
    let title = format!("Training: {}", folder.display());
    let page = page(&title, &request.to_toml()?, &records, &samples);
    let path = folder.join(PAGE);
    Ok(selenograph_files::write(&path, page)?)
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
