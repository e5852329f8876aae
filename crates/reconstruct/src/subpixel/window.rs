//! Aligning one small window: shift, gain and offset by Gauss-Newton.
#![allow(clippy::needless_range_loop, reason = "arrays of one fixed length side by side: what vectorises")]

use super::warp::cubic_weights;
use crate::dispatch::widest;
use selenograph_raster::Raster;

/// Half the side of a window, samples.
pub(super) const RADIUS: usize = 10;

/// Samples that a window needs on each side of its centre, with a neighbour for its gradients.
const REACH: usize = RADIUS + 1;

/// Samples from the rim that a window's centre keeps.
pub(super) const MARGIN: usize = REACH + 1;

/// Rows of a window with the neighbours of its rim.
const ROWS: usize = 2 * REACH + 1;

/// The same with room to a multiple of eight.
const COLUMNS: usize = 24;

/// Steps after which an alignment that does not settle is given up.
const MAX_STEPS: usize = 15;

/// A step this small ends the search, samples.
const SETTLED: f32 = 2e-3;

/// Smallest determinant of the normal matrix against its trace²: below it the window shows an edge, not a corner.
const MIN_CONDITION: f32 = 1e-3;

type Samples = [[f32; COLUMNS]; ROWS];

/// How a window was aligned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Aligned {
    /// Where the window is found, from where it was, samples.
    pub(super) shift: [f32; 2],
    /// Standard deviation of the shift from the residual, samples, mean of both axes.
    pub(super) sigma: f32,
    /// Correlation with what is found.
    pub(super) correlation: f32,
}

/// Finds the window of `from` around a sample in `to`; `None` where it leaves the picture or moves further than `limit` from the
/// start in either axis.
pub(super) fn align(
    from: &Raster<f32>,
    to: &Raster<f32>,
    centre: [usize; 2],
    start: [f32; 2],
    limit: f32,
) -> Option<Aligned> {
    let mut template = [[0.0; COLUMNS]; ROWS];
    whole_window(from, centre, &mut template)?;
    let mut shift = start;
    let mut state = State::default();
    for _ in 0..MAX_STEPS {
        let mut found = [[0.0; COLUMNS]; ROWS];
        shifted_window(to, centre, shift, &mut found)?;
        measure(&template, &found, &mut state);
        let step = state.step()?;
        shift = [shift[0] + step[0], shift[1] + step[1]];
        if (shift[0] - start[0]).abs() > limit || (shift[1] - start[1]).abs() > limit {
            return None;
        }
        if step[0].abs().max(step[1].abs()) < SETTLED {
            return Some(Aligned { shift, sigma: state.sigma()?, correlation: state.correlation });
        }
    }
    None
}

/// Copies the window around a sample.
fn whole_window(image: &Raster<f32>, [x, y]: [usize; 2], out: &mut Samples) -> Option<()> {
    let inside = |centre: usize, side: usize| centre >= REACH && centre + REACH < side;
    if !inside(x, image.width) || !inside(y, image.height) {
        return None;
    }
    for (j, row) in out.iter_mut().enumerate() {
        let from = (y + j - REACH) * image.width + x - REACH;
        row[..ROWS].copy_from_slice(&image.data[from..from + ROWS]);
    }
    Some(())
}

/// Interpolates the window at a shift from a sample.
fn shifted_window(image: &Raster<f32>, [x, y]: [usize; 2], shift: [f32; 2], out: &mut Samples) -> Option<()> {
    let (whole_x, whole_y) = (shift[0].floor(), shift[1].floor());
    let (weights_x, weights_y) = (cubic_weights(shift[0] - whole_x), cubic_weights(shift[1] - whole_y));
    // One sample more before the window and two after it.
    let start = |centre: usize, whole: f32, side: usize| {
        let low = usize::try_from(centre as i64 + whole as i64 - REACH as i64 - 1).ok()?;
        (low + ROWS + 3 <= side).then_some(low)
    };
    let left = start(x, whole_x, image.width)?;
    let top = start(y, whole_y, image.height)?;
    let mut lines = [[0.0f32; COLUMNS + 3]; ROWS + 3];
    for (j, line) in lines.iter_mut().enumerate() {
        let from = (top + j) * image.width + left;
        line[..ROWS + 3].copy_from_slice(&image.data[from..from + ROWS + 3]);
    }
    interpolate(&lines, &weights_x, &weights_y, out);
    Some(())
}

