//! Gradient, slope, aspect and hillshade of a height field whose rows run from north to south.

use crate::Raster;
use std::f32::consts::{PI, TAU};

/// Derivatives of the height, metres per metre.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradient {
    /// Towards the east (rising columns).
    pub east: Raster<f32>,
    /// Towards the north (falling rows).
    pub north: Raster<f32>,
}

/// Gradient of a height field by Horn's 3×3 kernel.
///
/// # Shapes and units
/// `heights`: H×W, metres. `cell_m`: metres per cell across and down, > 0. Results H×W; NaN at the border and
/// wherever one of the nine samples is absent, so a raster below 3×3 gives NaN only.
/// # Source
/// Horn 1981, "Hill shading and the reflectance map", Proc. IEEE 69(1).
pub fn horn(heights: &Raster<f32>, cell_m: [f64; 2]) -> Gradient {
    let (width, height) = (heights.width, heights.height);
    let mut east = Raster::filled(width, height, f32::NAN);
    let mut north = east.clone();
    for y in 1..height.saturating_sub(1) {
        let (above, here, below) = (heights.row(y - 1), heights.row(y), heights.row(y + 1));
        for x in 1..width.saturating_sub(1) {
            // Differences first, in f64: heights of kilometres differ by centimetres.
            let column = |x: usize| f64::from(above[x]) + 2.0 * f64::from(here[x]) + f64::from(below[x]);
            let row = |r: &[f32]| f64::from(r[x - 1]) + 2.0 * f64::from(r[x]) + f64::from(r[x + 1]);
            // The centre has no weight in the kernel, but a slope over an absent sample is none.
            let centre = 0.0 * f64::from(here[x]);
            east[(x, y)] = ((column(x + 1) - column(x - 1)) / (8.0 * cell_m[0]) + centre) as f32;
            north[(x, y)] = ((row(above) - row(below)) / (8.0 * cell_m[1]) + centre) as f32;
        }
    }
    Gradient { east, north }
}

impl Gradient {
    /// Slope against the horizontal, radians in [0, π/2).
    pub fn slope_rad(&self) -> Raster<f32> {
        self.zip(|east, north| east.hypot(north).atan())
    }

    /// Direction of steepest descent, clockwise from north, radians in [0, 2π); 0 where the ground is level.
    pub fn aspect_rad(&self) -> Raster<f32> {
        self.zip(|east, north| {
            let aspect = (-east).atan2(-north).rem_euclid(TAU);
            if east == 0.0 && north == 0.0 || aspect >= TAU { 0.0 } else { aspect }
        })
    }

    /// Cosine of the Sun's incidence angle on the slope, 0 where the slope faces away; no cast shadows.
    ///
    /// # Shapes and units
    /// `azimuth_rad` clockwise from north, `elevation_rad` above the horizon.
    pub fn hillshade(&self, azimuth_rad: f64, elevation_rad: f64) -> Raster<f32> {
        let (sin_az, cos_az) = (azimuth_rad.sin() as f32, azimuth_rad.cos() as f32);
        let (sin_el, cos_el) = (elevation_rad.sin() as f32, elevation_rad.cos() as f32);
        self.zip(|east, north| {
            let facing = sin_el - cos_el * (east * sin_az + north * cos_az);
            let cosine = facing / (1.0 + east * east + north * north).sqrt();
            // `max` would turn an absent NaN into 0.
            if cosine < 0.0 { 0.0 } else { cosine }
        })
    }

    fn zip(&self, f: impl Fn(f32, f32) -> f32) -> Raster<f32> {
        let data =
            self.east.data.iter().zip(&self.north.data).map(|(&east, &north)| f(east, north)).collect();
        Raster { width: self.east.width, height: self.east.height, data }
    }
}

/// Angle between two aspects, radians in [0, π].
pub fn aspect_difference_rad(a: f32, b: f32) -> f32 {
    PI - ((a - b).rem_euclid(TAU) - PI).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Height rises 0.3 per metre eastward and 0.4 northward.
    fn plane() -> Raster<f32> {
        Raster::from_fn(7, 5, |x, y| 0.3 * 5.0 * x as f32 - 0.4 * 10.0 * y as f32)
    }

    #[test]
    fn plane_has_its_slope_and_aspect_everywhere_inside() {
        let gradient = horn(&plane(), [5.0, 10.0]);
        let (slope, aspect) = (gradient.slope_rad(), gradient.aspect_rad());
        for y in 0..5 {
            for x in 0..7 {
                let inside = (1..6).contains(&x) && (1..4).contains(&y);
                assert_eq!(slope[(x, y)].is_finite(), inside);
                if inside {
                    assert!((slope[(x, y)] - 0.5f32.atan()).abs() < 1e-5);
                    // Downhill is to the south-west: 180° + atan(0.3 / 0.4).
                    assert!((aspect[(x, y)] - (PI + 0.75f32.atan())).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn hillshade_is_the_cosine_of_incidence() {
        let gradient = horn(&plane(), [5.0, 10.0]);
        let flat = 1.0 / 1.25f32.sqrt();
        assert!((gradient.hillshade(0.0, std::f64::consts::FRAC_PI_2)[(3, 2)] - flat).abs() < 1e-6);
        // Sun along the normal; then from behind the slope.
        let normal_az = f64::from(gradient.aspect_rad()[(3, 2)]);
        let normal_el = std::f64::consts::FRAC_PI_2 - 0.5f64.atan();
        assert!((gradient.hillshade(normal_az, normal_el)[(3, 2)] - 1.0).abs() < 1e-6);
        assert_eq!(gradient.hillshade(normal_az + std::f64::consts::PI, 0.1)[(3, 2)], 0.0);
        assert!(gradient.hillshade(1.0, 0.3)[(0, 0)].is_nan());
    }

    #[test]
    fn an_absent_sample_takes_its_neighbours_with_it() {
        let mut heights = plane();
        heights[(3, 2)] = f32::NAN;
        let slope = horn(&heights, [5.0, 10.0]).slope_rad();
        let num_valid = slope.data.iter().filter(|v| v.is_finite()).count();
        assert_eq!(num_valid, 15 - 9);
        assert!(horn(&Raster::filled(2, 2, 0.0), [1.0, 1.0]).slope_rad().data.iter().all(|v| v.is_nan()));
        let level = horn(&Raster::filled(3, 3, 7.0), [1.0, 1.0]);
        assert_eq!((level.slope_rad()[(1, 1)], level.aspect_rad()[(1, 1)]), (0.0, 0.0));
    }

    #[test]
    fn aspects_differ_the_short_way_round() {
        assert!((aspect_difference_rad(0.1, TAU - 0.1) - 0.2).abs() < 1e-6);
        assert!((aspect_difference_rad(1.0, 1.0 + PI) - PI).abs() < 1e-6);
    }
}
