//! Two-view refinement: the five degrees of freedom of a relative pose, over all matches, with a robust loss.
//!
//! Levenberg-Marquardt on the Sampson distances with iteratively reweighted squares; the rotation moves as `exp(ω) R`, the
//! translation on its sphere. Near a plane, rotation and lateral translation nearly trade places: only all matches together tell
//! them apart, so that this step, not the minimal solver, decides the pose.

use crate::decompose::{Motion, nearest_rotation};
use crate::points::{LANES, Pairs};
use crate::sampson::{Block, Tangent, essential_derivatives, linearise, tangent_axes};
use selenograph_geometry::robust::MAD_TO_SIGMA;
use selenograph_geometry::{Matrix3, Rotation3, SMatrix, Vector3};

/// What a residual costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// `c² ln(1 + r²/c²)` with the given `c²`; residuals above `cutoff²` do not count.
    Cauchy {
        /// Square of the scale.
        scale_squared: f64,
        /// Square of the residual from which a match is left out.
        cutoff_squared: f64,
    },
    /// `min(r², limit)`.
    Truncated {
        /// Square of the threshold.
        limit: f64,
    },
}

impl Loss {
    /// Weights of a block of residuals, and their summed cost.
    fn of(self, residuals: &[f64; LANES], weights: &mut [f64; LANES]) -> f64 {
        match self {
            Self::Cauchy { scale_squared, cutoff_squared } => {
                let (inverse, largest) = (1.0 / scale_squared, 1.0 + cutoff_squared.min(FAR) / scale_squared);
                // One logarithm of the product instead of one each: eight factors below 1e38 do not overflow.
                let mut product = 1.0;
                for (w, r) in weights.iter_mut().zip(residuals) {
                    let squared = r * r;
                    let factor = (1.0 + squared * inverse).min(largest);
                    *w = if squared < cutoff_squared { 1.0 / factor } else { 0.0 };
                    product *= factor.min(1e38);
                }
                scale_squared * product.ln()
            }
            Self::Truncated { limit } => {
                let mut cost = 0.0;
                for (w, r) in weights.iter_mut().zip(residuals) {
                    let squared = r * r;
                    *w = if squared < limit { 1.0 } else { 0.0 };
                    cost += squared.min(limit);
                }
                cost
            }
        }
    }
}

/// No Sampson distance on the plane `z = 1` is as large as this.
const FAR: f64 = 1e12;

/// A refined motion.
#[derive(Debug, Clone, Copy)]
pub struct Refined {
    /// The motion, its translation of length 1.
    pub motion: Motion,
    /// Its cost under the loss.
    pub cost: f64,
    /// Steps that were accepted.
    pub steps: usize,
}

/// `Σ w J Jᵀ` (upper triangle, packed), `Σ w r J` and the cost.
struct Normal {
    hessian: [f64; 15],
    gradient: [f64; 5],
    cost: f64,
}

/// Pairs `(i, j)` of the packed triangle.
const PACKED: [(usize, usize); 15] = [
    (0, 0),
    (0, 1),
    (0, 2),
    (0, 3),
    (0, 4),
    (1, 1),
    (1, 2),
    (1, 3),
    (1, 4),
    (2, 2),
    (2, 3),
    (2, 4),
    (3, 3),
    (3, 4),
    (4, 4),
];

/// Linearises the matches block by block and hands each block over, its padding zeroed.
fn for_blocks(pairs: &Pairs, motion: &Motion, mut take: impl FnMut(&Block, usize)) {
    let e = motion.essential();
    let derivatives = essential_derivatives(motion);
    let mut block = Block { residual: [0.0; LANES], jacobian: [[0.0; LANES]; 5] };
    for start in (0..pairs.padded_len()).step_by(LANES) {
        linearise(pairs, start, &e, &derivatives, &mut block);
        let valid = (pairs.len() - start).min(LANES);
        for k in valid..LANES {
            block.residual[k] = 0.0;
            for row in &mut block.jacobian {
                row[k] = 0.0;
            }
        }
        take(&block, valid);
    }
}

fn normal(pairs: &Pairs, motion: &Motion, loss: Loss) -> Normal {
    let mut hessian = [[0.0; LANES]; 15];
    let mut gradient = [[0.0; LANES]; 5];
    let mut cost = 0.0;
    for_blocks(pairs, motion, |block, _| {
        let mut weighted = [[0.0; LANES]; 5];
        let mut weights = [0.0; LANES];
        cost += loss.of(&block.residual, &mut weights);
        for (row, j) in weighted.iter_mut().zip(&block.jacobian) {
            for k in 0..LANES {
                row[k] = weights[k] * j[k];
            }
        }
        for (sum, (i, j)) in hessian.iter_mut().zip(PACKED) {
            for k in 0..LANES {
                sum[k] += weighted[i][k] * block.jacobian[j][k];
            }
        }
        for (sum, row) in gradient.iter_mut().zip(&weighted) {
            for k in 0..LANES {
                sum[k] += row[k] * block.residual[k];
            }
        }
    });
    Normal { hessian: hessian.map(|l| l.iter().sum()), gradient: gradient.map(|l| l.iter().sum()), cost }
}

