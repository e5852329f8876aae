//! `selenograph refine`.

use super::Target;
use super::dem::Reading;
use super::reconstruct::{SunGiven, sun};
use super::render::Law;
use clap::Args;
use std::path::PathBuf;

/// An elevation model and pictures of it into a sharper one.
#[derive(Debug, Args)]
pub struct Refine {
    /// Elevation model: GeoTIFF, PDS3 label or image, PDS4 label
    #[arg(value_name = "DEM")]
    pub dem: PathBuf,
    /// Pictures of it: PNG, JPEG, TIFF, PGM, PDS3 or PDS4 image, ISIS cube
    #[arg(required = true, value_name = "PICTURE")]
    pub pictures: Vec<PathBuf>,
    /// Camera of each picture with its place on the body, once for each, in order: our TOML or JSON, ASP .tsai
    #[arg(long = "camera", value_name = "FILE", required = true, help_heading = "Pictures")]
    pub cameras: Vec<PathBuf>,
    /// Sun of each picture, once for each, in order: azimuth from north and elevation in degrees, at the ground below the first camera, or a vector in that picture's camera's axes
    #[arg(long = "sun", value_name = "AZ,EL|X,Y,Z", value_parser = sun, allow_hyphen_values = true, required = true, help_heading = "Pictures")]
    pub suns: Vec<SunGiven>,
    /// Reflectance law of the ground
    #[arg(long, value_name = "LAW", default_value = "hapke1963", help_heading = "Pictures")]
    pub law: Law,
    /// How to read the elevation model.
    #[command(flatten)]
    pub reading: Reading,
    /// How sure the elevation model is.
    #[command(flatten)]
    pub trust: Trust,
    /// Side of a cell of the result on the ground, no larger than the model's [default: the model's own grid]
    #[arg(long, value_name = "M", allow_negative_numbers = true, help_heading = "Products")]
    pub cell_m: Option<f64>,
    /// Number written where rasters are absent [default: NaN]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true, help_heading = "Products")]
    pub absent: Option<f32>,
    /// No report.html
    #[arg(long, help_heading = "Products")]
    pub no_report: bool,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// How sure the elevation model is.
#[derive(Debug, Args)]
#[command(next_help_heading = "Elevation model")]
pub struct Trust {
    /// Standard deviation of its heights, means over its resolution: what holds the long waves [default: estimated from its relief]
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub dem_sigma_m: Option<f64>,
    /// Length below which it holds no relief [default: estimated from its relief]
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub dem_resolution_m: Option<f64>,
}
