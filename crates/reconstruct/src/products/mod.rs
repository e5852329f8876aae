//! Everything a reconstruction leaves behind, written into a folder: pointmaps, matches, clouds, elevation models.
//!
//! Each file is whole or not there: it is written beside its place and renamed. `products.json` comes last, so a folder
//! that holds it is complete.

mod arrays;
mod input;
mod shading;
mod tif;
mod transform;

pub use input::ProductInput;
pub use shading::{ALBEDO_NAME, CellLayer, OF_PICTURES};

use crate::Error;
use crate::cloud::{self, Cloud, CloudOptions};
use crate::grid::lift::Lifted;
use crate::grid::{self, Completed, Dem, GridOptions};
use crate::hazard::{self, Hazard, HazardMap, HazardOptions};
use crate::matches_file;
use crate::prediction::Fill;
use crate::scale::ScaleSource;
use rayon::prelude::*;
use selenograph_geometry::proj_string;
use selenograph_raster::statistics::{median, summary};
use selenograph_raster::{Raster, gradient};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of `products.json`; a reader refuses a newer one.
pub const PRODUCTS_VERSION: u32 = 1;
/// Name of the summary.
pub const SUMMARY_NAME: &str = "products.json";

/// What goes into the products.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProductOptions {
    /// The grid.
    pub grid: GridOptions,
    /// The clouds.
    pub cloud: CloudOptions,
    /// The lander's limits.
    pub hazard: HazardOptions,
    /// Light of the hillshade: azimuth clockwise from the raster's upward direction, degrees.
    pub light_azimuth_deg: f64,
    /// Light of the hillshade above the horizon, degrees.
    pub light_elevation_deg: f64,
    /// The number written where rasters of floats are absent; NaN if `None`.
    pub nodata: Option<f32>,
}

impl Default for ProductOptions {
    fn default() -> Self {
        Self {
            grid: GridOptions::default(),
            cloud: CloudOptions::default(),
            hazard: HazardOptions::default(),
            // From the upper left, as maps are shaded by custom.
            light_azimuth_deg: 315.0,
            light_elevation_deg: 30.0,
            nodata: None,
        }
    }
}

/// The rasters and the cloud before they are written, for whoever shows them.
#[derive(Debug, Clone)]
pub struct Products {
    /// Heights and their sigma.
    pub dem: Dem,
    /// Slope by Horn's kernel, radians.
    pub slope_rad: Raster<f32>,
    /// Cosine of the incidence angle.
    pub hillshade: Raster<f32>,
    /// Classes, slope and roughness over the lander's footprint.
    pub hazard: HazardMap,
    /// Both views' points.
    pub cloud: Cloud,
    /// What shading tells of the cells; none where it took no part.
    pub layers: Vec<CellLayer>,
    /// The number that the files of rasters of floats hold where they are absent; NaN if `None`.
    pub nodata: Option<f32>,
    /// What `products.json` says.
    pub summary: ProductSummary,
}

/// A file that was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct WrittenFile {
    /// Its name in the folder.
    pub name: String,
    /// Its size.
    pub bytes: u64,
}

/// What `products.json` says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProductSummary {
    /// `selenograph.products`.
    pub format: String,
    /// [`PRODUCTS_VERSION`].
    pub version: u32,
    /// Whether lengths are metres; else they are baselines.
    pub metric: bool,
    /// Where the size comes from: `none`, `baseline`, `altitude`, `dem`, `points`, `pose`.
    pub scale_source: String,
    /// Length of the prediction's unit here.
    pub scale: f64,
    /// Standard deviation of the scale as a fraction of it; absent where it is not known.
    pub scale_sigma: Option<f64>,
    /// PROJ string of the map; absent for a local grid.
    pub crs: Option<String>,
    /// The grid's coordinates in words.
    pub frame: String,
    /// Columns and rows of the grid.
    pub grid_size: [usize; 2],
    /// Side of a cell in map units.
    pub cell: f64,
    /// Left, lower, right and upper edge of the grid.
    pub extent: [f64; 4],
    /// Share of the grid's cells that hold a height.
    pub coverage: f64,
    /// Least and largest height.
    pub height_range: [f64; 2],
    /// Median sigma of the heights; absent where the method has none.
    pub sigma_median: Option<f64>,
    /// Median slope, degrees.
    pub slope_median_deg: Option<f64>,
    /// Share of the covered cells in each class of the hazard map.
    pub hazard: HazardSummary,
    /// Share of the pixels of view A and of view B that were measured.
    pub measured: [f64; 2],
    /// Share of the pixels of view A and of view B that were completed.
    pub completed: [f64; 2],
    /// Number of points of the clouds.
    pub num_points: usize,
    /// The files.
    pub files: Vec<WrittenFile>,
}

