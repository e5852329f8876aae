//! What networks can be run on here, and what is missing for the rest.

use selenograph_engine::Simd;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Backends for graphics cards, and whether this program was built with them.
const BACKENDS: [(&str, bool); 2] = [("cuda", cfg!(feature = "cuda")), ("wgpu", cfg!(feature = "wgpu"))];

/// Where the CUDA toolkit is looked for besides `CUDA_PATH`.
const CUDA_FOLDERS: [&str; 2] = ["/usr/local/cuda", "/opt/cuda"];
/// Where libraries lie that no index knows.
const LIBRARY_FOLDERS: [&str; 5] =
    ["/usr/lib/x86_64-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/lib/wsl/lib", "/usr/local/nvidia/lib64"];

/// A device, or a kind of device.
#[derive(Debug, Serialize)]
pub struct Device {
    /// What `--device` calls it.
    name: &'static str,
    /// Whether networks can be run on it.
    ready: bool,
    /// Whether this program was built with it.
    built: bool,
    /// What it is, of a device that is ready.
    description: Option<&'static str>,
    /// What this machine lacks at run time.
    lacks: Vec<&'static str>,
}

impl Device {
    /// All of them, those that are not ready too.
    pub fn list() -> Vec<Self> {
        let cpu = Self {
            name: "cpu",
            ready: true,
            built: true,
            description: Some(Simd::detect().name()),
            lacks: Vec::new(),
        };
        let others = BACKENDS.map(|(name, built)| {
            let lacks = if name == "cuda" { cuda_lacks() } else { wgpu_lacks() };
            Self { name, ready: built && lacks.is_empty(), built, description: None, lacks }
        });
        [cpu].into_iter().chain(others).collect()
    }

    /// Name and state in one line.
    pub fn sentence(&self) -> String {
        let mut told = Vec::new();
        if !self.built {
            told.push(format!("this program was built without `{}`", self.name));
        }
        if !self.lacks.is_empty() {
            told.push(format!("this machine lacks {}", self.lacks.join(", ")));
        }
        if self.ready {
            told.push(self.description.unwrap_or("ready").to_owned());
        }
        format!("{}: {}", self.name, told.join("; "))
    }
}

fn cuda_lacks() -> Vec<&'static str> {
    let folders = cuda_folders();
    let has_headers = folders.iter().any(|folder| folder.join("include/cuda_runtime.h").is_file());
    let found = [
        ("the driver (libcuda.so.1)", has_library("libcuda.so.1", &folders)),
        ("the compiler (libnvrtc.so)", has_library("libnvrtc.so", &folders)),
        ("the toolkit's headers (in CUDA_PATH, /usr/local/cuda or /opt/cuda)", has_headers),
    ];
    found.into_iter().filter(|(_, found)| !found).map(|(what, _)| what).collect()
}

fn wgpu_lacks() -> Vec<&'static str> {
    if has_library("libvulkan.so.1", &[]) { Vec::new() } else { vec!["Vulkan (libvulkan.so.1)"] }
}

fn cuda_folders() -> Vec<PathBuf> {
    let named = std::env::var_os("CUDA_PATH").map(PathBuf::from);
    named.into_iter().chain(CUDA_FOLDERS.map(PathBuf::from)).collect()
}

/// Whether a library whose name begins so would be found by the system's loader or in a toolkit's folder.
fn has_library(name: &str, toolkits: &[PathBuf]) -> bool {
    // The loader's index lists names between zero bytes.
    let index = std::fs::read("/etc/ld.so.cache").unwrap_or_default();
    if index.windows(name.len()).any(|part| part == name.as_bytes()) {
        return true;
    }
    let named = std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    let folders = std::env::split_paths(&named)
        .chain(LIBRARY_FOLDERS.map(PathBuf::from))
        .chain(toolkits.iter().map(|folder| folder.join("lib64")));
    folders.into_iter().any(|folder| holds(&folder, name))
}

fn holds(folder: &Path, name: &str) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.file_name()).any(|found| found.to_string_lossy().starts_with(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_built_says_so() {
        let devices = Device::list();
        assert!(devices[0].ready && devices[0].name == "cpu");
        for device in &devices[1..] {
            assert_eq!(device.sentence().contains("built without"), !device.built);
            assert!(!device.ready || device.built);
        }
    }

    #[test]
    fn libraries_are_found_by_the_beginning_of_their_name() {
        let dir = tempfile::tempdir().unwrap();
        let toolkit = [dir.path().to_owned()];
        assert!(!has_library("libselenograph-test.so", &toolkit));
        std::fs::create_dir(dir.path().join("lib64")).unwrap();
        std::fs::write(dir.path().join("lib64/libselenograph-test.so.12"), "").unwrap();
        assert!(has_library("libselenograph-test.so", &toolkit));
    }
}
