//! Elevation models from files into a terrain folder, streamed by bands of rows.

use crate::nest::{self, NestOptions};
use crate::store::{Description, Source, TerrainWriter};
use crate::{Error, Grid};
use selenograph_files::FolderDraft;
use selenograph_geometry::{Projection, proj_string::Crs};
use selenograph_raster::dem::{DemInfo, DemReader, OpenOptions};
use selenograph_raster::georef::Affine;
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::{Path, PathBuf};

/// Rows handled at a time where nothing else decides.
pub(crate) const BAND_ROWS: usize = 128;
/// A map is closed round the body if its columns miss a full turn by less than this many of them.
const CLOSING_TOLERANCE: f64 = 0.01;

/// One file to import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportSource {
    /// The file.
    pub path: PathBuf,
    /// How to read it.
    pub options: OpenOptions,
}

/// How to import.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImportOptions {
    /// How finer models are fitted onto coarser ones.
    pub nest: NestOptions,
}

/// How far an import has come.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress<'a> {
    /// The file at hand.
    pub path: &'a Path,
    /// Its position, in the order of work (coarsest first).
    pub layer_idx: usize,
    /// Number of files.
    pub num_layers: usize,
    /// Steps done of this file.
    pub rows_done: usize,
    /// Steps there are (a nested model is passed over twice).
    pub num_rows: usize,
}

