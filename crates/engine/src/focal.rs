//! The focal length that a pointmap implies.

/// Iterations, as the reference makes them.
const ITERATIONS: usize = 10;
/// Smallest residual that a weight is made of, pixels.
const MIN_RESIDUAL_PX: f64 = 1e-8;

/// Focal length in pixels for which the pointmap's points project nearest to their pixels, by Weiszfeld's
/// iteration for the sum of distances; `None` where no point says anything.
///
/// # Shapes and units
/// `points`: x, y, z per pixel, row-major, `width_px` pixels a row, in the camera's own frame. The principal
/// point is `principal_px`, in the convention of pixel indices (a pixel's centre at its integer index).
///
/// # Source
/// Wang et al., DUSt3R (2024), §3.3.
#[must_use]
pub fn focal_of_pointmap(points: &[f32], width_px: usize, principal_px: [f64; 2]) -> Option<f64> {
    let rays: Vec<([f64; 2], [f64; 2])> = points
        .chunks_exact(3)
        .enumerate()
        .map(|(idx, point)| {
            let pixel =
                [(idx % width_px) as f64 - principal_px[0], (idx / width_px) as f64 - principal_px[1]];
            let finite = |value: f32| {
                let ratio = f64::from(value) / f64::from(point[2]);
                if ratio.is_finite() { ratio } else { 0.0 }
            };
            (pixel, [finite(point[0]), finite(point[1])])
        })
        .collect();
    let fit = |focal: Option<f64>| {
        let mut sums = [0.0; 2];
        for (pixel, ray) in &rays {
            let weight = focal.map_or(1.0, |focal| {
                let off = (pixel[0] - focal * ray[0]).hypot(pixel[1] - focal * ray[1]);
                1.0 / off.max(MIN_RESIDUAL_PX)
            });
            sums[0] += weight * (ray[0] * pixel[0] + ray[1] * pixel[1]);
            sums[1] += weight * (ray[0] * ray[0] + ray[1] * ray[1]);
        }
        Some(sums[0] / sums[1]).filter(|focal| focal.is_finite())
    };
    let mut focal = fit(None)?;
    for _ in 0..ITERATIONS {
        focal = fit(Some(focal))?;
    }
    Some(focal)
}

/// Focal length in pixels that half of the pointmap's coordinates exceed, each taken alone; `None` where none says
/// anything. Cruder than [`focal_of_pointmap`], and indifferent to a minority of any size of error.
///
/// # Shapes and units
/// As [`focal_of_pointmap`]; of an even number of values the lower of the middle two, as the reference takes it.
#[must_use]
pub fn median_focal_of_pointmap(points: &[f32], width_px: usize, principal_px: [f64; 2]) -> Option<f64> {
    let of_point = |(idx, point): (usize, &[f32])| {
        let pixel = [(idx % width_px) as f64, (idx / width_px) as f64];
        [0, 1].map(|axis| (pixel[axis] - principal_px[axis]) * f64::from(point[2]) / f64::from(point[axis]))
    };
    let votes = points.chunks_exact(3).enumerate().flat_map(of_point);
    let mut votes: Vec<f64> = votes.filter(|focal| !focal.is_nan()).collect();
    let middle = votes.len().checked_sub(1)? / 2;
    let (_, focal, _) = votes.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*focal)
}

/// Bounds a focal length by multiples of the one at which the longer side spans 60°.
#[must_use]
pub fn bound_focal(focal_px: f64, size_px: (usize, usize), factors: (f64, f64)) -> f64 {
    let base = size_px.0.max(size_px.1) as f64 / (2.0 * std::f64::consts::FRAC_PI_6.tan());
    focal_px.max(factors.0 * base).min(factors.1 * base)
}
