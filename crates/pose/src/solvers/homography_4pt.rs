//! Homographies: through four matches, and the linear fit to many.
//!
//! # Source
//! Hartley, Zisserman 2004, "Multiple View Geometry", §4.1 (DLT), §4.4 (normalisation); Semple, Kneebone 1952 (projective bases).

use selenograph_geometry::{Matrix3, SMatrix, Vector3};

/// The homography through four matches: `b ∝ H a`. Frobenius norm √3.
///
/// Both quadruples are written in the basis of their first three points, scaled so that the fourth is their sum; `H` carries one
/// basis to the other.
///
/// Precondition: no three points of a picture lie on a line; none is returned where three nearly do.
pub fn homography_4pt(a: &[Vector3<f64>; 4], b: &[Vector3<f64>; 4]) -> Option<Matrix3<f64>> {
    let h = basis(b)? * basis(a)?.try_inverse()?;
    let norm = h.norm();
    (norm.is_finite() && norm > 0.0).then(|| h * (3.0_f64.sqrt() / norm))
}

fn basis(p: &[Vector3<f64>; 4]) -> Option<Matrix3<f64>> {
    // Cramer's rule, each determinant a triple product; their ratios are the weights.
    let whole = p[0].cross(&p[1]).dot(&p[2]);
    let weights = Vector3::new(
        p[3].cross(&p[1]).dot(&p[2]),
        p[0].cross(&p[3]).dot(&p[2]),
        p[0].cross(&p[1]).dot(&p[3]),
    );
    let smallest = weights.iter().fold(whole.abs(), |m, w| m.min(w.abs()));
    let largest = weights.iter().fold(whole.abs(), |m, w| m.max(w.abs()));
    if smallest.is_nan() || smallest <= 1e-9 * largest {
        return None;
    }
    Some(Matrix3::from_columns(&[p[0] * weights.x, p[1] * weights.y, p[2] * weights.z]))
}

/// The homography of least algebraic error over weighted matches `([ax, ay, bx, by], weight)`, normalised as Hartley asks.
///
/// Precondition: at least four matches of positive weight, not on a line.
pub fn homography_linear(matches: impl Iterator<Item = ([f64; 4], f64)> + Clone) -> Option<Matrix3<f64>> {
    let mut sums = [0.0; 9];
    for ([ax, ay, bx, by], w) in matches.clone() {
        for (sum, v) in
            sums.iter_mut().zip([1.0, ax, ay, bx, by, ax * ax + ay * ay, bx * bx + by * by, 0.0, 0.0])
        {
            *sum += w * v;
        }
    }
    let total = sums[0];
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let (ma, mb) = ([sums[1] / total, sums[2] / total], [sums[3] / total, sums[4] / total]);
    let spread = |square: f64, m: [f64; 2]| (2.0 / (square / total - m[0] * m[0] - m[1] * m[1])).sqrt();
    let (sa, sb) = (spread(sums[5], ma), spread(sums[6], mb));
    if !(sa.is_finite() && sb.is_finite()) {
        return None;
    }
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for ([ax, ay, bx, by], w) in matches {
        let (x, y) = (sa * (ax - ma[0]), sa * (ay - ma[1]));
        let (u, v) = (sb * (bx - mb[0]), sb * (by - mb[1]));
        let rows =
            [[x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y, -u], [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y, -v]];
        for row in rows {
            for i in 0..9 {
                for j in i..9 {
                    normal[(i, j)] += w * row[i] * row[j];
                }
            }
        }
    }
    for i in 0..9 {
        for j in 0..i {
            normal[(i, j)] = normal[(j, i)];
        }
    }
    let eigen = normal.symmetric_eigen();
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let from_a = Matrix3::new(sa, 0.0, -sa * ma[0], 0.0, sa, -sa * ma[1], 0.0, 0.0, 1.0);
    let to_b = Matrix3::new(1.0 / sb, 0.0, mb[0], 0.0, 1.0 / sb, mb[1], 0.0, 0.0, 1.0);
    let h = to_b * h * from_a;
    let norm = h.norm();
    (norm.is_finite() && norm > 0.0).then(|| h * (3.0_f64.sqrt() / norm))
}

/// Squared distance between `b` and the image of `a`, on the plane `z = 1` of B; infinite where `a` goes to infinity.
pub(crate) fn transfer_squared(h: &Matrix3<f64>, pair: &[f64; 4]) -> f64 {
    let p = h * Vector3::new(pair[0], pair[1], 1.0);
    let (dx, dy) = (p.x / p.z - pair[2], p.y / p.z - pair[3]);
    let squared = dx * dx + dy * dy;
    if squared.is_finite() { squared } else { f64::INFINITY }
}
