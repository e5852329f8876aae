//! A coarse elevation model as the long waves of synthetic relief.

use crate::{Error, Grid};
use selenograph_geometry::proj_string::Crs;

/// Nodes kept around the part of the base that the target needs: the spline's prefilter forgets its border by a factor
/// of 3.7 a node, so that ten nodes leave a millionth of it.
const BORDER: usize = 10;
/// Points along each side at which the target's outline is looked up in the base.
const OUTLINE: usize = 65;

/// The interpolating cubic B-spline (C²) through the nodes of a coarse grid, seen from another map.
#[derive(Debug, Clone)]
pub struct BaseSurface {
    /// The base's grid.
    grid: Grid,
    /// The map in which positions are asked for.
    target: Crs,
    same_map: bool,
    col0: usize,
    row0: usize,
    cols: usize,
    rows: usize,
    coefficients: Vec<f32>,
    present: Vec<bool>,
    cell_m: f64,
}

impl BaseSurface {
    /// Reads the part of a coarse grid that lies under `target`; `read_rows(first, count, out)` gives its rows.
    ///
    /// # Errors
    /// [`Error::NotCovered`] if part of the target lies outside the base or where it is absent; errors of the reader;
    /// [`Error::Geometry`] if the two lie on different spheres.
    pub fn read(
        grid: Grid,
        target: &Grid,
        mut read_rows: impl FnMut(usize, usize, &mut Vec<f32>) -> Result<(), Error>,
    ) -> Result<Self, Error> {
        grid.crs.body.same_sphere("the base", &target.crs.body, "the synthetic relief")?;
        let [c0, r0, c1, r1] = outline(&grid, target)?;
        let col0 = (c0.floor() as usize).saturating_sub(BORDER);
        let row0 = (r0.floor() as usize).saturating_sub(BORDER);
        let cols = (c1.ceil() as usize + BORDER + 1).min(grid.cols) - col0;
        let rows = (r1.ceil() as usize + BORDER + 1).min(grid.rows) - row0;
        let mut heights = Vec::with_capacity(cols * rows);
        let mut band = Vec::new();
        for row in row0..row0 + rows {
            read_rows(row, 1, &mut band)?;
            heights.extend_from_slice(&band[col0..col0 + cols]);
        }
        let present: Vec<bool> = heights.iter().map(|h| h.is_finite()).collect();
        fill_absent(&mut heights, &present, cols);
        prefilter(&mut heights, cols, rows);
        let cell_m = grid.cell_m();
        let same_map = grid.crs.projection == target.crs.projection;
        Ok(Self {
            grid,
            target: target.crs.clone(),
            same_map,
            col0,
            row0,
            cols,
            rows,
            coefficients: heights,
            present,
            cell_m,
        })
    }

    /// Size of the base's cells, metres.
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Height at a position of the target's map, metres; NaN where the base is absent or does not reach.
    pub(super) fn height(&self, x: f64, y: f64) -> f32 {
        let map = if self.same_map {
            Some([x, y])
        } else {
            let place = self.target.projection.place_from_map(x, y);
            place.and_then(|p| self.grid.crs.projection.map_from_place(&p))
        };
        let Some([x, y]) = map else { return f32::NAN };
        let [c, r] = self.grid.grid_from_map().apply(x, y);
        // Lattices of coarse levels stick out over the target's rim by a few of their steps: hold the border there.
        let hold = |v: f64, first: usize, count: usize| (v - first as f64).clamp(0.0, (count - 1) as f64);
        let (c, r) = (hold(c, self.col0, self.cols), hold(r, self.row0, self.rows));
        let (i, j) = ((c as usize).min(self.cols - 2), (r as usize).min(self.rows - 2));
        let at = j * self.cols + i;
        if !(self.present[at]
            && self.present[at + 1]
            && self.present[at + self.cols]
            && self.present[at + self.cols + 1])
        {
            return f32::NAN;
        }
        let (wc, wr) = (weights(c - i as f64), weights(r - j as f64));
        let mut sum = 0.0;
        for (n, wr) in wr.iter().enumerate() {
            let row = mirror(j as i64 + n as i64 - 1, self.rows) * self.cols;
            for (m, wc) in wc.iter().enumerate() {
                let col = mirror(i as i64 + m as i64 - 1, self.cols);
                sum += wr * wc * f64::from(self.coefficients[row + col]);
            }
        }
        sum as f32
    }
}

/// Bounds of a target in grid coordinates of the base.
fn outline(grid: &Grid, target: &Grid) -> Result<[f64; 4], Error> {
    let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for j in 0..OUTLINE {
        for i in 0..OUTLINE {
            let share = |n: usize, count: usize| (count - 1) as f64 * n as f64 / (OUTLINE - 1) as f64;
            let (tc, tr) = (share(i, target.cols), share(j, target.rows));
            let at = target.point_from_grid(tc, tr, 0.0).and_then(|p| grid.grid_from_point(&p));
            match at {
                Some(at) if grid.contains(at) => {
                    bounds[0] = bounds[0].min(at[0]);
                    bounds[1] = bounds[1].min(at[1]);
                    bounds[2] = bounds[2].max(at[0]);
                    bounds[3] = bounds[3].max(at[1]);
                }
                _ => {
                    let [x, y] = target.map_from_grid().apply(tc, tr);
                    return Err(Error::NotCovered { what: "the base of synthetic relief", x, y });
                }
            }
        }
    }
    Ok(bounds)
}

