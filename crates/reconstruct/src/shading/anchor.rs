//! What is known of the heights on the cells, stereo's answer or an elevation model: where the surface starts, and what holds it
//! where shading does not tell.

use super::globals::{Global, Globals};
use super::linearise::{Axes, Linearised, Surface};
use super::patch::Patch;
use crate::grid::lift::{Lifted, LiftedView};
use crate::grid::mesh;
use crate::grid::rasterise::{self, Gathered, Layout};
use crate::prediction::PredictedView;
use selenograph_geometry::{Point3, Vector3};
use selenograph_raster::Raster;

/// Heights with their precisions, in cells of one level.
#[derive(Debug, Clone)]
pub(super) struct Anchor {
    pub(super) heights: Raster<f32>,
    /// `1/σ²`, 0 where there is nothing.
    pub(super) precision: Raster<f32>,
    /// What is known of means over several cells.
    pub(super) means: Option<Means>,
    /// Share of its precision that each cell counts with: neighbours err together.
    pub(super) share: f32,
    /// Whether it was measured with the first two cameras' poses, and is another under others.
    pub(super) follows_pose: bool,
}

/// Means over squares of cells around each cell, of the differences from what is known.
#[derive(Debug, Clone, Copy)]
pub(super) struct Means {
    /// Side of the squares, in cells.
    pub(super) side: f64,
    /// `1/σ²`.
    pub(super) precision: f32,
}

impl Means {
    /// The mean about each cell; cells outside count as 0, so that the operator is its own adjoint and lengthens nothing.
    fn of(&self, values: &Raster<f32>) -> Raster<f32> {
        let reach = (0.5 * self.side).round() as usize;
        let turned = along_rows(values, reach);
        along_rows(&turned, reach)
    }
}

/// Means over `2 reach + 1` samples of each row, columns and rows exchanged.
fn along_rows(values: &Raster<f32>, reach: usize) -> Raster<f32> {
    let (width, height) = (values.width, values.height);
    let mut out = Raster::filled(height, width, 0.0);
    let share = 1.0 / (2 * reach + 1) as f64;
    for (y, row) in values.rows().enumerate() {
        let mut sum: f64 = row.iter().take(reach).map(|v| f64::from(*v)).sum();
        for x in 0..width {
            sum += row.get(x + reach).map_or(0.0, |v| f64::from(*v));
            out[(y, x)] = (share * sum) as f32;
            sum -= x.checked_sub(reach).map_or(0.0, |first| f64::from(row[first]));
        }
    }
    out
}

/// Least standard deviation that is believed, in cells.
const LEAST_SIGMA: f32 = 0.03;
/// Deviation, in standard deviations, beyond which an anchor lets go.
const OUTLIER: f32 = 3.0;

/// Plate that carries heights on, against a weight of 1 where they are known.
const CARRY_STIFFNESS: f32 = 0.01;
const CARRY_STEPS: usize = 100;
const CARRY_TOLERANCE: f64 = 1e-3;

