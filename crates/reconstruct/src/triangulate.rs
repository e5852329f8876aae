//! Points from pairs of rays with a known motion between the cameras.

use crate::relative_pose::JudgedMatch;
use crate::{Fill, PredictedView};
use selenograph_geometry::{CamA, CamB, Camera, Frame, Point2, Rigid3, Vector3, pixel};
use selenograph_pose::decompose::Motion;
use selenograph_pose::triangulate::optimal;
use selenograph_raster::Raster;

/// A point on a ray, with what the other camera says of it. Image lengths are on the plane `z = 1` of the other camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnRay {
    /// Inverse z-depth in the camera that the ray belongs to, in the inverse unit of the motion's translation.
    pub rho: f64,
    /// How far the point's image in the other camera moves for a unit of `rho`.
    pub image_per_rho: f64,
    /// Distance of the other camera's ray from the epipolar line: what no point on the ray explains.
    pub miss: f64,
}

/// Newton steps after the linear start: the image distance is nearly linear in inverse depth.
const STEPS: usize = 3;

/// The point on `ray` (with `z = 1`) whose image in the other camera is nearest to `seen` (its ray, with `z = 1`); `None` if the
/// two do not meet in front of both cameras, or nothing fixes where.
///
/// # Source
/// Lindstrom 2010, "Triangulation made easy", CVPR, treats both images alike; here one of them is a pixel's own ray and exact.
pub fn along_ray<To: Frame, From: Frame>(
    ray: &Vector3<f64>,
    seen: &Vector3<f64>,
    to_from: &Rigid3<To, From>,
) -> Option<OnRay> {
    let (turned, t) = (to_from.vector(ray), to_from.origin().coords);
    // (turned + t ρ) × seen = 0 first, then the distance in the image as it is.
    let (constant, linear) = (turned.cross(seen), t.cross(seen));
    let mut rho = -constant.dot(&linear) / linear.norm_squared();
    let image = |rho: f64| {
        let x = turned + t * rho;
        let (u, v) = (x.x / x.z, x.y / x.z);
        (x.z, u, v, (t.x - u * t.z) / x.z, (t.y - v * t.z) / x.z)
    };
    for _ in 0..STEPS {
        let (_, u, v, du, dv) = image(rho);
        rho -= ((u - seen.x) * du + (v - seen.y) * dv) / (du * du + dv * dv);
    }
    let (z, u, v, du, dv) = image(rho);
    let found = OnRay { rho, image_per_rho: du.hypot(dv), miss: (u - seen.x).hypot(v - seen.y) };
    (rho.is_finite() && rho > 0.0 && z > 0.0).then_some(found)
}

/// Matches that agree with a pose, triangulated; each stands at the pixel that holds it, in both views. In the pose's unit.
///
/// The sigma of a point is that of its match (`sigma_px`, the residual where there is none) along its ray.
pub fn matched(
    cameras: [&Camera; 2],
    cam_b_from_cam_a: &Rigid3<CamB, CamA>,
    matches: &[JudgedMatch],
) -> [PredictedView; 2] {
    let motion =
        Motion { rotation: cam_b_from_cam_a.rotation(), translation: cam_b_from_cam_a.origin().coords };
    let mut views = cameras.map(empty);
    for m in matches.iter().filter(|m| m.inlier) {
        let (Some(ray_a), Some(ray_b)) = (cameras[0].ray_z1(&m.a), cameras[1].ray_z1(&m.b)) else { continue };
        let Some(found) = optimal(&motion, &ray_a, &ray_b) else { continue };
        let x_in_a = found.x_in_a.coords;
        let in_front = x_in_a.z > 0.0 && (motion.rotation * x_in_a + motion.translation).z > 0.0;
        if !in_front {
            continue;
        }
        // Along the ray an error across it grows by one over the parallax.
        let error_rad = m.sigma_px.unwrap_or(m.residual_px.abs()) / (cameras[0].fx * cameras[0].fy).sqrt();
        let sigma = x_in_a.norm() * error_rad / found.parallax_rad.sin();
        put(&mut views[0], &m.a, &x_in_a, sigma);
        put(&mut views[1], &m.b, &x_in_a, sigma);
    }
    views
}

fn empty(camera: &Camera) -> PredictedView {
    let (width, height) = (camera.width, camera.height);
    PredictedView {
        points: Raster::filled(width, height, [f32::NAN; 3]),
        confidence: Raster::filled(width, height, 0.0),
        sigma: Some(Raster::filled(width, height, f32::NAN)),
        fill: Raster::filled(width, height, Fill::Absent),
    }
}

fn put(view: &mut PredictedView, at: &Point2<f64>, point: &Vector3<f64>, sigma: f64) {
    let inside = |coordinate: f64, size: usize| {
        usize::try_from(pixel::index_of(coordinate)).ok().filter(|index| *index < size)
    };
    let (Some(x), Some(y)) = (inside(at.x, view.points.width), inside(at.y, view.points.height)) else {
        return;
    };
    view.points[(x, y)] = [point.x as f32, point.y as f32, point.z as f32];
    view.confidence[(x, y)] = 1.0;
    view.fill[(x, y)] = Fill::Measured;
    if let Some(sigmas) = &mut view.sigma {
        sigmas[(x, y)] = sigma as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::{Point3, Rotation3};

    fn motion() -> Rigid3<CamB, CamA> {
        Rigid3::new(Rotation3::from_euler_angles(0.05, -0.1, 2.0), Point3::new(0.3, -0.4, 0.2))
    }

    #[test]
    fn the_point_that_made_the_rays_is_found_with_its_derivative() {
        let b_from_a = motion();
        let ray = Vector3::new(0.2, -0.1, 1.0);
        let seen_of = |z: f64| {
            let x = b_from_a.point(&Point3::from(ray * z)).coords;
            x / x.z
        };
        let found = along_ray(&ray, &seen_of(7.0), &b_from_a).unwrap();
        assert!((1.0 / found.rho - 7.0).abs() < 1e-9 && found.miss < 1e-12);
        let step = 1e-4;
        let moved = (seen_of(7.0 + step) - seen_of(7.0)).norm();
        let moved_z = moved / (found.image_per_rho * found.rho * found.rho);
        assert!((moved_z / step - 1.0).abs() < 1e-3);
    }

    #[test]
    fn rays_that_part_or_have_no_baseline_give_nothing() {
        let b_from_a = motion();
        let ray = Vector3::new(0.2, -0.1, 1.0);
        let behind = b_from_a.point(&Point3::from(ray * -3.0)).coords;
        assert!(along_ray(&ray, &(behind / behind.z), &b_from_a).is_none());
        let turn = Rigid3::<CamB, CamA>::new(Rotation3::from_euler_angles(0.1, 0.0, 0.0), Point3::origin());
        assert!(along_ray(&ray, &Vector3::new(0.1, 0.1, 1.0), &turn).is_none());
    }
}
