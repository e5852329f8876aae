//! What is known beforehand, in any subset, and how the size of a prediction follows from it.

use crate::Error;
use crate::prediction::Prediction;
use crate::scale::dem::{self, DemOptions, DemPatch};
use crate::scale::points::{self, KnownPoints};
use crate::scale::{self, Placement, ScaleSource, World};
use selenograph_geometry::{BodyFixed, CamA, CamB, Rigid3};
use serde::{Deserialize, Serialize};

/// A relative pose that was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownPose {
    /// The motion.
    pub cam_b_from_cam_a: Rigid3<CamB, CamA>,
    /// Whether its translation is in metres; else only its direction means something.
    pub metric: bool,
}

/// A length that was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownLength {
    /// Metres.
    pub metres: f64,
    /// Its standard deviation, metres; 0 where it is not known.
    pub sigma_m: f64,
}

/// Where the size comes from, if several priors can tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ScaleFrom {
    /// The distance between the cameras: given as such, or by a metric relative pose.
    Baseline,
    /// The height of camera A over the ground below it.
    Altitude,
    /// A coarse elevation model, seen from where camera A stands.
    Dem,
    /// Known points.
    Points,
}

impl ScaleFrom {
    /// The name on the command line and in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Altitude => "altitude",
            Self::Dem => "dem",
            Self::Points => "points",
        }
    }
}

/// What is known beforehand; nothing by default.
#[derive(Debug, Clone, Default)]
pub struct Priors {
    /// The relative pose: it is used as it is, and not estimated.
    pub cam_b_from_cam_a: Option<KnownPose>,
    /// Where camera A stands, or which direction is up in it.
    pub world: World,
    /// The distance between the cameras.
    pub baseline: Option<KnownLength>,
    /// The height of camera A over the ground straight below it.
    pub altitude: Option<KnownLength>,
    /// A coarse elevation model of the place; it needs `world` to be a place on a body.
    pub dem: Option<DemPatch>,
    /// How well the place of camera A is known, where a surface is laid onto that model.
    pub dem_options: DemOptions,
    /// Points of picture A whose place is known.
    pub points: Option<KnownPoints>,
    /// Which of these gives the size; by default the first that is there, in the order of [`ScaleFrom`].
    pub scale_from: Option<ScaleFrom>,
}

impl Priors {
    /// Which prior gives the size; `None` if there is none.
    ///
    /// # Errors
    /// [`Error::Undetermined`] if the one asked for is not there.
    pub fn scale_from(&self) -> Result<Option<ScaleFrom>, Error> {
        let Some(asked) = self.scale_from else {
            let all = [ScaleFrom::Baseline, ScaleFrom::Altitude, ScaleFrom::Dem, ScaleFrom::Points];
            return Ok(all.into_iter().find(|source| self.has(*source)));
        };
        if self.has(asked) {
            return Ok(Some(asked));
        }
        Err(Error::Undetermined {
            what: "scale",
            why: format!("it is asked for from `{}`, and nothing is given there", asked.as_str()),
        })
    }

    fn has(&self, source: ScaleFrom) -> bool {
        match source {
            ScaleFrom::Baseline => self.baseline.is_some() || self.metric_pose().is_some(),
            ScaleFrom::Altitude => self.altitude.is_some(),
            ScaleFrom::Dem => self.dem.is_some() && matches!(self.world, World::Body { .. }),
            ScaleFrom::Points => self.points.is_some(),
        }
    }

    fn metric_pose(&self) -> Option<&KnownPose> {
        self.cam_b_from_cam_a.as_ref().filter(|pose| pose.metric)
    }

    /// Size and place of a prediction.
    ///
    /// # Errors
    /// Those of the source: a length that is none, a surface that is not below the camera or not on the elevation model, points that do
    /// not fix a similarity.
    pub fn place(&self, prediction: &Prediction) -> Result<Placement, Error> {
        let world = || self.world.clone();
        let Some(source) = self.scale_from()? else {
            return scale::place(prediction, ScaleSource::None, world());
        };
        match source {
            ScaleFrom::Baseline => match self.baseline {
                Some(KnownLength { metres, sigma_m }) => {
                    let source = ScaleSource::Baseline { baseline_m: metres, sigma_m };
                    scale::place(prediction, source, world())
                }
                None => scale::place(prediction, ScaleSource::Pose, world()),
            },
            ScaleFrom::Altitude => {
                let KnownLength { metres, sigma_m } =
                    self.altitude.unwrap_or(KnownLength { metres: f64::NAN, sigma_m: 0.0 });
                let source = ScaleSource::Altitude { altitude_m: metres, sigma_m };
                scale::place(prediction, source, world())
            }
            ScaleFrom::Dem => self.place_by_dem(prediction),
            ScaleFrom::Points => self.place_by_points(prediction),
        }
    }

    fn place_by_points(&self, prediction: &Prediction) -> Result<Placement, Error> {
        let none = || Error::Undetermined { what: "scale from known points", why: "there are none".into() };
        Ok(points::fit(prediction, self.points.as_ref().ok_or_else(none)?)?.placement)
    }

    fn place_by_dem(&self, prediction: &Prediction) -> Result<Placement, Error> {
        match (&self.dem, &self.world) {
            (Some(dem), World::Body { body, body_from_cam_a }) => {
                let aligned = dem::align(prediction, body_from_cam_a, None, dem, &self.dem_options)?;
                debug_assert_eq!(body, dem.body());
                aligned.placement(dem)
            }
            _ => Err(Error::Undetermined {
                what: "scale from the elevation model",
                why: "where camera A stands on the body is not known".into(),
            }),
        }
    }
}

/// Relative pose of two cameras whose places are known.
pub fn between(
    world_from_cam_a: &Rigid3<BodyFixed, CamA>,
    world_from_cam_b: &Rigid3<BodyFixed, CamB>,
) -> KnownPose {
    KnownPose { cam_b_from_cam_a: &world_from_cam_b.inverse() * world_from_cam_a, metric: true }
}

#[cfg(test)]
mod tests;
