//! Hashed gradient noise: a smooth random field that is a pure function of seed and position.
//!
//! # Source
//! Perlin 2002, "Improving noise" (quintic fade); the lattice of each octave is turned and shifted by its own hash, so
//! that no axis shows.

/// Standard deviation of gradient noise with unit gradients, measured over 10⁶ points.
const VALUE_SIGMA: f64 = 0.2155;
/// Standard deviation of one gradient component per lattice spacing, of the same noise scaled to σ = 1.
pub(super) const SLOPE_PER_SIGMA: f64 = 2.90;

/// A well-mixed 64-bit word (the finaliser of splitmix64).
pub(super) fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The random word of a named stream of a seed.
pub(super) fn stream(seed: u64, name: &str, index: u64) -> u64 {
    name.bytes().fold(mix(seed ^ mix(index)), |word, byte| mix(word ^ u64::from(byte)))
}

/// A word as a number in `[0, 1)`.
pub(super) fn unit(word: u64) -> f64 {
    (word >> 11) as f64 / (1u64 << 53) as f64
}

/// Hash of a lattice point, 32 bits: three rounds of multiply and xor-shift are enough for a gradient's direction.
#[inline]
fn lattice_hash(x: i32, y: i32, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed;
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// Number of gradient directions; a power of two.
const NUM_DIRECTIONS: usize = 256;

/// Unit gradients, evenly spread round the circle.
fn directions() -> &'static [[f32; 2]; NUM_DIRECTIONS] {
    static TABLE: std::sync::OnceLock<[[f32; 2]; NUM_DIRECTIONS]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|i| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / NUM_DIRECTIONS as f64).sin_cos();
            [cos as f32, sin as f32]
        })
    })
}

/// One octave of noise with standard deviation 1, over map coordinates in metres.
#[derive(Debug, Clone)]
pub(super) struct Octave {
    /// Lattice spacing, metres.
    pub wavelength_m: f64,
    seed: u32,
    /// Lattice coordinates `u = m[0]·x + m[1]·y + m[2]`, `v = −m[1]·x + m[0]·y + m[3]`.
    lattice_from_map: [f64; 4],
    directions: &'static [[f32; 2]; NUM_DIRECTIONS],
}

impl Octave {
    /// The octave of a hashed word.
    pub fn new(word: u64, wavelength_m: f64) -> Self {
        let (sin, cos) = (unit(mix(word ^ 1)) * std::f64::consts::TAU).sin_cos();
        let offset = |n: u64| unit(mix(word ^ n)) * 1024.0;
        Self {
            wavelength_m,
            seed: word as u32,
            lattice_from_map: [cos / wavelength_m, sin / wavelength_m, offset(2), offset(3)],
            directions: directions(),
        }
    }

    /// The noise at a map position.
    #[inline]
    pub fn at(&self, x: f64, y: f64) -> f32 {
        let [a, b, c, d] = self.lattice_from_map;
        let (u, v) = (a * x + b * y + c, a * y - b * x + d);
        let (u0, v0) = (u.floor(), v.floor());
        let (i, j) = (u0 as i32, v0 as i32);
        let (s, t) = ((u - u0) as f32, (v - v0) as f32);
        let corner = |di: i32, dj: i32| {
            let hash = lattice_hash(i.wrapping_add(di), j.wrapping_add(dj), self.seed);
            let g = self.directions[hash as usize % NUM_DIRECTIONS];
            g[0] * (s - di as f32) + g[1] * (t - dj as f32)
        };
        let fade = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let (fs, ft) = (fade(s), fade(t));
        let lower = corner(0, 0) + fs * (corner(1, 0) - corner(0, 0));
        let upper = corner(0, 1) + fs * (corner(1, 1) - corner(0, 1));
        (lower + ft * (upper - lower)) * (1.0 / VALUE_SIGMA) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_octave_has_unit_spread_and_the_stated_slope() {
        let octave = Octave::new(stream(7, "test", 0), 40.0);
        let (mut sum, mut square, mut slope) = (0.0, 0.0, 0.0);
        let n = 400_000;
        for i in 0..n {
            let (x, y) = (unit(mix(2 * i)) * 4e4, unit(mix(2 * i + 1)) * 4e4);
            let v = f64::from(octave.at(x, y));
            sum += v;
            square += v * v;
            slope += ((f64::from(octave.at(x + 0.2, y)) - v) / 0.2).powi(2);
        }
        let n = n as f64;
        assert!((sum / n).abs() < 0.02, "mean {}", sum / n);
        // Within 2 %: the constants are measured, and these are 4·10⁵ correlated samples.
        assert!(((square / n).sqrt() - 1.0).abs() < 0.02, "sigma {}", (square / n).sqrt());
        let slope = (slope / n).sqrt() * octave.wavelength_m;
        assert!((slope / SLOPE_PER_SIGMA - 1.0).abs() < 0.02, "slope {slope}");
    }

    #[test]
    fn noise_is_continuous_across_lattice_lines() {
        let octave = Octave::new(99, 10.0);
        for i in 0..2000 {
            let x = f64::from(i) * 0.05 - 50.0;
            assert!((octave.at(x, 3.0) - octave.at(x + 1e-6, 3.0)).abs() < 1e-4);
        }
    }
}
