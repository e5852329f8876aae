//! Relative and absolute pose from matches: minimal solvers, robust estimation, refinement with covariance.
//!
//! Image points are on the plane `z = 1` of their camera (undistorted), so that nothing here knows a pixel.
#![forbid(unsafe_code)]

pub mod relative;
