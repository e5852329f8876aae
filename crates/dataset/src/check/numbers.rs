//! The numbers of a pair that a reader wants to see: where, how high, how far apart, how well it reprojects.

use super::reprojection::{DepthView, WarpStatistics, symmetric};
use crate::pair::{RelativeGeometry, tilt_rad};
use selenograph_geometry::units::wrap_360_deg;
use selenograph_geometry::{Body, Camera, Geodetic, pixel};
use selenograph_raster::statistics;
use serde::Serialize;

/// The numbers of one view.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ViewNumbers {
    /// Height of the camera above the reference sphere, metres.
    pub altitude_above_sphere_m: f64,
    /// Latitude below the camera, degrees.
    pub latitude_deg: f64,
    /// East longitude below the camera, degrees in `[0, 360)`.
    pub longitude_deg: f64,
    /// Depth of the pixel right and below of the image's middle, metres; absent where it has none.
    pub center_depth_z_m: Option<f64>,
    /// Mean over the pixels with depth, metres.
    pub mean_depth_z_m: f64,
    /// Nearest and farthest, metres.
    pub depth_z_range_m: [f64; 2],
    /// Number of pixels without depth.
    pub num_absent: usize,
    /// Mean depth over focal length, metres per pixel.
    pub gsd_m: f64,
    /// Angle between the optical axis and the local vertical, degrees.
    pub tilt_deg: f64,
}

/// The numbers of one pair.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairNumbers {
    /// Scene and first image, or number of the pair.
    pub name: String,
    /// A and B.
    pub views: [ViewNumbers; 2],
    /// Distance between the cameras, metres.
    pub baseline_m: f64,
    /// That over the mean of both altitudes over the site, as in `pair.json`.
    pub baseline_over_height: f64,
    /// Angle of the rotation between the cameras, degrees.
    pub relative_rotation_deg: f64,
    /// Reprojection both ways with the camera matrices as told; absent where the views share nothing.
    pub reprojection: Option<WarpStatistics>,
    /// The same with principal points moved by half a pixel, as if they were measured from the first pixel's centre.
    pub reprojection_half_pixel: Option<WarpStatistics>,
}

fn view_numbers(view: &DepthView, body: &Body) -> Option<ViewNumbers> {
    let position = view.world_from_cam.origin();
    let place = body.place(&position);
    let depths = view.depth_z.data.iter().map(|&z| if z > 0.0 { f64::from(z) } else { f64::NAN });
    let depth_z = statistics::summary(depths)?;
    let camera = view.camera;
    Some(ViewNumbers {
        altitude_above_sphere_m: place.height_m,
        latitude_deg: place.lat_rad.to_degrees(),
        longitude_deg: wrap_360_deg(place.lon_rad.to_degrees()),
        center_depth_z_m: view.depth_at(camera.width / 2, camera.height / 2),
        mean_depth_z_m: depth_z.mean,
        depth_z_range_m: [depth_z.min, depth_z.max],
        num_absent: depth_z.num_absent,
        gsd_m: camera.gsd_m(depth_z.mean),
        tilt_deg: tilt_rad(view.world_from_cam).to_degrees(),
    })
}

/// The numbers of a pair aimed at `site`; `None` if a view has no depth at all. Every `step`-th pixel is warped.
pub fn pair_numbers(
    name: &str,
    a: &DepthView,
    b: &DepthView,
    (body, site): (&Body, &Geodetic),
    step: usize,
) -> Option<PairNumbers> {
    let views = [view_numbers(a, body)?, view_numbers(b, body)?];
    let relative = RelativeGeometry::new(body, site, a.world_from_cam, b.world_from_cam);
    let [moved_a, moved_b] = [a, b].map(|view| moved(view.camera, pixel::HALF_PIXEL, pixel::HALF_PIXEL));
    Some(PairNumbers {
        name: name.to_owned(),
        views,
        baseline_m: relative.baseline_vector_m.norm(),
        baseline_over_height: relative.baseline_over_height,
        relative_rotation_deg: relative.relative_rotation_rad.to_degrees(),
        reprojection: symmetric(a, b, step),
        reprojection_half_pixel: symmetric(
            &DepthView { camera: &moved_a, ..*a },
            &DepthView { camera: &moved_b, ..*b },
            step,
        ),
    })
}

/// A camera with its principal point moved, pixels.
pub fn moved(camera: &Camera, du: f64, dv: f64) -> Camera {
    Camera { cx: camera.cx + du, cy: camera.cy + dv, ..camera.clone() }
}
