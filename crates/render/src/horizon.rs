//! Which ground the Sun's disc surely reaches, and which it surely does not: a grid along the Sun's azimuth that answers
//! for most shadow rays without tracing them.
//!
//! Blocks lie in columns across the direction towards the Sun (`u`) and strips along it (`v`). A ray that enters a column
//! at or above `lit_above` meets nothing from there on; one that enters below `dark_below` meets something. Both
//! follow from the blocks' highest and lowest nodes by one sweep against the light:
//! `lit_above(c) = max(highest(c), lit_above(c + 1) − least rise)`, and likewise from below. The rise is the least (most) of
//! any direction on the disc with the local vertical of that place, so the curvature is in it. Rays drift sideways:
//! blocks are bounded together with the strip on either side, and the sweep widens by one strip as often as a ray
//! may have crossed one. Beyond the picture's own ground the sweep starts in ever coarser blocks.

use crate::sun::SunDisc;
use rayon::prelude::*;
use selenograph_geometry::{Point3, Vector3};
use selenograph_terrain::{Layer, Terrain};

/// Side of a block of the finest grid, cells.
const BLOCK_CELLS: f64 = 4.0;
/// Columns beyond the picture's ground in fine blocks: as many as a ray needs to outgrow the highest ground, within these.
const MARGIN_COLUMNS: [f64; 2] = [32.0, 768.0];
/// Columns that a ray may skip at once where it is above all of them.
pub(crate) const SKIPS: [usize; 2] = [8, 64];
/// Columns of each coarser stage, whose blocks are this many times larger than the last stage's.
const STAGE_COLUMNS: usize = 128;
const STAGE_FACTOR: f64 = 4.0;
const MAX_STAGES: usize = 5;
/// Bounds are widened by this, metres: rounding of f32 heights in the kernels.
const MARGIN_M: f64 = 0.02;
/// Marks a block as foreign; no terrain is half as high, and a f32 this large still knows a sixteenth of a metre.
pub(crate) const FOREIGN_M: f32 = 1_048_576.0;
/// Above this drift (strips per column) the disc surrounds the zenith and has no azimuth.
const MAX_DRIFT: f64 = 0.5;

/// Heights (metres above the sphere) per block; block `(c, j)` is entry `j · columns + c`, the last column of
/// `lit_above` and `dark_below` being one past the last block.
pub(crate) struct Horizon {
    /// Blocks from grid coordinates: `u = m[0] c + m[1] r + m[2]`, `v = m[3] c + m[4] r + m[5]`.
    pub(crate) block_from_grid: [f64; 6],
    pub(crate) columns: usize,
    pub(crate) strips: usize,
    /// Highest ground in the block; [`FOREIGN_M`] more where not all of it is this layer's own, so that its cells cannot be
    /// walked.
    pub(crate) highest: Vec<f32>,
    pub(crate) lit_above: Vec<f32>,
    pub(crate) dark_below: Vec<f32>,
    /// For each of [`SKIPS`]: the highest ground in that many columns and the strips beside; `columns / skip` to a strip,
    /// rounded up.
    pub(crate) highest_of: [Vec<f32>; 2],
}

/// The direction of the light in the plane of a grid.
struct Light<'a> {
    terrain: &'a Terrain,
    layer: &'a Layer,
    layer_idx: usize,
    /// Unit vectors along and across, in grid coordinates.
    along: [f64; 2],
    across: [f64; 2],
    /// Directions to the centre and the rim of the disc.
    rim: Vec<Vector3<f64>>,
}

/// How rays run at one place: height gained and sideways drift per cell of `u`.
#[derive(Clone, Copy)]
struct Run {
    least_rise: f64,
    most_rise: f64,
    drift: f64,
}

