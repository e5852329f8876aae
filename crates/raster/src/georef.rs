//! The affine map between a raster's coordinates and its map's.

use crate::Error;
use selenograph_geometry::pixel::HALF_PIXEL;
use serde::{Deserialize, Serialize};

/// `x = a0 + a1·c + a2·r`, `y = a3 + a4·c + a5·r`: raster coordinates (column, row) → map coordinates.
///
/// Whether (0, 0) is the first pixel's corner or its centre is said by the name of the variable:
/// `map_from_pixel` is measured from the corner, `map_from_grid` from the first centre
/// ([`Affine::grid_from_pixel`] leads from one to the other).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Affine {
    /// `[a0, a1, a2, a3, a4, a5]`, the order of GDAL's geotransform.
    pub coefficients: [f64; 6],
}

impl Affine {
    /// From the six coefficients in GDAL's order.
    pub fn new(coefficients: [f64; 6]) -> Self {
        Self { coefficients }
    }

    /// A north-up map: the origin, then the step along a row and the step *down* a column (both positive).
    pub fn north_up(x0: f64, y0: f64, step_x: f64, step_y: f64) -> Self {
        Self::new([x0, step_x, 0.0, y0, 0.0, -step_y])
    }

    /// Raster → map.
    #[inline]
    pub fn apply(&self, column: f64, row: f64) -> [f64; 2] {
        let [a0, a1, a2, a3, a4, a5] = self.coefficients;
        [a0 + a1 * column + a2 * row, a3 + a4 * column + a5 * row]
    }

    /// The same map with the origin moved to raster coordinates (column, row).
    pub fn with_origin(&self, column: f64, row: f64) -> Self {
        let [_, a1, a2, _, a4, a5] = self.coefficients;
        let [x, y] = self.apply(column, row);
        Self::new([x, a1, a2, y, a4, a5])
    }

    /// `map_from_pixel` (origin at the corner) → `map_from_grid` (origin at the first pixel's centre).
    pub fn grid_from_pixel(&self) -> Self {
        self.with_origin(HALF_PIXEL, HALF_PIXEL)
    }

    /// `map_from_grid` (origin at the first pixel's centre) → `map_from_pixel` (origin at the corner).
    pub fn pixel_from_grid(&self) -> Self {
        self.with_origin(-HALF_PIXEL, -HALF_PIXEL)
    }

    /// Area of one cell in square map units; negative where rows run down the map (north-up).
    pub fn determinant(&self) -> f64 {
        let [_, a1, a2, _, a4, a5] = self.coefficients;
        a1 * a5 - a2 * a4
    }

    /// Map units per column and per row.
    pub fn steps(&self) -> [f64; 2] {
        let [_, a1, a2, _, a4, a5] = self.coefficients;
        [a1.hypot(a4), a2.hypot(a5)]
    }

    /// Map → raster.
    ///
    /// # Errors
    /// [`Error::SingularAffine`] if the map has no inverse.
    pub fn inverse(&self) -> Result<Self, Error> {
        let [a0, a1, a2, a3, a4, a5] = self.coefficients;
        let det = self.determinant();
        let [step_x, step_y] = self.steps();
        let finite = self.coefficients.iter().all(|a| a.is_finite());
        if !finite || det.abs() <= 1e-12 * step_x * step_y {
            return Err(Error::SingularAffine { coefficients: self.coefficients });
        }
        Ok(Self::new([
            (a2 * a3 - a5 * a0) / det,
            a5 / det,
            -a2 / det,
            (a4 * a0 - a1 * a3) / det,
            -a4 / det,
            a1 / det,
        ]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes() {
        let map = Affine::new([2000.0, 5.0, 0.3, -28_000.0, 0.2, -4.9]);
        let back = map.inverse().unwrap();
        let [x, y] = map.apply(17.25, 3000.5);
        let [c, r] = back.apply(x, y);
        assert!((c - 17.25).abs() < 1e-9 && (r - 3000.5).abs() < 1e-9);
        assert!(Affine::new([0.0, 1.0, 2.0, 0.0, 2.0, 4.0]).inverse().is_err());
        assert!(Affine::new([f64::NAN, 1.0, 0.0, 0.0, 0.0, 1.0]).inverse().is_err());
        assert!(Affine::new([0.0; 6]).inverse().is_err());
    }

    #[test]
    fn the_first_centre_is_half_a_cell_inside() {
        let map_from_pixel = Affine::north_up(-100.0, 100.0, 10.0, 20.0);
        let map_from_grid = map_from_pixel.grid_from_pixel();
        assert_eq!(map_from_grid.apply(0.0, 0.0), [-95.0, 90.0]);
        assert_eq!(map_from_grid.pixel_from_grid(), map_from_pixel);
    }
}
