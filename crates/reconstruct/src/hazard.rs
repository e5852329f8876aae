//! Where a lander may stand: slope and roughness over its footprint, against limits, as far as the sigma lets it be said.
//!
//! Over the square of `n × n` cells about each cell (the smallest odd `n ≥ 3` whose side reaches the footprint) a plane is
//! fitted to the heights by least squares:
//!
//! - **slope** is the plane's angle with the horizontal;
//! - **roughness** is the root mean square distance of the heights from the plane, along its normal:
//!   `√(Σ r² / (m − 3)) · cos(slope)` over the `m` cells that hold a height (`m − 3`: three are spent on the plane).
//!
//! The plane takes up what errors of neighbouring cells have in common, so the error of the slope is taken as that of two
//! heights at opposite ends of the footprint, `σ_slope = √2 σ_h / L · cos²(slope)`; what is left to the residuals is
//! independent, and the error of their root mean square is `σ_roughness = σ_h / √(m − 3)` (first order), with `σ_h` the
//! mean sigma in the square. With `k` = [`HazardOptions::sigmas`], a value `v` is *over* its limit if `v − k σ > limit`,
//! *under* it if `v + k σ ≤ limit`, and cannot be told in between.
//!
//! # Source
//! The plane under the lander's footprint: Johnson, Klumpp, Collier & Wolf 2002, "Lidar-based hazard avoidance for safe
//! landing on Mars", J. Guidance, Control, and Dynamics 25(6) (they take the largest distance from a median plane).

use crate::Error;
use crate::grid::Dem;
use rayon::prelude::*;
use selenograph_raster::Raster;
use serde::{Deserialize, Serialize};

/// What a cell is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Hazard {
    /// Nothing is there, or its sigma is too large to tell.
    #[default]
    Unknown,
    /// Slope and roughness are under their limits.
    Safe,
    /// The slope is over its limit.
    Slope,
    /// The roughness is over its limit.
    Roughness,
    /// Both are over their limits.
    Both,
}

impl Hazard {
    /// In the order of a legend.
    pub const ALL: [Self; 5] = [Self::Safe, Self::Slope, Self::Roughness, Self::Both, Self::Unknown];

    /// What it is, in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Safe => "safe",
            Self::Unknown => "cannot be told",
            Self::Roughness => "too rough",
            Self::Slope => "too steep",
            Self::Both => "too steep and too rough",
        }
    }

    /// A colour, 8 bits a channel, that the colour-blind can tell from the others (Okabe and Ito 2008, "Color universal
    /// design", but for the last two).
    pub fn color(self) -> [u8; 3] {
        match self {
            Self::Safe => [0, 158, 115],
            Self::Slope => [213, 94, 0],
            Self::Roughness => [240, 228, 66],
            Self::Both => [110, 20, 90],
            Self::Unknown => [170, 178, 190],
        }
    }

    /// The number in files, the larger the worse; 0 is left for cells without a height.
    pub fn code(self) -> u8 {
        match self {
            Self::Safe => 1,
            Self::Unknown => 2,
            Self::Roughness => 3,
            Self::Slope => 4,
            Self::Both => 5,
        }
    }
}

/// Limits of a lander.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HazardOptions {
    /// Steepest ground, degrees.
    pub max_slope_deg: f64,
    /// Roughest ground in the grid's unit; `None` takes 5 % of the side of the square.
    pub max_roughness_m: Option<f64>,
    /// Side of the lander's footprint in the grid's unit; `None` takes three cells. A smaller one than three cells cannot
    /// be judged from the grid and three cells are taken.
    pub footprint_m: Option<f64>,
    /// Number of sigmas by which a value must be off its limit.
    pub sigmas: f64,
}

impl Default for HazardOptions {
    fn default() -> Self {
        Self { max_slope_deg: 15.0, max_roughness_m: None, footprint_m: None, sigmas: 1.0 }
    }
}

/// Roughness limit as a share of the footprint (half a metre under a lander of 10 m).
const ROUGHNESS_SHARE: f64 = 0.05;
/// A square with a smaller share of heights is unknown.
const MIN_SHARE: f64 = 0.75;
/// Largest side of the square, cells: larger footprints are refused rather than computed for minutes.
const MAX_SIDE: usize = 255;

