//! What a network or a matcher says, as plain arrays.

use crate::evidence::FocalSource;
use crate::matching::{Grain, Match};
use selenograph_geometry::Camera;
use selenograph_raster::Raster;

/// Points of one view, pixel by pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Pointmap {
    /// In the axes and origin of camera A, in the network's unit; NaN where there is none.
    pub points: Raster<[f32; 3]>,
    /// In `[0, 1]`; 0 where there is no point.
    pub confidence: Raster<f32>,
}

/// What a network or matcher says of two pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct Learned {
    /// Points of A and of B, both in the frame of A; `None` for a matcher.
    pub pointmaps: Option<[Pointmap; 2]>,
    /// Matches for the pose; none for a network that does not match.
    pub matches: Vec<Match>,
    /// Matches of as many pixels as have one, where they were asked for.
    pub dense_matches: Option<Vec<Match>>,
    /// How fine it sees.
    pub grain: Grain,
}

/// What a network says of two pictures, and the cameras that it says it for.
#[derive(Debug, Clone)]
pub struct LearnedInput {
    /// Points and matches, on the grids of the views.
    pub learned: Learned,
    /// The cameras of the full pictures.
    pub cameras: [Camera; 2],
    /// Where their focal lengths come from.
    pub focal: FocalSource,
}
