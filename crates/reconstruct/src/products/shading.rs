//! What shading knows of each cell of the elevation model: albedo, pictures and residuals, carried from the surface's own cells.

use crate::grid::Dem;
use crate::shading::Shaded;
use rayon::prelude::*;
use selenograph_geometry::pixel;
use selenograph_raster::{Raster, resample};

/// A raster on the grid of the elevation model.
#[derive(Debug, Clone)]
pub struct CellLayer {
    /// Its file.
    pub file: &'static str,
    /// What it is.
    pub name: &'static str,
    /// Its values; NaN where no picture shows the ground lit, and where the model has no height.
    pub values: Raster<f32>,
}

/// File of the albedo.
pub const ALBEDO_NAME: &str = "albedo.tif";

/// A raster on the surface's cells, and what it is in the files.
struct Source {
    file: &'static str,
    name: &'static str,
    cells: Raster<f32>,
}

/// Files of a picture's model and residual: of A and of B.
pub const OF_PICTURES: [[&str; 2]; 2] =
    [["model_a.tif", "residual_a.tif"], ["model_b.tif", "residual_b.tif"]];

/// Everything of the surface's cells that becomes a file.
fn sources(shaded: &Shaded) -> Vec<Source> {
    // Without a picture it is what the prior says.
    let shown = |values: Vec<f32>| {
        let shown = values.iter().zip(&shaded.num_seen.data);
        Raster {
            width: shaded.num_seen.width,
            height: shaded.num_seen.height,
            data: shown.map(|(v, seen)| if *seen == 0 { f32::NAN } else { *v }).collect(),
        }
    };
    let albedo: Vec<f32> = shaded.log_albedo.data.iter().map(|log| log.exp()).collect();
    let albedo_sigma = albedo.iter().zip(&shaded.albedo_sigma.data).map(|(a, sigma)| a * sigma).collect();
    let of_ground = [
        Source { file: ALBEDO_NAME, name: "albedo against the mean", cells: shown(albedo) },
        Source {
            file: "albedo_sigma.tif",
            name: "standard deviation of the albedo",
            cells: shown(albedo_sigma),
        },
        Source {
            file: "slope_sigma.tif",
            name: "standard deviation of the slope's tangent",
            cells: shaded.slope_sigma.clone(),
        },
    ];
    let of_pictures = OF_PICTURES.iter().zip(&shaded.compared).flat_map(|([model, residual], compared)| {
        [
            Source {
                file: model,
                name: "the model's picture, in the lit mean",
                cells: compared.model.clone(),
            },
            Source {
                file: residual,
                name: "picture less model, in the lit mean",
                cells: compared.residual(),
            },
        ]
    });
    of_ground.into_iter().chain(of_pictures).collect()
}

/// The surface's rasters on the grid of the elevation model, each at the middle of the cell on its ground.
pub fn layers(shaded: &Shaded, dem: &Dem) -> Vec<CellLayer> {
    let (width, height) = (dem.heights.width, dem.heights.height);
    let place = |i: usize| {
        let ground = dem.heights.data[i];
        let [x, y] = dem.map_from_pixel.apply(pixel::center_of(i % width), pixel::center_of(i / width));
        let point = dem.frame.point_in_pred([x, y, f64::from(ground)]).filter(|_| ground.is_finite())?;
        Some(shaded.patch.place(&point.coords))
    };
    let places: Vec<Option<[f32; 3]>> = (0..width * height).into_par_iter().map(place).collect();
    let carried = |source: Source| {
        let value = |place: &Option<[f32; 3]>| {
            let [x, y, _] = (*place)?;
            resample::bilinear(&source.cells, f64::from(x), f64::from(y)).map(|value| value as f32)
        };
        let data = places.par_iter().map(|place| value(place).unwrap_or(f32::NAN)).collect();
        CellLayer { file: source.file, name: source.name, values: Raster { width, height, data } }
    };
    sources(shaded).into_iter().map(carried).collect()
}