/// Slope, roughness and what follows from them.
#[derive(Debug, Clone)]
pub struct HazardMap {
    /// What each cell is.
    pub classes: Raster<Hazard>,
    /// Slope over the footprint, radians; NaN where unknown.
    pub slope_rad: Raster<f32>,
    /// Roughness over the footprint, the grid's unit; NaN where unknown.
    pub roughness: Raster<f32>,
    /// Side of the square that was used, ground units.
    pub footprint: f64,
    /// Roughness limit that was used, the grid's unit.
    pub max_roughness: f64,
    /// Whether sigma took part; else a cell is judged by its values alone.
    pub sigma_aware: bool,
}

/// Judges every cell of an elevation model.
///
/// # Errors
/// [`Error::Value`] for a limit that is not positive or a footprint past 255 cells.
pub fn hazard(dem: &Dem, options: &HazardOptions) -> Result<HazardMap, Error> {
    let positive = |key, value: f64| match value > 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(Error::Value { key, expected: "a number > 0", found: value.to_string() }),
    };
    let max_slope_rad = positive("max_slope_deg", options.max_slope_deg)?.to_radians();
    let steps = dem.ground_cell();
    let cell = f64::midpoint(steps[0], steps[1]);
    let asked = options.footprint_m.map_or(Ok(3.0 * cell), |side| positive("footprint_m", side))?;
    // A thousandth of a cell is rounding, not a wish for two more cells.
    let side = ((asked / cell - 1e-3).ceil().max(3.0) as usize) | 1;
    if side > MAX_SIDE {
        let expected = "a footprint of at most 255 cells";
        return Err(Error::Value { key: "footprint_m", expected, found: format!("{side} cells") });
    }
    let footprint = side as f64 * cell;
    let max_roughness = options
        .max_roughness_m
        .map_or(Ok(ROUGHNESS_SHARE * footprint), |m| positive("max_roughness_m", m))?;
    let limits = Limits { max_slope_rad, max_roughness, sigmas: options.sigmas.max(0.0), footprint };

    let (width, height) = (dem.heights.width, dem.heights.height);
    let sigma_aware = dem.sigma.data.iter().any(|s| s.is_finite());
    let mut classes = Raster::filled(width, height, Hazard::Unknown);
    let mut slope_rad = Raster::filled(width, height, f32::NAN);
    let mut roughness = slope_rad.clone();
    let rows = classes.data.par_chunks_mut(width).zip(slope_rad.data.par_chunks_mut(width));
    rows.zip(roughness.data.par_chunks_mut(width)).enumerate().for_each(
        |(y, ((classes, slopes), roughs))| {
            let columns = column_sums(dem, y, side / 2, sigma_aware);
            for x in 0..width {
                let Some(fit) = Fit::over(&columns, x, side / 2, side * side, steps) else { continue };
                (slopes[x], roughs[x]) = (fit.slope_rad as f32, fit.roughness as f32);
                classes[x] = limits.judge(&fit);
            }
        },
    );
    Ok(HazardMap { classes, slope_rad, roughness, footprint, max_roughness, sigma_aware })
}

struct Limits {
    max_slope_rad: f64,
    max_roughness: f64,
    sigmas: f64,
    footprint: f64,
}

impl Limits {
    fn judge(&self, fit: &Fit) -> Hazard {
        let cos = fit.slope_rad.cos();
        let slope_sigma = std::f64::consts::SQRT_2 * fit.sigma / self.footprint * cos * cos;
        let slope = self.against(fit.slope_rad, slope_sigma, self.max_slope_rad);
        let roughness = self.against(fit.roughness, fit.roughness_sigma, self.max_roughness);
        match (slope, roughness) {
            (Some(true), Some(true)) => Hazard::Both,
            (Some(true), _) => Hazard::Slope,
            (_, Some(true)) => Hazard::Roughness,
            (Some(false), Some(false)) => Hazard::Safe,
            _ => Hazard::Unknown,
        }
    }

    /// Whether a value is over its limit; `None` where its sigma does not let that be told.
    fn against(&self, value: f64, sigma: f64, limit: f64) -> Option<bool> {
        let slack = self.sigmas * sigma;
        if value - slack > limit {
            Some(true)
        } else if value + slack <= limit {
            Some(false)
        } else {
            None
        }
    }
}

