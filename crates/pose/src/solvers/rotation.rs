//! The rotation between two sets of directions, in the least-squares sense.
//!
//! Maximises `Σ w bᵀ R a`: with `M = Σ w b aᵀ = U S Vᵀ`, `R = U diag(1, 1, det(U Vᵀ)) Vᵀ`.
//!
//! Precondition: at least two directions that are not parallel.
//! # Source
//! Kabsch 1976/1978; Umeyama 1991, IEEE TPAMI 13(4), eq. 43 (the sign).

use selenograph_geometry::{Matrix3, Vector3};

/// The rotation nearest to a correlation matrix `Σ w b aᵀ`, and the sum of its (signed) singular values; none where its rank is
/// below two.
pub(crate) fn rotation_of_correlation(m: &Matrix3<f64>) -> Option<(Matrix3<f64>, f64)> {
    if !m.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = m.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let s = svd.singular_values;
    if s[1] <= 1e-12 * s[0] {
        return None;
    }
    let sign = if (u * v_t).determinant() < 0.0 { -1.0 } else { 1.0 };
    let middle = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
    Some((u * middle * v_t, s[0] + s[1] + sign * s[2]))
}

/// The rotation that carries weighted directions `a` to `b`; their lengths count as weights too.
pub fn rotation(directions: impl Iterator<Item = (Vector3<f64>, Vector3<f64>, f64)>) -> Option<Matrix3<f64>> {
    let mut m = Matrix3::zeros();
    for (a, b, w) in directions {
        m += w * b * a.transpose();
    }
    rotation_of_correlation(&m).map(|(r, _)| r)
}
