//! `selenograph dem …`.

use super::Target;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// What to do with elevation models.
#[derive(Debug, Subcommand)]
pub enum DemCommand {
    /// What a file is, where it lies, how high and how steep
    #[command(after_help = "Example:\n  selenograph dem info LDEM_875S_5M.tif --json")]
    Info(Info),
    /// One or several elevation models, in any order, into a terrain that the renderer can trace
    #[command(
        after_help = "Example:\n  selenograph dem import site_5m.tif region_40m.tif ring_1600m.tif --out terrain"
    )]
    Import(Import),
    /// A synthetic Moon: seeded relief with craters, as a GeoTIFF
    #[command(
        after_help = "Example:\n  selenograph dem synth --size 4096 --cell-m 5 --seed 7 --out synthetic.tif"
    )]
    Synth(Synth),
    /// A shaded picture of an elevation model, for looking
    #[command(
        after_help = "Example:\n  selenograph dem hillshade site_5m.tif --azimuth-deg 315 --out site.png"
    )]
    Hillshade(Hillshade),
}

/// How to read an elevation model whose file does not say it all.
#[derive(Debug, Default, Args)]
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
    /// Unit of the heights instead of the file's
    #[arg(long, value_name = "UNIT")]
    pub height_unit: Option<HeightUnit>,
}

/// Unit of heights in a file.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum HeightUnit {
    /// Metres.
    M,
    /// Kilometres.
    Km,
}

/// `dem info`.
#[derive(Debug, Args)]
pub struct Info {
    /// GeoTIFF, PDS3 label or image, PDS4 label; or a terrain folder
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Read all of a terrain folder and compare its checksums
    #[arg(long)]
    pub verify: bool,
    /// How to read it.
    #[command(flatten)]
    pub reading: Reading,
}

/// `dem import`.
#[derive(Debug, Args)]
pub struct Import {
    /// Elevation models of one body; the finest that covers a place makes its surface
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// How to read them.
    #[command(flatten)]
    pub reading: Reading,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// `dem synth`.
#[derive(Debug, Args)]
pub struct Synth {
    /// Pixels along each side of the square map, centred on the south pole
    #[arg(long, value_name = "N", default_value_t = 2048)]
    pub size: usize,
    /// Metres per pixel
    #[arg(long, value_name = "M", default_value_t = 20.0)]
    pub cell_m: f64,
    /// Another seed, another Moon
    #[arg(long, value_name = "N", default_value_t = 1, env = "SELENOGRAPH_SEED", hide_env_values = true)]
    pub seed: u64,
    /// Factor on the fractal relief; 1 is polar highland
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub relief: f64,
    /// Crater density N(>D) D²; 0 makes none [default: that of old highland]
    #[arg(long, value_name = "DENSITY")]
    pub crater_density: Option<f64>,
    /// A coarse real elevation model that gives the long waves
    #[arg(long, value_name = "FILE")]
    pub base: Option<PathBuf>,
    /// Number written where heights are absent (with a base that has holes) [default: NaN]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    pub nodata: Option<f32>,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// `dem hillshade`.
#[derive(Debug, Args)]
pub struct Hillshade {
    /// GeoTIFF, PDS3 label or image, PDS4 label
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// How to read it.
    #[command(flatten)]
    pub reading: Reading,
    /// Sun's azimuth, clockwise from the top of the map
    #[arg(long, value_name = "DEG", default_value_t = 315.0)]
    pub azimuth_deg: f64,
    /// Sun's elevation above the horizon
    #[arg(long, value_name = "DEG", default_value_t = 30.0)]
    pub elevation_deg: f64,
    /// Longest side of the picture, pixels
    #[arg(long, value_name = "N", default_value_t = 2048)]
    pub max_side: usize,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}
