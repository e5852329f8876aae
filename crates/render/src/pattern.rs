//! Where the rays of a pixel go: a few fixed low-discrepancy patterns, turned by a hashed angle per pixel.
//!
//! A Gaussian and a disc stay what they are when turned, so a pattern made once serves every pixel, and a pixel's rays
//! depend on nothing but the seed and the pixel's number: any thread count gives the same picture.

use crate::Sun;
use crate::simd::LANES;

/// Different patterns; a power of two.
const NUM_PATTERNS: usize = 64;
/// Different angles; a power of two.
const NUM_ANGLES: usize = 1024;

/// Sixteen rays of a pattern.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Packet {
    /// Offset from the pixel's centre in standard deviations of the point spread, x.
    pub(crate) psf_x: [f32; LANES],
    /// The same, y.
    pub(crate) psf_y: [f32; LANES],
    /// Position on the unit disc of the Sun, x.
    pub(crate) sun_x: [f32; LANES],
    /// The same, y.
    pub(crate) sun_y: [f32; LANES],
    /// Share of the pixel's radiance; 0 in lanes beyond the last ray. Each pixel's weights add up to 1.
    pub(crate) weight: [f32; LANES],
}

/// The patterns of one picture.
pub(crate) struct Patterns {
    packets_per_pixel: usize,
    packets: Vec<Packet>,
    turns: Vec<[f32; 2]>,
    seed: u64,
}

/// One pixel's share of the patterns.
pub(crate) struct PixelPattern<'a> {
    pub(crate) packets: &'a [Packet],
    /// Cosine and sine of the angle that the point spread is turned by.
    pub(crate) psf_turn: [f32; 2],
    /// The same for the Sun's disc.
    pub(crate) sun_turn: [f32; 2],
}

/// Largest offset a pattern can hold, standard deviations: `√(−2 ln 2⁻²⁰) = 5.27` and room for the scaling to unit variance.
pub(crate) const MAX_SIGMAS: f64 = 5.6;

fn hash(seed: u64, n: u64) -> u64 {
    // SplitMix64 (Steele, Lea, Flood 2014).
    let mut z = seed.wrapping_add(n.wrapping_mul(0x9e37_79b9_7f4a_7c15)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

impl Patterns {
    /// Patterns of `rays_per_pixel ≥ 1` rays. All Suns of a picture share the limb darkening of the first.
    pub(crate) fn new(rays_per_pixel: usize, limb: Option<&Sun>, seed: u64) -> Self {
        /// Steps of the four-dimensional additive sequence: powers of the root of `x⁵ = x + 1` (Roberts 2018).
        const ROOT: f64 = 1.167_303_978_261_418_7;
        let packets_per_pixel = rays_per_pixel.div_ceil(LANES);
        let mut packets = Vec::with_capacity(NUM_PATTERNS * packets_per_pixel);
        for pattern in 0..NUM_PATTERNS as u64 {
            let shift: [f64; 4] = std::array::from_fn(|d| {
                (hash(seed ^ 0x5e1e, 4 * pattern + d as u64) >> 11) as f64 / (1u64 << 53) as f64
            });
            let weights: Vec<f64> = (0..rays_per_pixel)
                .map(|k| {
                    let u = fraction(shift[2] + (k + 1) as f64 * ROOT.powi(-3));
                    limb.map_or(1.0, |sun| sun.disc_weight(u.sqrt()))
                })
                .collect();
            let total: f64 = weights.iter().sum();
            for p in 0..packets_per_pixel {
                let mut packet = Packet {
                    psf_x: [0.0; LANES],
                    psf_y: [0.0; LANES],
                    sun_x: [0.0; LANES],
                    sun_y: [0.0; LANES],
                    weight: [0.0; LANES],
                };
                for lane in 0..LANES.min(rays_per_pixel - p * LANES) {
                    let k = p * LANES + lane;
                    let u: [f64; 4] = std::array::from_fn(|d| {
                        fraction(shift[d] + (k + 1) as f64 * ROOT.powi(-(d as i32 + 1)))
                    });
                    let radius = (-2.0 * (1.0 - u[0]).max(0.5f64.powi(20)).ln()).sqrt();
                    let (sin, cos) = (std::f64::consts::TAU * u[1]).sin_cos();
                    let (sun_sin, sun_cos) = (std::f64::consts::TAU * u[3]).sin_cos();
                    packet.psf_x[lane] = (radius * cos) as f32;
                    packet.psf_y[lane] = (radius * sin) as f32;
                    packet.sun_x[lane] = (u[2].sqrt() * sun_cos) as f32;
                    packet.sun_y[lane] = (u[2].sqrt() * sun_sin) as f32;
                    packet.weight[lane] = (weights[k] / total) as f32;
                }
                packets.push(packet);
            }
        }
        scale_to_unit_variance(&mut packets);
        let turns = (0..NUM_ANGLES)
            .map(|k| {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / NUM_ANGLES as f64).sin_cos();
                [cos as f32, sin as f32]
            })
            .collect();
        Self { packets_per_pixel, packets, turns, seed }
    }

    /// The rays of pixel number `n`.
    pub(crate) fn of_pixel(&self, n: usize) -> PixelPattern<'_> {
        let h = hash(self.seed, n as u64);
        let pattern = h as usize % NUM_PATTERNS;
        let first = pattern * self.packets_per_pixel;
        PixelPattern {
            packets: &self.packets[first..first + self.packets_per_pixel],
            psf_turn: self.turns[(h >> 16) as usize % NUM_ANGLES],
            sun_turn: self.turns[(h >> 40) as usize % NUM_ANGLES],
        }
    }
}

