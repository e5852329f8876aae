//! Frames, rigid motions, cameras, bodies and map projections: f64 mathematics without I/O or threads.
//!
//! The conventions (axes, pixels, depth, quaternions, datum) are drawn in `docs/conventions.md`.
#![forbid(unsafe_code)]

pub mod body;
pub mod camera;
mod error;
pub mod frames;
pub mod lookat;
pub mod pixel;
pub mod proj_string;
pub mod projection;
pub mod rigid;
pub mod similarity;
pub mod units;

pub use body::{Body, Geodetic};
pub use camera::{Camera, Distortion, mean_focal_px};
pub use error::Error;
pub use frames::{BodyFixed, Cam, CamA, CamB, Enu, Frame, PredA};
pub use nalgebra::{Matrix3, Point2, Point3, Rotation3, UnitQuaternion, UnitVector3, Vector2, Vector3};
pub use pixel::PixelConvention;
pub use projection::{Pole, Projection};
pub use rigid::Rigid3;
pub use similarity::Sim3;
