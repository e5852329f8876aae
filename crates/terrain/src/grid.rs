//! A regular grid of nodes on a map.

use crate::Error;
use selenograph_geometry::Point3;
use selenograph_geometry::proj_string::Crs;
use selenograph_raster::georef::Affine;

/// Where a layer's nodes lie: node `(i, j)` sits at integer *grid coordinates* `(c, r) = (i, j)`, c along columns, r along
/// rows. A DEM's pixel centre is a node.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Sphere and projection.
    pub crs: Crs,
    /// Nodes along a row.
    pub cols: usize,
    /// Rows of nodes.
    pub rows: usize,
    map_from_grid: Affine,
    grid_from_map: Affine,
}

impl Grid {
    /// A grid of `cols × rows` nodes; `map_from_grid` carries grid coordinates to map coordinates.
    ///
    /// # Errors
    /// [`Error::Grid`] for fewer than 2×2 nodes, more than 2³¹ nodes, or a georeference that cannot be inverted.
    pub fn new(crs: Crs, cols: usize, rows: usize, map_from_grid: Affine) -> Result<Self, Error> {
        let nodes = cols.checked_mul(rows);
        // Traversal addresses nodes with 32-bit signed indices.
        if cols < 2 || rows < 2 || nodes.is_none_or(|n| n > i32::MAX as usize) {
            return Err(Error::Grid {
                expected: "at least 2×2 and at most 2³¹ nodes",
                found: format!("{cols}×{rows}"),
            });
        }
        let grid_from_map = map_from_grid.inverse().map_err(|_| Error::Grid {
            expected: "a georeference that can be inverted",
            found: format!("{map_from_grid:?}"),
        })?;
        Ok(Self { crs, cols, rows, map_from_grid, grid_from_map })
    }

    /// Grid → map.
    pub fn map_from_grid(&self) -> &Affine {
        &self.map_from_grid
    }

    /// Map → grid.
    pub fn grid_from_map(&self) -> &Affine {
        &self.grid_from_map
    }

    /// Body-fixed point → grid coordinates, wherever they fall; `None` where the projection does not reach.
    #[inline]
    pub fn grid_from_point(&self, point: &Point3<f64>) -> Option<[f64; 2]> {
        let [x, y] = self.crs.projection.map_from_point(point)?;
        Some(self.grid_from_map.apply(x, y))
    }

    /// Grid coordinates and height → body-fixed point; `None` outside the projection.
    pub fn point_from_grid(&self, c: f64, r: f64, height_m: f64) -> Option<Point3<f64>> {
        let [x, y] = self.map_from_grid.apply(c, r);
        let mut place = self.crs.projection.place_from_map(x, y)?;
        place.height_m = height_m;
        Some(self.crs.body.point(&place))
    }

    /// Whether grid coordinates lie on the node rectangle (borders included).
    #[inline]
    pub fn contains(&self, [c, r]: [f64; 2]) -> bool {
        c >= 0.0 && r >= 0.0 && c <= (self.cols - 1) as f64 && r <= (self.rows - 1) as f64
    }

    /// Size of a cell on the ground at the middle of the grid, metres (geometric mean of both sides).
    pub fn cell_m(&self) -> f64 {
        let (c, r) = ((self.cols - 1) as f64 / 2.0, (self.rows - 1) as f64 / 2.0);
        let at = |c: f64, r: f64| self.point_from_grid(c, r, 0.0);
        let spacing = || {
            let along_c = (at(c + 0.5, r)? - at(c - 0.5, r)?).norm();
            let along_r = (at(c, r + 0.5)? - at(c, r - 0.5)?).norm();
            Some((along_c * along_r).sqrt())
        };
        spacing().unwrap_or(f64::NAN)
    }
}
