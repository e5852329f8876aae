//! `selenograph train …`.

use super::campaign::Known;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// The settings that come with the program.
const PRESETS: &[&str] = &["paper-iccv2025", "from-scratch"];

/// What to do about learning.
#[derive(Debug, Subcommand)]
pub enum TrainCommand {
    /// Trains a network on pairs and leaves checkpoints, curves and a page
    #[command(
        after_help = "Settings, layer over layer: the defaults (the paper's numbers, views unchanged), --preset, --settings, then single keys.\n\
            --dry-run prints all of them. --data, --triplets and --campaign may be mixed. Ctrl-C ends the run at its next step,\n\
            with a checkpoint.\n\nExample:\n  selenograph train run --preset paper-iccv2025 --weights mast3r.safetensors --data dataset --val held_out --out run"
    )]
    Run(Box<Run>),
    /// Goes on where a run stopped, or was killed
    #[command(after_help = "Example:\n  selenograph train resume run")]
    Resume(Resume),
    /// The settings that come with the program
    #[command(after_help = "Example:\n  selenograph train presets paper-iccv2025 > mine.toml")]
    Presets(Presets),
}

/// `train run`.
#[derive(Debug, Args)]
pub struct Run {
    /// Which settings.
    #[command(flatten)]
    pub settings: SettingsChoice,
    /// Where the network begins.
    #[command(flatten)]
    pub start: Start,
    /// What is learnt from.
    #[command(flatten)]
    pub pairs: Pairs,
    /// How long and with what.
    #[command(flatten)]
    pub means: Means,
    /// Folder of the run
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Say what would be done, and stop
    #[arg(long)]
    pub dry_run: bool,
}

/// Settings, layer over layer: preset, file, keys.
#[derive(Debug, Args)]
#[command(next_help_heading = "Settings")]
pub struct SettingsChoice {
    /// Settings that come with the program: paper-iccv2025 fine-tunes the published network, from-scratch begins anew
    #[arg(long, value_name = "NAME", value_parser = Known(PRESETS))]
    pub preset: Option<String>,
    /// Settings file (TOML)
    #[arg(long, value_name = "FILE")]
    pub settings: Option<PathBuf>,
    /// One key, for example learning.epochs=3; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Pairs of a batch
    #[arg(long, value_name = "N")]
    pub batch: Option<usize>,
    /// Batches of a step
    #[arg(long, value_name = "N")]
    pub accumulate: Option<usize>,
    /// Every random number derives from it
    #[arg(long, value_name = "N", env = "SELENOGRAPH_SEED", hide_env_values = true)]
    pub seed: Option<u64>,
}

/// Where the network begins.
#[derive(Debug, Args)]
#[command(next_help_heading = "Network")]
pub struct Start {
    /// Weights to begin with, .pth or safetensors
    #[arg(long, value_name = "FILE", required_unless_present = "network")]
    pub weights: Option<PathBuf>,
    /// Begin with a network that has learnt nothing: base, small, tiny or hybrid
    #[arg(long, value_name = "NAME", conflicts_with = "weights")]
    pub network: Option<String>,
    /// Weights of a network whose predictions stand in for the truth
    #[arg(long, value_name = "FILE")]
    pub teacher: Option<PathBuf>,
}

/// Where pairs come from.
#[derive(Debug, Args)]
#[command(next_help_heading = "Pairs")]
pub struct Pairs {
    /// Dataset folder to learn from; may be repeated
    #[arg(long, value_name = "DIR", required_unless_present_any = ["triplets", "campaign"])]
    pub data: Vec<PathBuf>,
    /// Folder of the paper's triplets to learn from; may be repeated
    #[arg(long, value_name = "DIR")]
    pub triplets: Vec<PathBuf>,
    /// Which of them: train.npz for one --triplets, or for one --data what `data split` wrote, whose other part is held out
    #[arg(long, value_name = "FILE")]
    pub split: Option<PathBuf>,
    /// Pairs of one --triplets that are held out: val.npz
    #[arg(long, value_name = "FILE", requires = "triplets")]
    pub val_split: Option<PathBuf>,
    /// Campaign whose pairs are rendered while learning: a file, or the name of a preset
    #[arg(long, value_name = "CAMPAIGN", requires = "terrain")]
    pub campaign: Option<String>,
    /// Its terrain, a folder made by `dem import`
    #[arg(long, value_name = "DIR", requires = "campaign")]
    pub terrain: Option<PathBuf>,
    /// Dataset folder of held-out ground, which the network is judged on; may be repeated
    #[arg(long, value_name = "DIR")]
    pub val: Vec<PathBuf>,
    /// Learn although pairs to learn from see held-out ground
    #[arg(long)]
    pub allow_leak: bool,
    /// Do not compare the files of pairs with the checksums in their records
    #[arg(long)]
    pub no_verify: bool,
    /// Leave faulty pairs out instead of stopping
    #[arg(long)]
    pub skip_faulty: bool,
}

/// How long and with what.
#[derive(Debug, Args)]
#[command(next_help_heading = "Run")]
pub struct Means {
    /// Time that it may take, such as 25min or 2h; the steps are sized to it
    #[arg(long = "for", value_name = "TIME", value_parser = seconds)]
    pub budget_s: Option<f64>,
    /// What computes: cpu, or with features cuda and wgpu a graphics card
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    pub device: String,
}

/// `train resume`.
#[derive(Debug, Args)]
pub struct Resume {
    /// Folder of the run
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
}

/// `train presets`.
#[derive(Debug, Args)]
pub struct Presets {
    /// Print this one
    #[arg(value_name = "NAME", value_parser = Known(PRESETS))]
    pub name: Option<String>,
}

/// Seconds of `90s`, `25min`, `2h`.
fn seconds(text: &str) -> Result<f64, String> {
    let units = [("min", 60.0), ("h", 3600.0), ("s", 1.0)];
    let found = units.iter().find_map(|(unit, factor)| Some((text.strip_suffix(unit)?, factor)));
    let number = found.and_then(|(number, factor)| Some(number.trim().parse::<f64>().ok()? * factor));
    number.filter(|s| *s > 0.0 && s.is_finite()).ok_or_else(|| "a time such as 90s, 25min or 2h".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "train")]
    #[test]
    fn all_presets_are_offered() {
        assert_eq!(selenograph_train::run::preset::PRESETS.map(|(name, _)| name), PRESETS);
    }

    #[test]
    fn times_have_units() {
        assert_eq!(seconds("25min"), Ok(1500.0));
        assert_eq!(seconds("1.5 h"), Ok(5400.0));
        assert!(seconds("25").is_err() && seconds("-3s").is_err() && seconds("min").is_err());
    }
}
