//! The slopes of view A's surface in every definition, and how those of two surfaces agree.

use crate::agreement::Agreement;
use crate::slope::{erode, from_sobel, neighbour_normals, sobel_length, true_slope, world_z};
use selenograph_geometry::{BodyFixed, CamA, Point3, Rigid3, Vector3};
use selenograph_raster::Raster;

/// How far the mask of footprint slopes is eroded, pixels.
const ERODED_PX: usize = 4;

/// Places of the definitions of slope: `slope_corr_code`, `_gsd`, `_normals`, `_true`.
pub(super) const CODE: usize = 0;
pub(super) const GSD: usize = 1;
pub(super) const NORMALS: usize = 2;
pub(super) const TRUE: usize = 3;

/// World Z and slopes, radians; NaN where absent.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    pub world_z_m: Raster<f64>,
    /// By [`CODE`], [`GSD`], [`NORMALS`], [`TRUE`].
    pub slopes: [Raster<f64>; 4],
}

/// Agreement of two surfaces' slopes, in the order of [`Surface::slopes`].
#[derive(Debug, Clone, Copy)]
pub(super) struct SlopeScores {
    pub correlation: [Option<f64>; 4],
    pub mean_abs_deg: [Option<f64>; 4],
}

impl Surface {
    /// From points in camera A's frame, and normals with the world's Z axis in their frame.
    pub fn new(
        points: &Raster<Point3<f64>>,
        world_from_cam_a: &Rigid3<BodyFixed, CamA>,
        footprint_m: f64,
        normals: &Raster<Vector3<f64>>,
        z_axis: &Vector3<f64>,
    ) -> Self {
        let world_z_m = world_z(points, world_from_cam_a);
        let length = sobel_length(&world_z_m);
        let slopes = [
            from_sobel(&length, 1.0),
            from_sobel(&length, footprint_m),
            normals.map(|normal| neighbour_normals::slope_against(normal, z_axis)),
            true_slope(points, world_from_cam_a),
        ];
        Self { world_z_m, slopes }
    }

    /// How the slopes agree with another surface's over the pixels of a mask.
    pub fn scores(&self, truth: &Self, mask: &Raster<bool>) -> SlopeScores {
        let (a, b) = (&self.world_z_m, &truth.world_z_m);
        let present = (0..mask.data.len())
            .map(|idx| mask.data[idx] && a.data[idx].is_finite() && b.data[idx].is_finite())
            .collect();
        let eroded = erode(&Raster { width: mask.width, height: mask.height, data: present }, ERODED_PX);
        let agreements: [Option<Agreement>; 4] = std::array::from_fn(|kind| {
            let mask = if kind == GSD { &eroded } else { mask };
            Agreement::of(masked(&self.slopes[kind], &truth.slopes[kind], mask))
        });
        SlopeScores {
            correlation: agreements.map(|a| a?.correlation),
            mean_abs_deg: agreements.map(|a| Some(a?.mean_abs.to_degrees())),
        }
    }
}

/// Pairs of samples under a mask.
pub(super) fn masked<'a>(
    a: &'a Raster<f64>,
    b: &'a Raster<f64>,
    mask: &'a Raster<bool>,
) -> impl Iterator<Item = (f64, f64)> + Clone + 'a {
    let pairs = a.data.iter().copied().zip(b.data.iter().copied());
    pairs.zip(&mask.data).filter(|(_, keep)| **keep).map(|(pair, _)| pair)
}
