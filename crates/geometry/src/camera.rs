//! The pinhole camera with Brown's distortion.

use crate::Error;
use crate::pixel::PixelConvention;
use nalgebra::{Matrix3, Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Brown's lens distortion, applied to normalised image coordinates (`x/z`, `y/z`).
///
/// # Source
/// Brown 1971, "Close-range camera calibration"; the order of OpenCV's `k1 k2 p1 p2 k3`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Distortion {
    /// Radial, second order.
    #[serde(default)]
    pub k1: f64,
    /// Radial, fourth order.
    #[serde(default)]
    pub k2: f64,
    /// Tangential.
    #[serde(default)]
    pub p1: f64,
    /// Tangential.
    #[serde(default)]
    pub p2: f64,
    /// Radial, sixth order.
    #[serde(default)]
    pub k3: f64,
}

impl Distortion {
    /// Whether the lens is an ideal pinhole.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Ideal normalised coordinates → distorted ones.
    pub fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        (
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    /// Derivatives `[∂xd/∂x, ∂xd/∂y, ∂yd/∂x, ∂yd/∂y]`.
    fn jacobian(&self, x: f64, y: f64) -> [f64; 4] {
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3));
        let cross = x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        [
            radial + x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            cross,
            cross,
            radial + y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        ]
    }

    /// Distorted normalised coordinates → ideal ones, by Newton's method; `None` where the lens model folds over.
    pub(crate) fn undistort(&self, xd: f64, yd: f64) -> Option<(f64, f64)> {
        if self.is_none() {
            return Some((xd, yd));
        }
        let (mut x, mut y) = (xd, yd);
        for _ in 0..50 {
            let (fx, fy) = self.distort(x, y);
            let (ex, ey) = (fx - xd, fy - yd);
            let [a, b, c, d] = self.jacobian(x, y);
            let det = a * d - b * c;
            // Past the fold the mapping turns over, and a root there is not what the lens shows.
            if det <= 0.0 || !det.is_finite() {
                return None;
            }
            x -= (d * ex - b * ey) / det;
            y -= (a * ey - c * ex) / det;
            if ex.abs() + ey.abs() < 1e-14 {
                return Some((x, y));
            }
        }
        let (fx, fy) = self.distort(x, y);
        ((fx - xd).abs() + (fy - yd).abs() < 1e-10).then_some((x, y))
    }
}

/// A pinhole camera: focal lengths and principal point in pixels, measured from the image's corner
/// ([`PixelConvention::Corner`]). Built by [`Camera::from_fov`], [`Camera::from_k`]: nobody can forget to say which
/// convention a matrix has.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Focal length over pixel width, pixels.
    pub fx: f64,
    /// Focal length over pixel height, pixels.
    pub fy: f64,
    /// Principal point from the left edge, pixels.
    pub cx: f64,
    /// Principal point from the top edge, pixels.
    pub cy: f64,
    /// Lens distortion.
    pub distortion: Distortion,
}

