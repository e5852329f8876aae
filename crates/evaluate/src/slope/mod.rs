//! Slopes of a pointmap in four definitions: the authors' code, over the footprint, from neighbours, and true.

pub(crate) mod neighbour_normals;

use crate::pose_error::angle_rad;
use selenograph_geometry::{BodyFixed, CamA, Point3, Rigid3, Vector3};
use selenograph_raster::Raster;

/// Sum of a Sobel kernel's weights on one side, times two samples apart.
const SOBEL_GAIN: f64 = 8.0;
/// How far apart the samples of a true slope are from its pixel.
const TRUE_SLOPE_REACH: usize = 2;

/// World Z of every point, metres; NaN where absent.
pub fn world_z(points: &Raster<Point3<f64>>, world_from_cam_a: &Rigid3<BodyFixed, CamA>) -> Raster<f64> {
    let row = world_from_cam_a.rotation().row(2).transpose();
    let origin = world_from_cam_a.origin().z;
    points.map(|p| row.dot(&p.coords) + origin)
}

/// Length of the Sobel gradient per pixel (eight times the difference of neighbours on a ramp), edges reflected as SciPy's
/// `sobel` has them; NaN where one of the nine samples is absent.
pub fn sobel_length(z: &Raster<f64>) -> Raster<f64> {
    let (width, height) = (z.width, z.height);
    // Reflection about the edge: the sample outside is the one on it.
    let around = |at: usize, count: usize| [at.saturating_sub(1), at, (at + 1).min(count - 1)];
    Raster::from_fn(width, height, |x, y| {
        let ([l, _, r], [above, here, below]) = (around(x, width), around(y, height).map(|y| z.row(y)));
        let column = |x: usize| above[x] + 2.0 * here[x] + below[x];
        let row = |row: &[f64]| row[l] + 2.0 * row[x] + row[r];
        let centre = 0.0 * here[x];
        (column(r) - column(l)).hypot(row(below) - row(above)) + centre
    })
}

/// The slopes that Sobel gradients make, radians: `pixel_m` is 1 in the authors' code, which takes metres per pixel for
/// metres per metre, and one pixel on the ground in the corrected form.
///
/// # Source
/// The authors' evaluation: `arctan(hypot(sobel x, sobel y) / (8 · pixel size))`.
pub fn from_sobel(length: &Raster<f64>, pixel_m: f64) -> Raster<f64> {
    length.map(|length| (length / (SOBEL_GAIN * pixel_m)).atan())
}

/// Angle between the surface's normal (central differences over ±2 px of the points) and the local vertical, radians; NaN
/// where one of the four neighbours is absent or outside.
pub fn true_slope(points: &Raster<Point3<f64>>, world_from_cam_a: &Rigid3<BodyFixed, CamA>) -> Raster<f64> {
    let (width, height) = (points.width, points.height);
    let cam_a_from_world = world_from_cam_a.inverse();
    let body_centre = cam_a_from_world.origin();
    let reach = TRUE_SLOPE_REACH;
    Raster::from_fn(width, height, |x, y| {
        if x < reach || y < reach || x + reach >= width || y + reach >= height {
            return f64::NAN;
        }
        let right: Vector3<f64> = points[(x + reach, y)] - points[(x - reach, y)];
        let down = points[(x, y + reach)] - points[(x, y - reach)];
        // X right, Y down, Z away: down × right comes towards the camera.
        let normal = down.cross(&right);
        angle_rad(&normal, &(points[(x, y)] - body_centre)).unwrap_or(f64::NAN)
    })
}

/// The pixels whose square of ±`radius` px lies in the mask (and in the frame).
pub fn erode(mask: &Raster<bool>, radius: usize) -> Raster<bool> {
    let (width, height) = (mask.width, mask.height);
    let along =
        |at: usize, count: usize| (at >= radius && at + radius < count).then(|| at - radius..=at + radius);
    let rows = Raster::from_fn(width, height, |x, y| {
        along(x, width).is_some_and(|mut columns| columns.all(|x| mask[(x, y)]))
    });
    Raster::from_fn(width, height, |x, y| {
        along(y, height).is_some_and(|mut lines| lines.all(|y| rows[(x, y)]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::Rotation3;

    #[test]
    fn a_ramp_has_its_slope_in_every_definition() {
        // Seen straight from above at the pole: z = 0.2 x − 0.1 y above a body of 1.7374e6 m, 10 m per pixel.
        let world_from_cam_a: Rigid3<BodyFixed, CamA> = Rigid3::new(
            Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
            Point3::new(0.0, 0.0, 1_747_400.0),
        );
        let points = Raster::from_fn(20, 16, |x, y| {
            let (east, south) = (10.0 * x as f64 - 100.0, 10.0 * y as f64 - 80.0);
            Point3::new(east, south, 10_000.0 - 0.2 * east + 0.1 * south)
        });
        let z = world_z(&points, &world_from_cam_a);
        assert!((z[(3, 0)] - z[(2, 0)] - 2.0).abs() < 1e-9 && (z[(0, 3)] - z[(0, 2)] + 1.0).abs() < 1e-9);
        let length = sobel_length(&z);
        let expected = 0.05f64.sqrt();
        assert!((from_sobel(&length, 10.0)[(7, 7)] - expected.atan()).abs() < 1e-9);
        assert!((from_sobel(&length, 1.0)[(7, 7)] - (10.0 * expected).atan()).abs() < 1e-9);
        let slope = true_slope(&points, &world_from_cam_a);
        // The vertical turns by 1e-4 over this patch.
        assert!((slope[(10, 8)] - expected.atan()).abs() < 1e-4, "{}", slope[(10, 8)]);
        assert!(slope[(1, 8)].is_nan() && slope[(2, 2)].is_finite() && slope[(18, 8)].is_nan());
    }

    #[test]
    fn absent_samples_take_their_neighbours_with_them() {
        let mut z = Raster::filled(9, 9, 1.0);
        z[(4, 4)] = f64::NAN;
        assert_eq!(sobel_length(&z).data.iter().filter(|v| v.is_nan()).count(), 9);
        let eroded = erode(&z.map(|v| v.is_finite()), 1);
        assert_eq!(eroded.data.iter().filter(|kept| **kept).count(), 49 - 9);
        assert!(!erode(&Raster::filled(3, 9, true), 2).data.contains(&true));
    }
}
