//! Relative and absolute pose from matches: minimal solvers, robust estimation, refinement with covariance.
//!
//! Image points are on the plane `z = 1` of their camera (undistorted), so that nothing here knows a pixel.
#![forbid(unsafe_code)]

pub mod absolute;
pub mod cheirality;
mod consensus;
pub mod decompose;
mod degenerate;
pub mod points;
mod polynomial;
pub mod problems;
pub mod random;
mod ransac;
pub mod refine;
pub mod relative;
pub mod sampson;
pub mod similarity;
pub mod solvers;
pub mod triangulate;
