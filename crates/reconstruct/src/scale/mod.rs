//! From a prediction's own unit of length to metres, and to a place on the body where that is known.
//!
//! Two pictures alone give shape without size. A [`ScaleSource`] gives the size ([`crate::priors::Priors::place`]); without one
//! the result keeps the baseline as its unit and says `metric: false`.

pub mod altitude;
pub mod dem;
pub mod points;

use crate::Error;
use crate::prediction::Prediction;
use selenograph_geometry::sun::SubSolar;
use selenograph_geometry::{Body, BodyFixed, CamA, Enu, Geodetic, PredA, Rigid3, Sim3, Vector3};
use serde::{Deserialize, Serialize};

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

impl World {
    /// Unit vector towards an azimuth (clockwise from north) and elevation in the axes of camera A, at the ground below it; `None` where
    /// nothing says where north is.
    pub fn sky_in_cam_a(&self, azimuth_rad: f64, elevation_rad: f64) -> Option<Vector3<f64>> {
        match self {
            Self::Unknown => None,
            Self::Level(level_from_cam_a) => {
                let (east, north) = azimuth_rad.sin_cos();
                let (up, along) = elevation_rad.sin_cos();
                Some(level_from_cam_a.inverse().vector(&Vector3::new(east * along, north * along, up)))
            }
            Self::Body { body, body_from_cam_a } => {
                let below = body.place(&body_from_cam_a.origin());
                Some(body_from_cam_a.inverse().vector(&body.direction(&below, azimuth_rad, elevation_rad)))
            }
        }
    }
}

impl World {
    /// Unit vector from where camera A stands to a Sun over the Moon, in the axes of camera A; `None` unless it stands on the Moon.
    ///
    /// It is that of the whole scene and of camera B as well: 100 km further the Sun stands 4e-5° elsewhere in the body's axes.
    pub fn sun_in_cam_a(&self, sun: &SubSolar) -> Option<Vector3<f64>> {
        match self {
            Self::Body { body, body_from_cam_a } if *body == Body::moon() => {
                Some(body_from_cam_a.inverse().vector(&sun.direction_from(&body_from_cam_a.origin())))
            }
            _ => None,
        }
    }

    /// The place on the body's sphere that camera A looks at, or the one below it where it looks past the body; `None` unless it
    /// stands on a body.
    pub fn ground(&self) -> Option<Geodetic> {
        let Self::Body { body, body_from_cam_a } = self else { return None };
        let (origin, axis) = (body_from_cam_a.origin(), body_from_cam_a.vector(&Vector3::z()));
        // |origin + range · axis| = radius, the nearer one.
        let along = origin.coords.dot(&axis);
        let across_sq = origin.coords.norm_squared() - along * along;
        let range = -along - (body.radius_m * body.radius_m - across_sq).sqrt();
        let seen = if range > 0.0 { origin + axis * range } else { origin };
        Some(Geodetic { height_m: 0.0, ..body.place(&seen) })
    }

    /// How high a direction in the axes of camera A points above the horizon of [`Self::ground`], radians; where only the vertical is
    /// known, above the plane across it.
    pub fn elevation_rad(&self, direction: &Vector3<f64>) -> Option<f64> {
        match (self, self.ground()) {
            (Self::Body { body, body_from_cam_a }, Some(ground)) => {
                Some(body.azimuth_elevation(&ground, &body_from_cam_a.vector(direction)).1)
            }
            _ => Some(std::f64::consts::FRAC_PI_2 - self.up_in_cam_a()?.angle(direction)),
        }
    }
}

/// Where the size of a prediction comes from, in the order of preference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum ScaleSource {
    /// The distance between the cameras, given as such or by a metric relative pose
    Baseline,
    /// A metric relative pose.
    #[cfg_attr(feature = "clap", value(skip))]
    Pose,
    /// The height of camera A over the terrain straight below it, as an altimeter reports it
    Altitude,
    /// A coarse elevation model, seen from where camera A stands
    Dem,
    /// Known points
    Points,
}

impl ScaleSource {
    /// All of them, the preferred ones first.
    pub const ALL: [Self; 5] = [Self::Baseline, Self::Pose, Self::Altitude, Self::Dem, Self::Points];

    /// The name on the command line and in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Pose => "pose",
            Self::Altitude => "altitude",
            Self::Dem => "dem",
            Self::Points => "points",
        }
    }
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
    /// Where the size comes from; `None` where nothing tells it.
    pub source: Option<ScaleSource>,
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
        source: ScaleSource,
    ) -> Result<Self, Error> {
        // x_in_body = R (s x) + t: the scale first, so the rest is where camera A stands.
        Ok(Self {
            cam_a_from_pred: Sim3::new(body_from_pred.scale(), Rigid3::identity())?,
            metric: true,
            scale_sigma,
            source: Some(source),
            world: World::Body { body, body_from_cam_a: body_from_pred.rigid().relabel() },
        })
    }
}

/// Distance between the cameras in the prediction's unit, where there is one.
pub fn baseline(prediction: &Prediction) -> Option<f64> {
    let length = prediction.cam_b_from_cam_a.as_ref().ok()?.origin().coords.norm();
    (length.is_finite() && length > 0.0).then_some(length)
}

#[cfg(test)]
mod tests;