/// Sums down one column of the square, rows counted from its middle.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: f64,
    y: f64,
    yy: f64,
    h: f64,
    hy: f64,
    hh: f64,
    sigma: f64,
}

fn column_sums(dem: &Dem, y: usize, reach: usize, with_sigma: bool) -> Vec<Sums> {
    let mut sums = vec![Sums::default(); dem.heights.width];
    // Heights are counted from one of the row's own, so that squares keep their digits far from the sphere.
    let base = dem.heights.row(y).iter().find(|h| h.is_finite()).copied().unwrap_or(0.0);
    for row in y.saturating_sub(reach)..(y + reach + 1).min(dem.heights.height) {
        let dy = y as f64 - row as f64;
        for (x, (sum, &height)) in sums.iter_mut().zip(dem.heights.row(row)).enumerate() {
            if height.is_nan() {
                continue;
            }
            let h = f64::from(height - base);
            sum.n += 1.0;
            sum.y += dy;
            sum.yy += dy * dy;
            sum.h += h;
            sum.hy += h * dy;
            sum.hh += h * h;
            if with_sigma {
                sum.sigma += f64::from(dem.sigma[(x, row)]);
            }
        }
    }
    sums
}

/// The plane through one square.
struct Fit {
    slope_rad: f64,
    roughness: f64,
    roughness_sigma: f64,
    /// Mean sigma of the heights; 0 where there is none.
    sigma: f64,
}

