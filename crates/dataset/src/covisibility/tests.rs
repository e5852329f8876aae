use super::*;
use crate::pair::Trajectory;
use crate::plan::{Campaign, Planner};
use crate::test_terrain::{cap, nested, wide};
use selenograph_geometry::{Body, Camera, Geodetic, Rigid3, Vector3, lookat, pixel};
use selenograph_raster::statistics::quantiles;
use selenograph_render::Interpolation;
use selenograph_terrain::Terrain;

/// Ground that ends B's ray this many pixels' ground before the point hides it.
const HIDDEN_GSDS: f64 = 20.0;

/// How well stored depth and poses agree with the terrain through the other view: a pixel of A is lifted by its depth,
/// projected into B, and B's ray there cast again; the distance, in pixels of A, between the pixel and the ground
/// that B's ray meets. Pixels that B does not see are left out.
///
/// Correct data leave the rounding of the stored depth; half a pixel in K, range taken for depth or a flipped pose leave
/// tenths of a pixel and more wherever the ground is not flat in the camera's frame.
pub(crate) fn warp_errors_px(
    tracer: &Tracer<'_>,
    a: &Viewpoint,
    depth_z: &[f32],
    b: &Viewpoint,
    stride: usize,
) -> Vec<f64> {
    let (width, stride) = (a.camera.width, stride.max(1));
    let pixels: Vec<usize> =
        (0..depth_z.len()).filter(|n| (n % width) % stride == 0 && (n / width) % stride == 0).collect();
    pixels
        .into_par_iter()
        .filter_map(|n| {
            let depth_z = f64::from(depth_z[n]);
            if !depth_z.is_finite() {
                return None;
            }
            let (x, y) = (n % width, n / width);
            let point = a.origin() + a.direction(x, y)? * depth_z;
            let at = b.project(&point)?;
            if !in_frame(&b.camera, Some(at)) {
                return None;
            }
            let ray = b.world_from_cam.vector(&b.camera.ray_z1(&at)?);
            let Hit::Surface(hit) = tracer.first_hit(b.origin(), ray, 0.0, f64::INFINITY) else {
                return None;
            };
            let back = a.project(&hit.point)?;
            // Hidden ground is no error; a fault of the data moves far less than the occluder stands away.
            let gsd = depth_z / a.camera.fx;
            if hit.t * ray.norm() < (point - b.origin()).norm() - HIDDEN_GSDS * gsd {
                return None;
            }
            Some((back - Point2::new(pixel::center_of(x), pixel::center_of(y))).norm())
        })
        .collect()
}

/// The two figures that a warp must keep, pixels: the median and the 99 % quantile.
const MEDIAN_PX: f64 = 0.002;
const P99_PX: f64 = 0.05;

fn pairs(trajectory: Trajectory, count: u64) -> Vec<[Viewpoint; 2]> {
    let mut campaign = Campaign::preset("paper-iccv2025").unwrap();
    campaign.nadir.pairs = 0;
    campaign.oblique.pairs = if trajectory == Trajectory::Oblique { count } else { 0 };
    campaign.dynamic.pairs = if trajectory == Trajectory::Dynamic { count } else { 0 };
    campaign.limits.max_coarse_share = 1.0;
    campaign.camera.width_px = 128;
    campaign.camera.height_px = 128;
    let tracer = Tracer::new(wide(), Interpolation::Bilinear);
    let plan = Planner::new(&campaign, &tracer).unwrap().plan(&|_| ());
    plan.rows.iter().map(|row| row.placed.as_ref().unwrap().views()).collect()
}

fn stored(truth: &Truth) -> Vec<f32> {
    truth.depth_z.iter().map(|z| *z as f32).collect()
}

fn figures(errors: Vec<f64>) -> [f64; 2] {
    quantiles(errors, [0.5, 0.99]).unwrap()
}

