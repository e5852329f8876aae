//! How much of a finer model's residual is kept where.

use crate::layer::SUPPORT_BLOCK;
use serde::{Deserialize, Serialize};

/// Blocks between a hole and the start of the fade: an absent node may sit at its block's corner.
const HOLE_MARGIN: f64 = 1.5;

/// 0 below 0, 1 above 1, C¹ between.
fn smoothstep(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Distance to the nearest marked block, in blocks, interpolated between block centres.
pub(super) struct BlockDistance {
    cols: usize,
    rows: usize,
    distance: Vec<f32>,
}

impl BlockDistance {
    /// `None` if no block is marked.
    pub fn new(cols: usize, rows: usize, marked: &[bool]) -> Option<Self> {
        if !marked.contains(&true) {
            return None;
        }
        let mut square: Vec<f32> = marked.iter().map(|m| if *m { 0.0 } else { f32::INFINITY }).collect();
        let mut line = Vec::new();
        for row in square.chunks_exact_mut(cols) {
            line.clear();
            line.extend_from_slice(row);
            nearest_squares(&line, |n, v| row[n] = v);
        }
        for col in 0..cols {
            line.clear();
            line.extend(square.iter().skip(col).step_by(cols));
            nearest_squares(&line, |n, v| square[n * cols + col] = v);
        }
        Some(Self { cols, rows, distance: square.into_iter().map(f32::sqrt).collect() })
    }

    pub fn block(&self, i: usize, j: usize) -> f32 {
        self.distance[j * self.cols + i]
    }

    /// At node coordinates.
    pub fn at(&self, c: f64, r: f64) -> f64 {
        let half = (SUPPORT_BLOCK - 1) as f64 / 2.0;
        let place = |v: f64, count: usize| {
            let v = ((v - half) / SUPPORT_BLOCK as f64).clamp(0.0, (count - 1) as f64);
            let first = (v as usize).min(count.saturating_sub(2));
            (first, (first + 1).min(count - 1), v - first as f64)
        };
        let (i0, i1, u) = place(c, self.cols);
        let (j0, j1, v) = place(r, self.rows);
        let mix = |a: f32, b: f32, t: f64| f64::from(a) * (1.0 - t) + f64::from(b) * t;
        mix(self.block(i0, j0), self.block(i1, j0), u) * (1.0 - v)
            + mix(self.block(i0, j1), self.block(i1, j1), u) * v
    }
}

/// Lower envelope of parabolas: `out(n) = min over m of (n − m)² + values[m]` (Felzenszwalb & Huttenlocher 2012).
fn nearest_squares(values: &[f32], mut out: impl FnMut(usize, f32)) {
    let mut hull: Vec<(usize, f64)> = Vec::new();
    for (m, &value) in values.iter().enumerate() {
        if value.is_infinite() {
            continue;
        }
        let key = f64::from(value) + (m * m) as f64;
        let mut from = f64::NEG_INFINITY;
        while let Some(&(last, start)) = hull.last() {
            let last_key = f64::from(values[last]) + (last * last) as f64;
            from = (key - last_key) / (2.0 * (m - last) as f64);
            if from > start {
                break;
            }
            hull.pop();
            from = f64::NEG_INFINITY;
        }
        hull.push((m, from));
    }
    let mut piece = 0;
    for n in 0..values.len() {
        while piece + 1 < hull.len() && hull[piece + 1].1 <= n as f64 {
            piece += 1;
        }
        out(
            n,
            hull.get(piece)
                .map_or(f32::INFINITY, |&(m, _)| values[m] + (n.abs_diff(m) * n.abs_diff(m)) as f32),
        );
    }
}

/// Widths over which a layer fades to what is below it, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Widths {
    /// From the first column on.
    pub left_m: f64,
    /// Up to the last column.
    pub right_m: f64,
    /// From the first row on.
    pub top_m: f64,
    /// Up to the last row.
    pub bottom_m: f64,
    /// Round absent nodes.
    pub holes_m: f64,
}

impl Widths {
    /// The widest, metres.
    pub fn max_m(&self) -> f64 {
        self.left_m.max(self.right_m).max(self.top_m).max(self.bottom_m).max(self.holes_m)
    }
}

/// The weight of the fine heights on a grid.
pub(super) struct Weight {
    pub widths: Widths,
    /// Metres per column and per row.
    pub step_m: [f64; 2],
    pub last: [f64; 2],
    pub holes: Option<BlockDistance>,
    /// Where the coarser terrain ends there is nothing to fade to.
    pub uncovered: Option<BlockDistance>,
}

impl Weight {
    pub fn at(&self, c: f64, r: f64) -> f64 {
        let Widths { left_m, right_m, top_m, bottom_m, holes_m } = self.widths;
        let [step_c, step_r] = self.step_m;
        let rim = smoothstep(c * step_c / left_m)
            * smoothstep((self.last[0] - c) * step_c / right_m)
            * smoothstep(r * step_r / top_m)
            * smoothstep((self.last[1] - r) * step_r / bottom_m);
        let block_m = SUPPORT_BLOCK as f64 * step_c.min(step_r);
        let from_blocks = |d: &BlockDistance| smoothstep((d.at(c, r) - HOLE_MARGIN) * block_m / holes_m);
        let weight = rim * self.holes.as_ref().map_or(1.0, from_blocks);
        1.0 - (1.0 - weight) * self.uncovered.as_ref().map_or(1.0, from_blocks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_brute_force() {
        let (cols, rows) = (17, 11);
        let marked: Vec<bool> = (0..cols * rows).map(|n| n * 7919 % 41 == 3).collect();
        let distance = BlockDistance::new(cols, rows, &marked).unwrap();
        for j in 0..rows {
            for i in 0..cols {
                let nearest = (0..cols * rows)
                    .filter(|n| marked[*n])
                    .map(|n| ((n % cols) as f32 - i as f32).hypot((n / cols) as f32 - j as f32))
                    .fold(f32::INFINITY, f32::min);
                assert!((distance.block(i, j) - nearest).abs() < 1e-5, "({i}, {j})");
            }
        }
        assert!(BlockDistance::new(3, 3, &[false; 9]).is_none());
    }

    #[test]
    fn the_weight_is_smooth_zero_at_rims_and_holes_and_one_inside() {
        let (cols, rows) = (40, 40);
        let marked: Vec<bool> = (0..cols * rows).map(|n| n == 20 * cols + 25).collect();
        let weight = Weight {
            widths: Widths { left_m: 400.0, right_m: 400.0, top_m: 400.0, bottom_m: 400.0, holes_m: 400.0 },
            step_m: [5.0, 5.0],
            last: [639.0, 639.0],
            holes: BlockDistance::new(cols, rows, &marked),
            uncovered: None,
        };
        // Every node of the hole's block and beside it, and the whole rim.
        for n in 0..=16 {
            let n = f64::from(n);
            assert_eq!(weight.at(400.0 + n - 0.5, 320.0 + n - 0.5), 0.0);
            assert_eq!(weight.at(n * 39.0, 0.0), 0.0);
            assert_eq!(weight.at(639.0, n * 39.0), 0.0);
        }
        assert_eq!(weight.at(150.0, 150.0), 1.0);
        // No step anywhere: a node's share changes by at most 1.5 · 5/400 on each of two axes, and for the hole alike.
        let limit = 1.5 * 5.0 / 400.0 * 2.0;
        for n in 0..639 {
            let along = |c: f64| weight.at(c, 330.0);
            assert!((along(f64::from(n) + 1.0) - along(f64::from(n))).abs() <= limit);
        }
    }
}
