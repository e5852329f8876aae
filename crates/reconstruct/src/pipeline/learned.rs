//! The same way for what a network says: pose and points are the network's, size and place are found as for stereo.

use super::{FocalSource, PoseSource, Reconstruction, Stage, Warning, answer};
use crate::Error;
use crate::learned::{Learned, LearnedOptions, PoseFrom, Solved, solve};
use crate::priors::Priors;
use crate::relative_pose::Counts;
use selenograph_geometry::Camera;

/// What a network says of two views.
#[derive(Debug, Clone)]
pub struct LearnedInput {
    /// Points and matches, on the grids of the views.
    pub learned: Learned,
    /// The cameras of the full pictures.
    pub cameras: [Camera; 2],
    /// Where their focal lengths come from.
    pub focal: FocalSource,
}

/// Places what a network says.
///
/// `progress` is told of each step that begins.
///
/// # Errors
/// [`Error::CannotSay`] where no pose can be told and one is asked for; those of [`solve`] and of the scale source.
pub fn reconstruct_learned(
    input: LearnedInput,
    priors: &Priors,
    options: &LearnedOptions,
    mut progress: impl FnMut(Stage),
) -> Result<Reconstruction, Error> {
    let LearnedInput { learned, cameras, focal } = input;
    progress(Stage::Pose);
    let Solved { prediction, source, matches, mut warnings } =
        solve(cameras.each_ref(), &learned, priors.cam_b_from_cam_a.as_ref(), options)?;
    let source = match (source, &prediction.cam_b_from_cam_a) {
        (Some(source), _) => source,
        (None, Err(why)) if options.pose != PoseFrom::Nothing => return Err(why.clone().into()),
        (None, _) => {
            warnings.push(Warning::NoPose);
            PoseSource::Nothing
        }
    };
    warnings.splice(0..0, focal.warning());
    progress(Stage::Placement);
    let placement = priors.place(&prediction)?;
    warnings.extend(answer::disagreements(priors, &prediction, &placement));
    if !placement.metric {
        warnings.push(if prediction.cam_b_from_cam_a.is_ok() {
            Warning::NotMetric
        } else {
            Warning::NetworkUnit
        });
    }
    let counts = Counts {
        matches: matches.len(),
        inliers: matches.iter().filter(|m| m.inlier).count(),
        ..Counts::default()
    };
    Ok(Reconstruction { prediction, pose: source, matches, counts, placement, cameras, focal, warnings })
}
