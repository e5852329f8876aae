//! Frames, rigid motions, cameras, bodies and map projections: f64 mathematics without I/O or threads.
//!
//! The conventions (axes, pixels, depth, quaternions, datum) are drawn in `docs/conventions.md`.
#![forbid(unsafe_code)]

mod body;
mod camera;
mod error;
mod frames;
pub mod lookat;
pub mod pixel;
pub mod proj_string;
mod projection;
mod rigid;
pub mod robust;
mod similarity;
pub mod sun;
pub mod time;
pub mod units;

pub use body::{Body, Geodetic};
pub use camera::{Camera, Distortion, mean_focal_px};
pub use error::Error;
pub use frames::{BodyFixed, Cam, CamA, CamB, Enu, Frame, PredA};
// The one door to the linear algebra that everything is computed in: other crates take its types from here.
pub use nalgebra::{
    DMatrix, Matrix2, Matrix3, Matrix4, Point2, Point3, Quaternion, Rotation3, RowVector3, RowVector4,
    SMatrix, SVector, SymmetricEigen, Unit, UnitQuaternion, UnitVector3, Vector2, Vector3,
};
pub use pixel::PixelConvention;
pub use projection::{Pole, Projection};
pub use rigid::Rigid3;
pub use similarity::Sim3;