/// Imports one or several files as one terrain. They are layered by cell size; of two with equal cells the one given
/// first lies on top. Peak memory is a band of rows, whatever the size of the files.
///
/// # Errors
/// [`Error::Raster`] for files that cannot be read or hold no valid height, [`Error::Geometry`] for files on different
/// spheres, [`Error::Grid`] without any file, [`Error::Files`], [`Error::Io`]. The target is touched only when all is done.
pub fn import(
    sources: &[ImportSource],
    folder: FolderDraft,
    options: &ImportOptions,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Description, Error> {
    let mut models = sources.iter().rev().map(Model::open).collect::<Result<Vec<_>, _>>()?;
    // Coarse to fine; a stable sort keeps equals as they are: last given lowest.
    models.sort_by(|a, b| b.grid.cell_m().total_cmp(&a.grid.cell_m()));
    let Some(coarsest) = models.first() else {
        return Err(Error::Grid { expected: "at least one elevation model", found: "none".into() });
    };
    let body = coarsest.grid.crs.body.clone();
    for model in &models {
        model.grid.crs.body.same_sphere(model.name(), &body, coarsest.name())?;
    }
    let mut writer = TerrainWriter::create(folder, body);
    let num_layers = models.len();
    for (layer_idx, mut model) in models.into_iter().enumerate() {
        let path = model.path.clone();
        let mut tell = |rows_done: usize, num_rows: usize| {
            progress(Progress { path: &path, layer_idx, num_layers, rows_done, num_rows });
        };
        let (grid, source) = (model.grid.clone(), model.source()?);
        if layer_idx == 0 {
            add_plain(
                &mut writer,
                &grid,
                source,
                |first, count, out| model.read_rows(first, count, out),
                &mut tell,
            )?;
        } else {
            let read = |first: usize, count: usize, out: &mut Vec<f32>| model.read_rows(first, count, out);
            nest::add_nested(&mut writer, &grid, source, &options.nest, read, &mut tell)?;
        }
    }
    writer.finish()
}

/// Adds the coarsest layer as it is.
pub(crate) fn add_plain(
    writer: &mut TerrainWriter,
    grid: &Grid,
    source: Source,
    mut read_rows: impl FnMut(usize, usize, &mut Vec<f32>) -> Result<(), Error>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<(), Error> {
    let mut layer = writer.begin_layer(grid, false)?;
    let mut band = Vec::new();
    for first in (0..grid.rows).step_by(BAND_ROWS) {
        let count = BAND_ROWS.min(grid.rows - first);
        read_rows(first, count, &mut band)?;
        layer.push_rows(&band)?;
        progress(first + count, grid.rows);
    }
    writer.finish_layer(layer, source, None, None)
}

/// An open file as node rows: closed round the body where its map goes all the way round.
struct Model {
    path: PathBuf,
    reader: DemReader,
    grid: Grid,
    closing: Closing,
}

/// Nodes added to those of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Closing {
    /// The first column again after the last.
    column: bool,
    /// A row beyond the pole above: the first row half a turn on.
    row_above: bool,
    /// The same below.
    row_below: bool,
}

impl Model {
    fn open(source: &ImportSource) -> Result<Self, Error> {
        let reader = DemReader::open(&source.path, &source.options)?;
        let info = reader.info();
        if info.width < 2 || info.height < 2 {
            return Err(Error::Grid {
                expected: "an elevation model of at least 2×2 pixels",
                found: format!("{}×{} in `{}`", info.width, info.height, source.path.display()),
            });
        }
        let (grid, closing) = closed_grid(info)?;
        if !grid.cell_m().is_finite() {
            return Err(Error::Grid {
                expected: "a map whose middle lies on the body, where the size of its cells is told",
                found: format!("none in `{}`", source.path.display()),
            });
        }
        Ok(Self { path: source.path.clone(), reader, grid, closing })
    }

    /// As people know it.
    fn name(&self) -> String {
        format!("`{}`", self.path.display())
    }

    fn source(&self) -> Result<Source, Error> {
        let path = &self.reader.info().data_path;
        let sum = selenograph_files::checksum::of_file(path)?;
        let mut info = self.reader.info().clone();
        // Folders of the machine that imported say nothing on another one.
        let name = |path: &Path| path.file_name().map_or_else(|| path.to_owned(), PathBuf::from);
        (info.path, info.data_path) = (name(&info.path), name(&info.data_path));
        Ok(Source {
            name: info.path.display().to_string(),
            blake3: Some(sum.to_string()),
            details: serde_json::to_value(&info).unwrap_or_default(),
        })
    }

    /// Node rows of the closed grid.
    fn read_rows(&mut self, first: usize, count: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        if self.closing == Closing::default() {
            self.reader.read_rows(first, count, out)?;
            return Ok(self.reader.refuse_impossible(out)?);
        }
        let height = self.reader.info().height;
        let above = usize::from(self.closing.row_above);
        let (mut rows, mut row) = (Vec::with_capacity(count * self.grid.cols), Vec::new());
        for node_row in first..first + count {
            let beyond = node_row < above || node_row - above >= height;
            self.reader.read_rows(node_row.saturating_sub(above).min(height - 1), 1, &mut row)?;
            if beyond {
                let half = row.len() / 2;
                row.rotate_left(half);
            }
            rows.extend_from_slice(&row);
            if self.closing.column {
                rows.push(row[0]);
            }
        }
        *out = rows;
        Ok(self.reader.refuse_impossible(out)?)
    }
}

/// The grid of a file's pixel centres, with the nodes that close it.
fn closed_grid(info: &DemInfo) -> Result<(Grid, Closing), Error> {
    let affine = info.map_from_pixel.grid_from_pixel();
    let (width, height) = (info.width, info.height);
    let [step_x, step_y] = affine.steps();
    let [_, a1, a2, _, a4, a5] = affine.coefficients;
    let turn = match info.crs.projection {
        Projection::Geographic { .. } => Some((360.0, 90.0)),
        Projection::Equirectangular { lat_ts_rad, radius_m, .. } => {
            Some((2.0 * PI * radius_m * lat_ts_rad.cos(), FRAC_PI_2 * radius_m))
        }
        Projection::PolarStereographic { .. } | Projection::Orthographic { .. } => None,
    };
    let axes_are_the_maps = a2 == 0.0 && a4 == 0.0 && a1 > 0.0 && a5 < 0.0;
    let Some((full_turn, to_pole)) = turn.filter(|_| axes_are_the_maps) else {
        return Ok((Grid::new(info.crs.clone(), width, height, affine)?, Closing::default()));
    };
    if (width as f64 * step_x - full_turn).abs() > CLOSING_TOLERANCE * step_x {
        return Ok((Grid::new(info.crs.clone(), width, height, affine)?, Closing::default()));
    }
    let equator = match info.crs.projection {
        Projection::Equirectangular { lat0_rad, false_northing_m, radius_m, .. } => {
            false_northing_m - radius_m * lat0_rad
        }
        _ => 0.0,
    };
    // A row half a step from a pole continues, half a turn on, as far beyond it.
    let half_step_from = |row: f64, pole: f64| {
        let [_, y] = affine.apply(0.0, row);
        ((equator + pole - y).abs() - step_y / 2.0).abs() < CLOSING_TOLERANCE * step_y
    };
    let even = width.is_multiple_of(2);
    let closing = Closing {
        column: true,
        row_above: even && half_step_from(0.0, to_pole),
        row_below: even && half_step_from((height - 1) as f64, -to_pole),
    };
    let above = usize::from(closing.row_above);
    let rows = height + above + usize::from(closing.row_below);
    let [first_x, _] = affine.apply(0.0, 0.0);
    let crs = turned_to(&info.crs, first_x + full_turn / 2.0);
    let map_from_grid: Affine = affine.with_origin(0.0, -(above as f64));
    Ok((Grid::new(crs, width + 1, rows, map_from_grid)?, closing))
}

/// The same map with its cut (the meridian where it tears) half a turn from map x `middle_x`: no point falls between the
/// last column and the first.
fn turned_to(crs: &Crs, middle_x: f64) -> Crs {
    let mut crs = crs.clone();
    match &mut crs.projection {
        Projection::Geographic { lon_center_deg } => *lon_center_deg = middle_x,
        Projection::Equirectangular { lat_ts_rad, lon0_rad, false_easting_m, radius_m, .. } => {
            let shift = middle_x - *false_easting_m;
            *lon0_rad += shift / (*radius_m * lat_ts_rad.cos());
            *false_easting_m += shift;
        }
        Projection::PolarStereographic { .. } | Projection::Orthographic { .. } => {}
    }
    crs
}
