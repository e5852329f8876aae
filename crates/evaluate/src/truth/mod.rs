//! What is known of a pair: cameras, poses, z-depth, and how finely the depth was stored.

pub(crate) mod covisible;
pub(crate) mod plane;

use selenograph_dataset::photometric::dequantise::half_interval;
use selenograph_dataset::stored::{StereoPair, StereoView};
use selenograph_geometry::pixel::{self, center_of};
use selenograph_geometry::{BodyFixed, Cam, CamA, CamB, Camera, Point2, Point3, Rigid3, Vector3};
use selenograph_raster::{Raster, statistics};
use serde::{Deserialize, Serialize};

/// How finely a depth was stored before it came here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// 24 significant bits or more.
    Float,
    /// A half float, 11 significant bits: steps of 8 to 32 m from 8 to 65 km.
    Half,
}

impl Precision {
    /// From the samples themselves: no float truth has every sample on the grid of half floats.
    pub fn of(depth_z: &Raster<f32>) -> Self {
        let on_the_grid = |&z: &f32| {
            let (low, high) = half_interval(f64::from(z));
            // The interval's ends lie half a step away: a half float is a multiple of its step.
            let step = high - f64::from(z);
            step > 0.0 && high > low && (f64::from(z) / (2.0 * step)).fract() == 0.0
        };
        let mut finite = depth_z.data.iter().filter(|z| z.is_finite()).peekable();
        if finite.peek().is_some() && finite.all(on_the_grid) { Self::Half } else { Self::Float }
    }
}

/// The truth of one view.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthView {
    /// The camera, measured from the corner, of the depth's size.
    pub camera: Camera,
    /// The pose.
    pub world_from_cam: Rigid3<BodyFixed, Cam>,
    /// z-depth, metres, NaN where absent.
    pub depth_z: Raster<f32>,
    /// How finely the depth was stored.
    pub precision: Precision,
}

impl TruthView {
    /// From a view of a dataset.
    pub fn from_stereo_view(view: &StereoView) -> Self {
        Self {
            camera: view.camera.clone(),
            world_from_cam: view.world_from_cam,
            depth_z: view.depth_z.clone(),
            precision: Precision::of(&view.depth_z),
        }
    }

    /// The rays of all pixels with `z = 1`, so that a point is its depth times its ray; NaN outside the lens model.
    pub fn rays_z1(&self) -> Raster<Vector3<f64>> {
        Raster::from_fn(self.camera.width, self.camera.height, |x, y| {
            self.camera
                .ray_z1(&Point2::new(center_of(x), center_of(y)))
                .unwrap_or_else(|| Vector3::repeat(f64::NAN))
        })
    }

    /// The points of all pixels in the camera's frame, metres; NaN where absent.
    pub fn points_in_cam(&self) -> Raster<Point3<f64>> {
        let rays = self.rays_z1();
        let data = rays.data.iter().zip(&self.depth_z.data).map(|(r, z)| Point3::from(r * f64::from(*z)));
        Raster { width: rays.width, height: rays.height, data: data.collect() }
    }

    /// Median z-depth, metres; `None` without a single depth.
    pub fn median_depth_z_m(&self) -> Option<f64> {
        statistics::median(self.depth_z.data.iter().map(|&z| f64::from(z)))
    }

    /// The rows `top..top + rows` alone.
    ///
    /// # Errors
    /// [`selenograph_geometry::Error::Camera`] if they leave the image.
    fn rows(&self, top: usize, rows: usize) -> Result<Self, selenograph_geometry::Error> {
        let camera = pixel::crop(&self.camera, 0, top, self.camera.width, rows)?;
        Ok(Self { camera, depth_z: crop_rows(&self.depth_z, top, rows), ..self.clone() })
    }
}

/// The rows `top..top + rows` of a raster.
///
/// # Panics
/// If they leave the raster.
pub fn crop_rows<T: Clone>(raster: &Raster<T>, top: usize, rows: usize) -> Raster<T> {
    let data = raster.data[top * raster.width..(top + rows) * raster.width].to_vec();
    Raster { width: raster.width, height: rows, data }
}

/// The truth of both views.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthPair {
    /// A and B.
    pub views: [TruthView; 2],
}

impl TruthPair {
    /// From a pair of a dataset.
    pub fn from_stereo_pair(pair: &StereoPair) -> Self {
        Self { views: pair.views.each_ref().map(TruthView::from_stereo_view) }
    }

    /// The pose of A in the world.
    pub fn world_from_cam_a(&self) -> Rigid3<BodyFixed, CamA> {
        self.views[0].world_from_cam.relabel()
    }

    /// The pose of B in the world.
    pub fn world_from_cam_b(&self) -> Rigid3<BodyFixed, CamB> {
        self.views[1].world_from_cam.relabel()
    }

    /// The relative pose, metres.
    pub fn cam_b_from_cam_a(&self) -> Rigid3<CamB, CamA> {
        &self.world_from_cam_b().inverse() * &self.world_from_cam_a()
    }

    /// The central rows of both views, as the reference protocol evaluates them; the pair itself where a view has no more.
    ///
    /// # Errors
    /// [`selenograph_geometry::Error::Camera`] for 0 rows.
    pub fn central_rows(&self, rows: usize) -> Result<Self, selenograph_geometry::Error> {
        let [a, b] = self.views.each_ref().map(|view| {
            let rows = rows.min(view.camera.height);
            view.rows((view.camera.height - rows) / 2, rows)
        });
        Ok(Self { views: [a?, b?] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precision_is_read_off_the_samples() {
        let half = Raster { width: 4, height: 1, data: vec![30_016.0, 40_000.0, f32::NAN, 1000.5] };
        assert_eq!(Precision::of(&half), Precision::Half);
        let float = Raster { width: 3, height: 1, data: vec![30_016.0, 30_017.0, 40_000.0] };
        assert_eq!(Precision::of(&float), Precision::Float);
        let absent = Raster { width: 2, height: 1, data: vec![f32::NAN; 2] };
        assert_eq!(Precision::of(&absent), Precision::Float);
    }

    #[test]
    fn central_rows_keep_the_points() {
        let camera = Camera::from_fov(16, 12, 0.8).unwrap();
        let view = TruthView {
            camera,
            world_from_cam: Rigid3::identity(),
            depth_z: Raster::from_fn(16, 12, |x, y| 100.0 + x as f32 + 0.1 * y as f32),
            precision: Precision::Float,
        };
        let pair = TruthPair { views: [view.clone(), view] };
        let cropped = pair.central_rows(8).unwrap();
        let (whole, part) = (pair.views[0].points_in_cam(), cropped.views[0].points_in_cam());
        assert_eq!((part.width, part.height), (16, 8));
        for y in 0..8 {
            for x in 0..16 {
                assert!((part[(x, y)] - whole[(x, y + 2)]).norm() < 1e-12);
            }
        }
        assert_eq!(pair.central_rows(100).unwrap(), pair);
        assert!(pair.central_rows(0).is_err());
    }
}
