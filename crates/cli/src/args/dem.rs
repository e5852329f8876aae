//! `selenograph dem …`.

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// What to do with elevation models.
#[derive(Debug, Subcommand)]
pub enum DemCommand {
    /// What a file is, where it lies, how high and how steep
    #[command(after_help = "Example:\n  selenograph dem info LDEM_875S_5M.tif --json")]
    Info(Info),
}

/// How to read an elevation model whose file does not say it all.
#[derive(Debug, Args)]
#[command(next_help_heading = "Reading")]
pub struct Reading {
    /// Band that holds the heights, from 1
    #[arg(long, value_name = "N")]
    pub band: Option<usize>,
    /// Coordinate system instead of the file's: PROJ string or IAU_2015 code
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,
    /// Value that means "absent" instead of the file's
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub nodata: Option<f64>,
}

/// `dem info`.
#[derive(Debug, Args)]
pub struct Info {
    /// GeoTIFF, PDS3 label or image, PDS4 label
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// How to read it.
    #[command(flatten)]
    pub reading: Reading,
}
