//! What can go wrong with rendering.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting that no picture can be made with.
    #[error("render setting `{name}`: expected {expected}, found {found}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// What was expected.
        expected: &'static str,
        /// What was found.
        found: String,
    },
    /// A parameter of a reflectance law.
    #[error(transparent)]
    Reflectance(#[from] crate::brdf::ParameterError),
    /// The camera's centre lies below the surface.
    #[error("camera is {below_m:.1} m below the terrain at latitude {lat_deg:.4}°, longitude {lon_deg:.4}°")]
    CameraBelowGround {
        /// How far, metres.
        below_m: f64,
        /// Where, degrees.
        lat_deg: f64,
        /// Where, degrees east.
        lon_deg: f64,
    },
}
