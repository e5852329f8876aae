//! Where principal points are measured from, found by reprojection.
//!
//! One common offset (du, dv) is added to the principal points of all cameras and fitted so that depths agree after
//! warping. A pair says nothing about an offset that moves both pictures alike (two views straight down from one
//! height), so the fit carries its covariance, and the verdict is "cannot tell" where corner and centre lie too
//! close together for it.

use super::numbers::moved;
use super::reprojection::{Carrier, DepthView, OUTLIER};
use selenograph_geometry::{Matrix2, Point2, Vector2, pixel, robust::MAD_TO_SIGMA};
use selenograph_raster::{Raster, resample, statistics};
use serde::Serialize;
use std::fmt;

/// What the offset says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// As told: no offset.
    AsTold,
    /// Half a pixel has to be added: told from the corner, measured from the first pixel's centre.
    HalfPixelMore,
    /// Half a pixel has to be taken away: told from the centre, measured from the corner.
    HalfPixelLess,
    /// Another offset fits.
    Other,
    /// The geometry cannot tell them apart.
    CannotTell,
}

/// The offset fitted over a folder.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PrincipalPoint {
    /// What has to be added to the principal points as told, pixels.
    pub offset_px: [f64; 2],
    /// One standard deviation of each.
    pub sigma_px: [f64; 2],
    /// Distance between "no offset" and "half a pixel" in standard deviations.
    pub separation_sigma: f64,
    /// Pairs in the fit.
    pub num_pairs: usize,
    /// What follows.
    pub verdict: Verdict,
}

impl fmt::Display for PrincipalPoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match self.verdict {
            Verdict::AsTold => "where it is told to be",
            Verdict::HalfPixelMore => "half a pixel more than told (measured from the first pixel's centre)",
            Verdict::HalfPixelLess => "half a pixel less than told (measured from the image's corner)",
            Verdict::Other => "somewhere else",
            Verdict::CannotTell => "cannot tell from this geometry",
        };
        let ([du, dv], [su, sv]) = (self.offset_px, self.sigma_px);
        write!(f, "{text}; offset ({du:+.3} ± {su:.3}, {dv:+.3} ± {sv:.3}) px")
    }
}

/// Normal equations of one pair: `information · offset = pull`, already divided by the residuals' variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    information: Matrix2<f64>,
    pull: Vector2<f64>,
}

impl Evidence {
    /// The offset that suits this pair alone, pixels; `None` where it says nothing.
    pub fn offset_px(&self) -> Option<[f64; 2]> {
        Some((self.information.try_inverse()? * self.pull).into())
    }
}

/// Neighbouring residuals are not independent and the model is not perfect: variances are taken nine times larger.
const VARIANCE_INFLATION: f64 = 9.0;

/// Standard deviations between the two hypotheses below which the verdict is "cannot tell".
const MIN_SEPARATION_SIGMA: f64 = 5.0;

/// An offset this near to a hypothesis counts as it, pixels.
const NEAR_PX: f64 = 0.15;

/// Depth slopes are taken over this many pixels on either side: over one, the steps of half-float depth drown them.
const SLOPE_REACH_PX: f64 = 3.0;

/// Rounds of linearisation; the problem is nearly linear within a pixel.
const ROUNDS: usize = 4;

/// What one pair says about the offset, by robust Gauss-Newton over every `step`-th pixel. `None` if too few pixels
/// meet or the offset runs away.
pub fn evidence(a: &DepthView, b: &DepthView, step: usize) -> Option<Evidence> {
    let mut offset = Vector2::zeros();
    let mut found = None;
    for _ in 0..ROUNDS {
        let normal = linearised(a, b, &offset, step)?;
        offset += normal.information.try_inverse()? * normal.pull;
        // Beyond a few pixels it is another fault than a convention.
        if !offset.norm().is_finite() || offset.norm() > 8.0 {
            return None;
        }
        found = Some(Evidence { pull: normal.information * offset, ..normal });
    }
    found
}

/// Normal equations around an offset; the unknown is the change of it.
fn linearised(a: &DepthView, b: &DepthView, offset: &Vector2<f64>, step: usize) -> Option<Evidence> {
    let mut rows: Vec<(f64, Vector2<f64>)> = Vec::new();
    for (from, to) in [(a, b), (b, a)] {
        collect_rows(from, to, offset, step, &mut rows);
    }
    let median = statistics::median(rows.iter().map(|(residual, _)| residual.abs()))?;
    // Normal consistency factor of the median absolute deviation; exact truth must not divide by 0.
    let sigma = (MAD_TO_SIGMA * median).max(1e-9);
    let mut information = Matrix2::zeros();
    let mut pull = Vector2::zeros();
    let mut num_used = 0;
    for (residual, slope) in rows {
        // Tukey's biweight: hidden ground has no vote.
        let u = residual / (4.685 * sigma);
        let weight = if u.abs() < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 };
        information += weight * slope * slope.transpose();
        pull -= weight * residual * slope;
        num_used += usize::from(weight > 0.0);
    }
    let scale = 1.0 / (sigma * sigma * VARIANCE_INFLATION);
    (num_used >= 50).then_some(Evidence { information: information * scale, pull: pull * scale })
}