impl Camera {
    /// A square-pixel camera with the principal point at the middle and `fov_rad` across the width.
    ///
    /// # Errors
    /// [`Error::Camera`] for an empty image or a field of view outside (0°, 180°).
    pub fn from_fov(width: usize, height: usize, fov_rad: f64) -> Result<Self, Error> {
        if !(fov_rad > 0.0 && fov_rad < std::f64::consts::PI) {
            return Err(Error::Camera {
                what: "a field of view between 0 and 180 degrees",
                found: format!("{} degrees", fov_rad.to_degrees()),
            });
        }
        let focal = width as f64 / (2.0 * (fov_rad / 2.0).tan());
        let camera = Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: width as f64 / 2.0,
            cy: height as f64 / 2.0,
            distortion: Distortion::default(),
        };
        camera.checked()
    }

    /// From a 3×3 matrix of a stated convention.
    ///
    /// # Errors
    /// [`Error::Camera`] for an empty image, a focal length that is not positive and finite, skew, or a last row
    /// other than `0 0 1`.
    pub fn from_k(
        width: usize,
        height: usize,
        k: &Matrix3<f64>,
        convention: PixelConvention,
    ) -> Result<Self, Error> {
        if k[(0, 1)] != 0.0
            || k[(1, 0)] != 0.0
            || k[(2, 0)] != 0.0
            || k[(2, 1)] != 0.0
            || (k[(2, 2)] - 1.0).abs() > 1e-9
        {
            return Err(Error::Camera {
                what: "K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]",
                found: format!("{:?}", k.transpose().as_slice()),
            });
        }
        let offset = convention.to_corner_offset();
        let camera = Self {
            width,
            height,
            fx: k[(0, 0)],
            fy: k[(1, 1)],
            cx: k[(0, 2)] + offset,
            cy: k[(1, 2)] + offset,
            distortion: Distortion::default(),
        };
        camera.checked()
    }

    /// The same camera with a lens.
    pub fn with_distortion(mut self, distortion: Distortion) -> Self {
        self.distortion = distortion;
        self
    }

    fn checked(self) -> Result<Self, Error> {
        let bad = |what, found| Err(Error::Camera { what, found });
        if self.width == 0 || self.height == 0 {
            return bad("an image of at least 1×1", format!("{}×{}", self.width, self.height));
        }
        for focal in [self.fx, self.fy] {
            if !(focal.is_finite() && focal > 0.0) {
                return bad("a positive focal length in pixels", format!("{focal}"));
            }
        }
        for (centre, side) in [(self.cx, self.width), (self.cy, self.height)] {
            // A principal point several images away is a unit mistake, not a lens.
            if !(centre.is_finite() && centre.abs() <= 4.0 * side as f64) {
                return bad("a principal point near the image", format!("{centre} px for {side} px"));
            }
        }
        Ok(self)
    }

    /// The 3×3 matrix in the convention asked for.
    pub fn k(&self, convention: PixelConvention) -> Matrix3<f64> {
        let offset = convention.to_corner_offset();
        Matrix3::new(self.fx, 0.0, self.cx - offset, 0.0, self.fy, self.cy - offset, 0.0, 0.0, 1.0)
    }

    /// Full horizontal field of view, radians (distortion left aside).
    pub fn fov_x_rad(&self) -> f64 {
        (self.cx / self.fx).atan() + ((self.width as f64 - self.cx) / self.fx).atan()
    }

    /// Point in the camera frame → pixel; `None` behind the camera.
    pub fn project(&self, x_in_cam: &Point3<f64>) -> Option<Point2<f64>> {
        if x_in_cam.z <= 0.0 {
            return None;
        }
        let (x, y) = self.distortion.distort(x_in_cam.x / x_in_cam.z, x_in_cam.y / x_in_cam.z);
        Some(Point2::new(self.fx * x + self.cx, self.fy * y + self.cy))
    }

    /// Direction through a pixel with `z = 1` (so that a point is `depth_z` times it); `None` outside the lens model.
    pub fn ray_z1(&self, pixel: &Point2<f64>) -> Option<Vector3<f64>> {
        let (x, y) =
            self.distortion.undistort((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy)?;
        Some(Vector3::new(x, y, 1.0))
    }

    /// Pixel and z-depth → point in the camera frame; `None` outside the lens model.
    pub fn unproject(&self, pixel: &Point2<f64>, depth_z: f64) -> Option<Point3<f64>> {
        Some(Point3::from(self.ray_z1(pixel)? * depth_z))
    }

    /// z-depth → distance along the ray of a pixel; `None` outside the lens model.
    pub fn range_from_depth_z(&self, pixel: &Point2<f64>, depth_z: f64) -> Option<f64> {
        Some(self.ray_z1(pixel)?.norm() * depth_z)
    }

    /// Distance along the ray of a pixel → z-depth; `None` outside the lens model.
    pub fn depth_z_from_range(&self, pixel: &Point2<f64>, range: f64) -> Option<f64> {
        Some(range / self.ray_z1(pixel)?.norm())
    }

    /// Ground sampling distance at a z-depth, metres per pixel (geometric mean of both axes).
    pub fn gsd_m(&self, depth_z: f64) -> f64 {
        depth_z / (self.fx * self.fy).sqrt()
    }
}

