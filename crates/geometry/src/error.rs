//! What can be wrong with a geometric input.

use crate::time::Utc;

/// What can be wrong with a geometric input.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A camera matrix or image size that no real camera has.
    #[error("camera: {what}, found {found}")]
    Camera {
        /// What was expected.
        what: &'static str,
        /// What was found.
        found: String,
    },
    /// A projection that has no closed form here.
    #[error("projection `{name}` is not supported")]
    UnknownProjection {
        /// The name or string as it was given.
        name: String,
    },
    /// A parameter of a projection is missing or unusable.
    #[error("projection parameter `{name}`: {what}")]
    ProjectionParameter {
        /// Name of the parameter.
        name: String,
        /// What is wrong with it.
        what: String,
    },
    /// A matrix that should be a rotation is not.
    #[error("not a rotation: {what}")]
    NotARotation {
        /// How it fails (determinant, orthonormality residual).
        what: String,
    },
    /// Two maps on different spheres, where heights or places of one are to be put beside those of the other.
    #[error("{what} lies on a sphere of {radius_m} m, {beside} on one of {beside_radius_m} m")]
    OtherSphere {
        /// One of them, for people.
        what: String,
        /// Radius of its sphere.
        radius_m: f64,
        /// The other one, for people.
        beside: String,
        /// Radius of the other one's sphere.
        beside_radius_m: f64,
    },
    /// A scale that no similarity has.
    #[error("a similarity's scale must be positive and finite, found {scale}")]
    Scale {
        /// The scale as it was given.
        scale: f64,
    },
    /// A text that is no time.
    #[error("time `{text}`: expected {expected}")]
    Time {
        /// The text as it was given.
        text: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A time for which a series was not made.
    #[error("the Sun's place over the Moon is known from {first} to {last}, not for {found}")]
    TimeOutside {
        /// The time as it was given.
        found: Utc,
        /// First year of the series.
        first: i32,
        /// Last year of the series.
        last: i32,
    },
    /// A viewing direction that leaves the camera's roll undefined.
    #[error("look-at is degenerate: {what}")]
    Degenerate {
        /// Which two directions coincide.
        what: &'static str,
    },
}
