//! Several layers as one surface.

use crate::{Error, Layer};
use selenograph_geometry::{Body, Point3};

/// One surface made of layers, finest first: a point belongs to the first layer whose node rectangle contains it.
#[derive(Clone)]
pub struct Terrain {
    /// The sphere heights are measured from.
    pub body: Body,
    /// Finest first.
    pub layers: Vec<Layer>,
}

/// The surface below or above a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceSample {
    /// Height above the sphere, metres.
    pub height_m: f64,
    /// Which layer carries it.
    pub layer_idx: usize,
    /// Effective cell size there, metres.
    pub cell_m: f64,
}

impl Terrain {
    /// A terrain from layers that share a sphere, finest first.
    ///
    /// # Errors
    /// [`Error::Geometry`] for layers on different spheres; [`Error::Grid`] without layers, or not ordered from fine to coarse.
    pub fn new(body: Body, layers: Vec<Layer>) -> Result<Self, Error> {
        if layers.is_empty() {
            return Err(Error::Grid { expected: "at least one layer", found: "none".into() });
        }
        for (idx, layer) in layers.iter().enumerate() {
            layer.grid.crs.body.same_sphere(format_args!("layer {idx}"), &body, "the terrain")?;
        }
        if let Some(pair) = layers.windows(2).find(|pair| pair[0].cell_m > pair[1].cell_m) {
            return Err(Error::Grid {
                expected: "layers ordered from fine to coarse",
                found: format!("{} m before {} m", pair[0].cell_m, pair[1].cell_m),
            });
        }
        Ok(Self { body, layers })
    }

    /// The layer that a point belongs to and its grid coordinates there.
    pub fn owner(&self, point: &Point3<f64>) -> Option<(usize, [f64; 2])> {
        self.layers.iter().enumerate().find_map(|(idx, layer)| {
            let at = layer.grid.grid_from_point(point)?;
            layer.grid.contains(at).then_some((idx, at))
        })
    }

    /// The surface along the radius through a point; `None` outside every layer or where the height is absent.
    pub fn sample(&self, point: &Point3<f64>) -> Option<SurfaceSample> {
        let (layer_idx, at) = self.owner(point)?;
        let layer = &self.layers[layer_idx];
        let (height_m, ..) = layer.bilinear(at)?;
        Some(SurfaceSample { height_m, layer_idx, cell_m: layer.effective_cell_m(at) })
    }

    /// Lowest and highest height of all layers, metres.
    pub fn height_range(&self) -> (f64, f64) {
        self.layers.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), layer| {
            (low.min(f64::from(layer.height_range.0)), high.max(f64::from(layer.height_range.1)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Grid;
    use selenograph_geometry::{Geodetic, Projection, proj_string::Crs};
    use selenograph_raster::georef::Affine;

    fn cap(cell: f64, half: usize, height: impl Fn(f64, f64) -> f32) -> Layer {
        let body = Body::moon();
        let crs = Crs { projection: Projection::south_polar(body.radius_m), body };
        let n = 2 * half + 1;
        let at = |i: usize| (i as f64 - half as f64) * cell;
        let heights = (0..n * n).map(|k| height(at(k % n), -at(k / n))).collect();
        let corner = -(half as f64) * cell;
        let affine = Affine::new([corner, cell, 0.0, -corner, 0.0, -cell]);
        Layer::from_heights(Grid::new(crs, n, n, affine).unwrap(), heights).unwrap()
    }

    #[test]
    fn the_finest_layer_owns_a_point_and_planes_are_reproduced() {
        let plane = |x: f64, y: f64| (0.1 * x - 0.05 * y + 7.0) as f32;
        let terrain = Terrain::new(Body::moon(), vec![cap(5.0, 100, plane), cap(40.0, 100, plane)]).unwrap();
        let map = Projection::south_polar(terrain.body.radius_m);
        for (x, y, layer) in [(12.0, 33.0, 0), (499.0, -499.0, 0), (501.0, 0.0, 1), (-3000.0, 200.0, 1)] {
            let point = terrain.body.point(&map.place_from_map(x, y).unwrap());
            let sample = terrain.sample(&point).unwrap();
            assert_eq!(sample.layer_idx, layer);
            assert!((sample.height_m - f64::from(plane(x, y))).abs() < 1e-3);
            assert!((sample.cell_m - terrain.layers[layer].cell_m).abs() < 1e-9);
        }
        assert!(terrain.sample(&terrain.body.point(&Geodetic::from_deg(10.0, 0.0, 0.0))).is_none());
    }

    #[test]
    fn the_c1_surface_reproduces_planes_with_their_slope() {
        let layer = cap(10.0, 20, |x, y| (0.2 * x + 0.3 * y) as f32);
        let (h, hc, hr) = layer.quadratic_b_spline([11.3, 17.8]).unwrap();
        let (hb, bc, br) = layer.bilinear([11.3, 17.8]).unwrap();
        assert!((h - hb).abs() < 1e-4 && (hc - bc).abs() < 1e-4 && (hr - br).abs() < 1e-4);
        assert!((hc - 2.0).abs() < 1e-4 && (hr + 3.0).abs() < 1e-4);
    }

    #[test]
    fn a_grid_without_heights_is_refused() {
        let body = Body::moon();
        let crs = Crs { projection: Projection::south_polar(body.radius_m), body };
        let grid = Grid::new(crs, 3, 3, Affine::new([0.0, 1.0, 0.0, 0.0, 0.0, -1.0])).unwrap();
        assert!(matches!(Layer::from_heights(grid, vec![f32::NAN; 9]), Err(Error::AllAbsent { .. })));
    }
}
