//! What a photometric check found, for programs (serde) and for people (`Display`).

use super::settings::{Limits, Settings};
use crate::plan::SunAngles;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

impl Limits {
    fn keeps(&self, fit: &ImageFit) -> bool {
        fit.pearson >= self.min_pearson && fit.rmse_levels <= self.max_rmse_levels
    }
}

/// One picture's agreement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImageFit {
    /// The picture.
    pub image: PathBuf,
    /// Number of its pair.
    pub pair_id: u64,
    /// Number of its light.
    pub light_idx: usize,
    /// 0 for A, 1 for B.
    pub view_idx: usize,
    /// The Sun it was rendered with.
    pub sun: SunAngles,
    /// Correlation over all pixels with depth.
    pub pearson: f64,
    /// Root mean square of the difference, grey levels.
    pub rmse_levels: f64,
    /// Fitted grey levels per unit of radiance factor.
    pub gain: f64,
    /// Pixels compared.
    pub num_pixels: usize,
}

/// Something that was not compared, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Skipped {
    /// The folder or file.
    pub path: PathBuf,
    /// The reason.
    pub reason: String,
}

/// The agreement of all pictures of a dataset.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// One entry per picture.
    pub images: Vec<ImageFit>,
    /// What was left out.
    pub skipped: Vec<Skipped>,
    /// The worst correlation; `None` without pictures.
    pub worst_pearson: Option<f64>,
    /// The median correlation.
    pub median_pearson: Option<f64>,
    /// The largest of the differences' root mean squares, grey levels.
    pub worst_rmse_levels: Option<f64>,
    /// Their median.
    pub median_rmse_levels: Option<f64>,
    /// The limits.
    pub limits: Limits,
    /// Whether there were pictures and all limits are kept.
    pub agrees: bool,
}

impl Report {
    pub(super) fn new(images: Vec<ImageFit>, skipped: Vec<Skipped>, settings: &Settings) -> Self {
        let limits = settings.limits;
        let median_pearson = median(images.iter().map(|fit| fit.pearson));
        let median_rmse_levels = median(images.iter().map(|fit| fit.rmse_levels));
        let agrees = images.iter().all(|fit| limits.keeps(fit))
            && median_pearson.is_some_and(|median| median >= limits.min_median_pearson);
        Self {
            worst_pearson: images.iter().map(|fit| fit.pearson).reduce(f64::min),
            median_pearson,
            worst_rmse_levels: images.iter().map(|fit| fit.rmse_levels).reduce(f64::max),
            median_rmse_levels,
            images,
            skipped,
            limits,
            agrees,
        }
    }
}

pub(super) fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (sorted.get(sorted.len().checked_sub(1)? / 2)?, sorted.get(sorted.len() / 2)?);
    Some((low + high) / 2.0)
}

/// Scene and image, as tables name a picture.
fn short_name(path: &Path) -> String {
    let names: Vec<_> = path.iter().rev().take(2).map(|part| part.to_string_lossy()).collect();
    names.into_iter().rev().collect::<Vec<_>>().join("/")
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<32} {:>5} {:>4} {:>9} {:>8} {:>9} {:>11} {:>9} {:>8}",
            "image", "light", "view", "Sun az °", "el °", "Pearson", "RMSE levels", "gain", "pixels"
        )?;
        for fit in &self.images {
            writeln!(
                f,
                "{:<32} {:>5} {:>4} {:>9.1} {:>8.1} {:>9.4} {:>11.2} {:>9.1} {:>8}",
                short_name(&fit.image),
                fit.light_idx,
                ["a", "b"][fit.view_idx.min(1)],
                fit.sun.azimuth_deg,
                fit.sun.elevation_deg,
                fit.pearson,
                fit.rmse_levels,
                fit.gain,
                fit.num_pixels
            )?;
        }
        if let (Some(worst), Some(middle), Some(rmse), Some(largest)) =
            (self.worst_pearson, self.median_pearson, self.median_rmse_levels, self.worst_rmse_levels)
        {
            let limits = &self.limits;
            writeln!(
                f,
                "Pearson: median {middle:.4} (at least {}), least {worst:.4} (at least {})",
                limits.min_median_pearson, limits.min_pearson
            )?;
            writeln!(
                f,
                "RMSE: median {rmse:.2} levels, largest {largest:.2} (at most {})",
                limits.max_rmse_levels
            )?;
        }
        write!(
            f,
            "{} of {} pictures compared keep the limits: the pictures are {}reproduced",
            self.images.iter().filter(|fit| self.limits.keeps(fit)).count(),
            self.images.len(),
            if self.agrees { "" } else { "NOT " }
        )
    }
}
