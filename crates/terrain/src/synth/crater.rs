//! Impact craters: populations placed by hashed cells, and the shape of one crater.
//!
//! # Source
//! Depth and rim height of fresh craters: Pike 1977, "Size-dependence in the shape of fresh impact craters on the Moon"
//! (`d = 0.196 D^1.010`, `h = 0.036 D^1.014` below 15 km, `d = 1.044 D^0.301`, `h = 0.236 D^0.399` above, km).
//! Ejecta falling as `r⁻³`: McGetchin, Settle & Head 1973. Cumulative slope −2 of a population in equilibrium: Trask 1966.

use super::noise::{Octave, mix, stream, unit};

/// Ejecta and soft flanks end here, in crater radii.
pub(super) const REACH: f64 = 2.5;
/// Cells in which craters are placed are this many times the smallest diameter of their class.
const CELL_PER_DIAMETER: f64 = 4.0;
/// Craters with less than this share of their fresh depth are worn away and not drawn.
const MIN_DEPTH_LEFT: f64 = 0.06;
/// From this diameter on, rims are scalloped by noise besides the harmonics, metres.
const SCALLOPED_FROM_M: f64 = 300.0;

/// The craters with diameters in `[min_diameter_m, 2 · min_diameter_m)`.
#[derive(Debug, Clone)]
pub(super) struct CraterClass {
    pub min_diameter_m: f64,
    /// `N(>D) · D²`: craters per area in units of their own size.
    density: f64,
    word: u64,
    /// Craters come in clusters (secondaries): this field modulates their density.
    clustering: Octave,
    /// Share of the clustering field that is applied, 0 = none.
    clustered: f64,
    scallops: [Octave; 2],
}

/// One crater.
#[derive(Debug, Clone)]
pub(super) struct Crater {
    pub x: f64,
    pub y: f64,
    pub radius_m: f64,
    /// 1 = oldest, 0 = youngest.
    pub age: f64,
    /// Breaks ties of age.
    pub id: u64,
    shape: Shape,
    /// Amplitude and phase (as cosine, sine) of the second and third harmonic of the rim.
    harmonics: [[f32; 2]; 2],
    scallop: f32,
}

/// The radial profile, in metres over radii.
#[derive(Debug, Clone, Copy)]
struct Shape {
    bowl_m: f32,
    rim: f32,
    /// Rounding of the crest, metres.
    softness: f32,
    /// Radius of the flat floor (0: a bowl).
    floor: f32,
    peak: f32,
    /// 0 fresh to 1 worn.
    wear: f32,
}

impl CraterClass {
    /// The class of a seed. `density` is `N(>D)·D²`.
    pub fn new(seed: u64, min_diameter_m: f64, density: f64) -> Self {
        let word = stream(seed, "crater", min_diameter_m.to_bits());
        Self {
            min_diameter_m,
            density,
            word,
            clustering: Octave::new(mix(word ^ 11), (25.0 * min_diameter_m).min(20_000.0)),
            // Secondaries are small: large craters fall evenly.
            clustered: (1.0 - (min_diameter_m / 1500.0).ln_1p()).clamp(0.0, 1.0),
            scallops: [3.1, 7.3].map(|n| Octave::new(mix(word ^ n as u64), 1.4 * min_diameter_m / n)),
        }
    }

    /// Craters whose reach touches the rectangle, oldest first.
    pub fn in_rectangle(&self, [x0, y0, x1, y1]: [f64; 4]) -> Vec<Crater> {
        let cell = CELL_PER_DIAMETER * self.min_diameter_m;
        // The largest crater of the class has twice the least diameter, so its radius is that diameter.
        let reach = REACH * self.min_diameter_m * 1.1;
        let range = |lo: f64, hi: f64| {
            (((lo - reach) / cell).floor() as i64)..=(((hi + reach) / cell).floor() as i64)
        };
        let mut craters = Vec::new();
        for j in range(y0, y1) {
            for i in range(x0, x1) {
                self.in_cell(i, j, cell, &mut craters);
            }
        }
        craters.retain(|c| {
            let reach = c.reach_m();
            c.x + reach >= x0 && c.x - reach <= x1 && c.y + reach >= y0 && c.y - reach <= y1
        });
        craters.sort_by(|a, b| b.age.total_cmp(&a.age).then(a.id.cmp(&b.id)));
        craters
    }

