//! The surface that a view sees, from its depth alone: points, normals, directions to the eye.

use super::dequantise::dequantise;
use crate::Error;
use crate::stored::RawView;
use rayon::prelude::*;
use selenograph_geometry::pixel::center_of;
use selenograph_geometry::{BodyFixed, Cam, Point2, Point3, Rigid3, Vector3};
use selenograph_raster::Raster;
use selenograph_raster::codec::exr::SampleType;

/// A pixel's surface in the body-fixed frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Outward unit normal.
    pub normal: Vector3<f64>,
    /// Unit vector to the camera.
    pub to_eye: Vector3<f64>,
}

/// What a view sees, ready to be lit.
#[derive(Debug, Clone)]
pub struct ViewSurface {
    /// `None` where the depth is absent or has no neighbour to take a slope from.
    pub facets: Raster<Option<Facet>>,
    /// The camera's pose.
    pub world_from_cam: Rigid3<BodyFixed, Cam>,
}

impl ViewSurface {
    /// From a view's depth, smoothed within its half-float steps where it was stored in those.
    ///
    /// # Errors
    /// [`Error::Geometry`] for a camera or pose that cannot be.
    pub fn new(view: &RawView) -> Result<Self, Error> {
        let camera = view.camera()?;
        let world_from_cam = view.world_from_cam()?;
        let depth_z = match view.depth_stored {
            SampleType::Half => dequantise(&view.depth_z),
            SampleType::Float | SampleType::Uint => view.depth_z.map(|&z| f64::from(z)),
        };
        // Camera axes and a camera origin: differences of neighbours keep their digits.
        let points = Raster::from_fn(depth_z.width, depth_z.height, |x, y| {
            let pixel = Point2::new(center_of(x), center_of(y));
            let z = depth_z[(x, y)];
            if z.is_finite() && z > 0.0 { camera.unproject(&pixel, z) } else { None }
        });
        let (width, height) = (points.width, points.height);
        let facets = (0..width * height)
            .into_par_iter()
            .map(|idx| {
                let facet = facet(&points, idx % width, idx / width)?;
                Some(Facet {
                    normal: world_from_cam.vector(&facet.normal),
                    to_eye: world_from_cam.vector(&facet.to_eye),
                })
            })
            .collect();
        Ok(Self { facets: Raster { width, height, data: facets }, world_from_cam })
    }
}

/// Normal by central differences of the points, one-sided at an edge or beside a hole; in the camera's axes.
fn facet(points: &Raster<Option<Point3<f64>>>, x: usize, y: usize) -> Option<Facet> {
    let at = |x: Option<usize>, y: Option<usize>| points.get(x?, y?).copied().flatten();
    let here = at(Some(x), Some(y))?;
    let difference = |before: Option<Point3<f64>>, after: Option<Point3<f64>>| match (before, after) {
        (None, None) => None,
        (before, after) => Some(after.unwrap_or(here) - before.unwrap_or(here)),
    };
    let right = difference(at(x.checked_sub(1), Some(y)), at(Some(x + 1), Some(y)))?;
    let down = difference(at(Some(x), y.checked_sub(1)), at(Some(x), Some(y + 1)))?;
    Some(Facet {
        // X right, Y down, Z away: down × right comes towards the camera.
        normal: down.cross(&right).try_normalize(0.0)?,
        to_eye: (-here.coords).try_normalize(0.0)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::{Distortion, Matrix3, Matrix4, PixelConvention};

    #[test]
    fn a_tilted_plane_has_its_normal_everywhere() {
        // The plane n·p = −1000 in the camera's frame, seen with an identity pose.
        let normal = Vector3::new(0.2, -0.3, -1.0).normalize();
        let k = Matrix3::new(60.0, 0.0, 8.0, 0.0, 60.0, 6.0, 0.0, 0.0, 1.0);
        let mut depth_z = Raster::from_fn(16, 12, |x, y| {
            let ray = Vector3::new((center_of(x) - 8.0) / 60.0, (center_of(y) - 6.0) / 60.0, 1.0);
            (-1000.0 / normal.dot(&ray)) as f32
        });
        depth_z[(5, 5)] = f32::NAN;
        let view = RawView {
            path: "plane".into(),
            k,
            k_convention: PixelConvention::Corner,
            distortion: Distortion::default(),
            world_from_cam: Matrix4::identity(),
            depth_z,
            depth_stored: SampleType::Float,
        };
        let surface = ViewSurface::new(&view).unwrap();
        assert!(surface.facets[(5, 5)].is_none());
        assert_eq!(surface.facets.data.iter().flatten().count(), 16 * 12 - 1);
        for facet in surface.facets.data.iter().flatten() {
            assert!((facet.normal - normal).norm() < 1e-4);
            assert!((facet.to_eye.norm() - 1.0).abs() < 1e-12 && facet.to_eye.z < 0.0);
        }
    }
}