/// Shares of the hazard classes and the limits behind them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HazardSummary {
    /// Safe.
    pub safe: f64,
    /// Too steep.
    pub slope: f64,
    /// Too rough.
    pub roughness: f64,
    /// Too steep and too rough.
    pub both: f64,
    /// Cannot be told.
    pub unknown: f64,
    /// Steepest ground allowed, degrees.
    pub max_slope_deg: f64,
    /// Roughest ground allowed, the grid's unit.
    pub max_roughness: f64,
    /// Side of the lander's footprint that was used, the grid's unit.
    pub footprint: f64,
    /// Whether sigma took part.
    pub sigma_aware: bool,
}

/// Makes everything in memory.
///
/// # Errors
/// [`Error::TooFewPoints`] for a prediction without a surface, and those of [`grid::grid`], [`hazard::hazard`] and
/// gathering the cloud.
pub fn make(input: &ProductInput, options: &ProductOptions) -> Result<Products, Error> {
    let (dem, lifted) = grid::grid(input.prediction, input.placement, &options.grid)?;
    let pictures = input.views.map(|view| &view.image);
    let cloud_options = CloudOptions {
        completed: options.cloud.completed || options.grid.completed == Completed::Include,
        ..options.cloud.clone()
    };
    let (cloud, (shaded, hazard)) = rayon::join(
        || cloud::gather(&lifted, &dem.frame, pictures, &cloud_options),
        || rayon::join(|| shade(&dem, options), || hazard::hazard(&dem, &options.hazard)),
    );
    let (cloud, hazard, (slope_rad, hillshade)) = (cloud?, hazard?, shaded);
    let layers = input.shaded.map_or_else(Vec::new, |shaded| shading::layers(shaded, &dem));
    let summary = summarise(input, options, &dem, &slope_rad, &hazard, &cloud, &lifted);
    Ok(Products { dem, slope_rad, hillshade, hazard, cloud, layers, nodata: options.nodata, summary })
}

/// Makes everything and writes it into `folder`, which is made if it is not there.
///
/// # Errors
/// Those of [`make`]; [`Error::Io`] and [`Error::Raster`] if a file cannot be written.
pub fn write(folder: &Path, input: &ProductInput, options: &ProductOptions) -> Result<Products, Error> {
    let mut products = make(input, options)?;
    std::fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    // The longest first, one at a time per thread.
    let tasks: Vec<Task> = tasks(input);
    let written = |name: &str| -> Result<WrittenFile, Error> {
        let path = folder.join(name);
        let bytes = std::fs::metadata(&path).map_err(Error::io("read", &path))?.len();
        Ok(WrittenFile { name: name.to_owned(), bytes })
    };
    let of_tasks = tasks.par_iter().with_max_len(1).map(|task| {
        (task.write)(&folder.join(task.name), input, &products)?;
        written(task.name)
    });
    let of_layers = products.layers.par_iter().with_max_len(1).map(|layer| {
        tif::write(&folder.join(layer.file), &products, &layer.values, layer.name, "")?;
        written(layer.file)
    });
    let files: Result<Vec<WrittenFile>, Error> = of_tasks.chain(of_layers).collect();
    products.summary.files = files?;
    products.summary.files.sort_by(|a, b| a.name.cmp(&b.name));
    let text = serde_json::to_string_pretty(&products.summary).map_err(|e| Error::Format {
        path: folder.join(SUMMARY_NAME),
        expected: "a summary that JSON can hold".to_owned(),
        found: e.to_string(),
    })?;
    write_whole(&folder.join(SUMMARY_NAME), text.as_bytes())?;
    Ok(products)
}

/// A file and what makes it.
struct Task {
    name: &'static str,
    write: fn(&Path, &ProductInput, &Products) -> Result<(), Error>,
}

