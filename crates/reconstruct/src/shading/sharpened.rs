//! A sharpened elevation model on the model's own grid: what shading has changed, carried along the lines of the cells.

use super::known_ground::KnownGround;
use super::patch::Patch;
use super::{Shaded, answer::inside};
use crate::field::filter;
use selenograph_geometry::Vector3;
use selenograph_raster::{Raster, resample};

/// The change of a known ground as a function of its points.
pub struct Sharpened<'a> {
    patch: &'a Patch,
    ground: KnownGround<'a>,
    /// Heights less those of the known ground, in cells; NaN where it has none.
    change: Raster<f32>,
    spline: Raster<f32>,
}

/// Steps with which a vertical is brought to the surface.
const STEPS: usize = 12;
/// Distance from the surface at which they end, in cells.
const REACHED: f64 = 1e-4;
/// Least rise over the surface for a step along the vertical.
const LEAST_RISE: f64 = 0.1;

impl Shaded {
    /// The change of the ground that this began with; `None` where it began with none.
    pub fn sharpened<'a>(&'a self, ground: &KnownGround<'a>) -> Option<Sharpened<'a>> {
        let known = self.known.as_ref()?;
        let data = self.heights.data.iter().zip(&known.data).map(|(h, k)| h - k).collect();
        let change = Raster { width: known.width, height: known.height, data };
        let spline = filter::spline_coefficients(&change.map(|c| if c.is_nan() { 0.0 } else { *c }));
        Some(Sharpened { patch: &self.patch, ground: *ground, change, spline })
    }
}

impl Sharpened<'_> {
    /// By how much the surface lies over a point of the known ground, along the unit vector `up`, in the scene's unit; `None` outside
    /// the cells and where the ground is not known.
    ///
    /// What the ground shows finer than the cells stays: it is the change that is smooth between them.
    pub fn rise(&self, point: &Vector3<f64>, up: &Vector3<f64>) -> Option<f64> {
        let cell = self.patch.cell;
        let over = |rise: f64| {
            let [x, y, height] = self.place(&(point + up * (rise * cell)));
            let known = self.ground.height_on_line(self.patch, x, y, f64::from(height))?;
            Some(f64::from(height) - known - self.change(x, y)?)
        };
        let mut rise = 0.0;
        let mut above = over(rise)?;
        let mut gain = 1.0f64;
        for _ in 0..STEPS {
            if above.abs() < REACHED {
                break;
            }
            let step = -above / gain;
            let next = over(rise + step)?;
            gain = ((next - above) / step).max(LEAST_RISE);
            (rise, above) = (rise + step, next);
        }
        Some(rise * cell)
    }

    /// Value of a raster on the cells at the line of a point, between the cells' middles; `None` outside them and where one that
    /// counts is absent.
    pub fn value(&self, raster: &Raster<f32>, point: &Vector3<f64>) -> Option<f32> {
        let [x, y, _] = self.place(point);
        resample::bilinear(raster, f64::from(x), f64::from(y)).map(|v| v as f32)
    }

    fn change(&self, x: f32, y: f32) -> Option<f64> {
        // Absent ones beside it make it absent; the spline alone would take them for unchanged.
        resample::bilinear(&self.change, f64::from(x), f64::from(y))?;
        let (x, y) = inside(&self.spline, x, y)?;
        Some(f64::from(filter::spline_at(&self.spline, x, y).0))
    }

    fn place(&self, point: &Vector3<f64>) -> [f32; 3] {
        self.patch.place(point)
    }
}
