//! Terrains for the tests.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_geometry::{Body, Projection, proj_string::Crs};
use selenograph_raster::georef::Affine;
use selenograph_terrain::{Grid, Layer, Terrain};

/// Rough relief with steep walls, in metres, from map metres.
pub fn relief(x: f64, y: f64) -> f64 {
    let wave = |l: f64, a: f64, p: f64| a * (x / l + p).sin() * (y / l * 1.3 - p).cos();
    let crater = |cx: f64, cy: f64, r: f64| {
        let d = (x - cx).hypot(y - cy) / r;
        if d < 1.0 { -0.25 * r * (1.0 - d * d) } else { 0.05 * r / (d * d * d) }
    };
    wave(900.0, 120.0, 0.3)
        + wave(210.0, 25.0, 1.0)
        + wave(60.0, 6.0, 2.0)
        + crater(300.0, -200.0, 400.0)
        + crater(-900.0, 700.0, 250.0)
        + crater(0.0, 0.0, 90.0)
}

/// A square layer of `2 half + 1` nodes a side round `origin` (map metres), with hashed roughness.
pub fn layer(
    projection: Projection,
    body: &Body,
    origin: [f64; 2],
    cell: f64,
    half: usize,
    rough: f64,
) -> Layer {
    let n = 2 * half + 1;
    let corner = half as f64 * cell;
    let affine = Affine::new([origin[0] - corner, cell, 0.0, origin[1] + corner, 0.0, -cell]);
    let crs = Crs { body: body.clone(), projection };
    let grid = Grid::new(crs, n, n, affine).unwrap();
    let heights = (0..n * n)
        .map(|k| {
            let [x, y] = affine.apply((k % n) as f64, (k / n) as f64);
            (relief(x - origin[0], y - origin[1]) + rough * ((k as f64 * 12.9898).sin() * 43_758.545).fract())
                as f32
        })
        .collect();
    Layer::from_heights(grid, heights).unwrap()
}

/// A finer layer inside a coarser one, equal to it at the rim and rough inside: what nesting makes.
pub fn nested(body: &Body, projection: Projection, origin: [f64; 2]) -> Terrain {
    let coarse = layer(projection, body, origin, 20.0, 120, 0.0);
    let fine = layer(projection, body, origin, 10.0, 80, 2.0);
    let (n, grid) = (fine.grid.cols, fine.grid.clone());
    let heights = (0..n * n)
        .map(|k| {
            let (i, j) = (k % n, k / n);
            let [x, y] = grid.map_from_grid().apply(i as f64, j as f64);
            let base = coarse.bilinear(coarse.grid.grid_from_map().apply(x, y)).unwrap().0;
            let rim = i.min(j).min(n - 1 - i).min(n - 1 - j) as f64;
            let w = (rim / 8.0).min(1.0);
            (base + w * (f64::from(fine.node(i, j)) - base)) as f32
        })
        .collect();
    Terrain::new(body.clone(), vec![Layer::from_heights(grid, heights).unwrap(), coarse]).unwrap()
}
