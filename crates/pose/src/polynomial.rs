//! Real roots of polynomials of low degree, as the minimal solvers need them.

/// Highest degree that is handled.
pub const MAX_DEGREE: usize = 10;
/// A critical point whose value is this small beside its terms is a double root that rounding has lifted off the axis.
const TOUCH: f64 = 1e-13;
/// Steps after which a bracketed root is as good as f64 makes it: bisection alone gains a bit per step.
const MAX_STEPS: usize = 64;

/// Real roots of `c[0] + c[1] x + … + c[n] xⁿ`, each once; their order is not sorted. Returns how many were written to `roots`.
///
/// Roots inside [-1, 1] come from the polynomial, those outside as reciprocals of the roots of its reverse, so that every search runs
/// on a bounded interval. On an interval, the roots of a derivative separate those of the function: starting from the linear
/// derivative, each degree is solved between the roots of the last.
///
/// # Shapes and units
/// `coefficients`: 2 to 11, ascending. Nothing is found where all are zero or one is not finite.
/// # Source
/// Yuksel 2022, "High-Performance Polynomial Root Finding for Graphics", Proc. ACM CGIT 5(3), with reversal for the outside.
pub fn real_roots(coefficients: &[f64], roots: &mut [f64; MAX_DEGREE]) -> usize {
    let degree = coefficients.len().saturating_sub(1).min(MAX_DEGREE);
    let scale = coefficients.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    if degree == 0 || !scale.is_finite() || scale <= 0.0 || coefficients.iter().any(|c| c.is_nan()) {
        return 0;
    }
    let mut forward = [0.0; MAX_DEGREE + 1];
    let mut reverse = [0.0; MAX_DEGREE + 1];
    for (i, c) in coefficients.iter().take(degree + 1).enumerate() {
        forward[i] = c / scale;
        reverse[degree - i] = c / scale;
    }
    let mut count = 0;
    let mut found = [0.0; MAX_DEGREE];
    let inside = roots_in_unit(&forward, degree, &mut found);
    for &x in &found[..inside] {
        count = push(roots, count, x);
    }
    let outside = roots_in_unit(&reverse, degree, &mut found);
    for &w in &found[..outside] {
        // ±1 belongs to the first half; 0 is a leading coefficient of zero, a root at infinity.
        if w.abs() < 1.0 && w.abs() > 1e-12 {
            count = push(roots, count, 1.0 / w);
        }
    }
    count
}

fn push(roots: &mut [f64; MAX_DEGREE], count: usize, x: f64) -> usize {
    if count < MAX_DEGREE {
        roots[count] = x;
        count + 1
    } else {
        count
    }
}

/// Roots in [-1, 1], ascending.
fn roots_in_unit(c: &[f64; MAX_DEGREE + 1], degree: usize, out: &mut [f64; MAX_DEGREE]) -> usize {
    // derivatives[k] has degree k: the (degree − k)-th derivative, divided by what keeps its numbers small.
    let mut derivatives = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    derivatives[degree] = *c;
    for k in (1..degree).rev() {
        for i in 0..=k {
            derivatives[k][i] = derivatives[k + 1][i + 1] * (i + 1) as f64 / (k + 1) as f64;
        }
    }
    let mut critical = [0.0; MAX_DEGREE];
    let mut num_critical = 0;
    for (k, derivative) in derivatives.iter().enumerate().take(degree + 1).skip(1) {
        let mut next = [0.0; MAX_DEGREE];
        num_critical = between(derivative, k, &critical[..num_critical], k == degree, &mut next);
        critical = next;
    }
    *out = critical;
    num_critical
}