#[test]
fn warps_between_views_agree_and_faults_do_not() {
    let tracer = Tracer::new(wide(), Interpolation::Bilinear);
    for trajectory in [Trajectory::Oblique, Trajectory::Dynamic] {
        for [a, b] in pairs(trajectory, 4) {
            let truth = Truth::cast(&tracer, &a).unwrap();
            let depth_z = stored(&truth);
            let [median, p99] = figures(warp_errors_px(&tracer, &a, &depth_z, &b, 1));
            assert!(median < MEDIAN_PX && p99 < P99_PX, "{trajectory:?}: {median} {p99}");
            let fails = |a: &Viewpoint, depth_z: &[f32], b: &Viewpoint| {
                let errors = warp_errors_px(&tracer, a, depth_z, b, 1);
                errors.len() < 100 || {
                    let [median, p99] = figures(errors);
                    median >= MEDIAN_PX || p99 >= P99_PX
                }
            };
            // Half a pixel in the principal point of both.
            let moved = |view: &Viewpoint| Viewpoint {
                camera: Camera { cx: view.camera.cx - 0.5, cy: view.camera.cy - 0.5, ..view.camera.clone() },
                ..view.clone()
            };
            assert!(fails(&moved(&a), &depth_z, &moved(&b)), "{trajectory:?}: half a pixel");
            let range: Vec<f32> = truth.range.iter().map(|r| *r as f32).collect();
            assert!(fails(&a, &range, &b), "{trajectory:?}: range as depth");
            // Y and Z of the camera axes turned round: OpenGL's pose read as OpenCV's.
            let flip = Rigid3::new(
                selenograph_geometry::Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
                Point3::origin(),
            );
            let flipped = Viewpoint { world_from_cam: &a.world_from_cam * &flip, ..a.clone() };
            assert!(fails(&flipped, &depth_z, &b), "{trajectory:?}: flipped pose");
        }
    }
}

#[test]
fn identical_views_see_all_of_each_other() {
    let tracer = Tracer::new(nested(), Interpolation::Bilinear);
    let [a, _] = pairs(Trajectory::Oblique, 1).remove(0);
    let truth = Truth::cast(&tracer, &a).unwrap();
    let sights = correspondence(&tracer, &a, &truth, &a, 1);
    for (n, sight) in sights.iter().enumerate() {
        let Sight::Seen(at) = sight else { panic!("pixel {n}: {sight:?}") };
        let centre = Point2::new(pixel::center_of(n % 128), pixel::center_of(n / 128));
        assert!((at - centre).norm() < 1e-6, "{at}");
    }
    assert_eq!(overlap(&sights, &sights).a_seen_by_b, 1.0);
}

/// A wall of 1 km between two cameras: its far side is inside the other's frame, but hidden.
#[test]
fn ground_behind_a_ridge_is_in_frame_but_not_seen() {
    let ridge = |x: f64, _: f64| 1000.0 * (-(x / 300.0).powi(2)).exp();
    let terrain = Terrain::new(Body::moon(), vec![cap(50.0, 400, ridge)]).unwrap();
    let tracer = Tracer::new(&terrain, Interpolation::Bilinear);
    let body = Body::moon();
    let camera = Camera::from_fov(96, 96, 60f64.to_radians()).unwrap();
    let target = body.point(&Geodetic::from_deg(-90.0, 0.0, 0.0));
    let view = |x: f64| {
        // The map's x axis is the body's Y.
        let origin = target + Vector3::new(1.0, x, -3000.0);
        Viewpoint {
            camera: camera.clone(),
            world_from_cam: lookat::level(origin, &(target - origin), &-Vector3::z()).unwrap(),
        }
    };
    let (a, b) = (view(6000.0), view(-6000.0));
    let (truth_a, truth_b) = (Truth::cast(&tracer, &a).unwrap(), Truth::cast(&tracer, &b).unwrap());
    let there = correspondence(&tracer, &a, &truth_a, &b, 1);
    let back = correspondence(&tracer, &b, &truth_b, &a, 1);
    let record = overlap(&there, &back);
    assert!(record.a_in_b > record.a_seen_by_b + 0.05, "{record:?}");
    assert!((record.a_seen_by_b - record.b_seen_by_a).abs() < 0.05, "mirror images: {record:?}");
    // Depth maps tell the same, wherever the ground is well inside a pixel's reach.
    let (mut compared, mut hidden) = (0, 0);
    for (n, sight) in there.iter().enumerate() {
        let (Sight::Seen(at) | Sight::Hidden(at)) = sight else { continue };
        let point = truth_a.point(&a, n % 96, n / 96).unwrap();
        let (x, y) =
            (pixel::index_of(at.x).clamp(0, 95) as usize, pixel::index_of(at.y).clamp(0, 95) as usize);
        let Some(seen) = truth_b.point(&b, x, y) else { continue };
        let before = (point - b.origin()).norm() - (seen - b.origin()).norm();
        if before > 1000.0 {
            compared += 1;
            hidden += usize::from(matches!(sight, Sight::Hidden(_)));
        }
    }
    // The depth map answers for its pixel's centre, which at the crest's outline may see other ground than the point's ray.
    assert!(compared > 100 && hidden * 20 > compared * 19, "{hidden} of {compared}");
    let [u, v, seen] = pixel_maps(&there);
    assert!(u.iter().zip(&v).all(|(u, v)| u.is_nan() == v.is_nan()));
    assert!(seen.iter().zip(&u).all(|(s, u)| *s == 0.0 || u.is_finite()));
}
