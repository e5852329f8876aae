//! Which part of an elevation model pictures see.

use super::{Error, PlacedPicture};
use crate::View;
use crate::scale::dem::DemPatch;
use selenograph_geometry::{Body, BodyFixed, Cam, Point2, Point3, Rigid3, Vector3, pixel};
use selenograph_raster::dem::DemReader;
use std::ops::Range;

/// Relief on either side of the sphere, as a share of its radius: the Moon's and Mars's stay below it.
const RELIEF_SHARE: f64 = 0.007;
/// Samples of a picture along each side.
const SAMPLES: usize = 17;
/// Cells at which the model is asked whether a picture sees them, at most.
const MAX_ASKED: usize = 1 << 20;
/// Cells around what is seen.
const MARGIN: usize = 4;

/// Reads the part of a model over which rays of the pictures pass between the lowest and the highest ground of the body; also its first
/// column and row.
pub(super) fn window(
    reader: &mut DemReader,
    pictures: &[PlacedPicture],
    max_cells: usize,
) -> Result<(DemPatch, [usize; 2]), crate::Error> {
    let info = reader.info().clone();
    let pixel_from_map = info.map_from_pixel.inverse()?;
    let body = info.body();
    let mut bounds: Option<[f64; 4]> = None;
    for picture in pictures {
        for point in reach(picture, body) {
            let Some([x, y]) = info.crs.projection.map_from_point(&point) else { continue };
            let [column, row] = pixel_from_map.apply(x, y);
            let [left, top, right, bottom] = bounds.unwrap_or([column, row, column, row]);
            bounds = Some([left.min(column), top.min(row), right.max(column), bottom.max(row)]);
        }
    }
    let [left, top, right, bottom] = bounds.ok_or(Error::NotInSight { number: 1 })?;
    let range = |from: f64, to: f64, count: usize| {
        let inside = |at: f64| at.clamp(0.0, count as f64) as usize;
        inside(from.floor() - MARGIN as f64)..inside(to.ceil() + MARGIN as f64)
    };
    let (columns, rows) = (range(left, right, info.width), range(top, bottom, info.height));
    let found = columns.len().saturating_mul(rows.len());
    if columns.len() < 2 || rows.len() < 2 {
        return Err(Error::NotInSight { number: 1 }.into());
    }
    if found > max_cells {
        return Err(Error::TooLarge { found, most: max_cells }.into());
    }
    let first = [columns.start, rows.start];
    Ok((DemPatch::of_window(reader, columns, rows)?, first))
}

/// Where rays of a picture pass the lowest and the highest sphere that ground may have.
fn reach(picture: &PlacedPicture, body: &Body) -> Vec<Point3<f64>> {
    let origin = picture.body_from_cam.origin().coords;
    let camera = &picture.view.camera;
    let mut points = Vec::new();
    for j in 0..SAMPLES {
        for i in 0..SAMPLES {
            let share = |k: usize, size: usize| k as f64 / (SAMPLES - 1) as f64 * size as f64;
            let at = Point2::new(share(i, camera.width), share(j, camera.height));
            let Some(ray) = camera.ray_z1(&at) else { continue };
            let direction = picture.body_from_cam.vector(&ray).normalize();
            for radius_m in [1.0 - RELIEF_SHARE, 1.0 + RELIEF_SHARE].map(|share| share * body.radius_m) {
                points.extend(on_sphere(&origin, &direction, radius_m).map(Point3::from));
            }
        }
    }
    points
}

/// Where a ray enters a sphere, or where it starts if it is inside; `None` where it misses.
fn on_sphere(origin: &Vector3<f64>, direction: &Vector3<f64>, radius_m: f64) -> Option<Vector3<f64>> {
    if origin.norm() <= radius_m {
        return Some(*origin);
    }
    let nearest = -origin.dot(direction);
    let across2 = origin.norm_squared() - nearest * nearest;
    let half2 = radius_m * radius_m - across2;
    (nearest > 0.0 && half2 >= 0.0).then(|| origin + direction * (nearest - half2.sqrt()))
}

/// Whether a picture shows a point, relief in front of it apart.
pub(super) fn shows(view: &View, cam_from_body: &Rigid3<Cam, BodyFixed>, point: &Point3<f64>) -> bool {
    let in_cam = cam_from_body.point(point);
    let camera = &view.camera;
    // The far side of the body projects into the picture as well.
    let origin = cam_from_body.inverse().origin().coords;
    (origin - point.coords).dot(&point.coords) > 0.0
        && camera.project(&in_cam).is_some_and(|p| {
            p.x >= 0.0 && p.y >= 0.0 && p.x <= camera.width as f64 && p.y <= camera.height as f64
        })
}

/// The part of a window that any picture sees.
pub(super) struct Seen {
    pub(super) columns: Range<usize>,
    pub(super) rows: Range<usize>,
    /// Points of it on the body.
    pub(super) points: Vec<Point3<f64>>,
}

impl Seen {
    /// # Errors
    /// [`Error::NotInSight`] for a picture that sees nothing of it.
    pub(super) fn of(model: &DemPatch, pictures: &[PlacedPicture]) -> Result<Self, Error> {
        let (width, height) = (model.heights().width, model.heights().height);
        let stride = (((width * height) as f64 / MAX_ASKED as f64).sqrt().ceil() as usize).max(1);
        let cams: Vec<_> = pictures.iter().map(|p| (p.body_from_cam.inverse(), &p.view)).collect();
        let mut counts = vec![0usize; pictures.len()];
        let mut points = Vec::new();
        let mut bounds = [usize::MAX, usize::MAX, 0, 0];
        for row in (0..height).step_by(stride) {
            for column in (0..width).step_by(stride) {
                let height_m = model.heights()[(column, row)];
                let [x, y] = model.map_from_pixel().apply(pixel::center_of(column), pixel::center_of(row));
                let point = model.point(x, y, f64::from(height_m)).filter(|_| height_m.is_finite());
                let Some(point) = point else { continue };
                let mut seen = false;
                for ((cam_from_body, view), count) in cams.iter().zip(&mut counts) {
                    if shows(view, cam_from_body, &point) {
                        *count += 1;
                        seen = true;
                    }
                }
                if seen {
                    points.push(point);
                    let [left, top, right, bottom] = bounds;
                    bounds = [left.min(column), top.min(row), right.max(column), bottom.max(row)];
                }
            }
        }
        if let Some(blind) = counts.iter().position(|count| *count == 0) {
            return Err(Error::NotInSight { number: blind + 1 });
        }
        let margin = MARGIN + stride;
        let [left, top, right, bottom] = bounds;
        Ok(Self {
            columns: left.saturating_sub(margin)..(right + margin + 1).min(width),
            rows: top.saturating_sub(margin)..(bottom + margin + 1).min(height),
            points,
        })
    }

    /// The middle of what is seen, on the body.
    pub(super) fn middle(&self) -> Point3<f64> {
        Point3::from(self.points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / self.points.len() as f64)
    }
}
