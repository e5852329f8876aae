//! Arc tangent and exponential good to a few ten-thousandths, in loops that vectorise.

use std::f32::consts::{FRAC_PI_2, LOG2_E, PI};

/// Angle of `(x, y)` in `[-π, π]`, to 4e-4; 0 at the origin.
#[inline(always)]
pub(super) fn atan2(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (large, small) = (ax.max(ay), ax.min(ay));
    let t = small / (large + f32::MIN_POSITIVE);
    let s = t * t;
    // Minimax polynomial of odd degree 7 on [0, 1].
    let r = ((-0.046_496_473 * s + 0.159_314_22) * s - 0.327_622_76) * s * t + t;
    let r = if ay > ax { FRAC_PI_2 - r } else { r };
    let r = if x < 0.0 { PI - r } else { r };
    if y < 0.0 { -r } else { r }
}

/// `exp(−t)` for `t ≥ 0`, relative error 2e-4.
#[inline(always)]
pub(super) fn exp_minus(t: f32) -> f32 {
    let e = (-t * LOG2_E).max(-120.0);
    let whole = e as i32 - 1;
    let f = e - whole as f32;
    // 2^f on [0, 1].
    let fraction = 1.0 + f * (0.695_976_1 + f * (0.224_940_4 + f * 0.079_083_5));
    f32::from_bits(((whole + 127) << 23) as u32) * fraction
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_and_exponentials_are_close() {
        for i in 0..1000u16 {
            let a = (f32::from(i) - 500.0) / 500.0 * 3.1;
            assert!((atan2(3.0 * a.sin(), 3.0 * a.cos()) - a).abs() < 4e-4, "{a}");
            let t = f32::from(i) * 0.02;
            assert!((exp_minus(t) / (-t).exp() - 1.0).abs() < 2e-4, "{t}");
        }
        assert_eq!(atan2(0.0, 0.0), 0.0);
    }
}
