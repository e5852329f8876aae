//! Heights that a plan asks the terrain for.

use selenograph_geometry::{Geodetic, Point3};
use selenograph_terrain::Terrain;

/// Median and spread of the heights round a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Median height above the sphere, metres.
    pub median_m: f64,
    /// Highest less lowest, metres.
    pub relief_m: f64,
}

/// Heights asked along each side of a footprint.
const FOOTPRINT_SIDE: usize = 9;

/// Median height and relief of the square of ground round a place; `None` if any of it is absent.
pub fn footprint(terrain: &Terrain, place: &Geodetic, width_m: f64) -> Option<Footprint> {
    let body = &terrain.body;
    let axes = body.body_from_enu(&Geodetic { height_m: 0.0, ..*place });
    let step = width_m / (FOOTPRINT_SIDE - 1) as f64;
    let offset = |k: usize| k as f64 * step - width_m / 2.0;
    let mut heights = Vec::with_capacity(FOOTPRINT_SIDE * FOOTPRINT_SIDE);
    for j in 0..FOOTPRINT_SIDE {
        for i in 0..FOOTPRINT_SIDE {
            let point = axes.point(&Point3::new(offset(i), offset(j), 0.0));
            heights.push(terrain.sample(&point)?.height_m);
        }
    }
    heights.sort_by(f64::total_cmp);
    Some(Footprint {
        median_m: heights[heights.len() / 2],
        relief_m: heights[heights.len() - 1] - heights[0],
    })
}

/// Height of a point over the terrain on the same radius, metres; `None` where the terrain is absent.
pub fn clearance_m(terrain: &Terrain, point: &Point3<f64>) -> Option<f64> {
    Some(terrain.body.height_m(point) - terrain.sample(point)?.height_m)
}
