//! Heights against a reference elevation model: how far off, on which slopes, and whether sigma tells it.

use crate::Error;
use crate::grid::plane::{self, Plane};
use crate::grid::{Dem, frame::GridFrame};
use crate::prediction::Fill;
use crate::scale::dem::DemPatch;
use selenograph_geometry::{Vector3, pixel};
use selenograph_raster::statistics::{median, quantiles};
use selenograph_raster::{Raster, gradient};
use serde::Serialize;

/// Width of a class of slopes, degrees.
const SLOPE_STEP_DEG: f64 = 5.0;
/// Classes with fewer cells than this tell nothing.
const LEAST_CELLS: usize = 30;
/// Cells that the plane is fitted to, at most: it has three numbers.
const PLANE_CELLS: usize = 20_000;
/// Shares of a normal distribution within one, two and three sigma.
pub const GAUSSIAN: [f64; 3] = [0.6827, 0.9545, 0.9973];

/// Heights less those of the reference, over the measured cells where both have one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Residuals {
    /// Side of the reference's cell on the ground, metres. Relief finer than that is in the residuals.
    pub reference_cell_m: f64,
    /// Cells compared.
    pub num_cells: usize,
    /// Median of the residual, metres: above zero the heights lie over the reference.
    pub offset_m: f64,
    /// Tilt of the plane through the residuals against the level, degrees.
    pub tilt_deg: f64,
    /// As they are.
    pub as_placed: Spread,
    /// With that plane taken off: what is left is shape, not place.
    pub levelled: Spread,
    /// The levelled ones by the slope of the reference on the grid, rising.
    pub by_slope: Vec<SlopeClass>,
}

/// How large residuals are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Median of the absolute residual, metres.
    pub median_m: f64,
    /// 90th percentile of it, metres.
    pub p90_m: f64,
    /// Share of the cells whose residual is within one, two and three of their sigma; null where the method has no sigma.
    pub within_sigma: Option<[f64; 3]>,
}

/// The residuals on the slopes between two bounds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SlopeClass {
    /// From this slope on, degrees.
    pub from_deg: f64,
    /// To this one.
    pub to_deg: f64,
    /// Cells.
    pub num_cells: usize,
    /// Median of the absolute residual, metres.
    pub median_m: f64,
    /// 90th percentile of it, metres.
    pub p90_m: f64,
}

/// A cell that both have.
struct Cell {
    /// x and y of the grid and the residual, metres.
    at: Vector3<f64>,
    sigma_m: f64,
    /// Of the reference; NaN at its border.
    slope_deg: f64,
}

/// Compares an elevation model on a map of the body with a reference; `None` for one on a local frame, or where they share hardly
/// any ground.
///
/// # Errors
/// [`Error::Undetermined`] if what they share is a line.
pub fn compare(dem: &Dem, reference: &DemPatch) -> Result<Option<Residuals>, Error> {
    let GridFrame::Map { crs, .. } = &dem.frame else { return Ok(None) };
    let body = reference.body();
    let map = |x: usize, y: usize| dem.map_from_pixel.apply(pixel::center_of(x), pixel::center_of(y));
    let (width, height) = (dem.heights.width, dem.heights.height);
    let beneath = Raster::from_fn(width, height, |x, y| {
        let [map_x, map_y] = map(x, y);
        let place = crs.projection.place_from_map(map_x, map_y);
        let over = place.and_then(|place| reference.height_over(&body.point(&place)));
        over.map_or(f32::NAN, |over| -over as f32)
    });
    let slope_rad = gradient::horn(&beneath, dem.ground_cell()).slope_rad();
    let mut cells = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let residual_m = f64::from(dem.heights[(x, y)]) - f64::from(beneath[(x, y)]);
            if dem.fill[(x, y)] == Fill::Measured && residual_m.is_finite() {
                let [map_x, map_y] = map(x, y);
                cells.push(Cell {
                    at: Vector3::new(map_x, map_y, residual_m),
                    sigma_m: f64::from(dem.sigma[(x, y)]),
                    slope_deg: f64::from(slope_rad[(x, y)]).to_degrees(),
                });
            }
        }
    }
    if cells.len() < LEAST_CELLS {
        return Ok(None);
    }
    let step = cells.len().div_ceil(PLANE_CELLS);
    let sampled: Vec<Vector3<f64>> = cells.iter().step_by(step).map(|cell| cell.at).collect();
    let plane = plane::fit(&sampled, &Vector3::new(0.0, 0.0, f64::MAX))?;
    let levelled: Vec<f64> = cells.iter().map(|cell| above(&plane, &cell.at)).collect();
    let placed: Vec<f64> = cells.iter().map(|cell| cell.at.z).collect();
    Ok(Some(Residuals {
        reference_cell_m: reference.cell_m(),
        num_cells: cells.len(),
        offset_m: median(placed.iter().copied()).unwrap_or(f64::NAN),
        tilt_deg: plane.normal.z.clamp(-1.0, 1.0).acos().to_degrees(),
        as_placed: spread(&cells, &placed),
        levelled: spread(&cells, &levelled),
        by_slope: by_slope(&cells, &levelled),
    }))
}

