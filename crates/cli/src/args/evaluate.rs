//! `selenograph evaluate`.

use super::Target;
use super::data::KConvention;
use super::network::NetworkChoice;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// `evaluate`.
#[derive(Debug, Args)]
pub struct Evaluate {
    /// Dataset folder, ours or triplets, or a folder of such folders
    #[arg(value_name = "DIR")]
    pub dataset: PathBuf,
    /// A method; give several to compare them: reductions are against the first that sees pictures only. Known: orb, sift, stereo, mast3r, mast3r-stereo, fused, truth, plane
    #[arg(long = "method", short, value_name = "METHOD", required = true, value_delimiter = ',')]
    pub methods: Vec<String>,
    /// View A under one light and view B under another: only such items, or beside those of one light
    #[arg(long, value_name = "HOW", num_args = 0..=1, require_equals = true, default_missing_value = "only")]
    pub cross_light: Option<CrossLight>,
    /// Only pairs flown like this (nadir, oblique, dynamic, descent, …)
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub trajectory: Vec<String>,
    /// Only these pairs: numbers, names as in the files, or folders of triplets
    #[arg(long, value_name = "PAIR", value_delimiter = ',')]
    pub pairs: Vec<String>,
    /// At most this many pairs, spread over the dataset
    #[arg(long, value_name = "N")]
    pub limit: Option<usize>,
    /// Where the triplets' K counts pixels from [default: what their depth says]
    #[arg(long, value_name = "WHERE")]
    pub k_convention: Option<KConvention>,
    /// One setting of the methods of `reconstruct`, for example shading.estimate_weights=false (keys as in its run.toml, parts orb, sift,
    /// stereo, shading); may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// The paper's figures of every pair: methods side by side, clouds, profiles
    #[arg(long)]
    pub figures: bool,
    /// Do not compare the files with the checksums in their pairs' records
    #[arg(long)]
    pub no_verify: bool,
    /// Its network.
    #[command(flatten)]
    pub network: NetworkChoice,
    /// Where to write; the same evaluation there is gone on with, --force begins it anew.
    #[command(flatten)]
    pub target: Target,
}

/// What becomes of items whose views have different lights.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum CrossLight {
    /// They alone are evaluated.
    Only,
    /// They are evaluated beside those of one light.
    Beside,
}
