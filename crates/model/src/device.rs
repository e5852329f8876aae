//! Which devices there are, and which one a name means.

use burn_tensor::Device;

use crate::error::{Error, Result};

/// Whether it is burn's CPU backend.
pub(crate) fn is_cpu(device: &Device) -> bool {
    *device == Device::flex()
}

/// The device of a name: `cpu`, `cuda:0`, `wgpu:0`.
///
/// # Errors
/// [`Error::DeviceName`].
pub fn parse(name: &str) -> Result<Device> {
    match name {
        "cpu" => Ok(Device::flex()),
        _ => Err(Error::DeviceName { found: name.to_owned() }),
    }
}
