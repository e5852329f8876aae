//! What can be typed: clap types only. What it means is in `commands`.

pub mod about;
pub mod campaign;
pub mod data;
pub mod dem;
pub mod evaluate;
pub mod frames;
pub mod network;
pub mod reconstruct;
pub mod refine;
pub mod render;
#[cfg_attr(
    not(feature = "train"),
    allow(dead_code, reason = "what can be typed is the same without training")
)]
pub mod train;
pub mod weights;

use clap::{Args, Parser, Subcommand};
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Lunar terrain in, verified stereo pairs out.
#[derive(Debug, Parser)]
#[command(name = "selenograph", version, propagate_version = true, max_term_width = 110)]
#[command(
    after_help = "Exit codes: 0 done, 1 wrong input or configuration, 2 unexpected failure, 3 done with skips.\n\
    Data goes to stdout, everything else to stderr. Conventions: docs/conventions.md, files: docs/formats.md."
)]
pub struct Cli {
    /// Options of every command.
    #[command(flatten)]
    pub global: Global,
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// Options of every command.
#[derive(Debug, Args)]
pub struct Global {
    /// Data on stdout as JSON
    #[arg(long, global = true)]
    pub json: bool,
    /// Nothing on stderr but errors and skips
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Resolved settings, instruction set, threads and the time of each stage on stderr
    #[arg(long, short, global = true, conflicts_with = "quiet")]
    pub verbose: bool,
    /// Worker threads [default: one per core]
    #[arg(long, global = true, value_name = "N", env = "SELENOGRAPH_THREADS", hide_env_values = true, value_parser = threads)]
    pub threads: Option<NonZeroUsize>,
}

/// Threads that a core may have: more only wait for each other.
const THREADS_PER_CORE: usize = 16;

/// A number of threads that this machine can carry.
fn threads(text: &str) -> Result<NonZeroUsize, String> {
    let most = THREADS_PER_CORE * std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let wanted = text.parse::<NonZeroUsize>().map_err(|_| "a whole number of at least 1".to_owned())?;
    if wanted.get() > most {
        return Err(format!("at most {most} on this machine ({THREADS_PER_CORE} for each core)"));
    }
    Ok(wanted)
}

/// Where a command writes.
#[derive(Debug, Args)]
pub struct Target {
    /// Folder or file to write
    #[arg(long, short, value_name = "PATH")]
    pub out: PathBuf,
    /// Overwrite what is there
    #[arg(long)]
    pub force: bool,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// A synthetic Moon, stereo pairs under three lights, terrain from one of them, scores of all, in minutes
    #[command(after_help = "Example:\n  selenograph demo --out out/demo")]
    Demo(campaign::Demo),
    /// Elevation models: what they are, import, synthesis, a quick look
    #[command(subcommand)]
    Dem(dem::DemCommand),
    /// One picture of a terrain with all its truth maps, for looking
    #[command(
        after_help = "Example:\n  selenograph render terrain --lat-deg -89.2 --lon-deg 120 --altitude-m 9500 --out picture"
    )]
    Render(render::Render),
    /// A campaign on a terrain as a table of pairs, to read and render later
    #[command(
        after_help = "Example:\n  selenograph plan --preset polar-real --terrain terrain --out plan.csv"
    )]
    Plan(campaign::Plan),
    /// Stereo pairs with their truth; run it again to go on where it stopped
    #[command(
        after_help = "Example:\n  selenograph generate --preset polar-real --terrain terrain --out dataset"
    )]
    Generate(campaign::Generate),
    /// Datasets: what is wrong with them, pictures of them, splits, the paper's triplets in and out
    #[command(subcommand)]
    Data(data::DataCommand),
    /// Methods against the truth of a dataset: the paper's tables, floors, plots, worst pairs; run it again to go on
    #[command(
        after_help = "Example:\n  selenograph evaluate out/dataset --method orb --method sift --method stereo --out evaluation"
    )]
    Evaluate(evaluate::Evaluate),
    /// Two pictures into terrain: pose, point cloud, elevation model, slope, hazards, a report
    #[command(
        after_help = "A pair that cannot tell (no overlap, no parallax, nothing to match) ends with `cannot say`, exit code 1, and nothing is written.\n\n\
        Example:\n  selenograph reconstruct a.png b.png --fov-deg 45 --out terrain_ab"
    )]
    Reconstruct(Box<reconstruct::Reconstruct>),
    /// An elevation model, sharpened by the shading of one or more pictures of it
    #[command(
        after_help = "The model's own grid is kept, and its heights where no picture sees them. Pictures that do not show its ground are refused.\n\n\
        Example:\n  selenograph refine coarse.tif a.png --camera a.camera.json --sun 130,22 --out sharpened"
    )]
    Refine(Box<refine::Refine>),
    /// Squares of an image sequence, cut at regular intervals, as pairs
    #[command(after_help = "Example:\n  selenograph frames descent_pictures --every 30 --gap 15 --out pairs")]
    Frames(frames::Frames),
    /// Checkpoints of networks: what is in them, conversion, random ones
    #[command(subcommand)]
    Weights(weights::WeightsCommand),
    /// Networks that learn: runs, their settings
    #[command(subcommand)]
    Train(train::TrainCommand),
    /// The campaigns that come with the program
    #[command(after_help = "Example:\n  selenograph presets polar-real > mine.toml")]
    Presets(campaign::Presets),
    /// What a campaign resolves to
    #[command(subcommand)]
    Config(campaign::ConfigCommand),
    /// What runs here: instructions, memory, devices, weights found; text to paste into a report of a fault
    #[command(
        after_help = "SELENOGRAPH_WEIGHTS names a folder that is searched, too. Exit code 1 if something that was named cannot be read.\n\n\
        Example:\n  selenograph doctor weights_folder"
    )]
    Doctor(about::Doctor),
    /// Shell completions on stdout
    #[command(
        after_help = "Example:\n  selenograph completions bash > ~/.local/share/bash-completion/completions/selenograph"
    )]
    Completions(about::Completions),
}