/// A motion moved by a tangent vector.
pub fn moved(motion: &Motion, step: &Tangent) -> Motion {
    let turn = Rotation3::new(Vector3::new(step[0], step[1], step[2]));
    let axes = tangent_axes(&motion.translation);
    let shift = axes[0] * step[3] + axes[1] * step[4];
    let angle = shift.norm();
    let translation = if angle > 0.0 {
        motion.translation.normalize() * angle.cos() + shift * (angle.sin() / angle)
    } else {
        motion.translation.normalize()
    };
    Motion { rotation: turn.matrix() * motion.rotation, translation }
}

/// Refines a motion over all matches, at most `max_steps` steps.
pub fn refine(pairs: &Pairs, start: &Motion, loss: Loss, max_steps: usize) -> Refined {
    let mut motion = Motion { translation: start.translation.normalize(), ..*start };
    let mut current = normal(pairs, &motion, loss);
    let mut damping = 1e-4;
    let mut steps = 0;
    for _ in 0..max_steps {
        let Some(step) = solve(&current, damping) else { break };
        let candidate = moved(&motion, &step);
        let next = normal(pairs, &candidate, loss);
        if next.cost < current.cost {
            let gain = current.cost - next.cost;
            let done = gain < 1e-9 * current.cost || step.norm() < 1e-10;
            (motion, current) = (candidate, next);
            steps += 1;
            damping = (damping * 0.1).max(1e-12);
            if done {
                break;
            }
        } else {
            if step.norm() < 1e-10 {
                break;
            }
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    motion.rotation = nearest_rotation(&motion.rotation);
    Refined { motion, cost: current.cost, steps }
}

fn solve(normal: &Normal, damping: f64) -> Option<Tangent> {
    let mut h = SMatrix::<f64, 5, 5>::zeros();
    for (value, (i, j)) in normal.hessian.iter().zip(PACKED) {
        h[(i, j)] = *value;
        h[(j, i)] = *value;
    }
    let floor = h.diagonal().max() * 1e-12;
    for i in 0..5 {
        h[(i, i)] += damping * h[(i, i)] + floor;
    }
    let gradient = Tangent::from_column_slice(&normal.gradient);
    h.cholesky().map(|c| -c.solve(&gradient)).filter(|s| s.iter().all(|v| v.is_finite()))
}

/// What the residuals at a motion say about its accuracy.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Uncertainty {
    /// Covariance of the five components (rotation in B, radians; direction in the axes of [`tangent_axes`], radians).
    pub covariance: SMatrix<f64, 5, 5>,
    /// Root mean square of the residuals below the cutoff.
    pub rms: f64,
}

/// Covariance of an M-estimate over the matches below the cutoff: `E[ψ²] / E[ψ']² · (Σ J Jᵀ)⁻¹ · n / (n − 5)`.
///
/// It holds the noise of the matches, taken as independent and of one size; not their common faults (an error of K, distortion).
/// Infinite on the diagonal where the normal matrix is singular.
/// # Source
/// Huber 1981, "Robust Statistics", §7.6.
pub(crate) fn uncertainty(
    pairs: &Pairs,
    motion: &Motion,
    scale_squared: f64,
    cutoff_squared: f64,
) -> Uncertainty {
    let mut information = SMatrix::<f64, 5, 5>::zeros();
    let (mut n, mut psi_squared, mut psi_slope, mut squares) = (0.0, 0.0, 0.0, 0.0);
    for_blocks(pairs, motion, |block, valid| {
        for k in 0..valid {
            let squared = block.residual[k] * block.residual[k];
            if squared >= cutoff_squared {
                continue;
            }
            let u = squared / scale_squared;
            n += 1.0;
            squares += squared;
            psi_squared += squared / ((1.0 + u) * (1.0 + u));
            psi_slope += (1.0 - u) / ((1.0 + u) * (1.0 + u));
            let j = Tangent::from_fn(|i, _| block.jacobian[i][k]);
            information += j * j.transpose();
        }
    });
    let free = (n - 5.0_f64).max(1.0);
    let slope = psi_slope / n;
    let factor = psi_squared / free / (slope * slope);
    let covariance = information
        .try_inverse()
        .filter(|c| c.iter().all(|v| v.is_finite()))
        .map_or_else(|| SMatrix::from_diagonal_element(f64::INFINITY), |inverse| inverse * factor);
    Uncertainty { covariance, rms: (squares / n.max(1.0)).sqrt() }
}

/// Robust sigma of the distances: [`MAD_TO_SIGMA`] × their median absolute value, over the matches within `cutoff`.
pub fn robust_sigma(pairs: &Pairs, e: &Matrix3<f64>, cutoff: f64) -> f64 {
    let mut sizes: Vec<f64> = (0..pairs.len())
        .map(|i| crate::sampson::distance(e, &pairs.a(i), &pairs.b(i)).abs())
        .filter(|r| *r < cutoff)
        .collect();
    if sizes.is_empty() {
        return cutoff;
    }
    let middle = sizes.len() / 2;
    MAD_TO_SIGMA * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
}
