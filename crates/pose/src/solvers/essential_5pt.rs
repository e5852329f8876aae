//! Essential matrices through five matches.
//!
//! Unknown `E` with `bᵀ E a = 0` for each match, `det E = 0` and `(E Eᵀ − ½ tr(E Eᵀ) I) E = 0`. The five linear equations leave
//! `E = x X + y Y + z Z + W`; the ten cubic ones, eliminated, leave a polynomial of degree ten in `z`.
//!
//! Precondition: the matches are not all explained by one rotation (then every direction of motion fits). A plane is allowed.
//!
//! # Source
//! Nistér 2004, "An efficient solution to the five-point relative pose problem", IEEE TPAMI 26(6), §3.2.

use crate::polynomial::{MAX_DEGREE, real_roots};
use selenograph_geometry::{Matrix3, SMatrix, SVector, Vector3};

/// Exponents of x, y, z in the monomials of a cubic, in the order of the elimination: the first ten are solved for.
const CUBIC: [[u8; 3]; 20] = [
    [3, 0, 0],
    [0, 3, 0],
    [2, 1, 0],
    [1, 2, 0],
    [2, 0, 1],
    [2, 0, 0],
    [0, 2, 1],
    [0, 2, 0],
    [1, 1, 1],
    [1, 1, 0],
    [1, 0, 2],
    [1, 0, 1],
    [1, 0, 0],
    [0, 1, 2],
    [0, 1, 1],
    [0, 1, 0],
    [0, 0, 3],
    [0, 0, 2],
    [0, 0, 1],
    [0, 0, 0],
];
const QUADRIC: [[u8; 3]; 10] = [
    [2, 0, 0],
    [1, 1, 0],
    [0, 2, 0],
    [1, 0, 1],
    [0, 1, 1],
    [0, 0, 2],
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [0, 0, 0],
];
const LINEAR: [[u8; 3]; 4] = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]];
const QUADRIC_OF: [[usize; 4]; 4] = products(&LINEAR, &QUADRIC);
const CUBIC_OF: [[usize; 4]; 10] = products(&QUADRIC, &CUBIC);

/// Where the product of each monomial with a linear one lies in `into`.
const fn products<const N: usize, const M: usize>(of: &[[u8; 3]; N], into: &[[u8; 3]; M]) -> [[usize; 4]; N] {
    let mut table = [[0; 4]; N];
    let mut i = 0;
    while i < N {
        let mut j = 0;
        while j < 4 {
            let mut k = 0;
            while k < M {
                if into[k][0] == of[i][0] + LINEAR[j][0]
                    && into[k][1] == of[i][1] + LINEAR[j][1]
                    && into[k][2] == of[i][2] + LINEAR[j][2]
                {
                    table[i][j] = k;
                }
                k += 1;
            }
            j += 1;
        }
        i += 1;
    }
    table
}

/// All essential matrices (at most ten, Frobenius norm √2) with `bᵀ E a = 0` for five matches, appended to `out`.
///
/// # Shapes and units
/// `a`, `b`: five directions in camera A and in camera B, of any length.
pub fn essential_5pt(a: &[Vector3<f64>; 5], b: &[Vector3<f64>; 5], out: &mut Vec<Matrix3<f64>>) {
    let basis = null_space(a, b);
    let mut m = constraints(&basis);
    if !eliminate(&mut m) {
        return;
    }
    let rows = reduced_rows(&m);
    let polynomial = determinant(&rows);
    let mut roots = [0.0; MAX_DEGREE];
    let count = real_roots(&polynomial, &mut roots);
    for &z in &roots[..count] {
        let Some((x, y)) = back_substitute(&rows, z) else { continue };
        let e =
            (x * basis[0] + y * basis[1] + z * basis[2] + basis[3]).normalize() * std::f64::consts::SQRT_2;
        if e.iter().all(|v| v.is_finite()) {
            out.push(e);
        }
    }
}

/// Four matrices that span the solutions of the linear equations, orthonormal, by Householder reflections.
fn null_space(a: &[Vector3<f64>; 5], b: &[Vector3<f64>; 5]) -> [Matrix3<f64>; 4] {
    let mut m = SMatrix::<f64, 9, 5>::zeros();
    for k in 0..5 {
        for i in 0..3 {
            for j in 0..3 {
                m[(3 * i + j, k)] = b[k][i] * a[k][j];
            }
        }
    }
    let mut reflectors = [SVector::<f64, 9>::zeros(); 5];
    for k in 0..5 {
        let mut v = SVector::<f64, 9>::zeros();
        for i in k..9 {
            v[i] = m[(i, k)];
        }
        let norm = v.norm();
        v[k] += if v[k] < 0.0 { -norm } else { norm };
        let squared = v.norm_squared();
        if squared > 0.0 {
            v *= (2.0 / squared).sqrt();
        }
        for j in k + 1..5 {
            let dot = v.dot(&m.column(j));
            for i in k..9 {
                m[(i, j)] -= dot * v[i];
            }
        }
        reflectors[k] = v;
    }
    std::array::from_fn(|c| {
        let mut q = SVector::<f64, 9>::zeros();
        q[5 + c] = 1.0;
        for v in reflectors.iter().rev() {
            q -= v * v.dot(&q);
        }
        Matrix3::from_fn(|i, j| q[3 * i + j])
    })
}

