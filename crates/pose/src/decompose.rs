//! Motions from an essential matrix and from a homography.

use selenograph_geometry::{Matrix3, SymmetricEigen, Vector3};

/// A rotation and a direction: `x_b ∝ R x_a + t / depth`, with `t` of length 1 (or of length baseline over plane distance).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Rotation from A's axes to B's.
    pub rotation: Matrix3<f64>,
    /// Where A's centre lies in B, up to scale.
    pub translation: Vector3<f64>,
}

impl Motion {
    /// `E = [t]× R`, with `t` as it is.
    pub fn essential(&self) -> Matrix3<f64> {
        self.translation.cross_matrix() * self.rotation
    }
}

/// The four motions of an essential matrix, two rotations with both signs of the unit translation.
///
/// `t tᵀ = ½ tr(E Eᵀ) I − E Eᵀ` and `R = (cof E ∓ [t]× E) / tᵀt`, without a singular value decomposition.
///
/// Precondition: `E` is essential (two equal singular values, one zero); from a minimal solver it is.
/// # Source
/// Horn 1990, "Recovering baseline and orientation from 'essential' matrix".
pub fn motions_of_essential(e: &Matrix3<f64>) -> [Motion; 4] {
    let rows = [e.row(0).transpose(), e.row(1).transpose(), e.row(2).transpose()];
    // Columns of E are perpendicular to t: the longest cross product of two of them has its direction.
    let (c0, c1, c2) = (e.column(0), e.column(1), e.column(2));
    let crosses = [c0.cross(&c1), c1.cross(&c2), c2.cross(&c0)];
    let longest = crosses
        .into_iter()
        .fold(Vector3::zeros(), |m: Vector3<f64>, v| if v.norm() > m.norm() { v } else { m });
    let length = (0.5 * e.norm_squared()).sqrt();
    let t = longest.normalize() * length;
    let cofactors = Matrix3::from_rows(&[
        rows[1].cross(&rows[2]).transpose(),
        rows[2].cross(&rows[0]).transpose(),
        rows[0].cross(&rows[1]).transpose(),
    ]);
    let turn = t.cross_matrix() * e;
    let squared = length * length;
    let rotations =
        [(cofactors - turn) / squared, (cofactors + turn) / squared].map(|r| nearest_rotation(&r));
    let direction = t / length;
    [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)]
        .map(|(k, sign)| Motion { rotation: rotations[k], translation: direction * sign })
}

/// A motion with the plane that a homography was made by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneMotion {
    /// The motion; its translation is the baseline divided by the plane's distance from A.
    pub motion: Motion,
    /// The plane's normal in A, pointing away from it: `nᵀ x = distance`, `n_z > 0`.
    pub normal: Vector3<f64>,
}

/// The two motions that a homography `H ∝ R + t nᵀ` allows with the plane in front of A; none where it is a rotation
/// (its singular values are equal within `1e-9`) or singular.
///
/// # Source
/// Ma, Soatto, Košecká, Sastry 2004, "An Invitation to 3-D Vision", §5.3.3 (table 5.1).
pub fn motions_of_homography(h: &Matrix3<f64>) -> Option<[PlaneMotion; 2]> {
    let singular = h.singular_values();
    let (largest, smallest) = (singular.max(), singular.min());
    let middle = singular.sum() - largest - smallest;
    if !(middle.is_finite() && smallest > 0.0 && largest - smallest > 1e-9 * middle) {
        return None;
    }
    let sign = if h.determinant() < 0.0 { -1.0 } else { 1.0 };
    let h = h * (sign / middle);
    let eigen = SymmetricEigen::new(h.transpose() * h);
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
    let (s1, s3) = (eigen.eigenvalues[order[0]], eigen.eigenvalues[order[2]]);
    let v = order.map(|i| eigen.eigenvectors.column(i).into_owned());
    let (along, across) = ((1.0 - s3).max(0.0).sqrt(), (s1 - 1.0).max(0.0).sqrt());
    let spread = (s1 - s3).sqrt();
    Some([1.0, -1.0].map(|side| {
        let u = (along * v[0] + side * across * v[2]) / spread;
        let normal = v[1].cross(&u);
        let from = Matrix3::from_columns(&[v[1], u, normal]);
        let (h_v, h_u) = (h * v[1], h * u);
        let rotation =
            nearest_rotation(&(Matrix3::from_columns(&[h_v, h_u, h_v.cross(&h_u)]) * from.transpose()));
        let facing = if normal.z < 0.0 { -1.0 } else { 1.0 };
        let translation = (h - rotation) * normal * facing;
        PlaneMotion { motion: Motion { rotation, translation }, normal: normal * facing }
    }))
}

/// The rotation nearest to a matrix that almost is one: the polar factor, by Newton's iteration (Higham 1986).
pub(crate) fn nearest_rotation(m: &Matrix3<f64>) -> Matrix3<f64> {
    let mut r = *m;
    for _ in 0..10 {
        let Some(inverse) = r.try_inverse() else { return r };
        let next = 0.5 * (r + inverse.transpose());
        let change = (next - r).amax();
        r = next;
        if change < 1e-15 {
            break;
        }
    }
    r
}
