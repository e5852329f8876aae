//! Series in time: the Sun, the Moon, and how the Moon is turned. Angles are degrees, as their source has them.

use crate::units::ASTRONOMICAL_UNIT_M;

/// Inclination of the Moon's mean equator to the ecliptic, degrees (IAU).
const INCLINATION_DEG: f64 = 1.54242;

fn sin(degrees: f64) -> f64 {
    degrees.to_radians().sin()
}

fn cos(degrees: f64) -> f64 {
    degrees.to_radians().cos()
}

/// A place on the ecliptic and mean equinox of date.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ecliptic {
    pub(super) lon_deg: f64,
    pub(super) lat_deg: f64,
    pub(super) distance_m: f64,
}

/// Arguments of the Moon's series.
pub(super) struct Arguments {
    /// Of Terrestrial Time since J2000.0.
    pub(super) centuries: f64,
    /// Mean longitude of the Moon.
    lon_deg: f64,
    /// Mean elongation, the Sun's and the Moon's mean anomaly, argument of latitude: `D`, `M`, `M′`, `F`.
    pub(super) angles_deg: [f64; 4],
    /// Ascending node.
    node_deg: f64,
    /// What the shrinking eccentricity of the Earth's orbit leaves of terms in `M`.
    eccentricity: f64,
}

impl Arguments {
    /// Chapter 47 (Chapront 1988).
    pub(super) fn at(centuries: f64) -> Self {
        let t = centuries;
        let polynomial = |c: [f64; 5]| c.into_iter().rev().fold(0.0, |sum, c| sum * t + c);
        Self {
            centuries,
            lon_deg: polynomial([
                218.316_447_7,
                481_267.881_234_21,
                -0.001_578_6,
                1.0 / 538_841.0,
                -1.0 / 65_194_000.0,
            ]),
            angles_deg: [
                [297.850_192_1, 445_267.111_403_4, -0.001_881_9, 1.0 / 545_868.0, -1.0 / 113_065_000.0],
                [357.529_109_2, 35_999.050_290_9, -0.000_153_6, 1.0 / 24_490_000.0, 0.0],
                [134.963_396_4, 477_198.867_505_5, 0.008_741_4, 1.0 / 69_699.0, -1.0 / 14_712_000.0],
                [93.272_095, 483_202.017_523_3, -0.003_653_9, -1.0 / 3_526_000.0, 1.0 / 863_310_000.0],
            ]
            .map(polynomial),
            node_deg: polynomial([
                125.044_547_9,
                -1_934.136_289_1,
                0.002_075_4,
                1.0 / 467_441.0,
                -1.0 / 60_616_000.0,
            ]),
            eccentricity: polynomial([1.0, -0.002_516, -0.000_007_4, 0.0, 0.0]),
        }
    }

    /// The angle of a term, degrees.
    fn angle(&self, multiples: [i8; 4]) -> f64 {
        self.angles_deg.iter().zip(multiples).map(|(angle, multiple)| f64::from(multiple) * angle).sum()
    }

    fn sum(&self, terms: &[Term]) -> f64 {
        let value = |term: &Term| match term {
            Sin(size, multiples) => size * sin(self.angle(*multiples)),
            Cos(size, multiples) => size * cos(self.angle(*multiples)),
        };
        terms.iter().map(value).sum()
    }

    /// The same with terms in `M` made smaller.
    fn orbital(&self, terms: &[Term]) -> f64 {
        let (with_sun, without): (Vec<Term>, Vec<Term>) = terms.iter().partition(|term| match term {
            Sin(_, multiples) | Cos(_, multiples) => multiples[1] != 0,
        });
        self.sum(&without) + self.eccentricity * self.sum(&with_sun)
    }
}

/// A size and the multiples of `D`, `M`, `M′`, `F`.
#[derive(Clone, Copy)]
enum Term {
    Sin(f64, [i8; 4]),
    Cos(f64, [i8; 4]),
}
use Term::{Cos, Sin};

