//! How a picture is made.

use crate::Error;
use crate::brdf::Brdf;
use selenograph_geometry::Point3;
use selenograph_raster::Raster;
use selenograph_terrain::Grid;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What multiplies the reflectance law: the albedo of laws that have none of their own, a relative value for the others.
#[derive(Clone)]
pub enum Albedo {
    /// The same everywhere.
    Constant(f64),
    /// A map, read bilinearly at the point that each pixel's centre sees (a map finer than the picture's ground sampling is
    /// not averaged over the pixel).
    Map(Arc<AlbedoMap>),
}

/// Albedo on a map grid.
pub struct AlbedoMap {
    /// Where the nodes lie.
    pub grid: Grid,
    /// Value per node, `grid.cols × grid.rows`; NaN where unknown.
    pub values: Raster<f32>,
    /// Value outside the map and where it is unknown.
    pub elsewhere: f64,
}

impl Albedo {
    /// The value at a point of the surface.
    pub fn at(&self, point: &Point3<f64>) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Map(map) => map.sample(point).unwrap_or(map.elsewhere),
        }
    }
}

impl AlbedoMap {
    fn sample(&self, point: &Point3<f64>) -> Option<f64> {
        let at = self.grid.grid_from_point(point)?;
        if !self.grid.contains(at) {
            return None;
        }
        let (i, j) = ((at[0] as usize).min(self.grid.cols - 2), (at[1] as usize).min(self.grid.rows - 2));
        let node = |i: usize, j: usize| f64::from(self.values.data[j * self.grid.cols + i]);
        let patch = selenograph_terrain::Patch {
            h00: node(i, j),
            h10: node(i + 1, j),
            h01: node(i, j + 1),
            h11: node(i + 1, j + 1),
        };
        Some(patch.eval(at[0] - i as f64, at[1] - j as f64).0).filter(|v| v.is_finite())
    }
}

/// Which shadows a picture has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shadows {
    /// Ground that faces away from the Sun, and ground that other ground hides from it.
    #[default]
    Cast,
    /// Only ground that faces away from the Sun (the pictures of the StereoLunar dataset).
    Attached,
}

/// How rays are followed. The picture is the same, bit for bit, with the first three.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InstructionSet {
    /// 512-bit vectors (x86-64 with F, DQ, BW, VL).
    Avx512,
    /// 256-bit vectors (x86-64).
    Avx2,
    /// Plain Rust.
    Scalar,
    /// No fast path: every ray in f64 by [`crate::Tracer`]. Slow; what the others are compared with.
    Exact,
}

impl InstructionSet {
    /// The widest that this machine has.
    pub fn best() -> Self {
        [Self::Avx512, Self::Avx2].into_iter().find(|set| set.is_available()).unwrap_or(Self::Scalar)
    }

    /// Whether this machine has it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Scalar | Self::Exact => true,
        }
    }
}

/// Settings of [`crate::radiance()`].
#[derive(Clone)]
pub struct RadianceSettings {
    /// Rays through each pixel, at least 1.
    pub rays_per_pixel: u32,
    /// Standard deviation of the Gaussian point spread, pixels; 0 sends all rays through the centre.
    pub psf_sigma_px: f64,
    /// Which shadows.
    pub shadows: Shadows,
    /// Reflectance law.
    pub brdf: Brdf,
    /// What multiplies it.
    pub albedo: Albedo,
    /// Decides where the rays go.
    pub seed: u64,
    /// Instructions to use; the machine's best by default.
    pub instruction_set: InstructionSet,
}

impl Default for RadianceSettings {
    fn default() -> Self {
        Self {
            rays_per_pixel: 64,
            psf_sigma_px: 0.6,
            shadows: Shadows::default(),
            brdf: Brdf::default(),
            albedo: Albedo::Constant(1.0),
            seed: 0,
            instruction_set: InstructionSet::best(),
        }
    }
}

impl RadianceSettings {
    /// Refuses settings that no picture can be made with.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn validate(&self) -> Result<(), Error> {
        let bad = |name, expected, found: String| Err(Error::Setting { name, expected, found });
        if self.rays_per_pixel == 0 || self.rays_per_pixel > 65_536 {
            return bad("rays_per_pixel", "1 to 65536", self.rays_per_pixel.to_string());
        }
        if !(self.psf_sigma_px >= 0.0 && self.psf_sigma_px <= 16.0) {
            return bad("psf_sigma_px", "0 to 16 pixels", self.psf_sigma_px.to_string());
        }
        if let Albedo::Constant(value) = self.albedo
            && !(value.is_finite() && value >= 0.0)
        {
            return bad("albedo", "a finite value of at least 0", value.to_string());
        }
        if !self.instruction_set.is_available() {
            return bad(
                "instruction_set",
                "one that this machine has",
                format!("{:?}", self.instruction_set),
            );
        }
        self.brdf.validate()?;
        Ok(())
    }
}