    fn in_cell(&self, i: i64, j: i64, cell: f64, craters: &mut Vec<Crater>) {
        let word = mix(self.word ^ mix((i as u64) ^ mix(j as u64)));
        let (cx, cy) = ((i as f64 + 0.5) * cell, (j as f64 + 0.5) * cell);
        let clump = f64::from(self.clustering.at(cx, cy));
        let factor = 1.0 + self.clustered * ((0.9 * clump).exp() * 0.72 - 1.0);
        // Between D and 2D lie three quarters of those above D, by the slope of −2.
        let mean = 0.75 * self.density * CELL_PER_DIAMETER * CELL_PER_DIAMETER * factor;
        for n in 0..poisson(mean, unit(word)) {
            let word = mix(word ^ (n + 1));
            craters.extend(self.crater(word, i, j, cell));
        }
    }

    fn crater(&self, word: u64, i: i64, j: i64, cell: f64) -> Option<Crater> {
        let draw = |n: u64| unit(mix(word ^ (n << 32)));
        let diameter_m = self.min_diameter_m / (1.0 - 0.75 * draw(1)).sqrt();
        let age = draw(2);
        let shape = Shape::of(diameter_m, age, draw(3))?;
        let wobble = 0.02 + 0.05 * draw(4) * draw(4);
        let (s2, c2) = (draw(5) * std::f64::consts::TAU).sin_cos();
        let (s3, c3) = (draw(6) * std::f64::consts::TAU).sin_cos();
        Some(Crater {
            x: (i as f64 + draw(7)) * cell,
            y: (j as f64 + draw(8)) * cell,
            radius_m: 0.5 * diameter_m,
            age,
            id: word,
            shape,
            harmonics: [[c2 * wobble, s2 * wobble], [c3 * wobble * 0.6, s3 * wobble * 0.6]]
                .map(|h| h.map(|v| v as f32)),
            scallop: if diameter_m < SCALLOPED_FROM_M {
                0.0
            } else {
                (0.028 * ((diameter_m / SCALLOPED_FROM_M).ln() / 3.0).min(1.0)) as f32
            },
        })
    }

    /// Height that a crater adds at an offset from its centre, the share of older relief that it erases there, and
    /// the factor it puts on later roughness.
    #[inline]
    pub fn effect(&self, crater: &Crater, dx: f64, dy: f64) -> Option<[f32; 3]> {
        let (u, v) = ((dx / crater.radius_m) as f32, (dy / crater.radius_m) as f32);
        let square = u * u + v * v;
        if square >= (REACH * REACH) as f32 {
            return None;
        }
        // cos 2θ·r², sin 2θ·r² and the third harmonic from u and v alone.
        let (cos2, sin2) = (u * u - v * v, 2.0 * u * v);
        let (cos3, sin3) = (u * cos2 - v * sin2, u * sin2 + v * cos2);
        let inverse = 1.0 / (square + 0.02);
        let [h2, h3] = crater.harmonics;
        let mut stretch = 1.0
            + inverse * (h2[0] * cos2 + h2[1] * sin2)
            + inverse * inverse.sqrt() * (h3[0] * cos3 + h3[1] * sin3);
        if crater.scallop > 0.0 {
            let [coarse, fine] = &self.scallops;
            let (x, y) = (crater.x + dx, crater.y + dy);
            stretch += crater.scallop * (coarse.at(x, y) + 0.5 * fine.at(x, y));
        }
        let r = square.sqrt() * stretch;
        Some(crater.shape.effect(r))
    }
}

impl Crater {
    /// Beyond this distance the crater does nothing, metres.
    pub fn reach_m(&self) -> f64 {
        REACH * self.radius_m
    }
}

impl Shape {
    /// The shape of a crater of a diameter and age; `None` if it is worn away. `luck` varies craters of one age.
    fn of(diameter_m: f64, age: f64, luck: f64) -> Option<Self> {
        let km = diameter_m / 1000.0;
        let (fresh_depth, fresh_rim) = if km < 15.0 {
            (196.0 * km.powf(1.01), 36.0 * km.powf(1.014))
        } else {
            (1044.0 * km.powf(0.301), 236.0 * km.powf(0.399))
        };
        // Diffusion wears a crater on a time ~ D²: a population in equilibrium holds all states below ~ 500 m, while
        // large craters keep most of their depth.
        let keeps = ((km / 1.0).ln() / (30f64).ln()).clamp(0.0, 1.0);
        let young = 1.0 - age;
        let slow = 0.34 + 0.2 * keeps;
        let left = slow * young + (1.0 - slow) * young.powf(14.0 - 10.0 * keeps);
        let left = left * (0.75 + 0.3 * luck);
        if left < MIN_DEPTH_LEFT {
            return None;
        }
        let wear = (1.15 * (1.0 - left)).clamp(0.0, 1.0).powf(0.8);
        let complex = ((km - 12.0) / 10.0).clamp(0.0, 1.0);
        let floor = (0.58 * complex * complex * (3.0 - 2.0 * complex)).max(0.45 * wear * keeps);
        Some(Self {
            bowl_m: (fresh_depth * left.min(1.0)) as f32,
            rim: (fresh_rim * left.min(1.0).powf(1.3)) as f32,
            softness: (fresh_rim * (0.9 + 4.0 * wear * left)) as f32,
            floor: floor as f32,
            peak: (complex * fresh_depth * 0.22 * luck * left) as f32,
            wear: wear as f32,
        })
    }

