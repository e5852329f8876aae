//! The homography that fits most matches, for carrying pixels from A to B.

use crate::dispatch::widest;
use crate::matching::Match;
use selenograph_geometry::pixel::center_of;
use selenograph_geometry::{Point2, SMatrix, SVector};

/// Rounds of reweighting.
const ROUNDS: usize = 8;

/// Residual at which a match counts half, pixels: relief moves points by some.
const HALF_WEIGHT_PX: f64 = 3.0;

/// Denominators below this are beyond the horizon, or nearly.
const HORIZON: f64 = 1e-3;

/// `b = (H a) / (h · a)` in coordinates around the matches' middles.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Homography {
    /// Rows of the matrix but its last entry, which is 1.
    h: [f64; 8],
    middle_a: Point2<f64>,
    middle_b: Point2<f64>,
    unit: f64,
}

impl Homography {
    /// Reweighted least squares; `None` if the matches do not fix it.
    pub(super) fn fit(matches: &[Match]) -> Option<Self> {
        let mean = |of: fn(&Match) -> Point2<f64>| {
            let sum = matches.iter().fold([0.0; 2], |s, m| [s[0] + of(m).x, s[1] + of(m).y]);
            Point2::new(sum[0] / matches.len() as f64, sum[1] / matches.len() as f64)
        };
        let (middle_a, middle_b) = (mean(|m| m.a), mean(|m| m.b));
        let spread = matches.iter().map(|m| (m.a - middle_a).norm()).sum::<f64>() / matches.len() as f64;
        let mut fitted =
            Self { h: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], middle_a, middle_b, unit: spread };
        for round in 0..ROUNDS {
            let mut normal = SMatrix::<f64, 8, 8>::zeros();
            let mut right = SVector::<f64, 8>::zeros();
            for m in matches {
                let weight = match (round, fitted.point(&m.a)) {
                    (0, _) => 1.0,
                    (_, Some(p)) => 1.0 / (1.0 + (p - m.b).norm_squared() / HALF_WEIGHT_PX.powi(2)),
                    (_, None) => 0.0,
                };
                let [x, y] = [(m.a.x - middle_a.x) / spread, (m.a.y - middle_a.y) / spread];
                let [u, v] = [(m.b.x - middle_b.x) / spread, (m.b.y - middle_b.y) / spread];
                for (row, value) in [
                    (SVector::from([x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y]), u),
                    (SVector::from([0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y]), v),
                ] {
                    normal.ger(weight, &row, &row, 1.0);
                    right.axpy(weight * value, &row, 1.0);
                }
            }
            let h = normal.cholesky()?.solve(&right);
            fitted.h = std::array::from_fn(|i| h[i]);
        }
        fitted.h.iter().all(|h| h.is_finite()).then_some(fitted)
    }

    /// Where a point of A lies in B; `None` at and beyond the horizon.
    #[inline]
    pub(super) fn point(&self, a: &Point2<f64>) -> Option<Point2<f64>> {
        let [x, y] = [(a.x - self.middle_a.x) / self.unit, (a.y - self.middle_a.y) / self.unit];
        let h = &self.h;
        let w = h[6] * x + h[7] * y + 1.0;
        (w > HORIZON).then(|| {
            let scale = self.unit / w;
            Point2::new(
                self.middle_b.x + scale * (h[0] * x + h[1] * y + h[2]),
                self.middle_b.y + scale * (h[3] * x + h[4] * y + h[5]),
            )
        })
    }

    /// Where the pixels of a row of A lie in B; NaN at and beyond the horizon.
    pub(super) fn row(&self, y: f64, bx: &mut [f64], by: &mut [f64]) {
        let v = (y - self.middle_a.y) / self.unit;
        let h = &self.h;
        let linear = |slope: f64, constant: f64| {
            let slope = slope / self.unit;
            [slope, constant + slope * (center_of(0) - self.middle_a.x)]
        };
        let rows =
            [linear(h[0], h[1] * v + h[2]), linear(h[3], h[4] * v + h[5]), linear(h[6], h[7] * v + 1.0)];
        along_row(&rows, self.unit, [self.middle_b.x, self.middle_b.y], bx, by);
    }

    /// Pixels of B a pixel of A, by area.
    pub(super) fn scale_at(&self, a: &Point2<f64>) -> f64 {
        let at = |dx: f64, dy: f64| self.point(&Point2::new(a.x + dx, a.y + dy));
        let (Some(o), Some(x), Some(y)) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)) else { return 1.0 };
        let (x, y) = (x - o, y - o);
        (x.x * y.y - x.y * y.x).abs().sqrt()
    }
}

widest! {
    /// `middle + unit · (p + q i) / (r + s i)` for both coordinates.
    fn along_row(rows: &[[f64; 2]; 3], unit: f64, middle: [f64; 2], bx: &mut [f64], by: &mut [f64]) = along_row_body
}

#[inline(always)]
fn along_row_body(rows: &[[f64; 2]; 3], unit: f64, middle: [f64; 2], bx: &mut [f64], by: &mut [f64]) {
    let n = bx.len().min(by.len());
    let (bx, by) = (&mut bx[..n], &mut by[..n]);
    for i in 0..n {
        let x = f64::from(i as u32);
        let w = rows[2][1] + rows[2][0] * x;
        let scale = if w > HORIZON { unit / w } else { f64::NAN };
        bx[i] = middle[0] + scale * (rows[0][1] + rows[0][0] * x);
        by[i] = middle[1] + scale * (rows[1][1] + rows[1][0] * x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_a_homography_among_outliers() {
        let truth = |x: f64, y: f64| {
            let w = 1.0 + 2e-4 * x - 1e-4 * y;
            Point2::new((0.3 * x - 0.9 * y + 400.0) / w, (0.9 * x + 0.35 * y - 20.0) / w)
        };
        let matches: Vec<Match> = (0..200u16)
            .map(|i| {
                let [x, y] = [f64::from(i * 37 % 512), f64::from(i * 91 % 512)];
                let off = if i % 10 == 0 { 40.0 } else { 0.0 };
                let b = truth(x, y);
                Match { a: Point2::new(x, y), b: Point2::new(b.x + off, b.y), score: 0.0 }
            })
            .collect();
        let fitted = Homography::fit(&matches).unwrap();
        let probe = Point2::new(250.0, 130.0);
        assert!((fitted.point(&probe).unwrap() - truth(250.0, 130.0)).norm() < 0.2);
        let (mut bx, mut by) = (vec![0.0; 300], vec![0.0; 300]);
        fitted.row(center_of(130), &mut bx, &mut by);
        let at = fitted.point(&Point2::new(center_of(250), center_of(130))).unwrap();
        assert!((bx[250] - at.x).hypot(by[250] - at.y) < 1e-9);
        let [o, x, y] = [truth(250.0, 130.0), truth(251.0, 130.0), truth(250.0, 131.0)];
        let area = (x - o).perp(&(y - o)).abs();
        assert!((fitted.scale_at(&probe) - area.sqrt()).abs() < 0.01);
    }
}
