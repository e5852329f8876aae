//! `selenograph render`.

use super::Target;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// One picture with all its truth maps.
#[derive(Debug, Args)]
pub struct Render {
    /// Terrain folder made by `dem import`
    #[arg(value_name = "TERRAIN")]
    pub terrain: PathBuf,
    /// Where the camera stands and looks.
    #[command(flatten)]
    pub camera: CameraPlace,
    /// Sun and shadows.
    #[command(flatten)]
    pub light: Light,
    /// Rays per pixel
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub rays_per_pixel: u32,
    /// Standard deviation of the point spread, pixels
    #[arg(long, value_name = "PX", default_value_t = 0.6)]
    pub psf_sigma_px: f64,
    /// Reflectance law with its usual parameters
    #[arg(long, value_name = "LAW", default_value = "hapke1963")]
    pub brdf: Law,
    /// Brightness of the ground.
    #[command(flatten)]
    pub albedo: AlbedoChoice,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// Where the camera stands and looks.
#[derive(Debug, Args)]
#[command(next_help_heading = "Camera")]
pub struct CameraPlace {
    /// Latitude of the ground that is looked at
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub lat_deg: f64,
    /// East longitude of the ground that is looked at
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub lon_deg: f64,
    /// Height of the camera over that ground
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub altitude_m: f64,
    /// Angle of the line of sight from the vertical
    #[arg(long, value_name = "DEG", default_value_t = 0.0)]
    pub tilt_deg: f64,
    /// Azimuth that the camera looks towards (the top of the picture when it looks down)
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    pub heading_deg: f64,
    /// Field of view across the width
    #[arg(long, value_name = "DEG", default_value_t = 45.0)]
    pub fov_deg: f64,
    /// Columns
    #[arg(long, value_name = "PX", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub width: u32,
    /// Rows
    #[arg(long, value_name = "PX", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub height: u32,
}

/// Sun and shadows.
#[derive(Debug, Args)]
#[command(next_help_heading = "Light")]
pub struct Light {
    /// Sun's azimuth at that ground, clockwise from north
    #[arg(long, value_name = "DEG", default_value_t = 330.0, allow_negative_numbers = true)]
    pub sun_azimuth_deg: f64,
    /// Sun's elevation at that ground
    #[arg(long, value_name = "DEG", default_value_t = 20.0, allow_negative_numbers = true)]
    pub sun_elevation_deg: f64,
    /// Shadows that terrain casts, or only where it faces away
    #[arg(long, value_name = "KIND", default_value = "cast")]
    pub shadows: ShadowKind,
}

/// Brightness of the ground.
#[derive(Debug, Args)]
#[command(next_help_heading = "Albedo")]
pub struct AlbedoChoice {
    /// Georeferenced raster whose values multiply the reflectance
    #[arg(long, value_name = "MAP")]
    pub albedo: Option<PathBuf>,
    /// Its band, from 1 [default: 1]
    #[arg(long, value_name = "N", requires = "albedo")]
    pub albedo_band: Option<usize>,
    /// Value outside the map and in holes of it [default: the map's mean]
    #[arg(long, value_name = "V", requires = "albedo", allow_negative_numbers = true)]
    pub albedo_elsewhere: Option<f64>,
}

/// Kinds of shadow.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum ShadowKind {
    /// The whole terrain occludes.
    Cast,
    /// Only ground that faces away is dark.
    Attached,
}

/// Reflectance laws.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Law {
    /// Lambert.
    Lambert,
    /// Lommel-Seeliger.
    LommelSeeliger,
    /// McEwen's lunar-Lambert.
    LunarLambert,
    /// Minnaert.
    Minnaert,
    /// Hapke 1963: the law of the paper's pictures.
    Hapke1963,
    /// Hapke 2012 with the Moon's parameters.
    Hapke,
}