type Linear = [f64; 4];
type Quadric = [f64; 10];
type Cubic = [f64; 20];

fn add_product(into: &mut Quadric, p: &Linear, q: &Linear, factor: f64) {
    for i in 0..4 {
        for j in 0..4 {
            into[QUADRIC_OF[i][j]] += factor * p[i] * q[j];
        }
    }
}

fn add_cubic(into: &mut Cubic, p: &Quadric, q: &Linear) {
    for i in 0..10 {
        for j in 0..4 {
            into[CUBIC_OF[i][j]] += p[i] * q[j];
        }
    }
}

/// The ten cubic constraints as rows over the twenty monomials.
fn constraints(basis: &[Matrix3<f64>; 4]) -> [Cubic; 10] {
    let e: [[Linear; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| basis.map(|m| m[(i, j)])));
    let mut rows = [[0.0; 20]; 10];
    let mut gram = [[[0.0; 10]; 3]; 3];
    for i in 0..3 {
        for j in i..3 {
            for (left, right) in e[i].iter().zip(&e[j]) {
                add_product(&mut gram[i][j], left, right, 1.0);
            }
            gram[j][i] = gram[i][j];
        }
    }
    let half_trace: Quadric = std::array::from_fn(|k| 0.5 * (gram[0][0][k] + gram[1][1][k] + gram[2][2][k]));
    for (i, row) in gram.iter_mut().enumerate() {
        for (value, half) in row[i].iter_mut().zip(&half_trace) {
            *value -= half;
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            for (left, right) in gram[i].iter().zip(&e) {
                add_cubic(&mut rows[3 * i + j], left, &right[j]);
            }
        }
    }
    for k in 0..3 {
        let (l, m) = ((k + 1) % 3, (k + 2) % 3);
        let mut minor = [0.0; 10];
        add_product(&mut minor, &e[1][l], &e[2][m], 1.0);
        add_product(&mut minor, &e[1][m], &e[2][l], -1.0);
        add_cubic(&mut rows[9], &minor, &e[0][k]);
    }
    rows
}

/// Gauss-Jordan with row pivots on the first ten columns; only the last six rows are reduced fully, as only they are used.
fn eliminate(m: &mut [Cubic; 10]) -> bool {
    for column in 0..10 {
        let mut pivot = column;
        for row in column + 1..10 {
            if m[row][column].abs() > m[pivot][column].abs() {
                pivot = row;
            }
        }
        m.swap(column, pivot);
        let head = m[column][column];
        if head.abs() < 1e-14 {
            return false;
        }
        for value in &mut m[column][column..] {
            *value /= head;
        }
        let source = m[column];
        for row in &mut m[column + 1..] {
            subtract(row, &source, column);
        }
    }
    for column in (5..10).rev() {
        let source = m[column];
        for row in &mut m[4..column] {
            subtract(row, &source, column);
        }
    }
    true
}

fn subtract(target: &mut Cubic, source: &Cubic, column: usize) {
    let factor = target[column];
    for k in column..20 {
        target[k] -= factor * source[k];
    }
}

/// Three equations `p(z) x + q(z) y + r(z) = 0`; coefficients ascending: degrees 3, 3, 4.
type Row = ([f64; 4], [f64; 4], [f64; 5]);

/// `⟨x² z⟩ − z ⟨x²⟩` and its likes: what remains of rows five to ten when their leading terms cancel.
fn reduced_rows(m: &[Cubic; 10]) -> [Row; 3] {
    std::array::from_fn(|k| {
        let (e, f) = (&m[4 + 2 * k], &m[5 + 2 * k]);
        let third = |at: usize| [e[at + 2], e[at + 1] - f[at + 2], e[at] - f[at + 1], -f[at]];
        let last = [e[19], e[18] - f[19], e[17] - f[18], e[16] - f[17], -f[16]];
        (third(10), third(13), last)
    })
}

fn determinant(rows: &[Row; 3]) -> [f64; 11] {
    let mut sum = [0.0; 11];
    for k in 0..3 {
        let (first, second) = (&rows[(k + 1) % 3], &rows[(k + 2) % 3]);
        let mut minor = [0.0; 7];
        for i in 0..4 {
            for j in 0..4 {
                minor[i + j] += first.0[i] * second.1[j] - first.1[i] * second.0[j];
            }
        }
        for i in 0..7 {
            for j in 0..5 {
                sum[i + j] += minor[i] * rows[k].2[j];
            }
        }
    }
    sum
}

fn evaluate(c: &[f64], z: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, v| sum * z + v)
}

/// x and y at a root: the null vector of the three equations, from the pair of rows that are least alike.
fn back_substitute(rows: &[Row; 3], z: f64) -> Option<(f64, f64)> {
    let at: [Vector3<f64>; 3] = std::array::from_fn(|k| {
        Vector3::new(evaluate(&rows[k].0, z), evaluate(&rows[k].1, z), evaluate(&rows[k].2, z))
    });
    let crosses = [at[0].cross(&at[1]), at[1].cross(&at[2]), at[2].cross(&at[0])];
    let best = crosses.iter().max_by(|p, q| p.norm_squared().total_cmp(&q.norm_squared()))?;
    (best.z.abs() > f64::MIN_POSITIVE).then(|| (best.x / best.z, best.y / best.z))
}
