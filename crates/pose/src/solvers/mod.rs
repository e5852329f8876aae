//! Minimal and linear solvers: one file, one equation, one citation, one precondition each.

pub mod essential_5pt;
pub mod homography_4pt;
pub mod rotation;

pub use essential_5pt::essential_5pt;
