//! Parameters of laws and their ranges.

/// A parameter outside the range where its law means something.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("reflectance `{law}`: `{parameter}` must be {expected}, found {found}")]
pub struct ParameterError {
    /// Name of the law in configuration files.
    pub law: &'static str,
    /// Name of the parameter.
    pub parameter: &'static str,
    /// What was expected.
    pub expected: String,
    /// What was found.
    pub found: f64,
}

impl ParameterError {
    pub(super) fn within(
        law: &'static str,
        parameter: &'static str,
        found: f64,
        min: f64,
        max: f64,
    ) -> Result<(), Self> {
        if found >= min && found <= max {
            return Ok(());
        }
        Err(Self { law, parameter, expected: format!("from {min} to {max}"), found })
    }
}
