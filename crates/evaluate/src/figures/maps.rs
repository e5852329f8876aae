//! The maps of one answer, in camera A.

use crate::aligned::AlignedPair;
use crate::truth::TruthPair;
use selenograph_geometry::{Point3, Vector3};
use selenograph_raster::colormap::{ABSENT, Colormap};
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::Fill;

/// Slope at the hot end of its colours, radians.
const MAX_SLOPE_RAD: f64 = MAX_SLOPE_DEG * std::f64::consts::PI / 180.0;
/// The same, degrees.
pub const MAX_SLOPE_DEG: f64 = 40.0;
/// Stripes over completed ground: one of so many pixels along both axes, this wide.
const STRIPE: [usize; 2] = [12, 3];
/// Colour of the stripes.
const STRIPE_COLOR: [u8; 3] = [250, 250, 248];
/// The lamp of the hillshade: left and above in the picture, this high over the ground.
const LAMP_ELEVATION_RAD: f64 = 35.0 * std::f64::consts::PI / 180.0;
/// Shares of the depths that are off the ends of the colours.
const OFF_THE_ENDS: [f64; 2] = [0.01, 0.99];

/// Depth, slope, shading and world Z of view A.
pub struct Maps {
    depth_z_m: Raster<f32>,
    slope_rad: Raster<f32>,
    shade: Raster<f32>,
    world_z_m: Raster<f64>,
}

impl Maps {
    /// Of an answer that was carried into metres.
    pub fn new(aligned: &AlignedPair, truth: &TruthPair) -> Self {
        let as_f32 = |raster: &Raster<f64>| raster.map(|v| *v as f32);
        Self {
            depth_z_m: as_f32(&aligned.depth_z_m(truth, 0)),
            slope_rad: as_f32(&aligned.slope_rad(truth, 0)),
            shade: shade(&aligned.points_in_cam_a[0]),
            world_z_m: aligned.world_z_m(truth, 0),
        }
    }

    /// Ends of the colours of depth.
    pub fn depth_range_m(&self) -> [f64; 2] {
        let depths = self.depth_z_m.data.iter().map(|z| f64::from(*z));
        statistics::quantiles(depths, OFF_THE_ENDS).unwrap_or([0.0, 1.0])
    }

    /// Depth in viridis.
    pub fn depth_picture(&self, [low, high]: [f64; 2]) -> Raster<[u8; 3]> {
        Colormap::Viridis.paint(&self.depth_z_m, low, high)
    }

    /// Slope in a heat map.
    pub fn slope_picture(&self) -> Raster<[u8; 3]> {
        Colormap::Inferno.paint(&self.slope_rad, 0.0, MAX_SLOPE_RAD)
    }

    /// The points under a lamp of their own: noise that depth hides is seen here.
    pub fn hillshade_picture(&self) -> Raster<[u8; 3]> {
        Colormap::Grey.paint(&self.shade, 0.0, 1.0)
    }

    /// World Z along the central row, metres.
    pub fn profile_m(&self) -> Vec<f64> {
        if self.world_z_m.height == 0 {
            Vec::new()
        } else {
            self.world_z_m.row(self.world_z_m.height / 2).to_vec()
        }
    }
}

/// A picture of a view with stripes where its ground was completed, not measured.
pub fn striped(picture: &Raster<[u8; 3]>, fill: &Raster<Fill>) -> Raster<[u8; 3]> {
    Raster::from_fn(picture.width, picture.height, |x, y| {
        let is_stripe = fill[(x, y)] == Fill::Completed && (x + y) % STRIPE[0] < STRIPE[1];
        if is_stripe { STRIPE_COLOR } else { picture[(x, y)] }
    })
}

/// Cosine of the lamp's incidence on the surface through each point and its four neighbours; NaN where one is absent.
fn shade(points: &Raster<Point3<f64>>) -> Raster<f32> {
    let (width, height) = (points.width, points.height);
    let mean_normal = normals(points).fold(Vector3::zeros(), |sum, (_, _, normal)| sum + normal);
    let Some(up) = mean_normal.try_normalize(0.0) else { return Raster::filled(width, height, f32::NAN) };
    // From the picture's upper left, over the mean surface.
    let left = Vector3::new(-1.0, -1.0, 0.0);
    let level = (left - up * up.dot(&left)).normalize();
    let lamp = up * LAMP_ELEVATION_RAD.sin() + level * LAMP_ELEVATION_RAD.cos();
    let mut shade = Raster::filled(width, height, f32::NAN);
    for (x, y, normal) in normals(points) {
        shade[(x, y)] = normal.dot(&lamp).max(0.0) as f32;
    }
    shade
}

/// Unit normals towards the camera, by central differences.
fn normals(points: &Raster<Point3<f64>>) -> impl Iterator<Item = (usize, usize, Vector3<f64>)> {
    let (width, height) = (points.width, points.height);
    let inner =
        (1..height.saturating_sub(1)).flat_map(move |y| (1..width.saturating_sub(1)).map(move |x| (x, y)));
    inner.filter_map(|(x, y)| {
        let across = points[(x + 1, y)] - points[(x - 1, y)];
        let down = points[(x, y + 1)] - points[(x, y - 1)];
        // x right, y down, z forward: down × across looks back at the camera.
        let normal = down.cross(&across).try_normalize(0.0)?;
        normal.iter().all(|v| v.is_finite()).then_some((x, y, normal))
    })
}

/// A picture as it is, from its darkest to its brightest hundredth.
pub fn grey(image: &Raster<f32>) -> Raster<[u8; 3]> {
    let levels = image.data.iter().map(|v| f64::from(*v));
    match statistics::quantiles(levels, [0.0, 0.995]) {
        Some([low, high]) => Colormap::Grey.paint(image, low, high),
        None => image.map(|_| ABSENT),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn completed_ground_is_striped_and_measured_ground_is_not() {
        let picture = Raster::filled(24, 24, [1, 2, 3]);
        let fill = Raster::from_fn(24, 24, |x, _| if x < 12 { Fill::Measured } else { Fill::Completed });
        let striped = striped(&picture, &fill);
        let count = |left: usize| (0..24).flat_map(move |y| (left..left + 12).map(move |x| (x, y)));
        assert_eq!(count(0).filter(|at| striped[*at] != [1, 2, 3]).count(), 0);
        assert_eq!(count(12).filter(|at| striped[*at] != [1, 2, 3]).count(), 12 * 24 / 4);
    }

    #[test]
    fn a_slope_towards_the_lamp_is_brighter() {
        // Seen from above (camera Z is down): a ridge along x = y.
        let points = Raster::from_fn(16, 16, |x, y| {
            let (x, y) = (x as f64, y as f64);
            Point3::new(x, y, 100.0 + 0.3 * (x + y - 15.0).abs())
        });
        let shade = shade(&points);
        assert!(shade[(0, 0)].is_nan());
        // The side towards the upper left looks at the lamp.
        assert!(shade[(3, 3)] > shade[(12, 12)] + 0.2, "{} {}", shade[(3, 3)], shade[(12, 12)]);
    }
}
