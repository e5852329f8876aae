//! A smooth field of displacements through scattered ones.

use crate::dispatch::widest;
use selenograph_geometry::pixel::center_of;
use selenograph_geometry::{Point2, Vector2};

/// Distance of the field's nodes, pixels.
const STEP_PX: f64 = 8.0;

/// Standard deviations of the smoothing, coarse to fine, in nodes.
const SIGMAS: [f32; 5] = [16.0, 8.0, 4.0, 2.0, 1.0];

/// How many matches the field of zero displacement counts for, where matches are few.
const PRIOR_MATCHES: f32 = 0.3;

/// Displacements further than this many times the typical one from the field are left out, pixels.
const OUTLIER_FACTOR: f64 = 5.0;

/// What is never an outlier, pixels.
const INLIER_PX: f64 = 0.1;

/// Displacements on a grid, linear in between.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    columns: usize,
    rows: usize,
    nodes: Vec<[f64; 2]>,
}

impl Field {
    /// Through displacements at points of a picture of `size` pixels: at each scale what the coarser ones leave over is averaged
    /// under a Gaussian; then once more without the outliers.
    pub(super) fn fit(size: [usize; 2], points: &[(Point2<f64>, Vector2<f64>)]) -> Self {
        let first = Self::through(size, points);
        let off: Vec<f64> = points.iter().map(|(at, d)| (d - first.at(at)).norm()).collect();
        let Some(median) = selenograph_raster::statistics::median(off.iter().copied()) else { return first };
        let limit = (OUTLIER_FACTOR * median).max(INLIER_PX);
        let kept: Vec<_> =
            points.iter().zip(&off).filter(|(_, off)| **off <= limit).map(|(p, _)| *p).collect();
        if kept.len() == points.len() { first } else { Self::through(size, &kept) }
    }

    fn through(size: [usize; 2], points: &[(Point2<f64>, Vector2<f64>)]) -> Self {
        let [columns, rows] = size.map(|side| (side as f64 / STEP_PX).ceil() as usize + 1);
        let mut field = Self { columns, rows, nodes: vec![[0.0; 2]; columns * rows] };
        for sigma in SIGMAS {
            let mut sums = vec![[0.0f32; 3]; columns * rows];
            for (at, displacement) in points {
                let left = displacement - field.at(at);
                let (corners, shares) = field.corners(at);
                for (corner, share) in corners.into_iter().zip(shares) {
                    for (sum, value) in sums[corner].iter_mut().zip([left.x, left.y, 1.0]) {
                        *sum += (share * value) as f32;
                    }
                }
            }
            blur(&mut sums, columns, rows, sigma);
            let prior = PRIOR_MATCHES / (std::f32::consts::TAU * sigma * sigma);
            for (node, [x, y, count]) in field.nodes.iter_mut().zip(&sums) {
                node[0] += f64::from(x / (count + prior));
                node[1] += f64::from(y / (count + prior));
            }
        }
        field
    }

    /// The four nodes around a point and their shares.
    #[inline]
    fn corners(&self, at: &Point2<f64>) -> ([usize; 4], [f64; 4]) {
        let place = |coordinate: f64, count: usize| {
            let position = (coordinate / STEP_PX).clamp(0.0, (count - 1) as f64);
            let low = (position as usize).min(count.saturating_sub(2));
            (low, position - low as f64)
        };
        let ((c, u), (r, v)) = (place(at.x, self.columns), place(at.y, self.rows));
        let first = r * self.columns + c;
        let right = usize::from(self.columns > 1);
        let below = if self.rows > 1 { self.columns } else { 0 };
        (
            [first, first + right, first + below, first + below + right],
            [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v],
        )
    }