widest! {
    fn interpolate(lines: &[[f32; COLUMNS + 3]; ROWS + 3], wx: &[f32; 4], wy: &[f32; 4], out: &mut Samples) = interpolate_body
}

#[inline(always)]
fn interpolate_body(lines: &[[f32; COLUMNS + 3]; ROWS + 3], wx: &[f32; 4], wy: &[f32; 4], out: &mut Samples) {
    let mut along = [[0.0f32; COLUMNS]; ROWS + 3];
    for j in 0..ROWS + 3 {
        for i in 0..COLUMNS {
            let line = &lines[j];
            along[j][i] = wx[0] * line[i] + wx[1] * line[i + 1] + wx[2] * line[i + 2] + wx[3] * line[i + 3];
        }
    }
    for j in 0..ROWS {
        for i in 0..COLUMNS {
            out[j][i] = wy[0] * along[j][i]
                + wy[1] * along[j + 1][i]
                + wy[2] * along[j + 2][i]
                + wy[3] * along[j + 3][i];
        }
    }
}

/// The normal equations of the shift, with gain and offset eliminated.
#[derive(Debug, Clone, Copy, Default)]
struct State {
    xx: f32,
    xy: f32,
    yy: f32,
    x: f32,
    y: f32,
    residual: f32,
    correlation: f32,
}

impl State {
    fn determinant(&self) -> f32 {
        self.xx * self.yy - self.xy * self.xy
    }

    fn step(&self) -> Option<[f32; 2]> {
        let (determinant, trace) = (self.determinant(), self.xx + self.yy);
        if determinant.is_nan() || determinant <= MIN_CONDITION * trace * trace {
            return None;
        }
        Some([
            (self.yy * self.x - self.xy * self.y) / determinant,
            (self.xx * self.y - self.xy * self.x) / determinant,
        ])
    }

    /// `√(s² · trace(N⁻¹) / 2)` with the residual's variance `s²`.
    fn sigma(&self) -> Option<f32> {
        let degrees = ((2 * RADIUS + 1) * (2 * RADIUS + 1) - 4) as f32;
        let variance = self.residual / degrees;
        let sigma = (0.5 * variance * (self.xx + self.yy) / self.determinant()).sqrt();
        sigma.is_finite().then_some(sigma)
    }
}

widest! {
    /// Compares a template with what was found, both with gradients.
    fn measure(template: &Samples, found: &Samples, state: &mut State) = measure_body
}

/// Columns that are summed side by side; those beyond the window have weight 0.
const LANES: usize = 8;

