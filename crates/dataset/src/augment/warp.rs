//! Pictures and depths seen through a homography.

use super::view::Fidelity;
use crate::sample::ViewTruth;
use selenograph_geometry::{Camera, Matrix3, Point2, Vector3, pixel};
use selenograph_raster::Raster;

/// The place that a homography gives a continuous pixel; NaN where it has none.
pub fn through(homography: &Matrix3<f64>, x: f64, y: f64) -> Point2<f64> {
    let p = homography * Vector3::new(x, y, 1.0);
    Point2::new(p.x / p.z, p.y / p.z)
}

/// Whether a continuous pixel lies in a picture.
fn inside<T>(picture: &Raster<T>, at: &Point2<f64>) -> bool {
    (0.0..picture.width as f64).contains(&at.x) && (0.0..picture.height as f64).contains(&at.y)
}

/// Value a share `t` of the way from the second to the third of four samples, along a cubic whose slope at a sample is `slope`
/// times the difference of its neighbours.
fn cubic([a, b, c, d]: [f64; 4], t: f64, slope: f64) -> f64 {
    let square = slope * (2.0 * a + b - 2.0 * c - d) + 3.0 * (c - b);
    let cube = slope * (c + d - a - b) + 2.0 * (b - c);
    b + t * (slope * (c - a) + t * (square + t * cube))
}

/// A picture whose pixel centres are those places of another, by bicubic interpolation; black outside.
///
/// [`Fidelity::Published`] is the Python Imaging Library's: a cubic that overshoots, cut down to whole levels.
pub fn picture(
    source: &Raster<f32>,
    source_from_target: &Matrix3<f64>,
    [width, height]: [usize; 2],
    fidelity: Fidelity,
) -> Raster<f32> {
    let slope = match fidelity {
        Fidelity::Published => 1.0,
        Fidelity::Exact => 0.5,
    };
    let clip = |position: f64, side: usize| {
        let first = position.floor();
        let near = |n: i64| (first as i64 + n - 1).clamp(0, side as i64 - 1) as usize;
        ([near(0), near(1), near(2), near(3)], position - first)
    };
    Raster::from_fn(width, height, |x, y| {
        let at = through(source_from_target, pixel::center_of(x), pixel::center_of(y));
        if !inside(source, &at) {
            return 0.0;
        }
        let (columns, tx) = clip(pixel::sample_position(at.x), source.width);
        let (rows, ty) = clip(pixel::sample_position(at.y), source.height);
        let along = rows.map(|row| {
            let row = source.row(row);
            cubic(columns.map(|column| f64::from(row[column])), tx, slope)
        });
        let value = cubic(along, ty, slope).max(0.0);
        match fidelity {
            Fidelity::Published => value.min(255.0).floor() as f32,
            Fidelity::Exact => value as f32,
        }
    })
}

/// The depths of a view in a camera turned about the same centre; `source_axis` is the new camera's optical axis in the old one.
///
/// [`Fidelity::Published`] takes the pixel that holds the place, [`Fidelity::Exact`] what [`ViewTruth::depth_z_at`] finds there.
pub fn depth_z(
    camera: &Camera,
    truth: &ViewTruth,
    source_from_target: &Matrix3<f64>,
    source_axis: &Vector3<f64>,
    [width, height]: [usize; 2],
    fidelity: Fidelity,
) -> Raster<f32> {
    let source = &truth.depth_z;
    let scaled = |at: &Point2<f64>, depth_z: f64| match camera.ray_z1(at) {
        Some(ray) => (ray.dot(source_axis) * depth_z) as f32,
        None => f32::NAN,
    };
    Raster::from_fn(width, height, |x, y| {
        let at = through(source_from_target, pixel::center_of(x), pixel::center_of(y));
        if !inside(source, &at) {
            return f32::NAN;
        }
        let holder = [at.x as usize, at.y as usize];
        let own = f64::from(source[(holder[0], holder[1])]);
        if !own.is_finite() {
            return own as f32;
        }
        match fidelity {
            Fidelity::Published => scaled(&Point2::from(holder.map(pixel::center_of)), own),
            Fidelity::Exact => scaled(&at, truth.depth_z_at(camera, &at).unwrap_or(own)),
        }
    })
}
