//! What a network says of two pictures, or any matcher, as plain arrays, into a pose and points in one unit.
//!
//! Everything is on the full pictures' pixel grids. Who makes the arrays is not known here.

mod arrays;
mod length;
mod located;
mod options;
mod surface;

pub use arrays::{Learned, LearnedInput, Pointmap};
pub use options::{LearnedOptions, PointsFrom, PoseFrom};

use crate::Error;
use crate::evidence::{PoseSource, Warning};
use crate::judge::{GIVEN_TOLERANCE_PX, Judge};
use crate::matching::{self, Match};
use crate::prediction::{NoPose, Prediction};
use crate::priors::KnownPose;
use crate::relative_pose::JudgedMatch;
use crate::triangulate::matched;
use selenograph_geometry::{CamA, CamB, Camera, Point3, Rigid3, mean_focal_px};
use selenograph_pose::relative::{CannotSay, RelativeOptions, RelativePose};

/// Pose and points, and what they rest on.
#[derive(Debug, Clone)]
pub struct Solved {
    /// Pose and points in one unit: the network's, that of a given pose, or the baseline. Points may stand without a pose.
    pub prediction: Prediction,
    /// Where the pose comes from.
    pub source: PoseSource,
    /// The matches with what the pose leaves of them.
    pub matches: Vec<JudgedMatch>,
    /// What must be said.
    pub warnings: Vec<Warning>,
}

/// Pose and points of a pair.
///
/// # Errors
/// [`Error::SizeMismatch`] for pointmaps of another size than their pictures; [`Error::Undetermined`] where the points cannot be
/// brought into the unit of a given pose, and where points are to be triangulated without dense matches.
pub fn solve(
    cameras: [&Camera; 2],
    learned: &Learned,
    known: Option<&KnownPose>,
    options: &LearnedOptions,
) -> Result<Solved, Error> {
    check(cameras, learned)?;
    let problem = Problem { cameras, learned, options };
    match known {
        Some(known) => problem.with_given(known),
        None => problem.with_estimated(),
    }
}

fn check(cameras: [&Camera; 2], learned: &Learned) -> Result<(), Error> {
    let Some(pointmaps) = &learned.pointmaps else { return Ok(()) };
    for (camera, map) in cameras.into_iter().zip(pointmaps) {
        let size = (camera.width, camera.height);
        for found in [(map.points.width, map.points.height), (map.confidence.width, map.confidence.height)] {
            if found != size {
                return Err(Error::SizeMismatch {
                    what: "pointmap",
                    expected: format!("{}×{}", size.0, size.1),
                    found: format!("{}×{}", found.0, found.1),
                });
            }
        }
    }
    Ok(())
}

/// The arrays with everything that does not change on the way.
struct Problem<'a> {
    cameras: [&'a Camera; 2],
    learned: &'a Learned,
    options: &'a LearnedOptions,
}

