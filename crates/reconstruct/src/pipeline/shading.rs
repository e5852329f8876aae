//! Shading on top of stereo, or in its place where two Suns leave nothing to match.

mod guards;

use super::given::Start;
use crate::evidence::{PoseSource, Warning};
use crate::grid::plane;
use crate::priors::Priors;
use crate::shading::{self, Picture, PoseSigma, Shaded, ShadingOptions};
use crate::{PredictedView, View, triangulate};
use guards::Measured;
use selenograph_geometry::{Point2, Rigid3, Vector3};

/// How much surer a pose from matches looks than it is: its sigma knows nothing of matches that err together.
const POSE_DOUBT: f64 = 3.0;
/// Correlation of a picture with its model below which the model is not believed.
const MIN_CORRELATION: f64 = 0.9;

/// Names of the pictures in messages.
const PICTURES: [&str; 2] = ["A", "B"];

/// Less light than this in a picture is said.
const GOOD_LIT_SHARE: f64 = 0.45;
/// Spread of the log albedo above which it is said: wrong Suns, another law and changed ground are explained by albedo, and the pictures
/// correlate with their models all the same.
const GOOD_ALBEDO: f64 = 0.07;

/// One surface from both pictures, and what must be said beside it; `dense` is stereo's answer, where there is one.
pub(super) fn shaded(
    views: [&View; 2],
    start: &Start,
    dense: Option<&[PredictedView; 2]>,
    priors: &Priors,
    options: &ShadingOptions,
) -> Result<(Shaded, Vec<Warning>), Warning> {
    let pose = &start.cam_b_from_cam_a;
    let sun = |k: usize| priors.suns[k].ok_or(Warning::NoSun { picture: PICTURES[k] });
    let (sun_a, sun_b) = (sun(0)?, sun(1)?);
    let no_shading = |why: String| Warning::NoShading { why };
    let matched = match dense {
        Some(_) => None,
        None => Some(triangulate::matched([&views[0].camera, &views[1].camera], pose, &start.matches)),
    };
    let points = dense.or(matched.as_ref()).into_iter().flat_map(|[a, _]| &a.points.data);
    let cloud: Vec<Vector3<f64>> =
        points.filter(|p| p.iter().all(|c| c.is_finite())).map(|p| Vector3::from(p.map(f64::from))).collect();
    let plane = plane::fit(&cloud, &Vector3::zeros()).map_err(|error| no_shading(error.to_string()))?;
    let pose_sigma = match &start.source {
        PoseSource::Estimated(pose) => {
            let mean = |from: usize, count: usize| {
                let variances = (from..from + count).map(|i| pose.covariance[(i, i)]);
                POSE_DOUBT * (variances.sum::<f64>() / count as f64).sqrt()
            };
            Some(PoseSigma { turn_rad: mean(0, 3), direction_rad: mean(3, 2) })
        }
        _ => priors.pose_sigma,
    };
    let pictures = [
        Picture {
            view: views[0],
            cam_from_scene: Rigid3::identity(),
            pose_sigma: None,
            sun: sun_a.direction,
            sun_sigma_rad: sun_a.sigma_rad,
        },
        Picture {
            view: views[1],
            cam_from_scene: pose.relabel(),
            pose_sigma: pose_sigma.filter(|s| s.turn_rad > 0.0 && s.direction_rad > 0.0),
            sun: sun_b.in_cam_a(&pose.inverse()),
            sun_sigma_rad: sun_b.sigma_rad,
        },
    ];
    for (picture, lit) in PICTURES.into_iter().zip(&pictures) {
        let elevation_deg = lit.sun.dot(&plane.normal).clamp(-1.0, 1.0).asin().to_degrees();
        if elevation_deg.is_nan() || elevation_deg <= 0.0 {
            return Err(Warning::SunBelow { picture, elevation_deg });
        }
    }
    let begun = shading::Start { plane, views: dense, ground: None, least_cell: 0.0 };
    let shaded = shading::shade(&pictures, &begun, options).map_err(|error| no_shading(error.to_string()))?;
    let surface = shaded.view(0, views[0]);
    let mut measured = Measured::new(&shaded);
    let before = |at: &Point2<f64>| match dense {
        Some([a, _]) => guards::point_at(a, at),
        None => guards::on_plane(&plane, &views[0].camera, at),
    };
    measured.misfit = guards::misfit(
        &start.matches,
        [&|at| guards::point_at(&surface, at), &before],
        &views[1].camera,
        [&shaded.pictures[1].cam_from_scene.relabel(), pose],
    );
    for (picture, explained) in PICTURES.into_iter().zip(&shaded.pictures) {
        let correlation = explained.correlation;
        if correlation.is_nan() || correlation < MIN_CORRELATION {
            return Err(Warning::NotExplained { picture, correlation });
        }
    }
    if let Some(misfit) = measured.misfit.filter(|m| dense.is_none() && m.contradicts()) {
        return Err(Warning::MatchesContradict { misfit_px: misfit.along_px, noise_px: misfit.noise_px() });
    }
    let little = PICTURES.into_iter().zip(&shaded.pictures).filter(|(_, p)| p.lit_share < GOOD_LIT_SHARE);
    let mut doubts: Vec<Warning> =
        little.map(|(picture, p)| Warning::LittleLit { picture, share: p.lit_share }).collect();
    if measured.albedo > GOOD_ALBEDO {
        doubts.push(Warning::MuchAlbedo { spread: measured.albedo });
    }
    Ok((shaded, doubts))
}
