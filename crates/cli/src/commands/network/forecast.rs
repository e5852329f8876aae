//! Time and memory that a network will take, told before it takes them.

use crate::args::network::NetworkChoice;
use crate::bytes::shown;
use crate::exit::refuse;
use crate::machine::{Memory, product_rate};
use crate::ui::Ui;
use selenograph_network::Checkpoint;
use selenograph_network::input::Rule;
use selenograph_predict::{Estimate, Passes, PredictOptions};
use selenograph_reconstruct::evidence::FocalKnowledge;
use serde::Serialize;

/// Longest sides that are tried for a hint lie so many pixels apart, and the shortest of them.
const SIDE_STEP: usize = 64;

/// What a network is to look at.
pub struct Task {
    /// Width and height of both pictures of a pair, at most.
    pub pictures: [[usize; 2]; 2],
    /// Whether their focal lengths are known.
    pub focal: FocalKnowledge,
    /// Pairs, at most.
    pub num_pairs: usize,
}

/// What `--dry-run --json` prints.
#[derive(Serialize)]
struct Forecast {
    inputs_px: [[usize; 2]; 2],
    num_pairs: usize,
    /// Of a pair: encoder, decoders, heads, matching.
    gflop: [f64; 4],
    /// Of this machine, measured now.
    gflop_per_s: f64,
    /// Of all pairs, without loading.
    seconds: f64,
    bytes: u64,
    /// What may be taken, where that is known.
    allowed_bytes: Option<u64>,
}

/// Tells what a task will take.
///
/// # Errors
/// More memory than is allowed or free.
pub fn tell(
    choice: &NetworkChoice,
    checkpoint: &Checkpoint,
    options: &PredictOptions,
    task: &Task,
    ui: &Ui,
) -> anyhow::Result<()> {
    let estimate = |options: &PredictOptions| {
        let threads = rayon::current_num_threads();
        Estimate::new(checkpoint.config(), task.pictures, options, task.focal, threads)
    };
    let expected = estimate(options)?;
    let rate = product_rate();
    let forecast = Forecast {
        inputs_px: expected.inputs,
        num_pairs: task.num_pairs,
        gflop: [
            expected.flops.encoder,
            expected.flops.decoders,
            expected.flops.heads,
            expected.matching_flops,
        ]
        .map(|flop| flop / 1e9),
        gflop_per_s: rate / 1e9,
        seconds: task.num_pairs as f64 * expected.seconds(rate),
        bytes: expected.bytes(),
        allowed_bytes: choice.max_memory.or_else(|| Some(Memory::now()?.free_bytes)),
    };
    match (choice.dry_run, ui.json) {
        (true, true) => ui.data_json(&forecast)?,
        (true, false) => ui.data(&forecast.sentence())?,
        (false, _) => ui.note(&forecast.sentence()),
    }
    match forecast.allowed_bytes {
        Some(allowed) if forecast.bytes > allowed => {
            let whose = if choice.max_memory.is_some() { "--max-memory allows" } else { "this machine has" };
            let fits = |options: &PredictOptions| estimate(options).is_ok_and(|e| e.bytes() <= allowed);
            Err(refuse(
                format!(
                    "the network would take {} of memory, {whose} {}{}",
                    shown(forecast.bytes),
                    shown(allowed),
                    if choice.max_memory.is_some() { "" } else { " free" }
                ),
                remedy(options, task, fits),
            ))
        }
        _ => Ok(()),
    }
}

impl Forecast {
    fn sentence(&self) -> String {
        let [[width_a, height_a], [width_b, height_b]] = self.inputs_px;
        let gflop: f64 = self.gflop.iter().sum();
        let (pairs, at_most) = match self.num_pairs {
            1 => (String::new(), ""),
            pairs => (format!("{pairs} pairs, "), "at most "),
        };
        let seconds = match self.seconds {
            seconds if seconds < 10.0 => format!("{seconds:.1} s"),
            seconds if seconds < 600.0 => format!("{seconds:.0} s"),
            seconds => format!("{:.0} min", seconds / 60.0),
        };
        let allowed = self.allowed_bytes.map_or_else(String::new, |bytes| format!(" of {}", shown(bytes)));
        format!(
            "estimate: {pairs}{width_a}×{height_a} and {width_b}×{height_b}, {gflop:.0} GFLOP a pair: {at_most}about {seconds} at {:.0} GFLOP/s; {}{allowed} memory",
            self.gflop_per_s,
            shown(self.bytes)
        )
    }
}

/// What would make it fit.
fn remedy(options: &PredictOptions, task: &Task, fits: impl Fn(&PredictOptions) -> bool) -> String {
    let other = "--max-memory AMOUNT says how much may be taken";
    let forward = PredictOptions { passes: Passes::Forward, ..options.clone() };
    if options.passes == Passes::Symmetric && task.focal == FocalKnowledge::Known && fits(&forward) {
        return format!("leave --symmetric out; {other}");
    }
    let longest = match options.input {
        Rule::Published { size, .. } => size,
        Rule::Whole { max_side, .. } => max_side.unwrap_or(usize::MAX),
    };
    let largest = task.pictures.iter().flatten().copied().max().unwrap_or(0).min(longest);
    let smaller = |side: usize| {
        let input = match options.input {
            Rule::Published { square, .. } => Rule::Published { size: side, square },
            Rule::Whole { border, .. } => Rule::Whole { max_side: Some(side), border },
        };
        PredictOptions { input, ..options.clone() }
    };
    let sides = (1..largest.div_ceil(SIDE_STEP)).rev().map(|k| k * SIDE_STEP);
    match sides.into_iter().find(|side| fits(&smaller(*side))) {
        Some(side) => format!("--max-side {side} would fit; {other}"),
        None => format!("take a smaller network, or free some memory; {other}"),
    }
}
