//! What is known beforehand, in any subset, and how the size of a prediction follows from it.

use crate::Error;
use crate::prediction::Prediction;
use crate::scale::dem::{self, DemOptions, DemPatch};
use crate::scale::points::{self, KnownPoints};
use crate::scale::{Placement, ScaleSource, World, altitude, baseline};
use crate::shading::PoseSigma;
use selenograph_geometry::{BodyFixed, CamA, CamB, Rigid3, Sim3, Vector3};

/// A relative pose that was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownPose {
    /// The motion.
    pub cam_b_from_cam_a: Rigid3<CamB, CamA>,
    /// Whether its translation is in metres; else only its direction means something.
    pub metric: bool,
}

/// A Sun that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownSun {
    /// Unit vector towards it.
    pub direction: Vector3<f64>,
    /// In which axes.
    pub axes: SunAxes,
    /// Standard deviation of its direction, radians; 0 where it is exact.
    pub sigma_rad: f64,
}

/// The axes in which a Sun is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SunAxes {
    /// Those of the camera whose picture it lights.
    Own,
    /// Those of camera A.
    CamA,
}

impl KnownSun {
    /// Unit vector towards the Sun of picture B (or A, of whose camera both kinds of axes are one) in the axes of camera A.
    pub fn in_cam_a(&self, cam_a_from_own: &Rigid3<CamA, CamB>) -> Vector3<f64> {
        match self.axes {
            SunAxes::Own => cam_a_from_own.vector(&self.direction),
            SunAxes::CamA => self.direction,
        }
    }
}

/// Suns that are further apart light the same ground too differently for stereo, radians.
const SAME_SUN_RAD: f64 = 0.1;

/// Whether two Suns, seen by cameras that are turned against each other, are one, as far as both are known.
pub(crate) fn same_sun(suns: &[Option<KnownSun>; 2], cam_b_from_cam_a: &Rigid3<CamB, CamA>) -> bool {
    match suns {
        [Some(a), Some(b)] => a.direction.angle(&b.in_cam_a(&cam_b_from_cam_a.inverse())) < SAME_SUN_RAD,
        _ => true,
    }
}

/// A length that was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownLength {
    /// Metres.
    pub metres: f64,
    /// Its standard deviation, metres; 0 where it is not known.
    pub sigma_m: f64,
}

impl KnownLength {
    fn positive(self, key: &'static str) -> Result<Self, Error> {
        if self.metres.is_finite() && self.metres > 0.0 {
            return Ok(self);
        }
        Err(Error::Value { key, expected: "a length > 0 m", found: self.metres.to_string() })
    }
}

/// What is known beforehand; nothing by default.
#[derive(Debug, Clone, Default)]
pub struct Priors {
    /// The relative pose: it is not estimated.
    pub cam_b_from_cam_a: Option<KnownPose>,
    /// How surely, where the given pose may be bettered by the methods that can; without it the pose is used as it is.
    pub pose_sigma: Option<PoseSigma>,
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
    /// The Suns of both pictures, for the methods that look at shading.
    pub suns: [Option<KnownSun>; 2],
    /// Which of these gives the size; by default the first that is there, in the order of [`ScaleSource`].
    pub scale_from: Option<ScaleSource>,
}

impl Priors {
    /// Whether the pictures may have been taken under two Suns: those that are told are two, or they are told in axes of two cameras whose
    /// relative pose is not known yet, in numbers that differ.
    pub fn may_be_two_suns(&self) -> bool {
        match (&self.suns, &self.cam_b_from_cam_a) {
            (suns, Some(pose)) => !same_sun(suns, &pose.cam_b_from_cam_a),
            ([Some(a), Some(b)], None) if b.axes == SunAxes::Own => a.direction != b.direction,
            (suns, None) => !same_sun(suns, &Rigid3::identity()),
        }
    }

