//! Refinement of a camera's pose on its reprojection errors.

use super::{Sighting, squared_error};
use crate::decompose::nearest_rotation;
use crate::solvers::p3p::CameraPose;
use selenograph_geometry::{Rotation3, SMatrix, SVector, Vector3};

/// Reprojection error and its derivatives by a rotation vector applied in the camera and by the translation.
fn residual(pose: &CameraPose, sighting: &Sighting) -> (SVector<f64, 2>, SMatrix<f64, 2, 6>) {
    let turned = pose.rotation * sighting.world.coords;
    let p = turned + pose.translation;
    let (u, v) = (p.x / p.z, p.y / p.z);
    let projection = SMatrix::<f64, 2, 3>::new(1.0, 0.0, -u, 0.0, 1.0, -v) / p.z;
    let mut jacobian = SMatrix::<f64, 2, 6>::zeros();
    jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(&(-projection * turned.cross_matrix()));
    jacobian.fixed_view_mut::<2, 3>(0, 3).copy_from(&projection);
    (SVector::<f64, 2>::new(u - sighting.image.x, v - sighting.image.y), jacobian)
}

/// `Σ Jᵀ J` and `Σ ‖r‖²` over the sightings whose squared error is below the limit.
pub fn linearised(sightings: &[Sighting], pose: &CameraPose, limit: f64) -> (SMatrix<f64, 6, 6>, f64) {
    let mut information = SMatrix::zeros();
    let mut squares = 0.0;
    for sighting in sightings {
        if squared_error(pose, sighting) < limit {
            let (r, j) = residual(pose, sighting);
            information += j.transpose() * j;
            squares += r.norm_squared();
        }
    }
    (information, squares)
}

fn cost(sightings: &[Sighting], pose: &CameraPose, limit: f64) -> f64 {
    sightings.iter().map(|s| squared_error(pose, s).min(limit)).sum()
}

/// Levenberg-Marquardt on `Σ min(‖r‖², limit)`: the inliers are chosen anew at each step.
pub fn refine(sightings: &[Sighting], start: &CameraPose, limit: f64, max_steps: usize) -> CameraPose {
    let mut pose = *start;
    let mut current = cost(sightings, &pose, limit);
    let mut damping = 1e-4;
    for _ in 0..max_steps {
        let mut information = SMatrix::<f64, 6, 6>::zeros();
        let mut gradient = SVector::<f64, 6>::zeros();
        for sighting in sightings {
            if squared_error(&pose, sighting) < limit {
                let (r, j) = residual(&pose, sighting);
                information += j.transpose() * j;
                gradient += j.transpose() * r;
            }
        }
        for i in 0..6 {
            information[(i, i)] *= 1.0 + damping;
        }
        let Some(cholesky) = information.cholesky() else { break };
        let step = -cholesky.solve(&gradient);
        let turn = Rotation3::new(Vector3::new(step[0], step[1], step[2]));
        let candidate = CameraPose {
            rotation: turn.matrix() * pose.rotation,
            translation: pose.translation + Vector3::new(step[3], step[4], step[5]),
        };
        let next = cost(sightings, &candidate, limit);
        if next < current {
            let gain = current - next;
            (pose, current) = (candidate, next);
            damping = (damping * 0.1).max(1e-12);
            if gain < 1e-10 * current {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    pose.rotation = nearest_rotation(&pose.rotation);
    pose
}