impl Anchor {
    /// Both views' points on the cells; completed points fill cells that nothing measured covers, with their own sigma.
    pub(super) fn of_views(
        views: &[PredictedView; 2],
        eyes: [Point3<f64>; 2],
        patch: &Patch,
        share: f32,
    ) -> Self {
        let lifted = |view: &'_ PredictedView| -> Raster<[f32; 3]> {
            view.points.map(|p| {
                let p = patch.position(&Vector3::from(p.map(f64::from)));
                let p = patch.sight.place(p.map(|c| c as f32));
                // The grid's rows run downwards, a map's y upwards.
                [p[0], -p[1], p[2]]
            })
        };
        let cell = patch.cell as f32;
        let view = |k: usize| {
            let eye = patch.position(&eyes[k].coords);
            LiftedView {
                points: lifted(&views[k]),
                confidence: &views[k].confidence,
                sigma: views[k].sigma.as_ref().map(|s| s.map(|v| v / cell)),
                fill: &views[k].fill,
                center: Some([eye[0] as f32, -eye[1] as f32, eye[2] as f32]),
            }
        };
        let lifted = Lifted { origin: [0.0; 3], views: [view(0), view(1)] };
        let joins = lifted.views.each_ref().map(mesh::joins);
        let layout = Layout { left: 0.0, top: 0.0, cell: 1.0, width: patch.width, height: patch.height };
        let cells = rasterise::gather(&lifted, joins.each_ref().map(Option::as_deref), &layout, true);
        let raster = |f: &dyn Fn(&Gathered) -> f32| Raster {
            width: patch.width,
            height: patch.height,
            data: cells.iter().map(f).collect(),
        };
        Self {
            heights: raster(&|c| if c.count > 0 { (c.weighted / c.weight) as f32 } else { 0.0 }),
            precision: raster(&|c| if c.count > 0 { precision(c) } else { 0.0 }),
            means: None,
            share,
            follows_pose: true,
        }
    }

    /// The same for cells of twice the side.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.heights.width / 2, self.heights.height / 2);
        let four = |x: usize, y: usize| [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| (2 * x + i, 2 * y + j));
        let total = |x: usize, y: usize| four(x, y).map(|at| self.precision[at]).iter().sum::<f32>();
        let heights = Raster::from_fn(width, height, |x, y| {
            let sum: f32 = four(x, y).map(|at| self.precision[at] * self.heights[at]).iter().sum();
            let total = total(x, y);
            if total > 0.0 { 0.5 * sum / total } else { 0.0 }
        });
        // Errors of neighbours go together: their mean is no surer than they are, but a cell is twice as long.
        let precision = Raster::from_fn(width, height, total);
        let means =
            self.means.map(|means| Means { side: 0.5 * means.side, precision: 4.0 * means.precision });
        Self { heights, precision, means, ..*self }
    }

    /// The heights, smoothly carried on to where there are none.
    pub(super) fn carried_on(&self) -> Vec<f32> {
        let (width, height) = (self.heights.width, self.heights.height);
        let weight: Vec<f32> = self.precision.data.iter().map(|&p| if p > 0.0 { 1.0 } else { 0.0 }).collect();
        let right: Vec<f32> = weight.iter().zip(&self.heights.data).map(|(w, h)| w * h).collect();
        let mut out = self.heights.clone();
        let stiffness = Raster::filled(width, height, CARRY_STIFFNESS);
        crate::stereo::solver::Solver::new(width, height).solve(
            &mut out,
            &weight,
            &right,
            &stiffness,
            CARRY_STEPS,
            CARRY_TOLERANCE,
        );
        out.data
    }

    /// The heights, NaN where there are none.
    pub(super) fn known(&self) -> Raster<f32> {
        let mut known = self.heights.clone();
        for (height, precision) in known.data.iter_mut().zip(&self.precision.data) {
            if *precision == 0.0 {
                *height = f32::NAN;
            }
        }
        known
    }

    /// The free globals of the pose that the heights were measured with.
    fn pose(&self, globals: &Globals) -> Vec<(usize, Global)> {
        let free = globals.free.iter().map(|free| free.global).enumerate();
        free.filter(|(_, global)| self.follows_pose && global.is_of_pose(1)).collect()
    }

    /// Each cell's weight, what its height differs by, and how that changes with the pose's unknowns; cells where nothing is known
    /// are left out.
    fn for_each(
        &self,
        surface: &Surface,
        globals: &Globals,
        weight: f32,
        mut told: impl FnMut(usize, f32, f32, &[f32]),
    ) {
        let pose = self.pose(globals);
        let axes = (!pose.is_empty()).then(|| Axes::of(globals, 1));
        let mut follows = vec![0.0; pose.len()];
        for (at, &precision) in self.precision.data.iter().enumerate() {
            if precision == 0.0 {
                continue;
            }
            let mut difference = self.heights.data[at] - surface.heights[at];
            if let Some(axes) = &axes {
                let place = (at % surface.width, at / surface.width);
                let found = surface.heights_follow(place, &globals.shots[1], axes, pose.iter().map(|p| p.1));
                for ((follows, found), &(g, _)) in follows.iter_mut().zip(found).zip(&pose) {
                    *follows = found;
                    difference += found * globals.free[g].deviation as f32;
                }
            }
            let far = difference * difference * precision / (OUTLIER * OUTLIER);
            told(at, weight * self.share * precision / (1.0 + far), difference, &follows);
        }
    }

    /// Means of the differences, where there is anything to differ from.
    fn mean_differences(&self, surface: &Surface, means: &Means) -> Raster<f32> {
        let (width, height) = (self.heights.width, self.heights.height);
        let known = self.precision.data.iter().zip(&self.heights.data).zip(&surface.heights);
        let data = known.map(|((p, h), s)| if *p > 0.0 { h - s } else { 0.0 }).collect();
        means.of(&Raster { width, height, data })
    }

    /// Adds what is known to the equations.
    pub(super) fn hold(&self, surface: &Surface, globals: &Globals, weight: f32, linear: &mut Linearised) {
        let pose = self.pose(globals);
        let Linearised { cells, columns, gram, right, .. } = linear;
        self.for_each(surface, globals, weight, |at, weight, difference, follows| {
            cells[at].add(weight, [0.0, 0.0, 1.0, 0.0], difference);
            for (&(g, _), follow) in pose.iter().zip(follows) {
                columns[g][at] -= weight * follow;
                right[g] -= f64::from(weight * follow * difference);
                for (&(h, _), other) in pose.iter().zip(follows) {
                    gram[(g, h)] += f64::from(weight * follow * other);
                }
            }
        });
        let Some(means) = &self.means else { return };
        // The gradient is exact, the matrix that of single cells, which is no less than that of means: steps of short waves are a
        // little short, and never too long.
        let pulled = means.of(&self.mean_differences(surface, means));
        for ((cell, pulled), precision) in cells.iter_mut().zip(&pulled.data).zip(&self.precision.data) {
            if *precision > 0.0 {
                cell.add(weight * means.precision, [0.0, 0.0, 1.0, 0.0], *pulled);
            }
        }
    }

    pub(super) fn energy(&self, surface: &Surface, globals: &Globals, weight: f32) -> f64 {
        let mut of_cells = 0.0;
        self.for_each(surface, globals, weight, |_, weight, difference, _| {
            of_cells += f64::from(weight * difference * difference);
        });
        let of_means = self.means.as_ref().map_or(0.0, |means| {
            let weight = f64::from(weight * means.precision);
            let differences = self.mean_differences(surface, means);
            weight * differences.data.iter().map(|d| f64::from(d * d)).sum::<f64>()
        });
        of_cells + of_means
    }
}