/// Height over a plane, along z.
fn above(plane: &Plane, at: &Vector3<f64>) -> f64 {
    (at - plane.center).dot(&plane.normal) / plane.normal.z
}

fn spread(cells: &[Cell], residuals: &[f64]) -> Spread {
    let [median_m, p90_m] = sizes(residuals.iter().copied()).unwrap_or([f64::NAN; 2]);
    let with_sigma: Vec<f64> = (cells.iter().zip(residuals))
        .filter(|(cell, _)| cell.sigma_m > 0.0)
        .map(|(cell, residual)| residual.abs() / cell.sigma_m)
        .collect();
    let within = |limit: f64| {
        with_sigma.iter().filter(|ratio| **ratio <= limit).count() as f64 / with_sigma.len() as f64
    };
    let within_sigma = (with_sigma.len() >= LEAST_CELLS).then(|| [1.0, 2.0, 3.0].map(within));
    Spread { median_m, p90_m, within_sigma }
}

fn sizes(residuals: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    quantiles(residuals.map(f64::abs), [0.5, 0.9])
}

fn by_slope(cells: &[Cell], residuals: &[f64]) -> Vec<SlopeClass> {
    let mut classes: Vec<Vec<f64>> = Vec::new();
    for (cell, residual) in cells.iter().zip(residuals) {
        if cell.slope_deg.is_finite() {
            let class = (cell.slope_deg / SLOPE_STEP_DEG) as usize;
            if classes.len() <= class {
                classes.resize(class + 1, Vec::new());
            }
            classes[class].push(*residual);
        }
    }
    let told = classes.iter().enumerate().filter(|(_, residuals)| residuals.len() >= LEAST_CELLS);
    told.filter_map(|(n, residuals)| {
        let [median_m, p90_m] = sizes(residuals.iter().copied())?;
        let from_deg = n as f64 * SLOPE_STEP_DEG;
        let num_cells = residuals.len();
        Some(SlopeClass { from_deg, to_deg: from_deg + SLOPE_STEP_DEG, num_cells, median_m, p90_m })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::proj_string;
    use selenograph_geometry::{BodyFixed, Geodetic, Point3, PredA, Rigid3, Sim3};
    use selenograph_raster::Affine;

    const SIDE: usize = 160;
    const CELL_M: f64 = 10.0;

    /// Hills whose slopes run from 0 to some 35°.
    fn hills(x: f64, y: f64) -> f64 {
        90.0 * ((x / 140.0).sin() + (y / 190.0).cos()) * (1.0 + x / 3000.0)
    }

    /// A reference, and heights on its own map: its hills with an error.
    fn pair(error_m: impl Fn(f64, f64, usize) -> f64, sigma_m: f32) -> (Dem, DemPatch) {
        let crs = proj_string::parse("IAU_2015:30135").unwrap();
        let [x, y] = crs.projection.map_from_place(&Geodetic::from_deg(-88.0, 30.0, 0.0)).unwrap();
        let grid = |side: f64| Affine::north_up(x - side, y + side, CELL_M, CELL_M);
        let (wide, narrow) = (grid(1000.0), grid(800.0));
        let local = |map: &Affine, column: usize, row: usize| {
            let [map_x, map_y] = map.apply(pixel::center_of(column), pixel::center_of(row));
            [map_x - x, map_y - y]
        };
        let heights = Raster::from_fn(200, 200, |column, row| {
            let [x, y] = local(&wide, column, row);
            hills(x, y) as f32
        });
        let dem = Dem {
            frame: GridFrame::Map {
                crs: crs.clone(),
                body_from_pred: Sim3::<BodyFixed, PredA>::new(
                    1.0,
                    Rigid3::from_quaternion(1.0, 0.0, 0.0, 0.0, Point3::origin()),
                )
                .unwrap(),
            },
            cell: CELL_M,
            map_from_pixel: narrow,
            heights: Raster::from_fn(SIDE, SIDE, |column, row| {
                let [x, y] = local(&narrow, column, row);
                (hills(x, y) + error_m(x, y, row * SIDE + column)) as f32
            }),
            sigma: Raster::filled(SIDE, SIDE, sigma_m),
            count: Raster::filled(SIDE, SIDE, 1),
            fill: Raster::filled(SIDE, SIDE, Fill::Measured),
        };
        (dem, DemPatch::new(heights, crs, &wide).unwrap())
    }

    /// Normal deviates, by the sum of twelve uniform ones.
    fn normal(n: usize) -> f64 {
        let uniform = |k: usize| {
            let mut z = (12 * n + k) as u64 ^ 0x9e37_79b9_7f4a_7c15;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            (z ^ (z >> 31)) as f64 / u64::MAX as f64
        };
        (0..12).map(uniform).sum::<f64>() - 6.0
    }

    #[test]
    fn gaussian_errors_have_gaussian_shares_once_the_place_is_taken_off() {
        let (dem, reference) = pair(|x, _, n| 5.0 + 0.02 * x + 2.0 * normal(n), 2.0);
        let found = compare(&dem, &reference).unwrap().unwrap();
        assert_eq!(found.num_cells, SIDE * SIDE);
        assert!((found.offset_m - 5.0).abs() < 0.3, "{found:?}");
        assert!((found.tilt_deg - 0.02f64.atan().to_degrees()).abs() < 0.02, "{found:?}");
        for (share, expected) in found.levelled.within_sigma.unwrap().into_iter().zip(GAUSSIAN) {
            assert!((share - expected).abs() < 0.015, "{found:?}");
        }
        // Half a sigma is 2 × 0.6745 in the median; off by more than that as it was placed.
        assert!((found.levelled.median_m - 1.349).abs() < 0.1, "{found:?}");
        assert!(found.as_placed.within_sigma.unwrap()[0] < 0.4, "{found:?}");
    }

    #[test]
    fn errors_that_grow_with_the_slope_show_in_its_classes() {
        let steepness = |x: f64, y: f64| {
            let d = |dx: f64, dy: f64| (hills(x + dx, y + dy) - hills(x - dx, y - dy)) / 2.0;
            d(1.0, 0.0).hypot(d(0.0, 1.0))
        };
        let (dem, reference) = pair(|x, y, n| (0.5 + 8.0 * steepness(x, y)) * normal(n), f32::NAN);
        let found = compare(&dem, &reference).unwrap().unwrap();
        assert!(found.by_slope.len() >= 5, "{found:?}");
        assert!(found.by_slope.windows(2).all(|two| two[0].median_m < two[1].median_m), "{found:?}");
        assert!(found.by_slope.iter().all(|class| class.p90_m > 2.0 * class.median_m), "{found:?}");
        assert_eq!(found.levelled.within_sigma, None);
    }

    #[test]
    fn what_was_not_measured_and_what_the_reference_lacks_is_not_compared() {
        let (mut dem, reference) = pair(|_, _, _| 1.0, 2.0);
        for n in 0..SIDE {
            dem.fill[(n, 3)] = Fill::Completed;
            dem.heights[(n, 4)] = f32::NAN;
        }
        assert_eq!(compare(&dem, &reference).unwrap().unwrap().num_cells, SIDE * (SIDE - 2));
        let moved = dem.map_from_pixel.with_origin(3.0 * SIDE as f64, 0.0);
        assert_eq!(compare(&Dem { map_from_pixel: moved, ..dem }, &reference).unwrap(), None);
    }
}
