//! Shadow at exact points: the horizon's blocks decide most, the exact tracer the rest.

use crate::Tracer;
use crate::horizon::Horizon;
use crate::sun::SunDisc;
use rayon::prelude::*;
use selenograph_geometry::{Point3, UnitVector3};

/// What hides one direction from the points of one picture.
pub(crate) struct Shade<'a> {
    tracer: &'a Tracer<'a>,
    sun: SunDisc,
    horizons: Vec<Option<Horizon>>,
}

impl<'a> Shade<'a> {
    /// For the surface points of a picture and the centre of a Sun.
    pub(crate) fn new(tracer: &'a Tracer<'a>, sun: &crate::Sun, points: &[Option<Point3<f64>>]) -> Self {
        let terrain = tracer.terrain();
        let sun = SunDisc::new(&sun.as_point());
        let none = || vec![None::<[f64; 4]>; terrain.layers.len()];
        let widened = |mut boxes: Vec<Option<[f64; 4]>>, idx: usize, b: [f64; 4]| {
            let all = boxes[idx].get_or_insert(b);
            *all = [all[0].min(b[0]), all[1].min(b[1]), all[2].max(b[2]), all[3].max(b[3])];
            boxes
        };
        let ground = points
            .par_iter()
            .flatten()
            .filter_map(|p| terrain.owner(p))
            .fold(none, |boxes, (idx, [c, r])| widened(boxes, idx, [c, r, c, r]))
            .reduce(none, |a, b| {
                b.iter().enumerate().fold(a, |a, (idx, b)| match b {
                    Some(b) => widened(a, idx, *b),
                    None => a,
                })
            });
        let horizons = ground
            .iter()
            .enumerate()
            .map(|(idx, ground)| ground.and_then(|ground| Horizon::new(terrain, idx, ground, &sun)))
            .collect();
        Self { tracer, sun, horizons }
    }

    /// Whether the ground hides the Sun's centre from a point of the surface.
    pub(crate) fn hides(&self, point: &Point3<f64>) -> bool {
        occluded(self.tracer, &self.horizons, point, &self.sun.sun.direction)
    }
}

/// Whether the ground hides a direction on a Sun's disc from a point of the surface, with the help of that Sun's horizons.
pub(crate) fn occluded(
    tracer: &Tracer<'_>,
    horizons: &[Option<Horizon>],
    point: &Point3<f64>,
    towards: &UnitVector3<f64>,
) -> bool {
    by_blocks(tracer, horizons, point, towards)
        .unwrap_or_else(|| tracer.occluded(*point, towards.into_inner()))
}

/// The answer of the blocks, with an exact ray only as far as the next column; `None` if they have none.
fn by_blocks(
    tracer: &Tracer<'_>,
    horizons: &[Option<Horizon>],
    point: &Point3<f64>,
    towards: &UnitVector3<f64>,
) -> Option<bool> {
    /// Long against rounding, short against a cell.
    const STEP_M: f64 = 0.1;
    let terrain = tracer.terrain();
    let (idx, at) = terrain.owner(point)?;
    let horizon = horizons.get(idx)?.as_ref()?;
    let grid = &terrain.layers[idx].grid;
    let towards = towards.into_inner();
    let m = &horizon.block_from_grid;
    let uv = |[c, r]: [f64; 2]| [m[0] * c + m[1] * r + m[2], m[3] * c + m[4] * r + m[5]];
    let [u, _] = uv(at);
    let [ahead, _] = uv(grid.grid_from_point(&(point + towards * STEP_M))?);
    let per_m = (ahead - u) / STEP_M;
    if per_m <= 0.0 {
        return None;
    }
    // The next column by count: at its border rounding could put the point on either side.
    let column = u.floor() + 1.0;
    let leave = (column - u) / per_m;
    let next = point + towards * leave;
    let [_, v] = uv(grid.grid_from_point(&next)?);
    let strip = v.floor();
    if column < 0.0 || strip < 0.0 || column > horizon.columns as f64 || strip >= horizon.strips as f64 {
        return None;
    }
    let n = strip as usize * (horizon.columns + 1) + column as usize;
    let height = terrain.body.height_m(&next);
    if height < f64::from(horizon.dark_below[n]) {
        return Some(true);
    }
    (height >= f64::from(horizon.lit_above[n])).then(|| tracer.occluded_between(*point, towards, 0.0, leave))
}