/// The Sun seen from the Earth, aberration in its longitude (chapter 25, "low accuracy": 0.01°).
pub(super) fn sun(centuries: f64) -> Ecliptic {
    let t = centuries;
    let mean_lon_deg = 280.466_46 + (36_000.769_83 + 0.000_303_2 * t) * t;
    let anomaly_deg = 357.529_11 + (35_999.050_29 - 0.000_153_7 * t) * t;
    let eccentricity = 0.016_708_634 - (0.000_042_037 + 0.000_000_126_7 * t) * t;
    let centre_deg = (1.914_602 - (0.004_817 + 0.000_014 * t) * t) * sin(anomaly_deg)
        + (0.019_993 - 0.000_101 * t) * sin(2.0 * anomaly_deg)
        + 0.000_289 * sin(3.0 * anomaly_deg);
    let distance_au = 1.000_001_018 * (1.0 - eccentricity * eccentricity)
        / (1.0 + eccentricity * cos(anomaly_deg + centre_deg));
    Ecliptic {
        lon_deg: mean_lon_deg + centre_deg - 0.005_69,
        lat_deg: 0.0,
        distance_m: distance_au * ASTRONOMICAL_UNIT_M,
    }
}

/// The Moon seen from the Earth (chapter 47). Left out are terms below 0.015°, 0.03° and 500 km: the Sun is 390 times further away, so they
/// turn its direction by less than 0.0002°.
pub(super) fn moon(arguments: &Arguments) -> Ecliptic {
    const LON: [Term; 14] = [
        Sin(6.288_774, [0, 0, 1, 0]),
        Sin(1.274_027, [2, 0, -1, 0]),
        Sin(0.658_314, [2, 0, 0, 0]),
        Sin(0.213_618, [0, 0, 2, 0]),
        Sin(-0.185_116, [0, 1, 0, 0]),
        Sin(-0.114_332, [0, 0, 0, 2]),
        Sin(0.058_793, [2, 0, -2, 0]),
        Sin(0.057_066, [2, -1, -1, 0]),
        Sin(0.053_322, [2, 0, 1, 0]),
        Sin(0.045_758, [2, -1, 0, 0]),
        Sin(-0.040_923, [0, 1, -1, 0]),
        Sin(-0.034_720, [1, 0, 0, 0]),
        Sin(-0.030_383, [0, 1, 1, 0]),
        Sin(0.015_327, [2, 0, 0, -2]),
    ];
    const LAT: [Term; 7] = [
        Sin(5.128_122, [0, 0, 0, 1]),
        Sin(0.280_602, [0, 0, 1, 1]),
        Sin(0.277_693, [0, 0, 1, -1]),
        Sin(0.173_237, [2, 0, 0, -1]),
        Sin(0.055_413, [2, 0, -1, 1]),
        Sin(0.046_271, [2, 0, -1, -1]),
        Sin(0.032_573, [2, 0, 0, 1]),
    ];
    const DISTANCE_KM: [Term; 4] = [
        Cos(-20_905.355, [0, 0, 1, 0]),
        Cos(-3_699.111, [2, 0, -1, 0]),
        Cos(-2_955.968, [2, 0, 0, 0]),
        Cos(-569.925, [0, 0, 2, 0]),
    ];
    Ecliptic {
        lon_deg: arguments.lon_deg + arguments.orbital(&LON),
        lat_deg: arguments.orbital(&LAT),
        distance_m: 1000.0 * (385_000.56 + arguments.orbital(&DISTANCE_KM)),
    }
}

/// Librations of the Moon towards something, degrees: longitude and latitude of the point below it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Librations {
    /// By geometry, with the Moon turned as Cassini's laws say.
    pub(super) optical_deg: [f64; 2],
    /// What the Moon's own swinging adds.
    pub(super) physical_deg: [f64; 2],
}

impl Librations {
    pub(super) fn place_deg(&self) -> [f64; 2] {
        [self.optical_deg[0] + self.physical_deg[0], self.optical_deg[1] + self.physical_deg[1]]
    }
}

/// Longitude and latitude of the Moon's point below something that sees the Moon at that place (chapter 53).
pub(super) fn librations(arguments: &Arguments, physical: Physical, moon: &Ecliptic) -> Librations {
    let from_node = moon.lon_deg - arguments.node_deg;
    let (along, lat, tilt) =
        (from_node.to_radians(), moon.lat_deg.to_radians(), INCLINATION_DEG.to_radians());
    let equatorial =
        (along.sin() * lat.cos() * tilt.cos() - lat.sin() * tilt.sin()).atan2(along.cos() * lat.cos());
    let optical_lat = (-along.sin() * lat.cos() * tilt.sin() - lat.sin() * tilt.cos()).asin();
    let [_, _, _, f] = arguments.angles_deg;
    let Physical { rho, sigma, tau } = physical;
    let (sin_a, cos_a) = equatorial.sin_cos();
    let lon_deg = (equatorial.to_degrees() - f + 180.0).rem_euclid(360.0) - 180.0;
    Librations {
        optical_deg: [lon_deg, optical_lat.to_degrees()],
        physical_deg: [-tau + (rho * cos_a + sigma * sin_a) * optical_lat.tan(), sigma * cos_a - rho * sin_a],
    }
}

