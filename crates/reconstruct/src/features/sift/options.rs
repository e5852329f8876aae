//! How SIFT features are found.

use serde::{Deserialize, Serialize};

/// Resolution of the first octave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FirstOctave {
    /// The picture enlarged twice: more and smaller features.
    Doubled,
    /// The picture as it is: four times less work.
    #[default]
    Original,
}

/// How features are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Resolution of the first octave.
    pub first_octave: FirstOctave,
    /// Least contrast of an extremum of the difference of Gaussians, as a share of the picture's range, times the number of
    /// intervals an octave has (the scaling of OpenCV).
    pub contrast: f32,
    /// Largest ratio of the principal curvatures: beyond it the point slides along an edge.
    pub edge_ratio: f32,
    /// At most so many keypoints are kept (before several directions multiply them).
    pub max_keypoints: usize,
    /// Cells along the longer side of the grid over which they are spread; 0 keeps the strongest wherever they are.
    pub spread_cells: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            first_octave: FirstOctave::Original,
            contrast: 0.01,
            edge_ratio: 10.0,
            max_keypoints: 1000,
            spread_cells: 16,
        }
    }
}