/// Index mirrored at both ends (whole-sample symmetry, as the prefilter has it).
fn mirror(index: i64, count: usize) -> usize {
    let last = count as i64 - 1;
    let index = index.abs();
    (if index > last { 2 * last - index } else { index }).clamp(0, last) as usize
}

/// Weights of the cubic B-spline at a fraction of a cell.
fn weights(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    let w0 = s * s * s / 6.0;
    let w3 = t * t * t / 6.0;
    let w1 = 2.0 / 3.0 - t * t * (1.0 - 0.5 * t);
    [w0, w1, 1.0 - w0 - w1 - w3, w3]
}

/// Gives absent nodes the value of the last present one before or after them in their row, then in their column.
fn fill_absent(heights: &mut [f32], present: &[bool], cols: usize) {
    if present.iter().all(|p| *p) {
        return;
    }
    let fill = |line: &mut dyn Iterator<Item = usize>, heights: &mut [f32]| {
        let mut last = f32::NAN;
        for at in line {
            if heights[at].is_finite() {
                last = heights[at];
            } else {
                heights[at] = last;
            }
        }
    };
    let len = heights.len();
    for start in (0..len).step_by(cols) {
        fill(&mut (start..start + cols), heights);
        fill(&mut (start..start + cols).rev(), heights);
    }
    for col in 0..cols {
        fill(&mut (col..len).step_by(cols), heights);
        fill(&mut (col..len).step_by(cols).rev(), heights);
    }
    heights.iter_mut().filter(|h| !h.is_finite()).for_each(|h| *h = 0.0);
}

/// Node values → spline coefficients (Unser 1999, "Splines: a perfect fit", cubic, mirrored ends).
fn prefilter(values: &mut [f32], cols: usize, rows: usize) {
    for start in (0..values.len()).step_by(cols) {
        prefilter_line(values, start, 1, cols);
    }
    for col in 0..cols {
        prefilter_line(values, col, cols, rows);
    }
}

fn prefilter_line(values: &mut [f32], start: usize, step: usize, count: usize) {
    let pole = 3f64.sqrt() - 2.0;
    let mut line: Vec<f64> = (0..count).map(|n| f64::from(values[start + n * step])).collect();
    // The mirrored sum is cut where the pole's powers fall below f64's resolution.
    let mut power = 1.0;
    let mut first = 0.0;
    for value in line.iter().take(30) {
        first += power * value;
        power *= pole;
    }
    line[0] = first;
    for n in 1..count {
        line[n] += pole * line[n - 1];
    }
    line[count - 1] = pole / (pole * pole - 1.0) * (line[count - 1] + pole * line[count - 2]);
    for n in (0..count - 1).rev() {
        line[n] = pole * (line[n + 1] - line[n]);
    }
    for (n, v) in line.iter().enumerate() {
        values[start + n * step] = (6.0 * v) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::{Body, Projection};
    use selenograph_raster::georef::Affine;

    fn grid(cell: f64, n: usize, projection: Projection) -> Grid {
        let half = (n - 1) as f64 / 2.0 * cell;
        Grid::new(Crs { body: Body::moon(), projection }, n, n, Affine::north_up(-half, half, cell, cell))
            .unwrap()
    }

    #[test]
    fn the_spline_passes_through_the_nodes_and_is_smooth() {
        let south = Projection::south_polar(Body::moon().radius_m);
        let (coarse, target) = (grid(1600.0, 60, south), grid(100.0, 200, south));
        let value = |c: usize, r: usize| ((c * 7919 + r * 104_729) % 613) as f32;
        let base = BaseSurface::read(coarse.clone(), &target, |first, count, out| {
            out.clear();
            out.extend((first..first + count).flat_map(|r| (0..60).map(move |c| value(c, r))));
            Ok(())
        })
        .unwrap();
        for (c, r) in [(30, 30), (27, 33), (26, 31)] {
            let [x, y] = coarse.map_from_grid().apply(c as f64, r as f64);
            assert!((base.height(x, y) - value(c, r)).abs() < 1e-3);
            let slope = |x: f64| (base.height(x + 1.0, y) - base.height(x - 1.0, y)) / 2.0;
            assert!((slope(x - 2.0) - slope(x + 2.0)).abs() < 0.01);
        }
    }

    #[test]
    fn a_base_that_is_too_small_is_refused() {
        let south = Projection::south_polar(Body::moon().radius_m);
        let result = BaseSurface::read(grid(100.0, 20, south), &grid(100.0, 40, south), |_, _, _| Ok(()));
        assert!(matches!(result, Err(Error::NotCovered { .. })));
    }
}
