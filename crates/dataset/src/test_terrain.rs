//! Terrains that the tests of this crate fly over.

use selenograph_geometry::{Body, Projection, Vector2, proj_string::Crs};
use selenograph_raster::Affine;
use selenograph_terrain::{Grid, Layer, Terrain};
use std::sync::OnceLock;

/// A square cap round the south pole: `2 · half + 1` nodes along each side.
pub fn cap(cell_m: f64, half: usize, height: impl Fn(f64, f64) -> f64) -> Layer {
    let body = Body::moon();
    let crs = Crs { projection: Projection::south_polar(body.radius_m), body };
    let n = 2 * half + 1;
    let at = |i: usize| (i as f64 - half as f64) * cell_m;
    let heights = (0..n * n).map(|k| height(at(k % n), -at(k / n)) as f32).collect();
    let corner = -(half as f64) * cell_m;
    let affine = Affine::new([corner, cell_m, 0.0, -corner, 0.0, -cell_m]);
    Layer::from_heights(Grid::new(crs, n, n, affine).unwrap(), heights).unwrap()
}

/// Hills from 3 km to 40 km wide, some 1.5 km high, and a flat plain round one place.
pub fn hills(x: f64, y: f64) -> f64 {
    let waves = [(41e3, 600.0, 0.3), (17e3, 250.0, 1.9), (7e3, 90.0, 4.0), (3.1e3, 40.0, 2.2)];
    let sum: f64 = waves
        .iter()
        .map(|(length, height, turn): &(f64, f64, f64)| {
            let k = std::f64::consts::TAU / length;
            let along = Vector2::new(turn.cos(), turn.sin()) * k;
            height * ((along.x * x + along.y * y).sin() + (along.y * x - along.x * y + turn).cos())
        })
        .sum();
    sum - 500.0
}

/// ±150 km of hills in cells of 200 m.
pub fn wide() -> &'static Terrain {
    static TERRAIN: OnceLock<Terrain> = OnceLock::new();
    TERRAIN.get_or_init(|| Terrain::new(Body::moon(), vec![cap(200.0, 750, hills)]).unwrap())
}

/// A 20 m site of ±12 km inside the wide cap.
pub fn nested() -> &'static Terrain {
    static TERRAIN: OnceLock<Terrain> = OnceLock::new();
    TERRAIN.get_or_init(|| {
        Terrain::new(Body::moon(), vec![cap(20.0, 600, hills), cap(200.0, 750, hills)]).unwrap()
    })
}
