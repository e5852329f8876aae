//! The ground as heights over a plane: the grid whose cells are the unknowns.

use super::Picture;
use crate::grid::plane::Plane;
use selenograph_geometry::{Point2, Vector3};

/// Cells of a regular grid on a plane, and the lines along which their ground lies higher or lower: towards the first picture's
/// camera. A line of sight keeps showing the same detail when the ground along it moves; over a vertical it would pass on to its
/// neighbour, and a surface that is wrong by some cells could not be mended by a linear step.
///
/// A *position* is counted from the grid's corner along columns, along rows, and along the plane's normal, in cells. A *place* is
/// the column and the row of the line that a position lies on, with the same height.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Corner of the first cell, in the scene's frame.
    pub corner: Vector3<f64>,
    /// Unit vectors along columns, along rows, and towards the cameras (left-handed, as rows run downwards).
    pub axes: [Vector3<f64>; 3],
    /// Side of a cell, in the scene's unit.
    pub cell: f64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Where the lines meet.
    pub(super) sight: Sight,
}

/// Lines towards a point `(x, y, z)` over the grid, as `x/z`, `y/z` and `1/z`; all 0 for verticals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sight {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) inverse: f32,
}

impl Sight {
    fn towards(eye: [f64; 3]) -> Self {
        Self { x: (eye[0] / eye[2]) as f32, y: (eye[1] / eye[2]) as f32, inverse: (1.0 / eye[2]) as f32 }
    }

    /// How a position moves for a cell of height on the line of a column and row.
    #[inline]
    pub(super) fn line(&self, x: f32, y: f32) -> [f32; 3] {
        [self.x - self.inverse * x, self.y - self.inverse * y, 1.0]
    }

    /// What distances across the lines shrink to at a height.
    #[inline]
    pub(super) fn narrowing(&self, height: f32) -> f32 {
        1.0 - self.inverse * height
    }

    /// The position of a place.
    #[inline]
    pub(super) fn position(&self, place: [f32; 3]) -> [f32; 3] {
        let narrow = self.narrowing(place[2]);
        [place[0] * narrow + self.x * place[2], place[1] * narrow + self.y * place[2], place[2]]
    }

    /// The place of a position.
    #[inline]
    pub(super) fn place(&self, position: [f32; 3]) -> [f32; 3] {
        let wide = 1.0 / self.narrowing(position[2]);
        let [x, y, h] = position;
        [(x - self.x * h) * wide, (y - self.y * h) * wide, h]
    }
}

/// Least cosine of the emission angle of ground that the grid reaches out to.
const LEAST_COSINE: f64 = 0.17;
/// Samples of a picture along each side.
const SAMPLES: usize = 17;
/// Ground around the pictures' footprints on the plane, as a share of their extent: relief moves what they see.
const MARGIN: f64 = 0.02;

