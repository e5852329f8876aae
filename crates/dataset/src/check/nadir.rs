//! The ground straight below a camera, as the depth of a pair shows it.

use super::reprojection::DepthView;
use selenograph_geometry::{Body, Point2, Point3, Vector3, pixel};

/// The ground where a plumb line meets it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Nadir {
    /// Of the pixel nearest to the plumb line, metres above the sphere.
    pub height_m: f64,
    /// How far the ground on the line itself may lie from that, metres: the pixels round it differ by no more, and between
    /// two of them nothing is taken to be steeper than 45°.
    pub tolerance_m: f64,
}

/// Where the plumb line from `position` meets what one of the views sees, the first of them that sees it.
pub(super) fn below(position: &Point3<f64>, body: &Body, views: [&DepthView<'_>; 2]) -> Option<Nadir> {
    views.into_iter().find_map(|view| seen(position, body, view))
}

fn seen(position: &Point3<f64>, body: &Body, view: &DepthView<'_>) -> Option<Nadir> {
    let up = position.coords.normalize();
    let ground = |x: usize, y: usize| {
        let at = Point2::new(pixel::center_of(x), pixel::center_of(y));
        let point = view.world_from_cam.point(&view.camera.unproject(&at, view.depth_at(x, y)?)?);
        (point.coords.dot(&up) > 0.0).then_some(point)
    };
    let (width, height) = (view.depth_z.width, view.depth_z.height);
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let off_line = |point: &Point3<f64>| point.coords.cross(&up).norm_squared();
    let (_, x, y) = pixels
        .filter_map(|(x, y)| Some((off_line(&ground(x, y)?), x, y)))
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    let here = ground(x, y)?;
    let (mut spacing_m, mut spread_m) = (0f64, 0f64);
    for (dx, dy) in NEIGHBOURS {
        let next = ground(x.checked_add_signed(dx)?, y.checked_add_signed(dy)?)?;
        let level = |v: Vector3<f64>| v - up * v.dot(&up);
        spacing_m = spacing_m.max(level(next - here).norm());
        spread_m = spread_m.max((body.height_m(&next) - body.height_m(&here)).abs());
    }
    let distance_m = off_line(&here).sqrt();
    // Farther away than the neighbours: the line passes beside the frame, or through a hole.
    (distance_m <= spacing_m)
        .then(|| Nadir { height_m: body.height_m(&here), tolerance_m: spread_m + distance_m + ROUNDING_M })
}

const NEIGHBOURS: [(isize, isize); 8] =
    [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// Half a step of f32 at the altitude of an orbit.
const ROUNDING_M: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::synthetic::{Shape, nadir_pair, oblique_pair};

    #[test]
    fn the_ground_below_is_found_in_either_view_and_not_where_none_sees_it() {
        let body = Body::moon();
        let [a, b] = nadir_pair(64);
        for (own, views) in [(&a, [&a.view(), &b.view()]), (&a, [&b.view(), &b.view()])] {
            let position = own.world_from_cam.origin();
            let nadir = below(&position, &body, views).unwrap();
            let altitude_m = Shape::default().altitude_m(&own.world_from_cam);
            let error = (body.height_m(&position) - altitude_m - nadir.height_m).abs();
            assert!(error <= nadir.tolerance_m && nadir.tolerance_m < 300.0, "{error} {nadir:?}");
        }
        let [a, b] = oblique_pair(64);
        assert_eq!(below(&a.world_from_cam.origin(), &body, [&a.view(), &b.view()]), None);
    }
}