/// Relative depth residuals of pixels of `from` in `to`, with their derivatives by the offset.
fn collect_rows(
    from: &DepthView,
    to: &DepthView,
    offset: &Vector2<f64>,
    step: usize,
    rows: &mut Vec<(f64, Vector2<f64>)>,
) {
    let cameras_at = |du: f64, dv: f64| {
        (moved(from.camera, offset.x + du, offset.y + dv), moved(to.camera, offset.x + du, offset.y + dv))
    };
    let cameras = [cameras_at(0.0, 0.0), cameras_at(1.0, 0.0), cameras_at(0.0, 1.0)];
    let carriers = cameras.each_ref().map(|(camera_from, camera_to)| {
        Carrier::new(&DepthView { camera: camera_from, ..*from }, &DepthView { camera: camera_to, ..*to })
    });
    for y in (step / 2..from.camera.height).step_by(step) {
        for x in (step / 2..from.camera.width).step_by(step) {
            let Some(depth_z) = from.depth_at(x, y) else { continue };
            let start = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let [Some(here), Some(right), Some(down)] =
                carriers.each_ref().map(|carrier| carrier.carry(&start, depth_z))
            else {
                continue;
            };
            let Some(there) = resample::bilinear(to.depth_z, here.pixel.x, here.pixel.y) else { continue };
            let Some(slope) = depth_slope(to.depth_z, &here.pixel) else { continue };
            let residual = (here.depth_z - there) / here.depth_z;
            if residual.abs() > 4.0 * OUTLIER {
                continue;
            }
            let derivative = [right, down].map(|moved| {
                let motion = moved.pixel - here.pixel;
                (moved.depth_z - here.depth_z - slope.dot(&motion)) / here.depth_z
            });
            rows.push((residual, Vector2::from(derivative)));
        }
    }
}

/// Change of depth per pixel across and down.
fn depth_slope(depth_z: &Raster<f32>, at: &Point2<f64>) -> Option<Vector2<f64>> {
    let sample = |dx: f64, dy: f64| resample::bilinear(depth_z, at.x + dx, at.y + dy);
    let r = SLOPE_REACH_PX;
    Some(Vector2::new(sample(r, 0.0)? - sample(-r, 0.0)?, sample(0.0, r)? - sample(0.0, -r)?) / (2.0 * r))
}

/// The offset of all pairs together; `None` without evidence.
pub fn combine(evidence: &[Evidence]) -> Option<PrincipalPoint> {
    let information = evidence.iter().map(|e| e.information).sum::<Matrix2<f64>>();
    let pull = evidence.iter().map(|e| e.pull).sum::<Vector2<f64>>();
    let covariance = information.try_inverse()?;
    let offset = covariance * pull;
    let distance = |to: Vector2<f64>| {
        let off = offset - to;
        (off.dot(&(information * off))).max(0.0).sqrt()
    };
    let half = Vector2::repeat(pixel::HALF_PIXEL);
    let separation_sigma = (half.dot(&(information * half))).max(0.0).sqrt();
    let hypotheses = [
        (Verdict::AsTold, Vector2::zeros()),
        (Verdict::HalfPixelMore, half),
        (Verdict::HalfPixelLess, -half),
    ];
    let (nearest, at) = hypotheses
        .into_iter()
        .min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)))
        .unwrap_or((Verdict::AsTold, Vector2::zeros()));
    let verdict = if separation_sigma < MIN_SEPARATION_SIGMA {
        Verdict::CannotTell
    } else if (offset - at).norm() < NEAR_PX || distance(at) < MIN_SEPARATION_SIGMA {
        nearest
    } else {
        Verdict::Other
    };
    Some(PrincipalPoint {
        offset_px: offset.into(),
        sigma_px: [covariance[(0, 0)].sqrt(), covariance[(1, 1)].sqrt()],
        separation_sigma,
        num_pairs: evidence.len(),
        verdict,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::synthetic::{TestView, nadir_pair, oblique_pair};

    fn fit([a, b]: &[TestView; 2], du: f64, dv: f64) -> PrincipalPoint {
        let cameras = [moved(&a.camera, du, dv), moved(&b.camera, du, dv)];
        let evidence = evidence(
            &DepthView { camera: &cameras[0], ..a.view() },
            &DepthView { camera: &cameras[1], ..b.view() },
            2,
        );
        combine(&[evidence.unwrap()]).unwrap()
    }

    #[test]
    fn offsets_are_found_to_a_hundredth_of_a_pixel() {
        let pair = oblique_pair(128);
        let cases = [
            (0.0, 0.0, Verdict::AsTold),
            (-0.5, -0.5, Verdict::HalfPixelMore),
            (0.5, 0.5, Verdict::HalfPixelLess),
            (1.0, -0.7, Verdict::Other),
        ];
        for (du, dv, verdict) in cases {
            let fit = fit(&pair, du, dv);
            assert_eq!(fit.verdict, verdict, "{fit:?}");
            assert!((fit.offset_px[0] + du).abs() < 0.01 && (fit.offset_px[1] + dv).abs() < 0.01, "{fit:?}");
        }
    }

    #[test]
    fn half_float_steps_do_not_spoil_it() {
        let mut pair = oblique_pair(128);
        for view in &mut pair {
            // Nearest half float: 11 significant bits.
            view.depth_z = view.depth_z.map(|z| f32::from_bits((z.to_bits() + 0x1000) & !0x1fff));
        }
        let found = fit(&pair, -0.5, -0.5);
        assert_eq!(found.verdict, Verdict::HalfPixelMore, "{found:?}");
    }

    #[test]
    fn nadir_views_with_coarse_depth_cannot_tell() {
        let mut pair = nadir_pair(128);
        for view in &mut pair {
            view.depth_z = view.depth_z.map(|z| f32::from_bits((z.to_bits() + 0x1000) & !0x1fff));
        }
        let found = fit(&pair, 0.0, 0.0);
        assert_eq!(found.verdict, Verdict::CannotTell, "{found:?}");
    }
}
