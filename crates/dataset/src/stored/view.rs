//! Views in memory: as their files hold them, and as they are worked with.

use crate::Error;
use selenograph_geometry::{
    BodyFixed, Cam, Camera, Distortion, Matrix3, Matrix4, PixelConvention, Point3, Rigid3, Rotation3,
};
use selenograph_raster::Raster;
use selenograph_raster::codec::Picture;
use selenograph_raster::codec::exr::SampleType;
use std::path::{Path, PathBuf};

/// A view's geometry exactly as its files hold it, right or wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct RawView {
    /// The file that names the view in messages.
    pub path: PathBuf,
    /// Camera matrix, pixels.
    pub k: Matrix3<f64>,
    /// Where the matrix puts the first pixel's centre, as far as the files say or the reader was told.
    pub k_convention: PixelConvention,
    /// Lens distortion.
    pub distortion: Distortion,
    /// Pose, camera to world, metres.
    pub world_from_cam: Matrix4<f64>,
    /// z-depth, metres; absent samples as the file has them (NaN, infinite).
    pub depth_z: Raster<f32>,
    /// Sample type of the depth in the file.
    pub depth_stored: SampleType,
}

impl RawView {
    /// Depth with every absent sample NaN.
    pub fn depth_or_nan(&self) -> Raster<f32> {
        self.depth_z.map(|&z| if z.is_finite() && z > 0.0 { z } else { f32::NAN })
    }

    /// Whether another view has the same camera matrix, pose and depth, to the last bit.
    pub fn is_same_geometry(&self, other: &Self) -> bool {
        let bits = |raw: &Self| raw.depth_z.data.iter().map(|z| z.to_bits()).collect::<Vec<_>>();
        self.k == other.k && self.world_from_cam == other.world_from_cam && bits(self) == bits(other)
    }

    /// The camera, measured from the corner.
    ///
    /// # Errors
    /// [`Error::Geometry`] for a matrix that no camera has.
    pub fn camera(&self) -> Result<Camera, Error> {
        let camera = Camera::from_k(self.depth_z.width, self.depth_z.height, &self.k, self.k_convention)?;
        Ok(camera.with_distortion(self.distortion))
    }

    /// The pose.
    ///
    /// # Errors
    /// [`Error::Geometry`] if the matrix is no rigid motion.
    pub fn world_from_cam(&self) -> Result<Rigid3<BodyFixed, Cam>, Error> {
        rigid(&self.world_from_cam)
    }
}

/// A pose out of a stored matrix.
///
/// # Errors
/// [`Error::Geometry`] if the matrix is no rigid motion.
pub(super) fn rigid(world_from_cam: &Matrix4<f64>) -> Result<Rigid3<BodyFixed, Cam>, Error> {
    let rotation = world_from_cam.fixed_view::<3, 3>(0, 0).into_owned();
    let origin = Point3::from(world_from_cam.fixed_view::<3, 1>(0, 3).into_owned());
    Rigid3::<BodyFixed, Cam>::from_matrix(&rotation, origin)?;
    // The check above projects by an iteration that stands still at half turns, which nadir cameras at a pole have.
    Ok(Rigid3::new(nearest_rotation(&rotation).unwrap_or_else(Rotation3::identity), origin))
}

/// One view of a pair, with its pictures under each light.
#[derive(Debug, Clone, PartialEq)]
pub struct StereoView {
    /// Where it came from, for messages and labels.
    pub name: String,
    /// The camera, measured from the corner.
    pub camera: Camera,
    /// The pose.
    pub world_from_cam: Rigid3<BodyFixed, Cam>,
    /// z-depth, metres, NaN where absent.
    pub depth_z: Raster<f32>,
    /// One 8-bit picture per light.
    pub images: Vec<Raster<u8>>,
    /// Slope of the terrain, radians, where the source knows it.
    pub slope_rad: Option<Raster<f32>>,
    /// One mask of lit pixels (not 0) per light, where the source knows it.
    pub lit: Vec<Raster<u8>>,
}

/// Two views of the same ground.
#[derive(Debug, Clone, PartialEq)]
pub struct StereoPair {
    /// Number in its folder.
    pub pair_id: u64,
    /// A and B.
    pub views: [StereoView; 2],
}

/// The rotation nearest to a matrix, which removes the float32 noise of a stored pose; `None` for mirrored axes.
pub(crate) fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Rotation3<f64>> {
    let svd = matrix.svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    (rotation.determinant() > 0.0).then(|| Rotation3::from_matrix_unchecked(rotation))
}

/// Refuses a picture of another size than its depth or camera.
pub(crate) fn check_size(
    picture: &Picture,
    (width, height): (usize, usize),
    path: &Path,
) -> Result<(), Error> {
    let found = picture.size();
    if found == (width, height) {
        return Ok(());
    }
    let expected = format!("a picture of {width}×{height} pixels, as its depth or camera");
    Err(Error::unexpected(path, expected, format!("{}×{}", found.0, found.1)))
}

/// A picture as 8-bit grey: 16 bits are scaled down and rounded; of three channels, which are equal, the first is taken.
pub(crate) fn grey8(picture: &Picture) -> Raster<u8> {
    match picture {
        Picture::Grey8(grey) => grey.clone(),
        Picture::Grey16(grey) => grey.map(|&level| ((u32::from(level) * 255 + 32_767) / 65_535) as u8),
        // Lunar pictures are grey: their channels are equal.
        Picture::Rgb8(colour) => colour.map(|&[red, _, _]| red),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_turns_and_noisy_rotations_are_kept() {
        for axes in [[1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
            let exact = Matrix3::from_diagonal(&axes.into());
            let noisy = exact + Matrix3::from_fn(|i, j| 1e-7 * (i as f64 - 2.0 * j as f64));
            let rotation = nearest_rotation(&noisy).unwrap();
            assert!((rotation.matrix() - exact).amax() < 1e-6);
            assert!((rotation.matrix() * rotation.matrix().transpose() - Matrix3::identity()).amax() < 1e-14);
        }
        assert!(nearest_rotation(&Matrix3::from_diagonal(&[1.0, 1.0, -1.0].into())).is_none());
    }
}
