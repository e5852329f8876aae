//! Gaussians of rising width, octave by octave.

use super::options::FirstOctave;
use crate::features::blur::{decimated, doubled, gaussian};
use selenograph_raster::Raster;

/// Intervals of an octave in which extrema are looked for.
pub(super) const LEVELS: usize = 3;

/// Standard deviation of an octave's first level, samples of the octave.
pub(super) const BASE_SIGMA: f64 = 1.6;

/// Blur that the picture is taken to have, pixels.
const CAMERA_SIGMA: f64 = 0.5;

/// Smallest side of an octave, samples.
const MIN_SIDE: usize = 16;

/// The levels of one octave.
pub(super) struct Octave {
    /// Pixels of the picture a sample.
    pub step: f32,
    /// `LEVELS + 3` pictures, each `2^(1/LEVELS)` wider than the one before.
    pub gaussians: Vec<Raster<f32>>,
}

/// All octaves of a picture.
pub(super) fn octaves(image: &Raster<f32>, first: FirstOctave) -> Vec<Octave> {
    let (mut base, mut step) = match first {
        FirstOctave::Doubled => (blurred_to(&doubled(image), 2.0 * CAMERA_SIGMA, BASE_SIGMA), 0.5),
        FirstOctave::Original => (blurred_to(image, CAMERA_SIGMA, BASE_SIGMA), 1.0),
    };
    let mut octaves = Vec::new();
    while base.width.min(base.height) >= MIN_SIDE {
        let mut gaussians = Vec::with_capacity(LEVELS + 3);
        gaussians.push(base);
        for level in 1..LEVELS + 3 {
            let sigma = |level: usize| BASE_SIGMA * (level as f64 / LEVELS as f64).exp2();
            gaussians.push(blurred_to(&gaussians[level - 1], sigma(level - 1), sigma(level)));
        }
        base = decimated(&gaussians[LEVELS]);
        octaves.push(Octave { step, gaussians });
        step *= 2.0;
    }
    octaves
}

/// From one standard deviation to another: variances add.
fn blurred_to(image: &Raster<f32>, has: f64, wanted: f64) -> Raster<f32> {
    gaussian(image, (wanted * wanted - has * has).max(0.0).sqrt())
}

/// The standard deviation of a (fractional) level, samples of its octave.
pub(super) fn sigma_of_level(level: f32) -> f32 {
    BASE_SIGMA as f32 * (level / LEVELS as f32).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octaves_halve_until_they_are_too_small() {
        let image = Raster { width: 100, height: 70, data: vec![0.5f32; 7000] };
        let found = octaves(&image, FirstOctave::Doubled);
        let sizes: Vec<_> = found.iter().map(|o| (o.gaussians[0].width, o.gaussians[0].height)).collect();
        assert_eq!(sizes, [(200, 140), (100, 70), (50, 35), (25, 18)]);
        assert_eq!(found[3].step, 4.0);
        assert_eq!(octaves(&image, FirstOctave::Original)[0].gaussians[0].width, 100);
    }
}
