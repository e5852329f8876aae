//! Commands that work on campaigns: `plan`, `generate`, `presets`, `config show`, `demo`.

use super::Target;
use clap::builder::{PossibleValue, StringValueParser, TypedValueParser};
use clap::{Args, Subcommand};
use std::ffi::OsStr;
use std::path::PathBuf;

/// The campaigns that come with the program.
pub const CAMPAIGNS: &[&str] =
    &["paper-iccv2025", "paper-iccv2025-scripts", "polar-real", "descent", "training", "hard-cases"];

/// A word of which the known ones are offered by completions and in the help; one that is none is refused where it is looked up, with
/// a message of its own.
#[derive(Debug, Clone, Copy)]
pub struct Known(pub &'static [&'static str]);

impl TypedValueParser for Known {
    type Value = String;

    fn parse_ref(
        &self,
        command: &clap::Command,
        arg: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<String, clap::Error> {
        StringValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.0.iter().map(|name| PossibleValue::new(*name))))
    }
}

/// Which campaign, layer over layer: preset, file, environment, flags.
#[derive(Debug, Args)]
#[command(next_help_heading = "Campaign")]
pub struct CampaignChoice {
    /// Campaign file (TOML)
    #[arg(value_name = "CAMPAIGN")]
    pub campaign: Option<PathBuf>,
    /// Campaign that comes with the program
    #[arg(long, value_name = "NAME", value_parser = Known(CAMPAIGNS))]
    pub preset: Option<String>,
    /// One key, for example nadir.pairs=20; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Every random number derives from it
    #[arg(long, value_name = "N", env = "SELENOGRAPH_SEED", hide_env_values = true)]
    pub seed: Option<u64>,
}

/// `presets`.
#[derive(Debug, Args)]
pub struct Presets {
    /// Print this one
    #[arg(value_name = "NAME", value_parser = Known(CAMPAIGNS))]
    pub name: Option<String>,
}

/// `config …`.
#[derive(Debug, Subcommand)]
pub enum ConfigCommand {
    /// Every key of a campaign with its value and where it came from
    #[command(after_help = "Example:\n  selenograph config show --preset polar-real --set nadir.pairs=20")]
    Show(ConfigShow),
}

/// `config show`.
#[derive(Debug, Args)]
pub struct ConfigShow {
    /// Which campaign.
    #[command(flatten)]
    pub choice: CampaignChoice,
}

/// `plan`.
#[derive(Debug, Args)]
pub struct Plan {
    /// Which campaign.
    #[command(flatten)]
    pub choice: CampaignChoice,
    /// Terrain folder made by `dem import`
    #[arg(long, value_name = "DIR")]
    pub terrain: PathBuf,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// `generate`.
#[derive(Debug, Args)]
pub struct Generate {
    /// Which campaign.
    #[command(flatten)]
    pub choice: CampaignChoice,
    /// Terrain folder made by `dem import`
    #[arg(long, value_name = "DIR")]
    pub terrain: PathBuf,
    /// Plan made by `plan` instead of a new one
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
    /// Number of this run among --shards, from 0: it makes every pair whose number leaves it when divided by --shards
    #[arg(long, value_name = "I", default_value_t = 0)]
    pub shard: u64,
    /// How many runs share the campaign
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    pub shards: u64,
    /// Plan and say how much it would be, but render nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// `demo`.
#[derive(Debug, Args)]
pub struct Demo {
    /// Another seed, another Moon
    #[arg(long, value_name = "N", default_value_t = 1, env = "SELENOGRAPH_SEED", hide_env_values = true)]
    pub seed: u64,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_presets_are_offered() {
        assert_eq!(selenograph_dataset::plan::PRESETS.map(|(name, _)| name), CAMPAIGNS);
    }
}
