//! `selenograph data …`.

use super::Target;
use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;
use std::path::PathBuf;

/// What to do with datasets.
#[derive(Debug, Subcommand)]
pub enum DataCommand {
    /// Find what is wrong with a dataset, ours or triplets, and explain it
    #[command(after_help = "Example:\n  selenograph data check out/dataset --json")]
    Check(Check),
    /// Contact sheets: views, depth, slope and shadow of some pairs
    #[command(after_help = "Example:\n  selenograph data sheet out/dataset --out sheets --pairs 16")]
    Sheet(Sheet),
    /// Training and validation parts that share no ground
    #[command(after_help = "Example:\n  selenograph data split out/dataset --out split.json")]
    Split(Split),
    /// The paper's triplets (jpg, exr, npz) into our layout
    #[command(after_help = "Example:\n  selenograph data import stereolunar --out dataset --suns scripts")]
    Import(Import),
    /// The paper's triplets (jpg, exr, npz), a COLMAP model or nerfstudio's transforms.json from our dataset
    #[command(
        after_help = "Example:\n  selenograph data export out/dataset --out triplets --split split.json"
    )]
    Export(Export),
}

/// `data check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Dataset folder, ours or triplets
    #[arg(value_name = "DIR")]
    pub dataset: PathBuf,
    /// Where the triplets' K is taken to count pixels from; the fit says whether that is so
    #[arg(long, value_name = "WHERE", default_value = "corner")]
    pub k_convention: KConvention,
    /// Warp every this many pixels across and down
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub step: usize,
    /// Instead, render the triplets' pictures from their own depth with the scripts' Suns, and tell how well they agree
    #[arg(long, conflicts_with = "step")]
    pub render: bool,
    /// With --render: write each picture beside its rendering and their difference into this folder
    #[arg(long, short, value_name = "DIR", requires = "render")]
    pub out: Option<PathBuf>,
    /// With --out: overwrite what is there
    #[arg(long, requires = "out")]
    pub force: bool,
}

/// `data sheet`.
#[derive(Debug, Args)]
pub struct Sheet {
    /// Dataset folder, ours or triplets
    #[arg(value_name = "DIR")]
    pub dataset: PathBuf,
    /// At most this many pairs, spread over the dataset
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub pairs: usize,
    /// Side of a thumbnail, pixels
    #[arg(long, value_name = "PX", default_value_t = 144)]
    pub thumbnail_px: usize,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// `data split`.
#[derive(Debug, Args)]
pub struct Split {
    /// Dataset folder
    #[arg(value_name = "DIR")]
    pub dataset: PathBuf,
    /// Share of the pairs to validate on
    #[arg(long, value_name = "SHARE", default_value_t = 0.2)]
    pub val_share: f64,
    /// Side of a cell of ground [default: the largest footprint]
    #[arg(long, value_name = "M")]
    pub cell_m: Option<f64>,
    /// Decides which cells
    #[arg(long, value_name = "N", default_value_t = 0, env = "SELENOGRAPH_SEED", hide_env_values = true)]
    pub seed: u64,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// `data import`.
#[derive(Debug, Args)]
pub struct Import {
    /// Folder of triplets, or of such folders `<trajectory>_<n>`
    #[arg(value_name = "SRC")]
    pub source: PathBuf,
    /// Where the triplets' K counts pixels from: the corner (the public samples) or the first pixel's centre
    #[arg(long, value_name = "WHERE", default_value = "corner")]
    pub k_convention: KConvention,
    /// Suns to record: the files hold none
    #[arg(long, value_name = "WHICH", default_value = "unknown")]
    pub suns: Suns,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// Suns of imported pairs.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Suns {
    /// Absent.
    Unknown,
    /// The three of the authors' scripts, for folders `nadir…`, `oblique…` and `pitch…`.
    Scripts,
}

/// `data export`.
#[derive(Debug, Args)]
pub struct Export {
    /// Dataset folder
    #[arg(value_name = "DIR")]
    pub dataset: PathBuf,
    /// What is written
    #[arg(long, value_name = "FORMAT", default_value = "triplets")]
    pub format: ExportFormat,
    /// Split made by `data split`, for split files beside the scenes (triplets)
    #[arg(long, value_name = "FILE")]
    pub split: Option<PathBuf>,
    /// Where the triplets' K counts pixels from: the first pixel's centre (the paper's loader) or the corner (the public samples)
    #[arg(long, value_name = "WHERE", default_value = "center")]
    pub k_convention: KConvention,
    /// Do not compare the files with the checksums in their pairs' records
    #[arg(long)]
    pub no_verify: bool,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// What `data export` writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ExportFormat {
    /// The paper's: a jpg, an exr and an npz per view and light.
    Triplets,
    /// Pictures, and COLMAP's model of them in `sparse/0`, as text and binary, with points of the truth.
    Colmap,
    /// Pictures and nerfstudio's `transforms.json`.
    Nerfstudio,
}

/// Where K counts pixels from.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum KConvention {
    /// The first pixel's centre is (0, 0): principal point 255.5 for 512 pixels.
    Center,
    /// The first pixel's centre is (0.5, 0.5): principal point 256.
    Corner,
}