impl Horizon {
    /// For one layer, a box of its ground `[c0, r0, c1, r1]` and one Sun. `None` if the Sun stands so low or so high over
    /// the box that no such grid exists.
    pub(crate) fn new(terrain: &Terrain, layer_idx: usize, ground: [f64; 4], disc: &SunDisc) -> Option<Self> {
        let light = Light::new(terrain, layer_idx, ground, disc)?;
        let corners = [[0, 1], [2, 1], [0, 3], [2, 3]].map(|[i, j]| light.uv([ground[i], ground[j]]));
        let range = |k: usize| {
            corners.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p[k]), b.max(p[k])))
        };
        let ((u0, u1), (v0, v1)) = (range(0), range(1));
        let (low, high) = terrain.height_range();
        let middle = light.run(light.grid(f64::midpoint(u0, u1), f64::midpoint(v0, v1)))?;
        let margin =
            ((high - low) / (middle.least_rise * BLOCK_CELLS)).clamp(MARGIN_COLUMNS[0], MARGIN_COLUMNS[1]);
        let columns = ((u1 - u0) / BLOCK_CELLS).ceil() as usize + margin as usize;
        // Rays of the margin may leave the ground's own strips sideways.
        let side = 4;
        let strips = ((v1 - v0) / BLOCK_CELLS).ceil() as usize + 2 * side;
        let v0 = v0 - side as f64 * BLOCK_CELLS;
        let stage = Stage { u0, v0, size: BLOCK_CELLS, columns, strips };
        let beyond = light.beyond(&stage, 0)?;
        let (highest, own, lowest) = light.block_bounds(&stage, true);
        let (lit_above, dark_below) = light.sweep(&stage, &highest, &lowest, &beyond)?;
        let highest_of = SKIPS.map(|skip| skipped(&highest, &stage, skip, middle.drift));
        let walkable =
            highest.iter().zip(&own).map(|(h, own)| if *own { *h } else { *h + FOREIGN_M + 0.125 }).collect();
        let (a, b) = (light.along, light.across);
        let s = 1.0 / BLOCK_CELLS;
        Some(Self {
            block_from_grid: [a[0] * s, a[1] * s, -u0 * s, b[0] * s, b[1] * s, -v0 * s],
            columns,
            strips,
            highest: walkable,
            lit_above,
            dark_below,
            highest_of,
        })
    }
}

/// A rectangle of blocks in `(u, v)`, in cells of the layer's grid.
struct Stage {
    u0: f64,
    v0: f64,
    size: f64,
    columns: usize,
    strips: usize,
}

/// What a stage starts from on its far side: per strip, `(lit_above, dark_below)`.
type Seeds = Vec<(f32, f32)>;

/// The highest ground of every `skip` columns and the strips beside; unknown (+∞) where rays drift too far for that.
fn skipped(highest: &[f32], stage: &Stage, skip: usize, drift: f64) -> Vec<f32> {
    let (columns, strips) = (stage.columns, stage.strips);
    let groups = columns.div_ceil(skip);
    if 2.0 * drift * skip as f64 > 1.0 {
        return vec![f32::INFINITY; groups * strips];
    }
    let mut out = vec![f32::NEG_INFINITY; groups * strips];
    for j in 0..strips {
        for c in 0..columns {
            let group = &mut out[j * groups + c / skip];
            *group = group.max(highest[j * columns + c]);
        }
    }
    dilated(&out, groups, strips, f32::max)
}

/// Each strip together with its neighbours.
fn dilated(values: &[f32], columns: usize, strips: usize, pick: fn(f32, f32) -> f32) -> Vec<f32> {
    let mut out = values.to_vec();
    for j in 0..strips {
        for c in 0..columns {
            for neighbour in [j.wrapping_sub(1), j + 1] {
                if neighbour < strips {
                    out[j * columns + c] = pick(out[j * columns + c], values[neighbour * columns + c]);
                }
            }
        }
    }
    out
}