    /// Adds the displacements at the pixels of a row.
    pub(super) fn add_row(&self, y: f64, bx: &mut [f64], by: &mut [f64]) {
        let (corners, shares) = self.corners(&Point2::new(0.0, y));
        let (above, below) =
            (&self.nodes[corners[0]..][..self.columns], &self.nodes[corners[2]..][..self.columns]);
        let node = |c: usize, k: usize| shares[0] * above[c][k] + shares[2] * below[c][k];
        let step = STEP_PX as usize;
        for (c, (bx, by)) in bx.chunks_mut(step).zip(by.chunks_mut(step)).enumerate() {
            let c = c.min(self.columns - 1);
            let right = (c + 1).min(self.columns - 1);
            for (k, b) in [bx, by].into_iter().enumerate() {
                let (first, rise) = (node(c, k), (node(right, k) - node(c, k)) / STEP_PX);
                for (i, b) in b.iter_mut().enumerate() {
                    *b += first + rise * center_of(i);
                }
            }
        }
    }

    /// The displacement at a point.
    #[inline]
    pub(super) fn at(&self, point: &Point2<f64>) -> Vector2<f64> {
        let (corners, shares) = self.corners(point);
        let mut sum = [0.0; 2];
        for (corner, share) in corners.into_iter().zip(shares) {
            sum[0] += share * self.nodes[corner][0];
            sum[1] += share * self.nodes[corner][1];
        }
        Vector2::new(sum[0], sum[1])
    }
}

/// A Gaussian blur that keeps sums: what would leave the grid is lost.
fn blur(nodes: &mut Vec<[f32; 3]>, columns: usize, rows: usize, sigma: f32) {
    let reach = (3.0 * sigma).ceil() as usize;
    let taps: Vec<f32> = (0..=reach).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
    let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
    let taps: Vec<f32> = taps.iter().map(|tap| tap / sum).collect();
    *nodes = transposed(&down_columns(nodes, columns, &taps), columns);
    *nodes = transposed(&down_columns(nodes, rows, &taps), rows);
}

/// Convolution from row to row, whole rows at a time.
fn down_columns(nodes: &[[f32; 3]], columns: usize, taps: &[f32]) -> Vec<[f32; 3]> {
    let (rows, reach) = (nodes.len() / columns, taps.len() - 1);
    let mut out = vec![[0.0f32; 3]; nodes.len()];
    for (i, target) in out.chunks_exact_mut(columns).enumerate() {
        for j in i.saturating_sub(reach)..(i + reach + 1).min(rows) {
            let source = nodes[j * columns..(j + 1) * columns].as_flattened();
            add_scaled(target.as_flattened_mut(), taps[i.abs_diff(j)], source);
        }
    }
    out
}

widest! {
    fn add_scaled(target: &mut [f32], factor: f32, source: &[f32]) = add_scaled_body
}

#[inline(always)]
fn add_scaled_body(target: &mut [f32], factor: f32, source: &[f32]) {
    for (target, source) in target.iter_mut().zip(source) {
        *target += factor * source;
    }
}

fn transposed(nodes: &[[f32; 3]], columns: usize) -> Vec<[f32; 3]> {
    let rows = nodes.len() / columns;
    (0..nodes.len()).map(|i| nodes[i % rows * columns + i / rows]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_smooth_displacements_and_ignores_outliers() {
        let truth = |p: &Point2<f64>| {
            Vector2::new(2.0 * (p.x / 60.0).sin(), 0.01 * p.y - 1.0 + (p.x * p.y / 3e4).cos())
        };
        let mut points: Vec<_> = (0..1600u32)
            .map(|i| {
                let at = Point2::new(f64::from(i * 7919 % 4999) / 10.0, f64::from(i * 104_729 % 5003) / 10.0);
                (at, truth(&at))
            })
            .collect();
        for (_, displacement) in points.iter_mut().step_by(40) {
            *displacement += Vector2::new(30.0, -20.0);
        }
        let field = Field::fit([512, 512], &points);
        let (mut bx, mut by) = (vec![0.0; 512], vec![0.0; 512]);
        field.add_row(center_of(77), &mut bx, &mut by);
        let at = field.at(&Point2::new(center_of(301), center_of(77)));
        assert!((bx[301] - at.x).hypot(by[301] - at.y) < 1e-9);
        for (x, y) in [(100.0, 100.0), (250.0, 333.0), (420.0, 60.0)] {
            let at = Point2::new(x, y);
            assert!(
                (field.at(&at) - truth(&at)).norm() < 0.15,
                "{x} {y} {:?} {:?}",
                field.at(&at),
                truth(&at)
            );
        }
    }
}
