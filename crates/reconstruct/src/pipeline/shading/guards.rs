//! What speaks against a surface from shading: it is measured here, and judged beside.

use crate::grid::plane::Plane;
use crate::prediction::PredictedView;
use crate::relative_pose::JudgedMatch;
use crate::shading::Shaded;
use crate::stereo::estimate::bilinear;
use selenograph_geometry::{Camera, Point2, Rigid3, Vector3};
use selenograph_raster::Raster;
use selenograph_raster::statistics::median;

/// What the pictures and the matches say of a surface.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    /// Standard deviation of the log albedo where two pictures show the ground.
    pub(super) albedo: f64,
    /// How far the surface puts the matches from where they are.
    pub(super) misfit: Option<Misfit>,
}

/// Medians over the matches, pixels of B.
#[derive(Debug, Clone, Copy)]
pub(super) struct Misfit {
    /// Along the epipolar line: what a wrong height does.
    pub(super) along_px: f64,
    /// Across it: what is left to the matches' own errors, and the pose's.
    pub(super) across_px: f64,
    /// Along it for the surface that there was before.
    pub(super) before_px: f64,
}

impl Misfit {
    /// What the matches' own errors come to.
    pub(super) fn noise_px(&self) -> f64 {
        self.across_px.max(self.before_px)
    }

    /// Whether the matches stand clearly farther off than they did before and than they do across.
    pub(super) fn contradicts(&self) -> bool {
        self.along_px > CONTRADICTION * self.noise_px()
    }
}

/// Good surfaces stay below 1.
const CONTRADICTION: f64 = 2.0;

impl Measured {
    pub(super) fn new(shaded: &Shaded) -> Self {
        let (mut count, mut sum, mut squares) = (0.0f64, 0.0, 0.0);
        for (albedo, _) in shaded.log_albedo.data.iter().zip(&shaded.num_seen.data).filter(|(_, n)| **n > 1) {
            let albedo = f64::from(*albedo);
            (count, sum, squares) = (count + 1.0, sum + albedo, squares + albedo * albedo);
        }
        let mean = sum / count;
        Self { albedo: (squares / count - mean * mean).max(0.0).sqrt(), misfit: None }
    }
}

/// The point that a ray of a picture meets.
type Ground<'a> = &'a dyn Fn(&Point2<f64>) -> Option<Vector3<f64>>;

/// Where a surface and a pose put the matches; `before` tells the ground that a ray of A met before. `None` where fewer than
/// [`MIN_MATCHES`] lie on the surface.
pub(super) fn misfit(
    matches: &[JudgedMatch],
    [surface, before]: [Ground<'_>; 2],
    camera_b: &Camera,
    [found, begun]: [&Rigid3<selenograph_geometry::CamB, selenograph_geometry::CamA>; 2],
) -> Option<Misfit> {
    let mut misses = [Vec::new(), Vec::new(), Vec::new()];
    for m in matches.iter().filter(|m| m.inlier) {
        let off = |point: Vector3<f64>, pose: &Rigid3<_, _>| {
            let at = |factor: f64| camera_b.project(&pose.point(&(point * factor).into()));
            let (here, there) = (at(1.0)?, at(1.0 + 1e-4)?);
            let along = (there - here).try_normalize(1e-12)?;
            let miss = m.b - here;
            Some((miss.dot(&along), miss.x * along.y - miss.y * along.x))
        };
        let pair = surface(&m.a).and_then(|p| off(p, found)).zip(before(&m.a).and_then(|p| off(p, begun)));
        if let Some(((along, across), (first, _))) = pair {
            misses[0].push(along.abs());
            misses[1].push(across.abs());
            misses[2].push(first.abs());
        }
    }
    let enough = misses[0].len() >= MIN_MATCHES;
    let [along_px, across_px, before_px] = misses.map(|m| median(m).unwrap_or(f64::NAN));
    enough.then_some(Misfit { along_px, across_px, before_px })
}

/// Fewer say nothing about a surface.
const MIN_MATCHES: usize = 12;

/// The point that a view has at a place; `None` at its gaps.
pub(super) fn point_at(view: &PredictedView, at: &Point2<f64>) -> Option<Vector3<f64>> {
    let (x, y) = ((at.x - 0.5) as f32, (at.y - 0.5) as f32);
    // Only the four around are looked at: cut them out, that the whole picture is not copied for each match.
    let (left, top) = (x.floor().max(0.0) as usize, y.floor().max(0.0) as usize);
    if left + 1 >= view.points.width || top + 1 >= view.points.height {
        return None;
    }
    let cut = |k: usize| Raster::from_fn(2, 2, |i, j| view.points[(left + i, top + j)][k]);
    let [px, py, pz] = [0, 1, 2].map(|k| bilinear(&cut(k), x - left as f32, y - top as f32));
    let point = Vector3::new(f64::from(px?), f64::from(py?), f64::from(pz?));
    point.iter().all(|c| c.is_finite()).then_some(point)
}

/// Where the ray of a pixel of A meets a plane.
pub(super) fn on_plane(plane: &Plane, camera: &Camera, at: &Point2<f64>) -> Option<Vector3<f64>> {
    let ray = camera.ray_z1(at)?;
    let depth_z = plane.center.dot(&plane.normal) / ray.dot(&plane.normal);
    (depth_z > 0.0 && depth_z.is_finite()).then_some(ray * depth_z)
}