    /// Which prior gives the size; `None` if there is none.
    ///
    /// # Errors
    /// [`Error::Undetermined`] if the one asked for is not there.
    pub fn scale_from(&self) -> Result<Option<ScaleSource>, Error> {
        let Some(asked) = self.scale_from else {
            return Ok(ScaleSource::ALL.into_iter().find(|source| self.has(*source)));
        };
        // A metric pose gives a baseline too.
        let given = match asked {
            ScaleSource::Baseline if self.baseline.is_none() => ScaleSource::Pose,
            other => other,
        };
        if self.has(given) {
            return Ok(Some(given));
        }
        Err(Error::Undetermined {
            what: "scale",
            why: format!("it is asked for from `{}`, and nothing is given there", asked.as_str()),
        })
    }

    fn has(&self, source: ScaleSource) -> bool {
        match source {
            ScaleSource::Baseline => self.baseline.is_some(),
            ScaleSource::Pose => self.cam_b_from_cam_a.is_some_and(|pose| pose.metric),
            ScaleSource::Altitude => self.altitude.is_some(),
            ScaleSource::Dem => self.dem.is_some() && matches!(self.world, World::Body { .. }),
            ScaleSource::Points => self.points.is_some(),
        }
    }

    /// Size and place of a prediction.
    ///
    /// The error of the scale is that of the source, with what the surface adds where it is compared with it; the error of
    /// the prediction's own shape is not in it.
    ///
    /// # Errors
    /// Those of the source: a length that is none, a prediction without a baseline, a surface that is not below the camera or not on
    /// the elevation model, points that do not fix a similarity.
    pub fn place(&self, prediction: &Prediction) -> Result<Placement, Error> {
        let source = self.scale_from()?;
        let (scale, sigma) = match source {
            // A method's own unit means nothing to anybody else: the baseline does.
            None => (baseline(prediction).map_or(1.0, |baseline| 1.0 / baseline), None),
            Some(ScaleSource::Pose) => (1.0, None),
            Some(source @ ScaleSource::Baseline) => {
                let given = given(self.baseline, source)?.positive("baseline_m")?;
                let baseline = baseline(prediction).ok_or_else(|| Error::Undetermined {
                    what: "scale from the baseline",
                    why: "the prediction has no relative pose with a baseline".to_owned(),
                })?;
                (given.metres / baseline, Some(given.sigma_m / given.metres))
            }
            Some(source @ ScaleSource::Altitude) => {
                let given = given(self.altitude, source)?.positive("altitude_m")?;
                let below = altitude::above_surface(prediction, self.world.up_in_cam_a().as_ref())?;
                let sigma = (given.sigma_m / given.metres).hypot(below.sigma / below.altitude);
                (given.metres / below.altitude, Some(sigma))
            }
            Some(ScaleSource::Dem) => return self.place_by_dem(prediction),
            Some(source @ ScaleSource::Points) => {
                return Ok(points::fit(prediction, given(self.points.as_ref(), source)?)?.placement);
            }
        };
        Ok(Placement {
            cam_a_from_pred: Sim3::new(scale, Rigid3::identity())?,
            metric: source.is_some(),
            scale_sigma: sigma.filter(|sigma| *sigma > 0.0 && sigma.is_finite()),
            source,
            world: self.world.clone(),
        })
    }

    fn place_by_dem(&self, prediction: &Prediction) -> Result<Placement, Error> {
        match (&self.dem, &self.world) {
            (Some(dem), World::Body { body, body_from_cam_a }) => {
                dem.body().same_sphere("the elevation model", body, "the first camera's world")?;
                let aligned = dem::align(prediction, body_from_cam_a, None, dem, &self.dem_options)?;
                aligned.placement(dem)
            }
            _ => Err(Error::Undetermined {
                what: "scale from the elevation model",
                why: "where camera A stands on the body is not known".into(),
            }),
        }
    }
}

/// What a source needs, which [`Priors::scale_from`] has found to be there.
fn given<T>(prior: Option<T>, source: ScaleSource) -> Result<T, Error> {
    prior.ok_or_else(|| Error::Undetermined {
        what: "scale",
        why: format!("nothing is given for `{}`", source.as_str()),
    })
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
