//! The terrain that a finer model is fitted onto, seen from the finer grid.

use crate::{Grid, Terrain};
use selenograph_raster::georef::Affine;

/// The coarser terrain seen from a finer grid.
pub(super) struct Under<'a> {
    surface: &'a Terrain,
    pub fine: &'a Grid,
    /// Fine grid → grid of each layer, where both are drawn on the same map.
    links: Vec<Option<Affine>>,
}

impl<'a> Under<'a> {
    pub fn new(surface: &'a Terrain, fine: &'a Grid) -> Self {
        let links = surface
            .layers
            .iter()
            .map(|layer| {
                let same = layer.grid.crs.projection == fine.crs.projection;
                same.then(|| chain(layer.grid.grid_from_map(), fine.map_from_grid()))
            })
            .collect();
        Self { surface, fine, links }
    }

    /// Height and effective cell size under fine grid coordinates; `None` where the coarser terrain is absent.
    pub fn sample(&self, c: f64, r: f64) -> Option<(f64, f64)> {
        let mut point = None;
        for (layer, link) in self.surface.layers.iter().zip(&self.links) {
            let at = match link {
                Some(link) => link.apply(c, r),
                None => {
                    let point = match point {
                        Some(point) => point,
                        None => *point.insert(self.fine.point_from_grid(c, r, 0.0)?),
                    };
                    match layer.grid.grid_from_point(&point) {
                        Some(at) => at,
                        None => continue,
                    }
                }
            };
            if layer.grid.contains(at) {
                let (height, ..) = layer.bilinear(at)?;
                return Some((height, layer.effective_cell_m(at)));
            }
        }
        None
    }
}

/// `outer ∘ inner`.
fn chain(outer: &Affine, inner: &Affine) -> Affine {
    let [a0, a1, a2, a3, a4, a5] = outer.coefficients;
    let [b0, b1, b2, b3, b4, b5] = inner.coefficients;
    Affine::new([
        a0 + a1 * b0 + a2 * b3,
        a1 * b1 + a2 * b4,
        a1 * b2 + a2 * b5,
        a3 + a4 * b0 + a5 * b3,
        a4 * b1 + a5 * b4,
        a4 * b2 + a5 * b5,
    ])
}