impl Fit {
    fn over(columns: &[Sums], x: usize, reach: usize, cells: usize, steps: [f64; 2]) -> Option<Self> {
        let mut t = Sums::default();
        let (mut sx, mut sxx, mut sxy, mut shx) = (0.0, 0.0, 0.0, 0.0);
        let first = x.saturating_sub(reach);
        for (i, c) in columns[first..(x + reach + 1).min(columns.len())].iter().enumerate() {
            let dx = (first + i) as f64 - x as f64;
            t.n += c.n;
            t.y += c.y;
            t.yy += c.yy;
            t.h += c.h;
            t.hy += c.hy;
            t.hh += c.hh;
            t.sigma += c.sigma;
            sx += dx * c.n;
            sxx += dx * dx * c.n;
            sxy += dx * c.y;
            shx += dx * c.h;
        }
        if t.n < MIN_SHARE * cells as f64 || t.n <= 3.0 {
            return None;
        }
        // Moments about the middle of what is there; the plane then has two unknowns.
        let (mx, my, mh) = (sx / t.n, t.y / t.n, t.h / t.n);
        let (xx, xy, yy) = (sxx - mx * sx, sxy - mx * t.y, t.yy - my * t.y);
        let (hx, hy, hh) = (shx - mh * sx, t.hy - mh * t.y, t.hh - mh * t.h);
        let determinant = xx * yy - xy * xy;
        if determinant <= 1e-9 * xx * yy {
            return None;
        }
        let east = (hx * yy - hy * xy) / determinant;
        let north = (hy * xx - hx * xy) / determinant;
        let squares = (hh - east * hx - north * hy).max(0.0);
        let tangent = (east / steps[0]).hypot(north / steps[1]);
        let slope_rad = tangent.atan();
        let roughness = (squares / (t.n - 3.0)).sqrt() * slope_rad.cos();
        let sigma = t.sigma / t.n;
        Some(Self { slope_rad, roughness, roughness_sigma: sigma / (t.n - 3.0).sqrt(), sigma })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::GridFrame;
    use crate::prediction::Fill;
    use selenograph_geometry::{Rigid3, Sim3};
    use selenograph_raster::Affine;
    use std::collections::BTreeSet;

    fn dem(cell: f64, sigma: f32, height: impl FnMut(usize, usize) -> f32) -> Dem {
        let heights = Raster::from_fn(40, 30, height);
        let local_from_pred = Sim3::from_rigid(Rigid3::identity());
        Dem {
            frame: GridFrame::Local { local_from_pred, metric: true, level: true },
            cell,
            map_from_pixel: Affine::north_up(0.0, 0.0, cell, cell),
            sigma: heights.map(|_| sigma),
            count: heights.map(|_| 1),
            fill: heights.map(|_| Fill::Measured),
            heights,
        }
    }

    /// f32 heights of tens of metres over cells of 2 m.
    const TOLERANCE: f32 = 1e-5;

    #[test]
    fn a_plane_has_its_slope_and_no_roughness_up_to_the_border() {
        let plane = dem(2.0, 0.0, |x, y| 0.3 * 2.0 * x as f32 - 0.4 * 2.0 * y as f32);
        let limits = HazardOptions { footprint_m: Some(9.0), ..HazardOptions::default() };
        let map = hazard(&plane, &limits).unwrap();
        assert_eq!(map.footprint, 10.0);
        let middle = (20, 15);
        assert!((map.slope_rad[middle] - 0.5f32.atan()).abs() < TOLERANCE);
        assert!(map.roughness[middle] < 1e-3);
        assert_eq!(map.classes[middle], Hazard::Slope);
        // A corner's square holds 9 of 25 cells, an edge's 15: neither is enough.
        assert!(map.slope_rad[(0, 0)].is_nan() && map.slope_rad[(20, 0)].is_nan());
        assert!((map.slope_rad[(20, 1)] - 0.5f32.atan()).abs() < TOLERANCE);
    }

    #[test]
    fn roughness_is_the_residual_along_the_normal() {
        // ±0.6 in a chequerboard on a slope of 45°: the best plane of a 3×3 square is the slope, raised by 0.6/9.
        let board = dem(1.0, 0.0, |x, y| x as f32 + if (x + y) % 2 == 0 { 0.6 } else { -0.6 });
        let map = hazard(&board, &HazardOptions { max_slope_deg: 60.0, ..HazardOptions::default() }).unwrap();
        let squares = 9.0 * 0.36 - 0.36 / 9.0;
        let expected = (squares / 6.0f64).sqrt() * 0.5f64.sqrt();
        assert!((f64::from(map.roughness[(20, 15)]) - expected).abs() < f64::from(TOLERANCE));
        assert_eq!(map.classes[(20, 15)], Hazard::Roughness);
        let both = HazardOptions { max_slope_deg: 10.0, ..HazardOptions::default() };
        assert_eq!(hazard(&board, &both).unwrap().classes[(20, 15)], Hazard::Both);
    }

    #[test]
    fn classes_differ_in_number_words_and_colour() {
        let distinct = |count: usize| assert_eq!(count, Hazard::ALL.len());
        distinct(Hazard::ALL.map(Hazard::code).into_iter().collect::<BTreeSet<_>>().len());
        distinct(Hazard::ALL.map(Hazard::words).into_iter().collect::<BTreeSet<_>>().len());
        distinct(Hazard::ALL.map(Hazard::color).into_iter().collect::<BTreeSet<_>>().len());
        assert!(Hazard::ALL.iter().all(|class| class.code() > 0), "0 is no height");
    }

    #[test]
    fn a_large_sigma_leaves_the_question_open() {
        let classes = |slope: f32, sigma: f32| {
            let limits = HazardOptions { max_roughness_m: Some(10.0), ..HazardOptions::default() };
            let map = hazard(&dem(1.0, sigma, |x, _| slope * x as f32), &limits).unwrap();
            map.classes[(20, 15)]
        };
        assert_eq!(classes(0.1, 0.01), Hazard::Safe);
        assert_eq!(classes(0.5, 0.01), Hazard::Slope);
        // √2 · 0.5 / 3 rad = 13.5°: 5.7° and 26.6° are both within one sigma of 15°.
        assert_eq!(classes(0.1, 0.5), Hazard::Unknown);
        assert_eq!(classes(0.5, 0.8), Hazard::Unknown);
    }

    #[test]
    fn absent_heights_are_unknown_and_absurd_limits_are_refused() {
        let holes = dem(1.0, 0.0, |x, _| if x < 20 { f32::NAN } else { 0.0 });
        let map = hazard(&holes, &HazardOptions::default()).unwrap();
        assert_eq!(map.classes[(10, 10)], Hazard::Unknown);
        assert_eq!(map.classes[(30, 10)], Hazard::Safe);
        for options in [
            HazardOptions { max_slope_deg: 0.0, ..HazardOptions::default() },
            HazardOptions { max_roughness_m: Some(f64::NAN), ..HazardOptions::default() },
            HazardOptions { footprint_m: Some(1e6), ..HazardOptions::default() },
        ] {
            assert!(matches!(hazard(&holes, &options), Err(Error::Value { .. })));
        }
    }
}
