//! Minimal and linear solvers: one file, one equation, one citation, one precondition each.

pub mod essential_5pt;
pub mod homography_4pt;
pub mod p3p;
pub mod rotation;
pub mod umeyama;

pub use essential_5pt::essential_5pt;