    #[inline]
    fn effect(&self, r: f32) -> [f32; 3] {
        let square = r * r;
        let window = {
            let w = (1.0 - square / (REACH * REACH) as f32).max(0.0);
            w * w
        };
        let crisp = {
            let wall = self.rim + self.bowl_m * ((square - 1.0) / (1.0 - self.floor * self.floor));
            let wall = if self.floor > 0.0 {
                // Floor and wall meet over a slope, not at a crease.
                -smooth_min(-wall, self.bowl_m - self.rim, 0.25 * self.bowl_m)
            } else {
                wall
            };
            let outside = self.rim * window * (1.0 / 0.7056) / (square * r).max(0.1);
            smooth_min(wall, outside, self.softness)
        };
        let soft = {
            // A worn bowl: (1 − q)² (1.6 q − 1) has a low broad rim and ends level at 1.4 radii.
            let q = (square * (1.0 / (1.4 * 1.4))).min(1.0);
            self.bowl_m * 0.9 * (1.0 - q) * (1.0 - q) * (1.5 * q - 1.0)
        };
        let mut height = crisp + self.wear * (soft - crisp);
        if self.peak > 0.0 {
            let q = (1.0 - square * (1.0 / (0.24 * 0.24))).max(0.0);
            height += self.peak * q * q;
        }
        let t = ((1.7 - r) * (1.0 / 0.8)).clamp(0.0, 1.0);
        let erased = t * t * (3.0 - 2.0 * t) * (1.0 - 0.6 * self.wear);
        [height, erased, 1.0 - 0.45 * erased * (1.0 - self.wear)]
    }
}

/// The smaller of two numbers, rounded off over `k` (polynomial smooth minimum).
#[inline]
fn smooth_min(a: f32, b: f32, k: f32) -> f32 {
    let h = (0.5 + 0.5 * (b - a) / k.max(1e-6)).clamp(0.0, 1.0);
    b + h * (a - b) - k * h * (1.0 - h)
}

/// Poisson-distributed count of a uniform number, by its cumulative sum.
fn poisson(mean: f64, uniform: f64) -> u64 {
    let mut term = (-mean).exp();
    let (mut sum, mut count) = (term, 0);
    while uniform > sum && count < 64 {
        count += 1;
        term *= mean / count as f64;
        sum += term;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_population_follows_its_power_law() {
        // Of large craters, all but one in seven or eight are still to be seen.
        let total: usize = (0..4)
            .map(|k| {
                let class = CraterClass::new(5, 20_000.0 * f64::from(1 << k), 0.1);
                let side = 4e6;
                class
                    .in_rectangle([0.0, 0.0, side, side])
                    .iter()
                    .filter(|c| (0.0..side).contains(&c.x) && (0.0..side).contains(&c.y))
                    .count()
            })
            .sum();
        // N(>20 km) − N(>320 km) = 0.1 · (4e6)² · (1/2e4² − 1/3.2e5²).
        let expected = 0.1 * 1.6e13 * (1.0 / 4e8 - 1.0 / 1.024e11);
        assert!((0.8..0.95).contains(&(total as f64 / expected)), "{total} against {expected}");
    }

    #[test]
    fn neighbouring_rectangles_see_the_same_craters() {
        let class = CraterClass::new(5, 64.0, 0.06);
        let whole = class.in_rectangle([0.0, 0.0, 4000.0, 4000.0]);
        let part = class.in_rectangle([1000.0, 1500.0, 2300.0, 2600.0]);
        assert!(!part.is_empty() && part.len() < whole.len());
        assert!(part.iter().all(|c| whole.iter().any(|w| w.id == c.id)));
        assert!(whole.windows(2).all(|w| w[0].age >= w[1].age));
    }

    #[test]
    fn a_fresh_crater_has_the_depth_and_rim_of_pike() {
        let shape = Shape::of(1000.0, 0.0, 0.9).unwrap();
        let [floor, ..] = shape.effect(0.0);
        let rim = (90..130).map(|i| shape.effect(i as f32 * 0.01)[0]).fold(f32::MIN, f32::max);
        assert!((f64::from(rim - floor) / 1000.0 - 0.19).abs() < 0.02, "{}", rim - floor);
        assert!(shape.effect(REACH as f32)[0].abs() < 1e-6);
        assert!(Shape::of(50.0, 0.999, 0.0).is_none());
    }
}
