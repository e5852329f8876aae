//! The pose from which a pointmap looks as the other picture has it.

use super::arrays::Pointmap;
use super::options::LearnedOptions;
use crate::evidence::PoseSource;
use selenograph_geometry::{CamA, CamB, Camera, Point2, Point3, Rigid3, mean_focal_px, pixel};
use selenograph_pose::absolute::{self, AbsoluteOptions, CannotLocate, Sighting};
use selenograph_pose::relative::CannotSay;
use selenograph_raster::statistics;

/// Points that take part at most, spread over the picture: neighbours are alike.
const MAX_SIGHTINGS: usize = 4000;
/// Points that agree, as a share of those that take part, below which a pose is the network's imagination.
const MIN_SHARE: f64 = 0.5;
/// A camera that moved by less than so many times what the points are off has not moved for sure.
const PARALLAX_TO_RESIDUAL: f64 = 3.0;

/// What is said where there are no sure points.
pub(super) const NONE: CannotSay = CannotSay::TooFewMatches { found: 0, needed: 5 };

/// A pose in the unit of the points.
#[derive(Debug, Clone)]
pub(super) struct Located {
    pub cam_b_from_cam_a: Rigid3<CamB, CamA>,
    agreeing: usize,
    sightings: usize,
    residual_px: f64,
}

impl Located {
    pub fn source(&self) -> PoseSource {
        PoseSource::Points { agreeing: self.agreeing, points: self.sightings, residual_px: self.residual_px }
    }
}

/// The pose of camera B from B's points and the pixels they stand at; `match_px` is the side of a matched pixel.
pub(super) fn locate(
    of_b: &Pointmap,
    camera: &Camera,
    match_px: f64,
    options: &LearnedOptions,
) -> Result<Located, CannotSay> {
    let (width, height) = (of_b.points.width, of_b.points.height);
    let step = ((width * height) as f64 / MAX_SIGHTINGS as f64).sqrt().ceil().max(1.0) as usize;
    let mut sightings = Vec::new();
    for y in (step / 2..height).step_by(step) {
        for x in (step / 2..width).step_by(step) {
            let ray = camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y)));
            let Some(ray) = ray.filter(|_| of_b.confidence[(x, y)] >= options.min_confidence) else {
                continue;
            };
            let world = Point3::from(of_b.points[(x, y)].map(f64::from));
            sightings.push(Sighting { world, image: Point2::new(ray.x, ray.y) });
        }
    }
    let focal_px = mean_focal_px([camera, camera]);
    let settings = AbsoluteOptions {
        threshold: options.reprojection_px * match_px / focal_px,
        seed: options.seed,
        ..AbsoluteOptions::default()
    };
    let found = absolute::estimate::<CamA>(&sightings, &settings).map_err(|why| match why {
        CannotLocate::TooFewPoints { found, needed } => CannotSay::TooFewMatches { found, needed },
        CannotLocate::NoConsensus { inliers, points } => CannotSay::NoConsensus { inliers, matches: points },
        _ => NONE,
    })?;
    let agreeing = found.inliers.iter().filter(|inlier| **inlier).count();
    if (agreeing as f64) < MIN_SHARE * sightings.len() as f64 {
        return Err(CannotSay::NoConsensus { inliers: agreeing, matches: sightings.len() });
    }
    let cam_b_from_cam_a: Rigid3<CamB, CamA> = found.cam_from_world.relabel();
    let ranges = sightings.iter().map(|s| s.world.coords.norm());
    let range = statistics::median(ranges).unwrap_or(f64::INFINITY);
    let moved = cam_b_from_cam_a.origin().coords.norm() / range;
    if moved < PARALLAX_TO_RESIDUAL * found.residual_rms.max(1.0 / focal_px) {
        return Err(CannotSay::NoParallax {
            rotation_deg: cam_b_from_cam_a.rotation_angle_rad().to_degrees(),
            cam_b_from_cam_a: turn(&cam_b_from_cam_a),
            residual: found.residual_rms,
        });
    }
    Ok(Located {
        cam_b_from_cam_a,
        agreeing,
        sightings: sightings.len(),
        residual_px: found.residual_rms * focal_px,
    })
}

fn turn(pose: &Rigid3<CamB, CamA>) -> selenograph_geometry::UnitQuaternion<f64> {
    let [w, x, y, z] = pose.quaternion_wxyz();
    selenograph_geometry::UnitQuaternion::from_quaternion(selenograph_geometry::Quaternion::new(w, x, y, z))
}