impl<'a> Light<'a> {
    fn new(terrain: &'a Terrain, layer_idx: usize, ground: [f64; 4], disc: &SunDisc) -> Option<Self> {
        let layer = &terrain.layers[layer_idx];
        let angles = (0..8).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_4);
        // An octagon around the disc: no direction on the disc is steeper, flatter or further aside.
        let scale = 1.0 / (std::f64::consts::PI / 8.0).cos();
        let rim = std::iter::once([0.0, 0.0])
            .chain(angles.map(|a| [scale * a.cos(), scale * a.sin()]))
            .map(|d| disc.towards(d.map(|v| v as f32)).into_inner())
            .collect();
        let mut light = Self { terrain, layer, layer_idx, along: [1.0, 0.0], across: [0.0, 1.0], rim };
        let middle = [f64::midpoint(ground[0], ground[2]), f64::midpoint(ground[1], ground[3])];
        let step = light.step(middle, &disc.sun.direction)?;
        let length = step[0].hypot(step[1]);
        if length < 1e-9 {
            return None;
        }
        light.along = [step[0] / length, step[1] / length];
        light.across = [-light.along[1], light.along[0]];
        Some(light)
    }

    fn uv(&self, [c, r]: [f64; 2]) -> [f64; 2] {
        [self.along[0] * c + self.along[1] * r, self.across[0] * c + self.across[1] * r]
    }

    fn grid(&self, u: f64, v: f64) -> [f64; 2] {
        [self.along[0] * u + self.across[0] * v, self.along[1] * u + self.across[1] * v]
    }

    /// Columns, rows and height that a ray gains in a metre at a place.
    fn step(&self, [c, r]: [f64; 2], direction: &Vector3<f64>) -> Option<[f64; 3]> {
        /// Short against the curvature, long against rounding.
        const HALF_M: f64 = 5.0;
        let grid = &self.layer.grid;
        let height =
            f64::midpoint(f64::from(self.layer.height_range.0), f64::from(self.layer.height_range.1));
        let p = grid.point_from_grid(c, r, height)?;
        let (before, after) = (p - direction * HALF_M, p + direction * HALF_M);
        let (a, b) = (grid.grid_from_point(&before)?, grid.grid_from_point(&after)?);
        let rise = after.coords.norm() - before.coords.norm();
        let s = 1.0 / (2.0 * HALF_M);
        Some([(b[0] - a[0]) * s, (b[1] - a[1]) * s, rise * s])
    }

    /// How the disc's rays run near a place; `None` where one of them does not rise or not run towards the Sun.
    fn run(&self, at: [f64; 2]) -> Option<Run> {
        let mut run = Run { least_rise: f64::INFINITY, most_rise: f64::NEG_INFINITY, drift: 0.0 };
        for direction in &self.rim {
            let [c, r, h] = self.step(at, direction)?;
            let [du, dv] = self.uv([c, r]);
            if du <= 0.0 || h <= 0.0 {
                return None;
            }
            run.least_rise = run.least_rise.min(h / du);
            run.most_rise = run.most_rise.max(h / du);
            run.drift = run.drift.max((dv / du).abs());
        }
        (run.drift < MAX_DRIFT).then_some(run)
    }

    /// How rays run anywhere in a column.
    fn column_run(&self, stage: &Stage, column: usize) -> Option<Run> {
        let u = stage.u0 + column as f64 * stage.size;
        let (v0, v1) = (stage.v0, stage.v0 + stage.strips as f64 * stage.size);
        let mut all: Option<Run> = None;
        for v in [v0, f64::midpoint(v0, v1), v1] {
            for u in [u, u + stage.size] {
                let run = self.run(self.grid(u, v))?;
                all = Some(all.map_or(run, |a| Run {
                    least_rise: a.least_rise.min(run.least_rise),
                    most_rise: a.most_rise.max(run.most_rise),
                    drift: a.drift.max(run.drift),
                }));
            }
        }
        all
    }

    /// What rays meet beyond the far side of a stage, from the next, coarser stage.
    fn beyond(&self, stage: &Stage, stage_idx: usize) -> Option<Seeds> {
        let open = vec![(f32::NEG_INFINITY, f32::NEG_INFINITY); stage.strips];
        let unknown = vec![(f32::INFINITY, f32::NEG_INFINITY); stage.strips];
        let (low, high) = self.terrain.height_range();
        let u0 = stage.u0 + stage.columns as f64 * stage.size;
        let size = stage.size * STAGE_FACTOR;
        // Room for the drift over the whole stage, on both sides.
        let side = (MAX_DRIFT * STAGE_COLUMNS as f64).min(12.0).ceil() as usize;
        let width = stage.strips as f64 * stage.size;
        let strips = (width / size).ceil() as usize + 2 * side;
        let v0 = stage.v0 - side as f64 * size;
        if stage_idx == MAX_STAGES {
            return Some(unknown);
        }
        let next = Stage { u0, v0, size, columns: STAGE_COLUMNS, strips };
        // Rays start on the ground of the finest stage, so in a coarser one they have risen all the way through it; its
        // near side is where they rise least. Above the highest ground nothing further matters.
        if stage_idx > 0 {
            let v = f64::midpoint(v0, v0 + strips as f64 * size);
            let grown = self.run(self.grid(stage.u0, v))?.least_rise * (u0 - stage.u0);
            if grown > high - low {
                return Some(open);
            }
        }
        let Some(beyond) = self.beyond(&next, stage_idx + 1) else { return Some(unknown) };
        let (highest, _, lowest) = self.block_bounds(&next, false);
        let Some((lit, dark)) = self.sweep(&next, &highest, &lowest, &beyond) else { return Some(unknown) };
        let stride = next.columns + 1;
        Some(
            (0..stage.strips)
                .map(|j| {
                    let at = |k: f64| ((stage.v0 + k * stage.size - v0) / size).floor() as usize;
                    let (first, last) = (at(j as f64 - 1.0), at(j as f64 + 2.0).min(strips - 1));
                    (first..=last).fold((f32::NEG_INFINITY, f32::INFINITY), |(a, b), s| {
                        (a.max(lit[s * stride]), b.min(dark[s * stride]))
                    })
                })
                .collect(),
        )
    }

    /// Highest node, whether all ground is the layer's own, and lowest node, per block.
    fn block_bounds(&self, stage: &Stage, fine: bool) -> (Vec<f32>, Vec<bool>, Vec<f32>) {
        let half = 0.5 * stage.size * (self.along[0].abs() + self.along[1].abs());
        let blocks: Vec<(f32, bool, f32)> = (0..stage.strips)
            .into_par_iter()
            .flat_map_iter(|j| (0..stage.columns).map(move |c| (c, j)))
            .map(|(c, j)| {
                let u = stage.u0 + (c as f64 + 0.5) * stage.size;
                let v = stage.v0 + (j as f64 + 0.5) * stage.size;
                let [gc, gr] = self.grid(u, v);
                let bounds = [gc - half, gr - half, gc + half, gr + half];
                let own = fine.then(|| self.own_nodes(bounds)).flatten();
                let (low, high) = own.unwrap_or_else(|| self.any_layer(bounds));
                (high, own.is_some(), low)
            })
            .collect();
        (
            blocks.iter().map(|b| b.0).collect(),
            blocks.iter().map(|b| b.1).collect(),
            blocks.iter().map(|b| b.2).collect(),
        )
    }

    /// Bounds over the layer's own nodes; `None` if the box leaves it, touches a finer layer, or has a hole.
    fn own_nodes(&self, [c0, r0, c1, r1]: [f64; 4]) -> Option<(f32, f32)> {
        let grid = &self.layer.grid;
        if c0 < 0.0 || r0 < 0.0 || c1 >= (grid.cols - 1) as f64 || r1 >= (grid.rows - 1) as f64 {
            return None;
        }
        if self.layer_idx > 0 && self.touches_finer([c0, r0, c1, r1]) {
            return None;
        }
        let nodes = self.layer.nodes();
        let (i0, i1) = (c0 as usize, c1 as usize + 1);
        let (mut low, mut high, mut sum) = (f32::INFINITY, f32::NEG_INFINITY, 0.0);
        for j in r0 as usize..=r1 as usize + 1 {
            for h in &nodes[j * grid.cols + i0..=j * grid.cols + i1] {
                (low, high) = (low.min(*h), high.max(*h));
                sum += *h;
            }
        }
        (!sum.is_nan()).then_some((low, high))
    }

    fn corner_points(&self, [c0, r0, c1, r1]: [f64; 4]) -> Option<[Point3<f64>; 4]> {
        let grid = &self.layer.grid;
        Some([
            grid.point_from_grid(c0, r0, 0.0)?,
            grid.point_from_grid(c1, r0, 0.0)?,
            grid.point_from_grid(c0, r1, 0.0)?,
            grid.point_from_grid(c1, r1, 0.0)?,
        ])
    }

    /// A box of this grid on the grid of another layer; `None` where a map does not reach.
    fn box_on(&self, layer: &Layer, bounds: [f64; 4]) -> Option<[f64; 4]> {
        let grid = &self.layer.grid;
        if layer.grid.crs.projection != grid.crs.projection {
            return box_on(layer, &self.corner_points(bounds)?);
        }
        let [c0, r0, c1, r1] = bounds;
        let corners = [[c0, r0], [c1, r0], [c0, r1], [c1, r1]].map(|[c, r]| {
            let [x, y] = grid.map_from_grid().apply(c, r);
            layer.grid.grid_from_map().apply(x, y)
        });
        Some(enclosing(&corners, 0.01))
    }

    fn touches_finer(&self, bounds: [f64; 4]) -> bool {
        self.terrain.layers[..self.layer_idx].iter().any(|layer| {
            self.box_on(layer, bounds).is_none_or(|[c0, r0, c1, r1]| {
                let (last_c, last_r) = ((layer.grid.cols - 1) as f64, (layer.grid.rows - 1) as f64);
                !(c1 < 0.0 || r1 < 0.0 || c0 > last_c || r0 > last_r)
            })
        })
    }

    /// Bounds of the surface under a box, whichever layers carry it; −∞ to −∞ where there is none, unknown (−∞ to ∞) where a
    /// map does not reach.
    fn any_layer(&self, bounds: [f64; 4]) -> (f32, f32) {
        const UNKNOWN: (f32, f32) = (f32::NEG_INFINITY, f32::INFINITY);
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for layer in &self.terrain.layers {
            let Some([c0, r0, c1, r1]) = self.box_on(layer, bounds) else { return UNKNOWN };
            let (last_c, last_r) = ((layer.grid.cols - 1) as f64, (layer.grid.rows - 1) as f64);
            if c1 < 0.0 || r1 < 0.0 || c0 > last_c || r0 > last_r {
                continue;
            }
            let (lo, hi) = layer.height_bounds([c0, r0, c1, r1]);
            (low, high) = (low.min(lo), high.max(hi));
            if c0 >= 0.0 && r0 >= 0.0 && c1 <= last_c && r1 <= last_r {
                // Coarser layers carry nothing here.
                return (low, high);
            }
        }
        (f32::NEG_INFINITY, high)
    }

    /// The sweep against the light. Both results have one column more than the stage has blocks.
    fn sweep(
        &self,
        stage: &Stage,
        highest: &[f32],
        lowest: &[f32],
        beyond: &[(f32, f32)],
    ) -> Option<(Vec<f32>, Vec<f32>)> {
        let (columns, strips) = (stage.columns, stage.strips);
        let highest = dilated(highest, columns, strips, f32::max);
        let lowest = dilated(lowest, columns, strips, f32::min);
        let stride = columns + 1;
        let mut lit = vec![f32::INFINITY; stride * strips];
        let mut dark = vec![f32::NEG_INFINITY; stride * strips];
        for (j, (above, below)) in beyond.iter().enumerate() {
            (lit[j * stride + columns], dark[j * stride + columns]) = (*above, *below);
        }
        // Sideways drift since the sweep was last widened, strips.
        let mut drifted = 0.0;
        for c in (0..columns).rev() {
            let run = self.column_run(stage, c)?;
            let (least, most) = ((run.least_rise * stage.size) as f32, (run.most_rise * stage.size) as f32);
            drifted += run.drift;
            let widen = drifted + run.drift > 1.0;
            if widen {
                drifted = 0.0;
            }
            for j in 0..strips {
                let next = |k: usize| k * stride + c + 1;
                let (mut above, mut below) = (lit[next(j)], dark[next(j)]);
                if widen {
                    // At the outermost strips there is no neighbour to ask: nothing is known of what comes from there.
                    if j == 0 || j + 1 == strips {
                        (above, below) = (f32::INFINITY, f32::NEG_INFINITY);
                    } else {
                        above = above.max(lit[next(j - 1)]).max(lit[next(j + 1)]);
                        below = below.min(dark[next(j - 1)]).min(dark[next(j + 1)]);
                    }
                }
                let block = j * columns + c;
                let margin = MARGIN_M as f32;
                lit[j * stride + c] = (highest[block] + margin).max(above - least);
                dark[j * stride + c] = (lowest[block] - margin).max(below - most);
            }
        }
        Some((lit, dark))
    }
}

/// Bounding box of a box's corners on a layer's grid, with room for what bulges between them on another map.
fn box_on(layer: &Layer, points: &[Point3<f64>; 4]) -> Option<[f64; 4]> {
    let mut corners = [[0.0; 2]; 4];
    for (corner, point) in corners.iter_mut().zip(points) {
        *corner = layer.grid.grid_from_point(point)?;
    }
    // An edge of length s bends by s²/8R on any map that is smooth here; four times that, and a hundredth of a cell.
    let side = (points[0] - points[3]).norm();
    let room = 0.5 * side * side / layer.grid.crs.body.radius_m / layer.cell_m + 0.01;
    Some(enclosing(&corners, room))
}

/// Bounding box of corners, with room on every side.
fn enclosing(corners: &[[f64; 2]; 4], room: f64) -> [f64; 4] {
    let start = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let b = corners.iter().fold(start, |b, [c, r]| [b[0].min(*c), b[1].min(*r), b[2].max(*c), b[3].max(*r)]);
    [b[0] - room, b[1] - room, b[2] + room, b[3] + room]
}
