//! What a camera does to light: point spread, exposure, photon and read-out noise.

use crate::plan::Interval;
use crate::rng::Stream;
use selenograph_raster::Raster;
use serde::{Deserialize, Serialize};

/// Cameras that views are taken with; each view draws its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Physical {
    /// Standard deviation of a Gaussian point spread on top of the picture's own, pixels.
    pub psf_sigma_px: Interval,
    /// Exposure over the picture's own, stops: 1 doubles the levels.
    pub exposure_stops: Interval,
    /// Electrons at full scale; fewer make more photon noise. Drawn by its logarithm.
    pub full_well_electrons: Interval,
    /// Standard deviation of the read-out, electrons.
    pub read_noise_electrons: Interval,
}

impl Default for Physical {
    fn default() -> Self {
        Self {
            psf_sigma_px: Interval::new(0.0, 0.8),
            exposure_stops: Interval::new(-1.5, 0.5),
            full_well_electrons: Interval::new(2_000.0, 30_000.0),
            read_noise_electrons: Interval::new(2.0, 20.0),
        }
    }
}

impl Physical {
    pub(super) fn check(&self, key: &str) -> Result<(), crate::Error> {
        self.psf_sigma_px.check(&format!("{key}.psf_sigma_px"), Interval::new(0.0, 16.0))?;
        self.exposure_stops.check(&format!("{key}.exposure_stops"), Interval::new(-10.0, 10.0))?;
        self.full_well_electrons.check(&format!("{key}.full_well_electrons"), Interval::new(1.0, 1e9))?;
        self.read_noise_electrons.check(&format!("{key}.read_noise_electrons"), Interval::new(0.0, 1e6))
    }

    /// A picture of levels (255 is full scale) as one of these cameras records it.
    pub fn apply(&self, levels: &Raster<f32>, stream: &mut Stream) -> Raster<f32> {
        let sigma_px = self.psf_sigma_px.draw(stream);
        let gain = self.exposure_stops.draw(stream).exp2() as f32;
        let Interval { min, max } = self.full_well_electrons;
        let full_well = stream.uniform(min.ln(), max.ln()).exp();
        let read = self.read_noise_electrons.draw(stream);
        let mut picture = blur(levels, sigma_px);
        let per_electron = (255.0 / full_well) as f32;
        for level in &mut picture.data {
            let exposed = *level * gain;
            let electrons = exposed.max(0.0) / per_electron;
            let sigma = (electrons + (read * read) as f32).sqrt();
            *level = exposed + sigma * per_electron * nearly_normal(stream);
        }
        picture
    }
}

/// The standard deviation of the sum of four numbers uniform in `[0, 1)`: √(4/12).
const SIGMA_OF_FOUR: f32 = 0.577_350_26;

/// A number of mean 0 and variance 1 from 64 bits: four uniform ones added, which ends at ±3.5 standard deviations.
fn nearly_normal(stream: &mut Stream) -> f32 {
    let bits = stream.next_u64();
    let sum: u64 = (0..4).map(|n| (bits >> (16 * n)) & 0xffff).sum();
    // Four halves of the last unit centre it.
    ((sum as f32 + 2.0) / 65_536.0 - 2.0) / SIGMA_OF_FOUR
}

/// Blur narrower than this, pixels, changes nothing that can be seen.
const MIN_SIGMA_PX: f64 = 0.1;

/// Gaussian blur; beyond the border its pixels go on.
fn blur(levels: &Raster<f32>, sigma_px: f64) -> Raster<f32> {
    if sigma_px < MIN_SIGMA_PX {
        return levels.clone();
    }
    let reach = (3.0 * sigma_px).ceil() as i64;
    let weights: Vec<f32> =
        (-reach..=reach).map(|n| (-0.5 * (n as f64 / sigma_px).powi(2)).exp() as f32).collect();
    let sum: f32 = weights.iter().sum();
    let near = |n: usize, step: usize, side: usize| {
        (n as i64 + step as i64 - reach).clamp(0, side as i64 - 1) as usize
    };
    let along = |rows: &Raster<f32>| {
        Raster::from_fn(rows.width, rows.height, |x, y| {
            let row = rows.row(y);
            let taps = weights.iter().enumerate();
            taps.map(|(step, weight)| weight / sum * row[near(x, step, rows.width)]).sum::<f32>()
        })
    };
    let rows = along(levels);
    let mut out = Raster::filled(levels.width, levels.height, 0.0);
    for y in 0..levels.height {
        for (step, weight) in weights.iter().enumerate() {
            let from = rows.row(near(y, step, levels.height));
            for (value, sample) in out.row_mut(y).iter_mut().zip(from) {
                *value += weight / sum * sample;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::rng;

    #[test]
    fn noise_has_the_variance_of_electrons() {
        let camera = Physical {
            psf_sigma_px: Interval::new(0.0, 0.0),
            exposure_stops: Interval::new(-1.0, -1.0),
            full_well_electrons: Interval::new(1_000.0, 1_000.0),
            read_noise_electrons: Interval::new(10.0, 10.0),
        };
        let noisy = camera.apply(&Raster::filled(200, 200, 204.0), &mut rng(1, "test", 0, "noise"));
        let mean = noisy.data.iter().sum::<f32>() / 4e4;
        let variance = noisy.data.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / 4e4;
        // 102 levels are 400 electrons; 400 + 10² of them², 0.255 levels each. Standard errors are 0.03 and 0.23.
        assert!((mean - 102.0).abs() < 0.15, "{mean}");
        assert!((variance - 500.0 * 0.255 * 0.255).abs() < 1.2, "{variance}");
    }

    #[test]
    fn blur_keeps_flat_pictures_and_light() {
        let flat = blur(&Raster::filled(9, 6, 100.0), 1.5);
        assert!(flat.data.iter().all(|v| (v - 100.0).abs() < 1e-3), "{flat:?}");
        let mut point = Raster::filled(21, 21, 0.0);
        point[(10, 10)] = 1.0;
        let spread = blur(&point, 0.8);
        assert!((spread.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let variance: f32 = (0..21).map(|x| (x as f32 - 10.0).powi(2) * spread.row(10)[x]).sum::<f32>()
            / spread.row(10).iter().sum::<f32>();
        // The tail beyond three standard deviations is cut.
        assert!((variance - 0.64).abs() < 0.02, "{variance}");
        assert_eq!(blur(&point, 0.0), point);
    }
}
