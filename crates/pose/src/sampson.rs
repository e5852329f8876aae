//! Sampson distance of a match to an essential matrix, written once: exact, with its gradient, and as a loop that vectorises.
//!
//! `r = C / √D` with `C = bᵀ E a` and `D = (E a)₁² + (E a)₂² + (Eᵀ b)₁² + (Eᵀ b)₂²`: to first order the distance by which the four
//! coordinates must move to fulfil `C = 0`. With independent noise of one sigma on each coordinate, `r` has that sigma.
//!
//! # Source
//! Hartley, Zisserman 2004, "Multiple View Geometry", §11.4.3.

use crate::decompose::Motion;
use crate::points::{LANES, Pairs};
use selenograph_geometry::{Matrix3, SMatrix, Vector3};

/// Signed Sampson distance on the plane `z = 1`.
pub fn distance(e: &Matrix3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let line_b = e * a;
    let line_a = e.transpose() * b;
    let squared = line_b.x * line_b.x + line_b.y * line_b.y + line_a.x * line_a.x + line_a.y * line_a.y;
    b.dot(&line_b) / squared.max(f64::MIN_POSITIVE).sqrt()
}

/// Truncated cost `Σ min(r², limit)` and the number below the limit, over a block of matches in f32.
///
/// All slices have one length. Matches that are not numbers count `limit`, so that padding adds a constant.
pub fn truncated_f32(e: &[f32; 9], ax: &[f32], ay: &[f32], bx: &[f32], by: &[f32], limit: f32) -> (f32, u32) {
    let mut cost = [0.0_f32; LANES];
    let mut count = [0_u32; LANES];
    let chunks = ax
        .chunks_exact(LANES)
        .zip(ay.chunks_exact(LANES))
        .zip(bx.chunks_exact(LANES))
        .zip(by.chunks_exact(LANES));
    for (((ax, ay), bx), by) in chunks {
        for k in 0..LANES {
            let (x, y, u, v) = (ax[k], ay[k], bx[k], by[k]);
            let l0 = e[0] * x + e[1] * y + e[2];
            let l1 = e[3] * x + e[4] * y + e[5];
            let l2 = e[6] * x + e[7] * y + e[8];
            let m0 = e[0] * u + e[3] * v + e[6];
            let m1 = e[1] * u + e[4] * v + e[7];
            let c = u * l0 + v * l1 + l2;
            let d = l0 * l0 + l1 * l1 + m0 * m0 + m1 * m1;
            let squared = c * c / d;
            let close = squared < limit;
            cost[k] += if close { squared } else { limit };
            count[k] += u32::from(close);
        }
    }
    (cost.iter().sum(), count.iter().sum())
}

/// How a motion may change: three components of a rotation applied in B, two of the translation in its tangent plane.
pub type Tangent = SMatrix<f64, 5, 1>;

/// Two unit vectors that span the tangent plane of the sphere at `t`: the axes of the translation's covariance.
pub fn tangent_axes(t: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let smallest = t.iamin();
    let first = t.cross(&Vector3::ith(smallest, 1.0)).normalize();
    [first, t.normalize().cross(&first)]
}

/// The derivatives of `E` by the five components of a [`Tangent`] at zero.
pub fn essential_derivatives(motion: &Motion) -> [Matrix3<f64>; 5] {
    let t = motion.translation.cross_matrix();
    let turned = |k: usize| t * Vector3::ith(k, 1.0).cross_matrix() * motion.rotation;
    let axes = tangent_axes(&motion.translation);
    let moved = |k: usize| axes[k].cross_matrix() * motion.rotation;
    [turned(0), turned(1), turned(2), moved(0), moved(1)]
}

/// Distances and their derivatives by the five components, for the eight matches from `start`.
pub struct Block {
    /// Signed Sampson distances.
    pub residual: [f64; LANES],
    /// Their derivatives.
    pub jacobian: [[f64; LANES]; 5],
}

/// Fills a block; the matches from `start` to `start + 8` must exist (padding gives values that are not numbers).
pub fn linearise(
    pairs: &Pairs,
    start: usize,
    e: &Matrix3<f64>,
    derivatives: &[Matrix3<f64>; 5],
    block: &mut Block,
) {
    let end = start + LANES;
    let (ax, ay) = (&pairs.ax[start..end], &pairs.ay[start..end]);
    let (bx, by) = (&pairs.bx[start..end], &pairs.by[start..end]);
    let mut g = [[0.0; LANES]; 9];
    for k in 0..LANES {
        let (x, y, u, v) = (ax[k], ay[k], bx[k], by[k]);
        let l0 = e[(0, 0)] * x + e[(0, 1)] * y + e[(0, 2)];
        let l1 = e[(1, 0)] * x + e[(1, 1)] * y + e[(1, 2)];
        let l2 = e[(2, 0)] * x + e[(2, 1)] * y + e[(2, 2)];
        let m0 = e[(0, 0)] * u + e[(1, 0)] * v + e[(2, 0)];
        let m1 = e[(0, 1)] * u + e[(1, 1)] * v + e[(2, 1)];
        let c = u * l0 + v * l1 + l2;
        let d = (l0 * l0 + l1 * l1 + m0 * m0 + m1 * m1).max(f64::MIN_POSITIVE);
        let s = 1.0 / d.sqrt();
        let q = c / d;
        block.residual[k] = c * s;
        // ∂r/∂E = (b aᵀ − C/D · ½ ∂D/∂E) / √D, entry by entry.
        let (p0, p1, n0, n1) = (q * l0, q * l1, q * m0, q * m1);
        g[0][k] = s * (u * x - p0 * x - n0 * u);
        g[1][k] = s * (u * y - p0 * y - n1 * u);
        g[2][k] = s * (u - p0);
        g[3][k] = s * (v * x - p1 * x - n0 * v);
        g[4][k] = s * (v * y - p1 * y - n1 * v);
        g[5][k] = s * (v - p1);
        g[6][k] = s * (x - n0);
        g[7][k] = s * (y - n1);
        g[8][k] = s;
    }
    for (row, d) in block.jacobian.iter_mut().zip(derivatives) {
        *row = [0.0; LANES];
        for i in 0..9 {
            let factor = d[(i / 3, i % 3)];
            for k in 0..LANES {
                row[k] += factor * g[i][k];
            }
        }
    }
}
