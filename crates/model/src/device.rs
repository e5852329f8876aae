//! Which devices there are, and which one a name means: obeyed, or an error that says what is missing.
//!
//! Nothing here panics, whatever a driver does, and nothing moves to another device on its own.

#[cfg(any(feature = "cuda", feature = "wgpu"))]
use burn_tensor::DeviceType;
use burn_tensor::{Device, Tensor};

use crate::error::{Error, Result};

/// The name of burn's CPU backend.
const CPU: &str = "cpu";

/// A kind of graphics device.
struct Kind {
    /// What its names begin with, and the feature of this crate that it needs.
    name: &'static str,
    /// Whether it is built in.
    built: bool,
    /// The devices found.
    found: fn() -> Vec<Device>,
    /// What a machine must have for it.
    needs: &'static str,
}

const KINDS: [Kind; 2] = [
    Kind {
        name: "cuda",
        built: cfg!(feature = "cuda"),
        found: cuda,
        needs: "an NVIDIA driver (libcuda.so.1), libnvrtc.so and the CUDA headers (CUDA_PATH or /usr/local/cuda)",
    },
    Kind {
        name: "wgpu",
        built: cfg!(feature = "wgpu"),
        found: wgpu,
        needs: "a Vulkan, Metal or DirectX 12 driver",
    },
];

#[cfg(feature = "cuda")]
fn cuda() -> Vec<Device> {
    Device::enumerate(DeviceType::Cuda).into_vec()
}

#[cfg(not(feature = "cuda"))]
fn cuda() -> Vec<Device> {
    Vec::new()
}

#[cfg(feature = "wgpu")]
fn wgpu() -> Vec<Device> {
    Device::enumerate(DeviceType::Wgpu).into_vec()
}

#[cfg(not(feature = "wgpu"))]
fn wgpu() -> Vec<Device> {
    Vec::new()
}

/// The names of all devices of this machine that this build can use.
pub fn list() -> Vec<String> {
    let graphics = KINDS
        .iter()
        .flat_map(|kind| (0..enumerated(kind).len()).map(move |idx| format!("{}:{idx}", kind.name)));
    std::iter::once(CPU.to_owned()).chain(graphics).collect()
}

/// What a build and a machine lack for the devices of each kind that has none: its name and what is missing.
pub fn missing() -> Vec<(&'static str, String)> {
    KINDS.iter().filter(|kind| enumerated(kind).is_empty()).map(|kind| (kind.name, absence(kind))).collect()
}

/// The device of a name, after it has computed something: `cpu`, `cuda:0`, `wgpu:0`; without a number, the first.
///
/// # Errors
/// [`Error::DeviceName`]; [`Error::DeviceAbsent`] with what is missing.
pub fn parse(name: &str) -> Result<Device> {
    if name == CPU {
        return Ok(Device::flex());
    }
    let (kind, number) = name.split_once(':').unwrap_or((name, "0"));
    let known = KINDS.iter().find(|each| each.name == kind).zip(number.parse::<usize>().ok());
    let (kind, idx) = known.ok_or_else(|| Error::DeviceName { found: name.to_owned() })?;
    let absent = |missing: String| Error::DeviceAbsent { device: name.to_owned(), missing };
    let found = enumerated(kind);
    match found.get(idx) {
        Some(device) => probe(device)
            .map(|()| device.clone())
            .map_err(|said| absent(format!("it does not compute ({said}); it needs {}", kind.needs))),
        None if found.is_empty() => Err(absent(absence(kind))),
        None => Err(absent(format!("there are {} of its kind, counted from 0", found.len()))),
    }
}

/// Whether it is burn's CPU backend.
pub fn is_cpu(device: &Device) -> bool {
    *device == Device::flex()
}

fn absence(kind: &Kind) -> String {
    if kind.built {
        format!("no such device was found; it needs {}", kind.needs)
    } else {
        format!("this program was built without the feature `{}`", kind.name)
    }
}

/// Looking for devices loads drivers, which may do anything.
fn enumerated(kind: &Kind) -> Vec<Device> {
    std::panic::catch_unwind(kind.found).unwrap_or_default()
}

/// Compiles and runs a small kernel: a library that is missing shows here, as a panic or as an error of the reading.
fn probe(device: &Device) -> std::result::Result<(), String> {
    let device = device.clone();
    let sum = std::panic::catch_unwind(move || {
        Tensor::<1>::ones([64], &device).sum().try_into_scalar::<f32>().map_err(|error| error.to_string())
    });
    match sum {
        Ok(Ok(sum)) if (sum - 64.0).abs() < 0.5 => Ok(()),
        Ok(Ok(sum)) => Err(format!("64 ones sum to {sum}")),
        Ok(Err(message)) => Err(message),
        Err(panic) => Err(panic
            .downcast_ref::<String>()
            .cloned()
            .or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
            .unwrap_or_else(|| "its driver failed".into())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cpu_is_always_there() {
        assert_eq!(list()[0], "cpu");
        assert!(is_cpu(&parse("cpu").unwrap()));
    }

    #[test]
    fn what_is_no_device_is_an_error_that_says_so() {
        for name in ["", "gpu", "cuda:x", "cpu:0", "wgpu:-1", "cuda:0:1"] {
            assert!(matches!(parse(name), Err(Error::DeviceName { .. })), "{name}");
        }
        for kind in ["cuda", "wgpu"] {
            let Err(Error::DeviceAbsent { missing, .. }) = parse(&format!("{kind}:999")) else {
                panic!("there are no thousand devices");
            };
            assert!(!missing.is_empty());
        }
    }

    #[cfg(not(any(feature = "cuda", feature = "wgpu")))]
    #[test]
    fn a_device_that_was_not_built_in_names_its_feature() {
        assert!(parse("cuda").unwrap_err().to_string().contains("feature `cuda`"));
        assert_eq!(missing().len(), 2);
    }
}