fn precision(cell: &Gathered) -> f32 {
    let mean = cell.weighted / cell.weight;
    let disagreement = (cell.squared / cell.weight - mean * mean).max(0.0);
    let variance = f64::from(cell.count) / cell.weight + disagreement;
    1.0 / (variance as f32).max(LEAST_SIGMA * LEAST_SIGMA)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_their_own_adjoint_and_lengthen_nothing() {
        let field = |seed: usize| {
            Raster::from_fn(11, 7, |x, y| ((x * 31 + y * 17 + seed * 29) % 23) as f32 / 11.0 - 1.0)
        };
        let means = Means { side: 4.0, precision: 1.0 };
        let (a, b) = (field(1), field(2));
        let product = |a: &Raster<f32>, b: &Raster<f32>| {
            a.data.iter().zip(&b.data).map(|(a, b)| f64::from(a * b)).sum::<f64>()
        };
        let (ma, mb) = (means.of(&a), means.of(&b));
        assert!((product(&ma, &b) - product(&a, &mb)).abs() < 1e-4);
        assert!(product(&ma, &ma) < product(&a, &a));
        // Far from the edge a plane stays as it is.
        let plane = Raster::from_fn(11, 11, |x, y| x as f32 - 2.0 * y as f32);
        assert!((means.of(&plane)[(5, 5)] - plane[(5, 5)]).abs() < 1e-5);
        let single = Means { side: 0.4, precision: 1.0 };
        assert_eq!(single.of(&a).data, a.data);
    }
}