/// The geometric mean of the focal lengths of both cameras, pixels: what carries a distance in pixels to the plane `z = 1`.
pub fn mean_focal_px(cameras: [&Camera; 2]) -> f64 {
    cameras.iter().map(|camera| camera.fx * camera.fy).product::<f64>().powf(0.25)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel;

    fn lens() -> Distortion {
        Distortion { k1: -0.12, k2: 0.03, p1: 4e-4, p2: -7e-4, k3: 0.001 }
    }

    #[test]
    fn project_and_unproject_are_inverse_with_and_without_lens() {
        for distortion in [Distortion::default(), lens()] {
            let camera = Camera::from_fov(512, 384, 0.8).unwrap().with_distortion(distortion);
            for (u, v) in [(0.5, 0.5), (511.5, 383.5), (256.0, 192.0), (17.25, 300.0)] {
                let point = camera.unproject(&Point2::new(u, v), 1234.5).unwrap();
                assert!((point.z - 1234.5).abs() < 1e-9);
                let back = camera.project(&point).unwrap();
                assert!((back - Point2::new(u, v)).norm() < 1e-9, "{u} {v} {back:?}");
            }
        }
    }

    #[test]
    fn the_papers_camera_and_its_gsd_table() {
        let camera = Camera::from_fov(512, 512, 45f64.to_radians()).unwrap();
        assert!((camera.fx - 618.0387).abs() < 1e-4);
        assert_eq!(camera.k(PixelConvention::Center)[(0, 2)], 255.5);
        assert_eq!(camera.k(PixelConvention::Corner)[(0, 2)], 256.0);
        // GSD = 2 h tan(fov/2) / 512, the paper's table 1 (m per pixel).
        for (altitude_km, gsd) in [(3.5, 5.66), (30.5, 49.35)] {
            assert!((camera.gsd_m(altitude_km * 1000.0) - gsd).abs() < 0.005);
        }
    }

    #[test]
    fn crop_and_resize_move_the_principal_point_as_the_pixels_move() {
        let camera = Camera::from_fov(512, 512, 0.8).unwrap().with_distortion(lens());
        let x = Point3::new(30.0, -20.0, 400.0);
        let p = camera.project(&x).unwrap();
        let cropped = pixel::crop(&camera, 100, 64, 300, 384).unwrap();
        assert!((cropped.project(&x).unwrap() - Point2::new(p.x - 100.0, p.y - 64.0)).norm() < 1e-9);
        let resized = pixel::resize(&camera, 256, 128).unwrap();
        assert!((resized.project(&x).unwrap() - Point2::new(p.x / 2.0, p.y / 4.0)).norm() < 1e-9);
        assert!(pixel::crop(&camera, 300, 0, 300, 10).is_err());
        assert!(pixel::resize(&camera, 0, 10).is_err());
    }

    #[test]
    fn absurd_cameras_are_refused() {
        assert!(Camera::from_fov(0, 512, 0.8).is_err());
        assert!(Camera::from_fov(512, 512, 3.2).is_err());
        assert!(Camera::from_fov(512, 512, f64::NAN).is_err());
        let negative = Matrix3::new(-600.0, 0.0, 256.0, 0.0, 600.0, 256.0, 0.0, 0.0, 1.0);
        assert!(Camera::from_k(512, 512, &negative, PixelConvention::Corner).is_err());
        let skewed = Matrix3::new(600.0, 2.0, 256.0, 0.0, 600.0, 256.0, 0.0, 0.0, 1.0);
        assert!(Camera::from_k(512, 512, &skewed, PixelConvention::Corner).is_err());
        let far = Matrix3::new(600.0, 0.0, 256e6, 0.0, 600.0, 256.0, 0.0, 0.0, 1.0);
        assert!(Camera::from_k(512, 512, &far, PixelConvention::Corner).is_err());
    }

    #[test]
    fn range_is_longer_than_z_depth_off_axis() {
        let camera = Camera::from_fov(512, 512, 0.8).unwrap();
        let corner = Point2::new(0.5, 0.5);
        let range = camera.range_from_depth_z(&corner, 1000.0).unwrap();
        assert!(range > 1100.0);
        assert!((camera.depth_z_from_range(&corner, range).unwrap() - 1000.0).abs() < 1e-9);
    }
}
