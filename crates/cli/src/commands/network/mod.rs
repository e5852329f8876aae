//! The network that `reconstruct` and `evaluate` run: found, announced with what it will take, loaded.

pub mod builtin;
mod forecast;

pub use forecast::Task;

use super::clock::instant;
use crate::args::network::{InputRule, NetworkChoice};
use crate::exit::refuse;
use crate::ui::Ui;
use indicatif::ProgressBar;
use selenograph_network::Checkpoint;
use selenograph_network::checkpoint::HeadCounts;
use selenograph_network::input::{Border, Rule, SquareCrop};
use selenograph_predict::{About, Executor, PredictOptions, Predictor, Progress, Step};
use std::time::Instant;

/// Longest side of an input where neither the command line nor the weights tell: that of the published networks.
const USUAL_SIDE: usize = 512;

/// How the network is run, as far as the command line says.
///
/// # Errors
/// A device that this build does not have; an input without pixels.
pub fn options(choice: &NetworkChoice) -> anyhow::Result<PredictOptions> {
    let side = max_side(choice)?;
    let input = match choice.input {
        InputRule::Whole => Rule::Whole { max_side: Some(side), border: Border::Pad },
        InputRule::Published => Rule::Published { size: side, square: SquareCrop::FourThirds },
    };
    Ok(PredictOptions { executor: Executor::named(&choice.device)?, input, ..PredictOptions::default() })
}

/// Longest side of an input.
///
/// # Errors
/// An input without pixels; weights that cannot be read.
pub fn max_side(choice: &NetworkChoice) -> anyhow::Result<usize> {
    match choice.max_side {
        Some(0) => Err(refuse("--max-side 0: no such picture", "512 is what most networks are trained on")),
        Some(side) => Ok(side),
        None => Ok(checkpoint(choice)?.input_px().unwrap_or(USUAL_SIDE)),
    }
}

/// The weights that were named, or those of the program.
fn checkpoint(choice: &NetworkChoice) -> anyhow::Result<Checkpoint> {
    let heads = HeadCounts { encoder: choice.heads.encoder_heads, decoder: choice.heads.decoder_heads };
    builtin::open(choice.weights.as_deref(), heads)
}

/// Refuses what no method would read.
///
/// # Errors
/// If weights were named, or a dry run asked for.
pub fn unused(choice: &NetworkChoice) -> anyhow::Result<()> {
    match &choice.weights {
        None if choice.dry_run => Err(refuse(
            "--dry-run is for the methods `mast3r` and `mast3r-stereo`",
            "pass --method mast3r, or leave --dry-run out: the other methods take seconds and little memory",
        )),
        None => Ok(()),
        Some(path) => Err(refuse(
            format!("--weights `{}` is for the methods `mast3r` and `mast3r-stereo`", path.display()),
            "pass --method mast3r, or leave --weights out",
        )),
    }
}

/// Says what runs and what it will take.
///
/// # Errors
/// A file that is no checkpoint; a network that would take more memory than there is.
pub fn open(
    choice: &NetworkChoice,
    options: &PredictOptions,
    task: &Task,
    ui: &Ui,
) -> anyhow::Result<Checkpoint> {
    let checkpoint = checkpoint(choice)?;
    let about = About::new(&checkpoint, &options.executor);
    ui.note(&format!("{}; {} threads", about.sentence(), rayon::current_num_threads()));
    if let (None, Some(side)) = (choice.max_side, checkpoint.input_px()) {
        ui.note(&format!("note: pictures are made {side} px at most, as the weights' file asks"));
    }
    for note in &about.notes {
        ui.note(&format!("note: {note}"));
    }
    forecast::tell(choice, &checkpoint, options, task, ui)?;
    Ok(checkpoint)
}

/// Loads it.
///
/// # Errors
/// Tensors that do not make its network.
pub fn load(checkpoint: &Checkpoint, options: &PredictOptions, ui: &Ui) -> anyhow::Result<Predictor> {
    with_steps(ui, |progress| Ok(Predictor::new(checkpoint, options, progress)?))
}

/// Runs work that tells how far it is: shown while it lasts, timed with --verbose.
pub fn with_steps<T>(ui: &Ui, work: impl FnOnce(&mut dyn FnMut(Progress)) -> T) -> T {
    let bar = ui.bar(0, "parts");
    let mut running: Option<(Step, Instant)> = None;
    let done = work(&mut |progress| {
        if running.is_none_or(|(step, _)| step != progress.step) {
            finished(running, ui);
            running = Some((progress.step, instant()));
        }
        show(&bar, progress);
    });
    finished(running, ui);
    bar.finish_and_clear();
    done
}

fn show(bar: &ProgressBar, progress: Progress) {
    bar.set_message(progress.step.as_str());
    bar.set_length(progress.of as u64);
    bar.set_position(progress.done as u64);
}

fn finished(step: Option<(Step, Instant)>, ui: &Ui) {
    if let Some((step, start)) = step {
        ui.detail(&format!("time: {} {:.3} s", step.as_str(), start.elapsed().as_secs_f64()));
    }
}