/// Eckhardt's angles, degrees.
#[derive(Debug, Clone, Copy)]
pub(super) struct Physical {
    pub(super) rho: f64,
    pub(super) sigma: f64,
    pub(super) tau: f64,
}

impl Physical {
    /// Of the mean-Earth axes: chapter 53 (Eckhardt 1981, "Theory of the libration of the Moon", The Moon and the Planets 25) less the terms
    /// `-0.02245° sin F` of rho and `+0.02244° cos F` of sigma. In axes that turn with the Moon they are a constant, the tilt of the axis
    /// of largest inertia (78.56″ = 0.0218° in JPL's DE430) against the pole that maps have.
    pub(super) fn at(arguments: &Arguments) -> Self {
        const RHO: [Term; 9] = [
            Cos(-0.027_52, [0, 0, 1, 0]),
            Cos(0.006_84, [0, 0, 1, -2]),
            Cos(-0.002_93, [0, 0, 0, 2]),
            Cos(-0.000_85, [-2, 0, 0, 2]),
            Cos(-0.000_54, [-2, 0, 1, 0]),
            Sin(-0.000_20, [0, 0, 1, 1]),
            Cos(-0.000_20, [0, 0, 1, 2]),
            Cos(-0.000_20, [0, 0, 1, -1]),
            Cos(0.000_14, [-2, 0, 1, 2]),
        ];
        const SIGMA: [Term; 12] = [
            Sin(-0.028_16, [0, 0, 1, 0]),
            Sin(-0.006_82, [0, 0, 1, -2]),
            Sin(-0.002_79, [0, 0, 0, 2]),
            Sin(-0.000_83, [-2, 0, 0, 2]),
            Sin(0.000_69, [-2, 0, 1, 0]),
            Cos(0.000_40, [0, 0, 1, 1]),
            Sin(-0.000_25, [0, 0, 2, 0]),
            Sin(-0.000_23, [0, 0, 1, 2]),
            Cos(0.000_20, [0, 0, 1, -1]),
            Sin(0.000_19, [0, 0, 1, -1]),
            Sin(0.000_13, [-2, 0, 1, 2]),
            Cos(-0.000_10, [0, 0, 1, -3]),
        ];
        const TAU: [Term; 15] = [
            Sin(0.004_73, [0, 0, 2, -2]),
            Sin(-0.004_67, [0, 0, 1, 0]),
            Sin(0.002_76, [-2, 0, 2, 0]),
            Cos(-0.001_83, [0, 0, 1, -1]),
            Sin(0.001_15, [-2, 0, 1, 0]),
            Sin(-0.000_96, [-1, 0, 1, 0]),
            Sin(0.000_46, [-2, 0, 0, 2]),
            Sin(-0.000_39, [0, 0, 1, -1]),
            Sin(-0.000_32, [-1, -1, 1, 0]),
            Sin(0.000_27, [-2, -1, 2, 0]),
            Sin(-0.000_14, [2, 0, 0, 0]),
            Cos(0.000_14, [0, 0, 2, -2]),
            Sin(-0.000_12, [0, 0, 1, -2]),
            Sin(-0.000_12, [0, 0, 2, 0]),
            Sin(0.000_11, [-2, -2, 2, 0]),
        ];
        let [_, m, _, _] = arguments.angles_deg;
        let k1 = 119.75 + 131.849 * arguments.centuries;
        let k2 = 72.56 + 20.186 * arguments.centuries;
        Self {
            rho: arguments.sum(&RHO),
            sigma: arguments.sum(&SIGMA),
            tau: arguments.sum(&TAU)
                + 0.025_20 * arguments.eccentricity * sin(m)
                + 0.003_96 * sin(k1)
                + 0.001_96 * sin(arguments.node_deg)
                + 0.000_23 * sin(k2),
        }
    }
}
