//! A window of a coarse elevation model, asked for the height under a point.

use crate::Error;
use selenograph_geometry::proj_string::Crs;
use selenograph_geometry::{Body, Geodetic, Point3};
use selenograph_raster::dem::{DemReader, OpenOptions};
use selenograph_raster::{Affine, Raster, resample};
use std::ops::Range;
use std::path::Path;

/// Heights on a map, in memory.
#[derive(Debug, Clone)]
pub struct DemPatch {
    heights: Raster<f32>,
    crs: Crs,
    map_from_pixel: Affine,
    pixel_from_map: Affine,
    cell_m: f64,
}

/// Rows are read in bands of this many, so that a large file is never in memory as a whole.
const BAND_ROWS: usize = 256;

impl DemPatch {
    /// From heights above the body's sphere, metres, NaN where absent.
    ///
    /// # Errors
    /// [`Error::Raster`] if the map has no inverse.
    pub fn new(heights: Raster<f32>, crs: Crs, map_from_pixel: &Affine) -> Result<Self, Error> {
        let middle = map_from_pixel.apply(heights.width as f64 / 2.0, heights.height as f64 / 2.0);
        let ground = crs.projection.ground_m_per_unit(middle[0], middle[1], crs.body.radius_m);
        let [across, down] = map_from_pixel.steps();
        let [per_x, per_y] = ground.unwrap_or([1.0, 1.0]);
        let cell_m = (across * per_x * down * per_y).sqrt();
        let pixel_from_map = map_from_pixel.inverse()?;
        Ok(Self { heights, crs, map_from_pixel: *map_from_pixel, pixel_from_map, cell_m })
    }

    /// Reads a window of an open elevation model, never the whole.
    ///
    /// # Errors
    /// Those of the reader.
    pub fn of_window(
        reader: &mut DemReader,
        columns: Range<usize>,
        rows: Range<usize>,
    ) -> Result<Self, Error> {
        let info = reader.info().clone();
        let (mut data, mut band) = (Vec::with_capacity(columns.len() * rows.len()), Vec::new());
        for first in rows.clone().step_by(BAND_ROWS) {
            reader.read_rows(first, BAND_ROWS.min(rows.end - first), &mut band)?;
            data.extend(band.chunks_exact(info.width).flat_map(|row| &row[columns.clone()]));
        }
        let heights = Raster::new(columns.len(), rows.len(), data)?;
        let map_from_pixel = info.map_from_pixel.with_origin(columns.start as f64, rows.start as f64);
        Self::new(heights, info.crs, &map_from_pixel)
    }

    /// Reads the window within `reach_m` of a body-fixed point.
    ///
    /// # Errors
    /// Those of the reader; [`Error::Undetermined`] if the point lies outside the map.
    pub fn read(
        path: &Path,
        options: &OpenOptions,
        center: &Point3<f64>,
        reach_m: f64,
    ) -> Result<Self, Error> {
        let mut reader = DemReader::open(path, options)?;
        let info = reader.info().clone();
        let outside = || Error::Undetermined {
            what: "place on an elevation model",
            why: format!("the scene lies outside `{}`", path.display()),
        };
        let [x, y] = info.crs.projection.map_from_point(center).ok_or_else(outside)?;
        let [column, row] = info.map_from_pixel.inverse()?.apply(x, y);
        let ground =
            info.crs.projection.ground_m_per_unit(x, y, info.crs.body.radius_m).ok_or_else(outside)?;
        let [across, down] = info.map_from_pixel.steps();
        let window = |at: f64, step_m: f64, side: usize| {
            let reach = reach_m / step_m + 2.0;
            let first = (at - reach).floor().clamp(0.0, side as f64) as usize;
            first..((at + reach).ceil().clamp(0.0, side as f64) as usize).max(first)
        };
        let columns = window(column, across * ground[0], info.width);
        let rows = window(row, down * ground[1], info.height);
        if columns.len() < 2 || rows.len() < 2 {
            return Err(outside());
        }
        Self::of_window(&mut reader, columns, rows)
    }

    /// The body.
    pub fn body(&self) -> &Body {
        &self.crs.body
    }

    /// Heights above the body's sphere, metres; NaN where absent.
    pub fn heights(&self) -> &Raster<f32> {
        &self.heights
    }

    /// Body and projection.
    pub fn crs(&self) -> &Crs {
        &self.crs
    }

    /// Corner-based pixels → map units.
    pub fn map_from_pixel(&self) -> &Affine {
        &self.map_from_pixel
    }

    /// Side of a cell on the ground, metres.
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Columns and rows of a window of it, on the same grid.
    ///
    /// # Errors
    /// [`Error::Raster`] for one that leaves it.
    pub fn cropped(&self, columns: Range<usize>, rows: Range<usize>) -> Result<Self, Error> {
        let whole = &self.heights;
        let data = rows.clone().filter(|y| *y < whole.height).flat_map(|y| {
            let row = whole.row(y);
            row.get(columns.clone()).unwrap_or_default()
        });
        let heights = Raster::new(columns.len(), rows.len(), data.copied().collect())?;
        let map_from_pixel = self.map_from_pixel.with_origin(columns.start as f64, rows.start as f64);
        Self::new(heights, self.crs.clone(), &map_from_pixel)
    }

    /// The body-fixed point of a place on the map at a height above the sphere, metres; `None` outside the projection.
    #[inline]
    pub fn point(&self, x: f64, y: f64, height_m: f64) -> Option<Point3<f64>> {
        let place = self.crs.projection.place_from_map(x, y)?;
        Some(self.crs.body.point(&Geodetic { height_m, ..place }))
    }

    /// Height at a place on the map, metres above the sphere; `None` outside it and over absent cells.
    #[inline]
    pub fn height(&self, x: f64, y: f64) -> Option<f64> {
        let [column, row] = self.pixel_from_map.apply(x, y);
        resample::bilinear(&self.heights, column, row)
    }

    /// How far a body-fixed point lies above the model, metres; `None` outside it and over absent cells.
    #[inline]
    pub fn height_over(&self, point: &Point3<f64>) -> Option<f64> {
        let [x, y] = self.crs.projection.map_from_point(point)?;
        Some(self.crs.body.height_m(point) - self.height(x, y)?)
    }
}
