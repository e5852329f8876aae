//! One view's depth carried into the other: the test of camera, pose and depth together.

use selenograph_geometry::{BodyFixed, Cam, CamA, CamB, Camera, Point2, Rigid3, pixel};
use selenograph_raster::{Raster, resample, statistics};
use serde::Serialize;

/// Relative depth difference above which a pixel is an outlier (hidden ground, far edges).
pub const OUTLIER: f64 = 5e-3;

/// A view with its truth.
#[derive(Debug, Clone, Copy)]
pub struct DepthView<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The pose.
    pub world_from_cam: &'a Rigid3<BodyFixed, Cam>,
    /// z-depth, metres; absent where it is not finite and positive.
    pub depth_z: &'a Raster<f32>,
}

impl DepthView<'_> {
    /// z-depth of a pixel, `None` where it is absent.
    pub fn depth_at(&self, x: usize, y: usize) -> Option<f64> {
        self.depth_z.get(x, y).map(|&z| f64::from(z)).filter(|z| z.is_finite() && *z > 0.0)
    }
}

/// A pixel's ground seen from the other view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landing {
    /// Where it falls in the other picture.
    pub pixel: Point2<f64>,
    /// Its z-depth there, metres.
    pub depth_z: f64,
}

/// The way from one view into another.
#[derive(Debug, Clone)]
pub struct Carrier<'a> {
    from: &'a Camera,
    to: &'a Camera,
    to_from: Rigid3<CamB, CamA>,
}

impl<'a> Carrier<'a> {
    /// From `from` into `to`. The world drops out first, so that its large coordinates cost no digits.
    pub fn new(from: &DepthView<'a>, to: &DepthView<'a>) -> Self {
        let to_from = (&to.world_from_cam.inverse() * from.world_from_cam).relabel();
        Self { from: from.camera, to: to.camera, to_from }
    }

    /// Carries a continuous pixel with its z-depth; `None` behind the other camera.
    pub fn carry(&self, pixel: &Point2<f64>, depth_z: f64) -> Option<Landing> {
        let x_in_to = self.to_from.point(&self.from.unproject(pixel, depth_z)?);
        Some(Landing { pixel: self.to.project(&x_in_to)?, depth_z: x_in_to.z })
    }
}

/// What a warp from one view into the other shows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Warp {
    /// Pixels with depth that were carried.
    pub num_valid: usize,
    /// Those that fall into the other frame, where it has depth.
    pub num_inside: usize,
    /// For each of those: (carried depth − depth there) / carried depth.
    pub relative_errors: Vec<f64>,
    /// For each of those: distance between the pixel and where the other view's depth carries it back to, pixels.
    pub pixel_errors: Vec<f64>,
}

/// Warps every `step`-th pixel across and down of `from` into `to`, and back by the bilinear depth found there.
pub fn warp(from: &DepthView, to: &DepthView, step: usize) -> Warp {
    let mut warp = Warp::default();
    let first = step / 2;
    let (there_from_here, here_from_there) = (Carrier::new(from, to), Carrier::new(to, from));
    for y in (first..from.camera.height).step_by(step) {
        for x in (first..from.camera.width).step_by(step) {
            let Some(depth_z) = from.depth_at(x, y) else { continue };
            warp.num_valid += 1;
            let start = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let Some(landing) = there_from_here.carry(&start, depth_z) else { continue };
            let Some(there) = resample::bilinear(to.depth_z, landing.pixel.x, landing.pixel.y) else {
                continue;
            };
            warp.num_inside += 1;
            warp.relative_errors.push((landing.depth_z - there) / landing.depth_z);
            if let Some(back) = here_from_there.carry(&landing.pixel, there) {
                warp.pixel_errors.push((back.pixel - start).norm());
            }
        }
    }
    warp
}

/// Statistics of the warps A → B and B → A together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WarpStatistics {
    /// Share of A's pixels with depth that fall on pixels of B with depth (hidden ground counts).
    pub overlap_a_in_b: f64,
    /// The same from B.
    pub overlap_b_in_a: f64,
    /// Pixels compared, both directions.
    pub num_compared: usize,
    /// Median of the relative depth difference.
    pub median_relative_error: f64,
    /// 99th percentile of it.
    pub p99_relative_error: f64,
    /// Share of pixels above [`OUTLIER`].
    pub outlier_share: f64,
    /// Median of the pixel error there and back.
    pub median_px: f64,
    /// 99th percentile of it.
    pub p99_px: f64,
}

