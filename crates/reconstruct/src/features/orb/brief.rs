//! The direction of a patch by its centre of brightness, and comparisons of pairs of samples turned with it.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use selenograph_raster::Raster;

/// 256 comparisons.
pub type Descriptor = [u64; 4];

/// Radius of the patch that a descriptor and its direction look at, samples of the level.
pub(super) const PATCH_RADIUS: usize = 15;

/// Blur before samples are compared, samples of the level.
pub(super) const SMOOTHING_SIGMA: f64 = 2.0;

/// Spread of the pairs: a fifth of the patch's side.
const PAIR_SIGMA: f64 = (2 * PATCH_RADIUS + 1) as f64 / 5.0;

/// Seed of the pairs; descriptors of other seeds do not compare.
const SEED: u64 = 2011;

/// Two places for each bit.
pub(super) type Pattern = Vec<[[f32; 2]; 2]>;

/// The pairs, drawn from a Gaussian within the patch.
pub(super) fn pattern() -> Pattern {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut uniform = move || (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let limit = PATCH_RADIUS as f64 - 1.0;
    let mut place = || {
        loop {
            // Box and Muller.
            let radius = PAIR_SIGMA * (-2.0 * (1.0 - uniform()).ln()).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * uniform()).sin_cos();
            if radius <= limit {
                return [(radius * cos) as f32, (radius * sin) as f32];
            }
        }
    };
    (0..256).map(|_| [place(), place()]).collect()
}

/// Direction from a sample to the centre of brightness of the disc around it, radians in `[0, 2π)`.
pub(super) fn direction(image: &Raster<f32>, x: usize, y: usize) -> f32 {
    let radius = PATCH_RADIUS as i32;
    let (mut mx, mut my) = (0.0f32, 0.0f32);
    for dy in -radius..=radius {
        let half = f64::from(radius * radius - dy * dy).sqrt() as usize;
        let from = (y as i32 + dy) as usize * image.width + x - half;
        for (i, grey) in image.data[from..=from + 2 * half].iter().enumerate() {
            mx += (i as f32 - half as f32) * grey;
            my += dy as f32 * grey;
        }
    }
    my.atan2(mx).rem_euclid(std::f32::consts::TAU)
}

/// One bit a pair: whether its first sample is darker than its second.
pub(super) fn describe(
    smooth: &Raster<f32>,
    x: usize,
    y: usize,
    angle_rad: f32,
    pattern: &Pattern,
) -> Descriptor {
    let (sin, cos) = angle_rad.sin_cos();
    let sample = |[u, v]: [f32; 2]| {
        let dx = (cos * u - sin * v).round() as i32;
        let dy = (sin * u + cos * v).round() as i32;
        smooth.data[(y as i32 + dy) as usize * smooth.width + (x as i32 + dx) as usize]
    };
    let mut bits = [0u64; 4];
    for (i, &[first, second]) in pattern.iter().enumerate() {
        bits[i / 64] |= u64::from(sample(first) < sample(second)) << (i % 64);
    }
    bits
}
