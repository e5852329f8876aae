//! Which pixels of a view show ground that the other view shows as well, by the depths of both.

use super::TruthView;
use rayon::prelude::*;
use selenograph_geometry::pixel::{center_of, index_of};
use selenograph_geometry::{BodyFixed, CamA, CamB, Point2, Point3, Rigid3};
use selenograph_raster::{Raster, resample};

/// Depths that differ by less than this share of theirs are of one surface: ten times the step of a half float, a tenth
/// of what relief hides.
pub const CONSISTENT_SHARE: f64 = 0.005;

/// Pixels of `here` whose true point is seen by `other`: its z-depth there agrees with `other`'s, and the ground that
/// `other` has there agrees, on its way back, with `here`'s.
///
/// # Shapes and units
/// The size of `here`; false where there is no truth or its point leaves the other frame.
pub fn covisible(here: &TruthView, other: &TruthView) -> Raster<bool> {
    let world_from_here: Rigid3<BodyFixed, CamA> = here.world_from_cam.relabel();
    let world_from_other: Rigid3<BodyFixed, CamB> = other.world_from_cam.relabel();
    let other_from_here = &world_from_other.inverse() * &world_from_here;
    let here_from_other = other_from_here.inverse();
    let (width, height) = (here.depth_z.width, here.depth_z.height);
    let seen = |idx: usize| -> Option<bool> {
        let pixel = Point2::new(center_of(idx % width), center_of(idx / width));
        let depth_z = f64::from(here.depth_z.data[idx]);
        if !depth_z.is_finite() {
            return None;
        }
        let there = other_from_here.point(&here.camera.unproject(&pixel, depth_z)?);
        let at = other.camera.project(&there)?;
        let other_z = surface_z(&other.depth_z, &at)?;
        let back: Point3<f64> = here_from_other.point(&other.camera.unproject(&at, other_z)?);
        let back_z = surface_z(&here.depth_z, &here.camera.project(&back)?)?;
        Some(agree(there.z, other_z) && agree(back.z, back_z))
    };
    let data = (0..width * height).into_par_iter().map(|idx| seen(idx).unwrap_or(false)).collect();
    Raster { width, height, data }
}

fn agree(z: f64, surface_z: f64) -> bool {
    (z - surface_z).abs() <= CONSISTENT_SHARE * surface_z
}

/// Depth at a place of a picture: between the centres of the outer pixels and the frame it is theirs, and beside an absent
/// neighbour it is that of the pixel itself.
fn surface_z(depth_z: &Raster<f32>, at: &Point2<f64>) -> Option<f64> {
    let column = usize::try_from(index_of(at.x)).ok().filter(|&column| column < depth_z.width)?;
    let row = usize::try_from(index_of(at.y)).ok().filter(|&row| row < depth_z.height)?;
    let x = at.x.clamp(center_of(0), center_of(depth_z.width - 1));
    let y = at.y.clamp(center_of(0), center_of(depth_z.height - 1));
    resample::bilinear(depth_z, x, y)
        .or_else(|| Some(f64::from(depth_z[(column, row)])).filter(|z| z.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::Precision;
    use selenograph_geometry::{Cam, Camera, Rotation3};

    /// A level plane 1000 m below, seen from two places side by side.
    fn view(x_m: f64, hole: Option<(usize, usize)>) -> TruthView {
        let mut depth_z = Raster::filled(40, 30, 1000.0f32);
        if let Some(hole) = hole {
            depth_z[hole] = f32::NAN;
        }
        let world_from_cam: Rigid3<BodyFixed, Cam> =
            Rigid3::new(Rotation3::identity(), Point3::new(x_m, 0.0, 0.0));
        let camera = Camera::from_fov(40, 30, 0.8).unwrap();
        TruthView { camera, world_from_cam, depth_z, precision: Precision::Float }
    }

    #[test]
    fn a_shifted_view_shares_all_but_its_margin() {
        let a = view(0.0, None);
        let step_m = a.camera.gsd_m(1000.0);
        let seen = covisible(&a, &view(4.25 * step_m, None));
        for y in 0..30 {
            for x in 0..40 {
                // Pixel centres 4.25 px to the left are outside from column 4 down.
                assert_eq!(seen[(x, y)], x >= 4, "{x} {y}");
            }
        }
    }

    #[test]
    fn other_ground_in_front_hides() {
        let a = view(0.0, None);
        let mut b = view(0.0, None);
        b.depth_z[(10, 10)] = 990.0;
        b.depth_z[(11, 10)] = f32::NAN;
        let seen = covisible(&a, &b);
        assert!(!seen[(10, 10)] && !seen[(11, 10)] && seen[(12, 10)]);
        assert_eq!(seen.data.iter().filter(|s| !**s).count(), 2);
    }
}
