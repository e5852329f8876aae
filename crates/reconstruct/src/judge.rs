//! What a known motion says of matches.

use crate::relative_pose::JudgedMatch;
use selenograph_geometry::{CamA, CamB, Camera, Matrix3, Point2, Rigid3, Vector3, mean_focal_px};
use selenograph_pose::decompose::Motion;
use selenograph_pose::{cheirality, sampson};

/// Poses from navigation are off by pixels: matches are judged by this many pixels, in place of the threshold of an estimate.
pub(crate) const GIVEN_TOLERANCE_PX: f64 = 3.0;

/// Whether matches agree with a motion.
pub(crate) struct Judge<'a> {
    motion: Motion,
    essential: Matrix3<f64>,
    cameras: [&'a Camera; 2],
    focal_px: f64,
    tolerance_px: f64,
}

impl<'a> Judge<'a> {
    pub fn new(cam_b_from_cam_a: &Rigid3<CamB, CamA>, cameras: [&'a Camera; 2], tolerance_px: f64) -> Self {
        let translation = cam_b_from_cam_a.origin().coords;
        let motion = Motion {
            rotation: cam_b_from_cam_a.rotation(),
            translation: translation.try_normalize(0.0).unwrap_or(translation),
        };
        let focal_px = mean_focal_px(cameras);
        Self { motion, essential: motion.essential(), cameras, focal_px, tolerance_px }
    }

    fn rays(&self, a: &Point2<f64>, b: &Point2<f64>) -> Option<[Vector3<f64>; 2]> {
        Some([self.cameras[0].ray_z1(a)?, self.cameras[1].ray_z1(b)?])
    }

    fn residual_px(&self, a: &Point2<f64>, b: &Point2<f64>) -> f64 {
        self.rays(a, b).map_or(f64::NAN, |[a, b]| sampson::distance(&self.essential, &a, &b) * self.focal_px)
    }

    /// Whether it lies within the tolerance of its epipolar line and in front of both cameras.
    pub fn agrees(&self, a: &Point2<f64>, b: &Point2<f64>) -> bool {
        self.rays(a, b).is_some_and(|[ray_a, ray_b]| {
            self.residual_px(a, b).abs() < self.tolerance_px
                && cheirality::in_front(&self.motion, &ray_a, &ray_b)
        })
    }

    /// A match with what the motion leaves of it.
    pub fn judged(&self, a: Point2<f64>, b: Point2<f64>, sigma_px: Option<f64>) -> JudgedMatch {
        JudgedMatch { a, b, residual_px: self.residual_px(&a, &b), sigma_px, inlier: self.agrees(&a, &b) }
    }
}
