//! From a prediction's own unit of length to metres, and to a place on the body where that is known.
//!
//! Two pictures alone give shape without size. A [`ScaleSource`] gives the size; without one the result keeps the
//! baseline as its unit and says `metric: false`.

pub mod altitude;
pub mod dem;
pub mod points;

use crate::Error;
use crate::prediction::Prediction;
use selenograph_geometry::{Body, BodyFixed, CamA, Enu, PredA, Rigid3, Sim3, Vector3};
use serde::Serialize;

/// What is known of the world around camera A.
#[derive(Debug, Clone, Default)]
pub enum World {
    /// Nothing: only the surface itself says where up may be.
    #[default]
    Unknown,
    /// A Cartesian frame whose Z points up along the local vertical, in metres.
    Level(Rigid3<Enu, CamA>),
    /// Where camera A stands on a body, metres.
    Body {
        /// The body.
        body: Body,
        /// The pose of camera A.
        body_from_cam_a: Rigid3<BodyFixed, CamA>,
    },
}

impl World {
    /// The local vertical in the axes of camera A, where it is known.
    pub fn up_in_cam_a(&self) -> Option<Vector3<f64>> {
        match self {
            Self::Unknown => None,
            Self::Level(level_from_cam_a) => Some(level_from_cam_a.inverse().vector(&Vector3::z())),
            Self::Body { body_from_cam_a, .. } => {
                let up = body_from_cam_a.origin().coords.try_normalize(0.0)?;
                Some(body_from_cam_a.inverse().vector(&up))
            }
        }
    }
}

/// Where the size of a prediction comes from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum ScaleSource {
    /// Nowhere: the unit of length stays the baseline.
    #[default]
    None,
    /// The distance between the two cameras.
    Baseline {
        /// Metres, > 0.
        baseline_m: f64,
        /// Its standard deviation, metres; 0 where it is not known.
        sigma_m: f64,
    },
    /// The height of camera A over the terrain straight below it, as an altimeter reports it
    /// ([`altitude`] says how it is compared with the surface).
    Altitude {
        /// Metres, > 0.
        altitude_m: f64,
        /// Its standard deviation, metres; 0 where it is not known.
        sigma_m: f64,
    },
    /// The prediction was made with a metric relative pose: its unit is the metre already.
    Pose,
}

/// By what a placement got its size, as products name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ScaleKind {
    /// No source.
    None,
    /// The baseline's length.
    Baseline,
    /// The altitude of camera A.
    Altitude,
    /// A coarse elevation model.
    Dem,
    /// Known points.
    Points,
    /// A metric relative pose.
    Pose,
}

/// Where a prediction lies, and in which unit.
#[derive(Debug, Clone)]
pub struct Placement {
    /// A pure scale: from the prediction's unit to metres, or to baselines where `metric` is false.
    pub cam_a_from_pred: Sim3<CamA, PredA>,
    /// Whether lengths are metres.
    pub metric: bool,
    /// Standard deviation of the scale as a fraction of it; `None` where it is not known.
    pub scale_sigma: Option<f64>,
    /// Where the size comes from.
    pub source: ScaleKind,
    /// What is known around camera A.
    pub world: World,
}

impl Placement {
    /// From the prediction to the body; `None` unless it is metric and the body is known.
    pub fn body_from_pred(&self) -> Option<Sim3<BodyFixed, PredA>> {
        match &self.world {
            World::Body { body_from_cam_a, .. } if self.metric => {
                Some(&Sim3::from_rigid(*body_from_cam_a) * &self.cam_a_from_pred)
            }
            _ => None,
        }
    }

    /// From a similarity that was found as a whole (known points, a coarse elevation model).
    ///
    /// # Errors
    /// [`Error::Geometry`] for a scale that is none.
    pub fn from_body(
        body: Body,
        body_from_pred: &Sim3<BodyFixed, PredA>,
        scale_sigma: Option<f64>,
        source: ScaleKind,
    ) -> Result<Self, Error> {
        // x_in_body = R (s x) + t: the scale first, so the rest is where camera A stands.
        Ok(Self {
            cam_a_from_pred: Sim3::new(body_from_pred.scale(), Rigid3::identity())?,
            metric: true,
            scale_sigma,
            source,
            world: World::Body { body, body_from_cam_a: body_from_pred.rigid().relabel() },
        })
    }
}

/// Finds the size of a prediction.
///
/// The error of the scale is that of the source, with what the surface adds where it is compared with it; the error of
/// the prediction's own shape is not in it.
///
/// # Errors
/// [`Error::Value`] for a length that is not positive and finite; [`Error::Undetermined`] if a baseline is given and
/// the prediction has no pose or no baseline; [`Error::TooFewPoints`] if an altitude is given and there is no surface.
pub fn place(prediction: &Prediction, source: ScaleSource, world: World) -> Result<Placement, Error> {
    let (scale, metric, scale_sigma, kind) = match source {
        ScaleSource::None => {
            // A method's own unit means nothing to anybody else: the baseline does.
            let unit = baseline(prediction).map_or(1.0, |baseline| 1.0 / baseline);
            (unit, false, None, ScaleKind::None)
        }
        ScaleSource::Pose => (1.0, true, None, ScaleKind::Pose),
        ScaleSource::Baseline { baseline_m, sigma_m } => {
            positive("baseline_m", baseline_m)?;
            let baseline = baseline(prediction).ok_or_else(|| Error::Undetermined {
                what: "scale from the baseline",
                why: "the prediction has no relative pose with a baseline".to_owned(),
            })?;
            (baseline_m / baseline, true, known(sigma_m / baseline_m), ScaleKind::Baseline)
        }
        ScaleSource::Altitude { altitude_m, sigma_m } => {
            positive("altitude_m", altitude_m)?;
            let below = altitude::above_surface(prediction, world.up_in_cam_a().as_ref())?;
            let relative = (sigma_m / altitude_m).hypot(below.sigma / below.altitude);
            (altitude_m / below.altitude, true, known(relative), ScaleKind::Altitude)
        }
    };
    let cam_a_from_pred = Sim3::new(scale, Rigid3::identity())?;
    Ok(Placement { cam_a_from_pred, metric, scale_sigma, source: kind, world })
}

/// Distance between the cameras in the prediction's unit, where there is one.
pub fn baseline(prediction: &Prediction) -> Option<f64> {
    let length = prediction.cam_b_from_cam_a.as_ref().ok()?.origin().coords.norm();
    (length.is_finite() && length > 0.0).then_some(length)
}

fn positive(key: &'static str, value: f64) -> Result<(), Error> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::Value { key, expected: "a length > 0 m", found: value.to_string() })
}

fn known(sigma: f64) -> Option<f64> {
    (sigma > 0.0 && sigma.is_finite()).then_some(sigma)
}

#[cfg(test)]
mod tests;
