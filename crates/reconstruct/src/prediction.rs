//! What a method says of a pair: the common form of stereo, of a network, and of the truth itself.

use selenograph_geometry::{CamA, CamB, Rigid3};
use selenograph_pose::relative::CannotSay;
use selenograph_raster::Raster;

/// Where a pixel's point comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fill {
    /// There is no point.
    #[default]
    Absent,
    /// Measured from both pictures.
    Measured,
    /// Completed from its surroundings or from a prior; nothing was measured here.
    Completed,
}

/// The points of one view, pixel by pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictedView {
    /// Points in the frame `PredA` (axes and origin of camera A, the prediction's own unit), for view B as well; NaN where absent.
    pub points: Raster<[f32; 3]>,
    /// Confidence in `[0, 1]`; 0 where absent.
    pub confidence: Raster<f32>,
    /// Standard deviation of the point along its ray, in the prediction's unit; `None` where a method has none. NaN where absent.
    pub sigma: Option<Raster<f32>>,
    /// Where each point comes from.
    pub fill: Raster<Fill>,
}

/// Why there is no relative pose.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum NoPose {
    /// The pictures do not tell one.
    #[error(transparent)]
    CannotSay(#[from] CannotSay),
    /// None was asked for.
    #[error("no pose was asked for")]
    NotAsked,
}

/// What a method says of a pair.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// The relative pose in the prediction's unit, or why there is none.
    pub cam_b_from_cam_a: Result<Rigid3<CamB, CamA>, NoPose>,
    /// Points of view A and of view B; `None` for a method that gives a pose only, or where it cannot say.
    pub views: Option<[PredictedView; 2]>,
}