/// Makes the variance of all patterns together exactly 1: a few thousand samples of a Gaussian miss it by a per cent or two.
fn scale_to_unit_variance(packets: &mut [Packet]) {
    let (mut squares, mut count) = (0.0, 0.0);
    for packet in packets.iter() {
        for k in (0..LANES).filter(|k| packet.weight[*k] > 0.0) {
            squares += f64::from(packet.psf_x[k]).powi(2) + f64::from(packet.psf_y[k]).powi(2);
            count += 2.0;
        }
    }
    let scale = (count / squares).sqrt() as f32;
    for packet in packets {
        packet.psf_x = packet.psf_x.map(|v| v * scale);
        packet.psf_y = packet.psf_y.map(|v| v * scale);
    }
}

fn fraction(v: f64) -> f64 {
    v - v.floor()
}

/// Turns a vector of the plane.
#[inline(always)]
pub(crate) fn turned([cos, sin]: [f32; 2], x: f32, y: f32) -> [f32; 2] {
    [cos * x - sin * y, sin * x + cos * y]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_gaussian_and_fill_the_disc() {
        let patterns = Patterns::new(64, None, 7);
        let (mut xx, mut yy, mut rr, mut n) = (0.0, 0.0, 0.0, 0.0);
        let mut worst = 0.0f64;
        for pixel in 0..2000 {
            let p = patterns.of_pixel(pixel);
            for packet in p.packets {
                for k in 0..LANES {
                    let [x, y] = turned(p.psf_turn, packet.psf_x[k], packet.psf_y[k]).map(f64::from);
                    let [sx, sy] = turned(p.sun_turn, packet.sun_x[k], packet.sun_y[k]).map(f64::from);
                    (xx, yy, rr, n) = (xx + x * x, yy + y * y, rr + sx * sx + sy * sy, n + 1.0);
                    worst = worst.max(x.hypot(y));
                    assert!(sx.hypot(sy) < 1.000_001);
                }
            }
        }
        assert!((xx / n - 1.0).abs() < 0.02 && (yy / n - 1.0).abs() < 0.02, "{} {}", xx / n, yy / n);
        // Mean squared radius of a uniform unit disc: 1/2.
        assert!((rr / n - 0.5).abs() < 0.01);
        assert!(worst <= MAX_SIGMAS);
    }

    #[test]
    fn weights_add_up_to_one_for_any_number_of_rays() {
        let sun = Sun::from_vector(selenograph_geometry::Vector3::z()).unwrap();
        for rays in [1, 5, 16, 17, 64, 100] {
            let patterns = Patterns::new(rays, Some(&sun), 3);
            let p = patterns.of_pixel(99);
            let total: f32 = p.packets.iter().flat_map(|k| k.weight).sum();
            assert!((total - 1.0).abs() < 1e-5, "{rays}: {total}");
        }
    }
}