fn tasks(input: &ProductInput) -> Vec<Task> {
    let mut tasks = vec![
        Task { name: "cloud.las", write: |path, _, p| write_whole(path, &cloud::las::encode(&p.cloud)) },
        Task { name: "pointmaps.npz", write: |path, input, _| write_whole(path, &arrays::pointmaps(input)?) },
        Task {
            name: "dem.tif",
            write: |path, _, p| tif::write(path, p, &p.dem.heights, "height", tif::length_unit(&p.dem)),
        },
        Task {
            name: "dem_sigma.tif",
            write: |path, _, p| {
                tif::write(path, p, &p.dem.sigma, "sigma of height", tif::length_unit(&p.dem))
            },
        },
        Task {
            name: "slope.tif",
            write: |path, _, p| tif::write(path, p, &p.slope_rad.map(|s| s.to_degrees()), "slope", "degree"),
        },
        Task {
            name: "hillshade.tif",
            write: |path, _, p| tif::write(path, p, &p.hillshade, "cosine of incidence", ""),
        },
        Task { name: "cloud.ply", write: |path, _, p| write_whole(path, &cloud::ply::encode(&p.cloud)) },
        Task { name: "cloud.glb", write: |path, _, p| write_whole(path, &cloud::glb::encode(&p.cloud)) },
        Task { name: "hazard.tif", write: |path, _, p| tif::write_classes(path, &p.dem, &p.hazard.classes) },
        Task {
            name: "hazard.tif.aux.xml",
            write: |path, _, _| write_whole(path, tif::class_names().as_bytes()),
        },
    ];
    tasks.push(Task {
        name: "transform.json",
        write: |path, _, p| write_whole(path, transform::transform(&p.dem)?.as_bytes()),
    });
    if input.matches.is_some() {
        tasks.push(Task {
            name: "matches.npz",
            write: |path, input, _| write_whole(path, &arrays::matches(input)?),
        });
        tasks.push(Task {
            name: "matches.csv",
            write: |path, input, _| {
                write_whole(path, matches_file::encode(input.matches.unwrap_or_default()).as_bytes())
            },
        });
    }
    tasks
}

fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    Ok(selenograph_files::write(path, bytes)?)
}

/// Slope (radians) by Horn's kernel, and hillshade under the light of the options.
pub fn shade(dem: &Dem, options: &ProductOptions) -> (Raster<f32>, Raster<f32>) {
    let gradient = gradient::horn(&dem.heights, dem.ground_cell());
    let light = [options.light_azimuth_deg.to_radians(), options.light_elevation_deg.to_radians()];
    (gradient.slope_rad(), gradient.hillshade(light[0], light[1]))
}

fn summarise(
    input: &ProductInput,
    options: &ProductOptions,
    dem: &Dem,
    slope_rad: &Raster<f32>,
    hazard: &HazardMap,
    cloud: &Cloud,
    lifted: &Lifted,
) -> ProductSummary {
    let (width, height) = (dem.heights.width, dem.heights.height);
    let [left, top] = dem.map_from_pixel.apply(0.0, 0.0);
    let [right, bottom] = dem.map_from_pixel.apply(width as f64, height as f64);
    let heights = summary(dem.heights.data.iter().map(|h| f64::from(*h)));
    let share = |fill: Fill| {
        lifted.views.each_ref().map(|view| {
            let count = view.fill.data.iter().filter(|f| **f == fill).count();
            count as f64 / view.fill.data.len().max(1) as f64
        })
    };
    let of = |raster: &Raster<f32>| median(raster.data.iter().map(|v| f64::from(*v)));
    ProductSummary {
        format: "selenograph.products".to_owned(),
        version: PRODUCTS_VERSION,
        metric: input.placement.metric,
        scale_source: input.placement.source.map_or("none", ScaleSource::as_str).to_owned(),
        scale: input.placement.cam_a_from_pred.scale(),
        scale_sigma: input.placement.scale_sigma,
        crs: dem.frame.crs().map(proj_string::format),
        frame: cloud.frame.clone(),
        grid_size: [width, height],
        cell: dem.cell,
        extent: [left, bottom, right, top],
        coverage: dem.coverage(),
        height_range: heights.map_or([0.0; 2], |h| [h.min, h.max]),
        sigma_median: of(&dem.sigma),
        slope_median_deg: of(slope_rad).map(f64::to_degrees),
        hazard: hazard_summary(dem, hazard, options),
        measured: share(Fill::Measured),
        completed: share(Fill::Completed),
        num_points: cloud.points.len(),
        files: Vec::new(),
    }
}

fn hazard_summary(dem: &Dem, map: &HazardMap, options: &ProductOptions) -> HazardSummary {
    let covered = dem.heights.data.iter().filter(|h| !h.is_nan()).count().max(1) as f64;
    let cells = || map.classes.data.iter().zip(&dem.heights.data).filter(|(_, h)| !h.is_nan());
    let share = |class: Hazard| cells().filter(|(c, _)| **c == class).count() as f64 / covered;
    HazardSummary {
        safe: share(Hazard::Safe),
        slope: share(Hazard::Slope),
        roughness: share(Hazard::Roughness),
        both: share(Hazard::Both),
        unknown: share(Hazard::Unknown),
        max_slope_deg: options.hazard.max_slope_deg,
        max_roughness: map.max_roughness,
        footprint: map.footprint,
        sigma_aware: map.sigma_aware,
    }
}

#[cfg(test)]
mod tests;