impl Patch {
    /// The grid over everything that any picture sees of the plane, with cells of the sharpest picture's pixels but no smaller than
    /// `least_cell`, and columns and rows in multiples of `multiple`. Also how many pixels of each picture's own lie along a cell. `None` where no picture sees
    /// the plane, or two of its sides are not finite.
    pub(super) fn cover(
        plane: &Plane,
        pictures: &[Picture<'_>],
        least_cell: f64,
        max_cells: usize,
        multiple: usize,
    ) -> Option<(Self, Vec<f64>)> {
        let first = pictures.first()?;
        let along = first.cam_from_scene.inverse().vector(&Vector3::x());
        let normal = plane.normal;
        let u = (along - normal * along.dot(&normal)).try_normalize(1e-9)?;
        let v = u.cross(&normal);
        let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let mut footprints = Vec::with_capacity(pictures.len());
        for picture in pictures {
            let seen = seen(picture, plane);
            for (point, _) in &seen {
                let d = point - plane.center;
                let (x, y) = (d.dot(&u), d.dot(&v));
                bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x), bounds[3].max(y)];
            }
            let sizes = seen.iter().map(|(_, size)| *size);
            footprints.push(selenograph_raster::statistics::median(sizes)?);
        }
        let margin = MARGIN * (bounds[2] - bounds[0]).max(bounds[3] - bounds[1]);
        let (wide, high) = (bounds[2] - bounds[0] + 2.0 * margin, bounds[3] - bounds[1] + 2.0 * margin);
        let least = (wide * high / max_cells as f64).sqrt().max(least_cell);
        let cell = footprints.iter().copied().fold(f64::INFINITY, f64::min).max(least);
        let count = |extent: f64| {
            let least = ((extent / cell).ceil() as usize).div_ceil(multiple);
            multiple * (least..2 * least.max(1)).find(|&n| is_smooth(n)).unwrap_or(least)
        };
        let (width, height) = (count(wide), count(high));
        let middle = plane.center + u * (0.5 * (bounds[0] + bounds[2])) + v * (0.5 * (bounds[1] + bounds[3]));
        let corner = middle - u * (0.5 * cell * width as f64) - v * (0.5 * cell * height as f64);
        let finite = corner.iter().all(|c| c.is_finite()) && cell > 0.0;
        let pixels = footprints.iter().map(|size| cell / size).collect();
        let vertical = Sight { x: 0.0, y: 0.0, inverse: 0.0 };
        let mut patch = Self { corner, axes: [u, v, normal], cell, width, height, sight: vertical };
        let eye = patch.position(&first.cam_from_scene.inverse().origin().coords);
        patch.sight = Sight::towards(eye);
        finite.then_some((patch, pixels))
    }

    /// Components of a direction along the grid's axes.
    pub(super) fn direction(&self, direction: &Vector3<f64>) -> [f64; 3] {
        self.axes.map(|axis| axis.dot(direction))
    }

    /// The direction with these components along the grid's axes.
    pub(super) fn vector(&self, components: [f32; 3]) -> Vector3<f64> {
        let [u, v, n] = self.axes;
        u * f64::from(components[0]) + v * f64::from(components[1]) + n * f64::from(components[2])
    }

    /// The position of a point of the scene.
    pub fn position(&self, point: &Vector3<f64>) -> [f64; 3] {
        self.direction(&(point - self.corner)).map(|length| length / self.cell)
    }

    /// The point of the scene at a place.
    pub fn point_of(&self, place: [f32; 3]) -> Vector3<f64> {
        self.point(self.sight.position(place).map(f64::from))
    }

    /// Column and row, in cells, of the line that a point of the scene lies on, and its height there.
    pub fn place(&self, point: &Vector3<f64>) -> [f32; 3] {
        self.sight.place(self.position(point).map(|c| c as f32))
    }

    /// The point of the scene at a position.
    pub fn point(&self, position: [f64; 3]) -> Vector3<f64> {
        let [u, v, n] = self.axes;
        self.corner + (u * position[0] + v * position[1] + n * position[2]) * self.cell
    }
}

/// Whether a number has no prime factors above 5: transforms of such lengths are several times faster.
fn is_smooth(number: usize) -> bool {
    let without = |mut n: usize, prime: usize| {
        while n > 0 && n.is_multiple_of(prime) {
            n /= prime;
        }
        n
    };
    [2, 3, 5].into_iter().fold(number, without) == 1
}

/// Points of the plane that a picture sees, with the side of a square of a pixel's area there.
fn seen(picture: &Picture<'_>, plane: &Plane) -> Vec<(Vector3<f64>, f64)> {
    let scene_from_cam = picture.cam_from_scene.inverse();
    let center = scene_from_cam.origin().coords;
    let camera = &picture.view.camera;
    let mut out = Vec::new();
    for j in 0..SAMPLES {
        for i in 0..SAMPLES {
            let share = |k: usize, size: usize| k as f64 / (SAMPLES - 1) as f64 * size as f64;
            let at = Point2::new(share(i, camera.width), share(j, camera.height));
            let Some(ray) = camera.ray_z1(&at) else { continue };
            let direction = scene_from_cam.vector(&ray);
            let approach = -direction.dot(&plane.normal);
            let depth_z = (center - plane.center).dot(&plane.normal) / approach;
            let cosine = approach / ray.norm();
            if depth_z > 0.0 && cosine >= LEAST_COSINE {
                // A pixel's solid angle is cos³θ / f², its ground that times range² over the cosine of emission.
                let area = depth_z * depth_z / (ray.norm() * camera.fx * camera.fy * cosine);
                out.push((center + direction * depth_z, area.sqrt()));
            }
        }
    }
    out
}