impl Problem<'_> {
    fn threshold_px(&self) -> f64 {
        self.options.threshold_px * self.learned.grain.match_px
    }

    fn judged(&self, matches: &[Match], pose: &Rigid3<CamB, CamA>, tolerance_px: f64) -> Vec<JudgedMatch> {
        let judge = Judge::new(pose, self.cameras, tolerance_px);
        matches.iter().map(|m| judge.judged(m.a, m.b, None)).collect()
    }

    fn with_given(&self, known: &KnownPose) -> Result<Solved, Error> {
        let pose = known.cam_b_from_cam_a;
        let tolerance_px = GIVEN_TOLERANCE_PX * self.learned.grain.match_px;
        let matches = self.judged(&self.learned.matches, &pose, tolerance_px);
        let source = PoseSource::given(&matches);
        let mut warnings: Vec<Warning> = source.warning().into_iter().collect();
        let views = match self.options.points {
            PointsFrom::Triangulated => Some(self.triangulated(&pose, tolerance_px)?),
            PointsFrom::Network => match &self.learned.pointmaps {
                None => None,
                Some(maps) => {
                    let measured = self.length(maps, &pose, &matches);
                    // Without matches the pose that the points imply has a length in their unit too.
                    let ratio = match measured {
                        Some(measured) => {
                            warnings.extend(measured.warning());
                            measured.ratio
                        }
                        None => {
                            let located = self.locate(maps).map_err(|why| Error::Undetermined {
                                what: "size of the network's points",
                                why: format!("neither its matches nor its points fit the given pose ({why})"),
                            })?;
                            located.cam_b_from_cam_a.origin().coords.norm() / pose.origin().coords.norm()
                        }
                    };
                    Some(surface::views(maps, 1.0 / ratio, Some(&pose), self.cameras))
                }
            },
        };
        let prediction = Prediction { cam_b_from_cam_a: Ok(pose), views };
        Ok(Solved { prediction, source, matches, warnings })
    }

    fn with_estimated(&self) -> Result<Solved, Error> {
        let mut warnings = Vec::new();
        let (pose, source) = match self.estimated(&mut warnings) {
            Ok(found) => found,
            Err(why) => {
                // The points are the network's answer whether or not a pose comes with them.
                let views =
                    self.learned.pointmaps.as_ref().filter(|_| self.options.points == PointsFrom::Network);
                let views = views.map(|maps| surface::views(maps, 1.0, None, self.cameras));
                let matches = self.learned.matches.iter().map(|m| JudgedMatch::unjudged(m.a, m.b)).collect();
                let prediction = Prediction { cam_b_from_cam_a: Err(why), views };
                return Ok(Solved { prediction, source: PoseSource::Nothing, matches, warnings });
            }
        };
        warnings.extend(source.warning());
        let matches = self.judged(&self.learned.matches, &pose, self.threshold_px());
        let (pose, views) = match (self.options.points, &self.learned.pointmaps) {
            (PointsFrom::Triangulated, _) => (pose, Some(self.triangulated(&pose, self.threshold_px())?)),
            (PointsFrom::Network, None) => (pose, None),
            (PointsFrom::Network, Some(maps)) => {
                let pose = match &source {
                    PoseSource::Estimated(_) => self.in_unit_of(maps, &pose, &matches, &mut warnings),
                    _ => pose,
                };
                let views = surface::views(maps, 1.0, Some(&pose), self.cameras);
                (pose, Some(views))
            }
        };
        let prediction = Prediction { cam_b_from_cam_a: Ok(pose), views };
        Ok(Solved { prediction, source, matches, warnings })
    }

    /// The pose with its translation in the points' unit.
    fn in_unit_of(
        &self,
        maps: &[Pointmap; 2],
        pose: &Rigid3<CamB, CamA>,
        matches: &[JudgedMatch],
        warnings: &mut Vec<Warning>,
    ) -> Rigid3<CamB, CamA> {
        // Every inlier lies in front of both cameras, so that there are ratios.
        let Some(measured) = self.length(maps, pose, matches) else { return *pose };
        warnings.extend(measured.warning());
        let [w, x, y, z] = pose.quaternion_wxyz();
        Rigid3::from_quaternion(w, x, y, z, Point3::from(pose.origin().coords * measured.ratio))
    }

    fn locate(&self, [_, of_b]: &[Pointmap; 2]) -> Result<located::Located, CannotSay> {
        located::locate(of_b, self.cameras[1], self.learned.grain.match_px, self.options)
    }

    fn length(
        &self,
        maps: &[Pointmap; 2],
        pose: &Rigid3<CamB, CamA>,
        matches: &[JudgedMatch],
    ) -> Option<length::Measured> {
        length::measure(maps, pose, self.cameras, matches)
    }

    /// The relative pose that the matches tell, refined.
    fn pose_of_matches(&self) -> Result<RelativePose, CannotSay> {
        let focal_px = mean_focal_px(self.cameras);
        let options = RelativeOptions {
            threshold: self.threshold_px() / focal_px,
            least_noise: self.learned.grain.noise_px / focal_px,
            per_evidence: self.learned.grain.per_patch(&self.learned.matches),
            seed: self.options.seed,
            ..RelativeOptions::default()
        };
        selenograph_pose::relative::estimate(
            &matching::on_plane(self.cameras, &self.learned.matches),
            &options,
        )
    }

    fn estimated(&self, warnings: &mut Vec<Warning>) -> Result<(Rigid3<CamB, CamA>, PoseSource), NoPose> {
        let maps = self.learned.pointmaps.as_ref();
        match self.options.pose {
            PoseFrom::Nothing => Err(NoPose::NotAsked),
            PoseFrom::Points => {
                let located = maps.map_or(Err(located::NONE), |maps| self.locate(maps))?;
                Ok((located.cam_b_from_cam_a, located.source()))
            }
            PoseFrom::Matches => {
                match (self.pose_of_matches(), maps) {
                    (Ok(found), _) => Ok((found.cam_b_from_cam_a, PoseSource::Estimated(Box::new(found)))),
                    // Without parallax the points have no better answer: they only look as if they had.
                    (Err(why @ CannotSay::NoParallax { .. }), _) | (Err(why), None) => Err(why.into()),
                    (Err(why), Some(maps)) => {
                        let Ok(located) = self.locate(maps) else { return Err(why.into()) };
                        warnings.push(Warning::PoseFromPoints { why: why.to_string() });
                        Ok((located.cam_b_from_cam_a, located.source()))
                    }
                }
            }
        }
    }

    /// Points in which the rays of dense matches meet, in the unit of the pose.
    fn triangulated(
        &self,
        pose: &Rigid3<CamB, CamA>,
        tolerance_px: f64,
    ) -> Result<[crate::PredictedView; 2], Error> {
        let dense = self.learned.dense_matches.as_ref().ok_or_else(|| Error::Undetermined {
            what: "triangulated points",
            why: "there are no dense matches".into(),
        })?;
        let mut judged = self.judged(dense, pose, tolerance_px);
        let sigma_px = surface::sigma_px(&judged, self.learned.grain.match_px);
        for m in &mut judged {
            m.sigma_px = Some(sigma_px);
        }
        Ok(matched(self.cameras, pose, &judged))
    }
}

#[cfg(test)]
mod tests;