/// Roots of a polynomial of degree `k` in [-1, 1], between its given critical points.
fn between(
    p: &[f64; MAX_DEGREE + 1],
    k: usize,
    critical: &[f64],
    last: bool,
    out: &mut [f64; MAX_DEGREE],
) -> usize {
    // The ends of a bracket need not be exact: only roots nearer to each other than this are lost.
    let tolerance = if last { 2.0 * f64::EPSILON } else { 1e-8 };
    let mut count = 0;
    let (mut low, mut value_low) = (-1.0, value(p, k, -1.0));
    if value_low == 0.0 {
        count = push(out, count, low);
    }
    for i in 0..=critical.len() {
        let high = if i < critical.len() { critical[i] } else { 1.0 };
        let value_high = value(p, k, high);
        if value_low * value_high < 0.0 {
            count = push(out, count, bracketed(p, k, [low, high], [value_low, value_high], tolerance));
        } else if value_high == 0.0
            || (last && i < critical.len() && value_high.abs() < TOUCH * magnitude(p, k, high))
        {
            count = push(out, count, high);
        }
        (low, value_low) = (high, value_high);
    }
    count
}

fn value(p: &[f64; MAX_DEGREE + 1], k: usize, x: f64) -> f64 {
    let mut sum = p[k];
    for i in (0..k).rev() {
        sum = sum * x + p[i];
    }
    sum
}

fn magnitude(p: &[f64; MAX_DEGREE + 1], k: usize, x: f64) -> f64 {
    let mut sum = p[k].abs();
    for i in (0..k).rev() {
        sum = sum * x.abs() + p[i].abs();
    }
    sum
}

/// The root in a bracket whose ends have different signs: Newton, and bisection where Newton leaves the bracket.
fn bracketed(p: &[f64; MAX_DEGREE + 1], k: usize, ends: [f64; 2], values: [f64; 2], tolerance: f64) -> f64 {
    let [mut low, mut high] = ends;
    let value_low = values[0];
    // Where the chord crosses, kept off the ends.
    let share = (values[0] / (values[0] - values[1])).clamp(0.05, 0.95);
    let mut x = low + share * (high - low);
    for _ in 0..MAX_STEPS {
        let (mut f, mut slope) = (p[k], 0.0);
        for i in (0..k).rev() {
            slope = slope * x + f;
            f = f * x + p[i];
        }
        if f == 0.0 {
            return x;
        }
        if (f < 0.0) == (value_low < 0.0) {
            low = x;
        } else {
            high = x;
        }
        let newton = x - f / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() <= tolerance {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients of a product of linear factors.
    fn from_roots(roots: &[f64]) -> Vec<f64> {
        let mut c = vec![1.0];
        for r in roots {
            let mut next = vec![0.0; c.len() + 1];
            for (i, v) in c.iter().enumerate() {
                next[i + 1] += v;
                next[i] -= r * v;
            }
            c = next;
        }
        c
    }

    fn sorted(c: &[f64]) -> Vec<f64> {
        let mut roots = [0.0; MAX_DEGREE];
        let n = real_roots(c, &mut roots);
        let mut v = roots[..n].to_vec();
        v.sort_by(f64::total_cmp);
        v
    }

    #[test]
    fn roots_of_every_degree_are_found() {
        let all = [-30.0, -4.0, -1.5, -0.9, -0.3, 0.0, 0.2, 0.7, 3.0, 800.0];
        for n in 1..=10 {
            let found = sorted(&from_roots(&all[..n]));
            assert_eq!(found.len(), n, "{found:?}");
            for (f, t) in found.iter().zip(&all) {
                assert!((f - t).abs() < 1e-8 * t.abs().max(1.0), "{f} {t}");
            }
        }
    }

    #[test]
    fn complex_pairs_and_vanishing_leading_terms() {
        assert!(sorted(&[1.0, 0.0, 1.0]).is_empty());
        assert_eq!(sorted(&[-2.0, 1.0, 0.0, 0.0]).len(), 1);
        // (x² + 1)(x − 0.5)(x + 8)
        let found = sorted(&[-4.0, 7.5, -3.0, 7.5, 1.0]);
        assert_eq!(found.len(), 2);
        assert!((found[0] + 8.0).abs() < 1e-12 && (found[1] - 0.5).abs() < 1e-14);
        assert!(sorted(&[0.0, 0.0]).is_empty());
        assert!(sorted(&[f64::NAN, 1.0]).is_empty());
    }

    #[test]
    fn a_double_root_is_found_at_least_once() {
        let found = sorted(&from_roots(&[0.5, 0.5, -0.25]));
        assert!(found.iter().any(|x| (x - 0.5).abs() < 1e-6), "{found:?}");
    }
}