#[inline(always)]
fn measure_body(template: &Samples, found: &Samples, state: &mut State) {
    let inside = interior();
    let n = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
    let (mut sa, mut sb) = ([0.0f32; COLUMNS], [0.0f32; COLUMNS]);
    for j in 1..ROWS - 1 {
        for i in 0..COLUMNS {
            sa[i] += inside[i] * template[j][i];
            sb[i] += inside[i] * found[j][i];
        }
    }
    let (mean_a, mean_b) = (total(&sa) / n, total(&sb) / n);
    let (mut aa, mut ab, mut bb) = ([0.0f32; COLUMNS], [0.0f32; COLUMNS], [0.0f32; COLUMNS]);
    for j in 1..ROWS - 1 {
        for i in 0..COLUMNS {
            let (a, b) = (inside[i] * (template[j][i] - mean_a), inside[i] * (found[j][i] - mean_b));
            aa[i] += a * a;
            ab[i] += a * b;
            bb[i] += b * b;
        }
    }
    let (aa, ab, bb) = (total(&aa), total(&ab), total(&bb));
    let gain = ab / bb;
    state.correlation = ab / (aa * bb).sqrt();
    let mut sums = [[0.0f32; COLUMNS]; 10];
    for j in 1..ROWS - 1 {
        let mut gx = [0.0f32; COLUMNS];
        let mut gy = [0.0f32; COLUMNS];
        for i in 1..COLUMNS - 1 {
            gx[i] = 0.25
                * ((template[j][i + 1] - template[j][i - 1]) + gain * (found[j][i + 1] - found[j][i - 1]));
        }
        for i in 0..COLUMNS {
            gy[i] = 0.25
                * ((template[j + 1][i] - template[j - 1][i]) + gain * (found[j + 1][i] - found[j - 1][i]));
        }
        for i in 0..COLUMNS {
            let (x, y) = (inside[i] * gx[i], inside[i] * gy[i]);
            let b = found[j][i] - mean_b;
            let r = template[j][i] - mean_a - gain * b;
            sums[0][i] += x;
            sums[1][i] += y;
            sums[2][i] += x * x;
            sums[3][i] += x * y;
            sums[4][i] += y * y;
            sums[5][i] += x * b;
            sums[6][i] += y * b;
            sums[7][i] += x * r;
            sums[8][i] += y * r;
            sums[9][i] += inside[i] * r * r;
        }
    }
    let mut s = [0.0f32; 10];
    for k in 0..10 {
        s[k] = total(&sums[k]);
    }
    state.xx = s[2] - s[0] * s[0] / n - s[5] * s[5] / bb;
    state.xy = s[3] - s[0] * s[1] / n - s[5] * s[6] / bb;
    state.yy = s[4] - s[1] * s[1] / n - s[6] * s[6] / bb;
    (state.x, state.y, state.residual) = (s[7], s[8], s[9]);
}

/// 1 inside the window, 0 in its rim.
#[inline(always)]
fn interior() -> [f32; COLUMNS] {
    let mut inside = [0.0; COLUMNS];
    for i in 1..ROWS - 1 {
        inside[i] = 1.0;
    }
    inside
}

/// The sum of all columns, in an order that does not depend on the machine.
#[inline(always)]
fn total(columns: &[f32; COLUMNS]) -> f32 {
    let mut lanes = [0.0f32; LANES];
    for i in 0..LANES {
        lanes[i] = columns[i] + columns[i + LANES] + columns[i + 2 * LANES];
    }
    let mut sum = 0.0;
    for lane in lanes {
        sum += lane;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth enough for cubic interpolation, rough enough to fix a shift.
    fn wavy(x: f32, y: f32) -> f32 {
        (0.31 * x + 0.13 * y).sin()
            + 0.7 * (0.17 * x - 0.29 * y + 1.0).cos()
            + 0.3 * (0.53 * y + 0.2 * x).sin()
    }

    /// What cubic interpolation of waves of 11 samples leaves, and where the search stops, samples.
    const INTERPOLATION_PX: f32 = 5e-3;

    #[test]
    fn shifts_are_found_whatever_gain_and_offset() {
        let a = Raster::from_fn(64, 64, |x, y| wavy(x as f32, y as f32));
        for (dx, dy) in [(0.0f32, 0.0f32), (0.37, -0.81), (1.5, 1.25), (-0.05, 0.5)] {
            let b = Raster::from_fn(64, 64, |x, y| 0.4 * wavy(x as f32 - dx, y as f32 - dy) + 3.0);
            let found = align(&a, &b, [30, 33], [0.0, 0.0], 3.0).unwrap();
            let error = (found.shift[0] - dx).hypot(found.shift[1] - dy);
            assert!(error < INTERPOLATION_PX && found.correlation > 0.999, "{dx} {dy} {found:?}");
        }
    }

    #[test]
    fn edges_rims_and_flat_ground_are_refused() {
        let edge = Raster::from_fn(64, 64, |x, _| (x as f32 * 0.2).tanh());
        assert_eq!(align(&edge, &edge, [30, 30], [0.0, 0.0], 3.0), None);
        let flat = Raster { width: 64, height: 64, data: vec![0.5f32; 4096] };
        assert_eq!(align(&flat, &flat, [30, 30], [0.0, 0.0], 3.0), None);
        let a = Raster::from_fn(64, 64, |x, y| wavy(x as f32, y as f32));
        assert_eq!(align(&a, &a, [5, 30], [0.0, 0.0], 3.0), None);
    }
}