/// Warps both ways. `None` where not one pixel of either view falls on depth of the other.
pub fn symmetric(a: &DepthView, b: &DepthView, step: usize) -> Option<WarpStatistics> {
    let (to_b, to_a) = (warp(a, b, step), warp(b, a, step));
    let both =
        |f: fn(&Warp) -> &[f64]| f(&to_b).iter().chain(f(&to_a)).map(|error| error.abs()).collect::<Vec<_>>();
    let relative = both(|warp| &warp.relative_errors);
    let [median_relative_error, p99_relative_error] =
        statistics::quantiles(relative.iter().copied(), [0.5, 0.99])?;
    let [median_px, p99_px] = statistics::quantiles(both(|warp| &warp.pixel_errors), [0.5, 0.99])?;
    let share = |warp: &Warp| warp.num_inside as f64 / warp.num_valid.max(1) as f64;
    Some(WarpStatistics {
        overlap_a_in_b: share(&to_b),
        overlap_b_in_a: share(&to_a),
        num_compared: relative.len(),
        median_relative_error,
        p99_relative_error,
        outlier_share: relative.iter().filter(|error| **error > OUTLIER).count() as f64
            / relative.len() as f64,
        median_px,
        p99_px,
    })
}

/// Distances along the rays turned into z-depths.
pub fn depth_z_from_range(camera: &Camera, range: &Raster<f32>) -> Raster<f32> {
    Raster::from_fn(range.width, range.height, |x, y| {
        let center = Point2::new(pixel::center_of(x), pixel::center_of(y));
        camera
            .depth_z_from_range(&center, f64::from(range[(x, y)]))
            .map_or(f32::NAN, |depth_z| depth_z as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::synthetic::{Shape, oblique_pair};

    #[test]
    fn exact_truth_reprojects_exactly() {
        let [a, b] = oblique_pair(128);
        let statistics = symmetric(&a.view(), &b.view(), 1).unwrap();
        // What is left is the bilinear interpolation of a curved depth, far below a pixel.
        assert!(statistics.median_relative_error < 5e-5, "{statistics:?}");
        assert!(statistics.median_px < 5e-3, "{statistics:?}");
        assert!(statistics.overlap_a_in_b > 0.4 && statistics.overlap_b_in_a > 0.4, "{statistics:?}");
    }

    #[test]
    fn each_fault_is_far_above_the_noise() {
        let [a, b] = oblique_pair(128);
        let clean = symmetric(&a.view(), &b.view(), 1).unwrap();
        let mut shifted = a.camera.clone();
        (shifted.cx, shifted.cy) = (shifted.cx + pixel::HALF_PIXEL, shifted.cy + pixel::HALF_PIXEL);
        let mut other = b.camera.clone();
        (other.cx, other.cy) = (other.cx + pixel::HALF_PIXEL, other.cy + pixel::HALF_PIXEL);
        let half_pixel = symmetric(
            &DepthView { camera: &shifted, ..a.view() },
            &DepthView { camera: &other, ..b.view() },
            1,
        )
        .unwrap();
        assert!(half_pixel.median_px > 5.0 * clean.median_px, "{half_pixel:?} {clean:?}");
        let (range_a, range_b) = (a.range(), b.range());
        let as_z = symmetric(
            &DepthView { depth_z: &range_a, ..a.view() },
            &DepthView { depth_z: &range_b, ..b.view() },
            1,
        )
        .unwrap();
        assert!(as_z.median_relative_error > 100.0 * clean.median_relative_error, "{as_z:?}");
        let back = depth_z_from_range(&a.camera, &range_a);
        let worst = back.data.iter().zip(&a.depth_z.data).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
        assert!(worst < 0.01, "{worst}");
    }

    #[test]
    fn views_that_share_nothing_have_no_statistics() {
        let [a, _] = oblique_pair(32);
        let away = Shape::default().view(32, -80.0, 10.0, 20_000.0, 0.0, 0.0);
        assert!(symmetric(&a.view(), &away.view(), 1).is_none());
    }
}
