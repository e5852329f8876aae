//! Both clouds of a pair in one picture, seen from the side: view A orange, view B blue.

use selenograph_geometry::{BodyFixed, CamA, Point3, Rigid3, Vector3};
use selenograph_raster::{Raster, statistics};
use selenograph_report::color::{VIEW_1, VIEW_2};

/// Side of the picture, pixels.
const SIDE_PX: usize = 512;
/// The eye looks down at the ground at this angle from the horizon, radians.
const EYE_ELEVATION_RAD: f64 = 40.0 * std::f64::consts::PI / 180.0;
/// Shares of the points that may lie outside the picture on each side.
const OUTSIDE: [f64; 2] = [0.002, 0.998];
const PAPER: [u8; 3] = [250, 250, 248];
/// How much of a colour a shadowed point keeps.
const LEAST_SHADE: f64 = 0.25;

/// A parallel projection of both clouds; `None` without a point.
pub fn picture(
    points_in_cam_a: &[Raster<Point3<f64>>; 2],
    world_from_cam_a: &Rigid3<BodyFixed, CamA>,
) -> Option<Raster<[u8; 3]>> {
    let all = || {
        points_in_cam_a.iter().flat_map(|view| &view.data).filter(|p| p.coords.iter().all(|c| c.is_finite()))
    };
    let count = all().count();
    if count == 0 {
        return None;
    }
    let centre = Point3::from(all().map(|p| p.coords).sum::<Vector3<f64>>() / count as f64);
    // Up at the middle of the cloud, in camera A: away from the centre of the body.
    let up = world_from_cam_a.inverse().vector(&world_from_cam_a.point(&centre).coords.normalize());
    let right = Vector3::x() - up * up.x;
    let right = right.try_normalize(1e-6).unwrap_or_else(|| up.cross(&Vector3::y()).normalize());
    let into = up.cross(&right);
    // Screen axes of an eye that looks along `into` and down.
    let (sin, cos) = EYE_ELEVATION_RAD.sin_cos();
    let screen_up = up * cos + into * sin;
    let away = into * cos - up * sin;
    let on_screen = |p: &Point3<f64>| {
        let off = p - centre;
        [off.dot(&right), off.dot(&screen_up), off.dot(&away), off.dot(&up)]
    };
    let [left, east] = statistics::quantiles(all().map(|p| on_screen(p)[0]), OUTSIDE)?;
    let [bottom, top] = statistics::quantiles(all().map(|p| on_screen(p)[1]), OUTSIDE)?;
    let [low, high] = statistics::quantiles(all().map(|p| on_screen(p)[3]), [0.02, 0.98])?;
    let span = (east - left).max(top - bottom).max(f64::MIN_POSITIVE);
    let middle = [0.5 * (left + east), 0.5 * (bottom + top)];
    let mut nearest = Raster::filled(SIDE_PX, SIDE_PX, f64::INFINITY);
    let mut shown = Raster::filled(SIDE_PX, SIDE_PX, PAPER);
    for (view, color) in points_in_cam_a.iter().zip([VIEW_1, VIEW_2]) {
        for point in view.data.iter().filter(|p| p.coords.iter().all(|c| c.is_finite())) {
            let [x, y, distance, height] = on_screen(point);
            let column = ((x - middle[0]) / span * 0.94 + 0.5) * SIDE_PX as f64;
            let row = (0.5 - (y - middle[1]) / span * 0.94) * SIDE_PX as f64;
            if !(0.0..SIDE_PX as f64).contains(&column) || !(0.0..SIDE_PX as f64).contains(&row) {
                continue;
            }
            let at = (column as usize, row as usize);
            if distance < nearest[at] {
                nearest[at] = distance;
                // Height as brightness: a flat colour would show no relief.
                let share = ((height - low) / (high - low).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                let shade = LEAST_SHADE + (1.0 - LEAST_SHADE) * share;
                shown[at] = color.map(|channel| (f64::from(channel) * shade).round() as u8);
            }
        }
    }
    Some(shown)
}
