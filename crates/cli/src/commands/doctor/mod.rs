//! `doctor`: what runs here, in words that can be pasted into a report of a fault.

mod checkpoints;
mod devices;

use crate::args::about::Doctor;
use crate::bytes::shown;
use crate::exit::Outcome;
use crate::machine::{Memory, disk_free, product_rate};
use crate::ui::Ui;
use checkpoints::Found;
use devices::Device;
use selenograph_engine::Simd;
use selenograph_render::InstructionSet;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The folder that is searched for weights wherever the program is run.
const WEIGHTS_FOLDER: &str = "SELENOGRAPH_WEIGHTS";
/// The folder of test data.
const SHARED_FOLDER: &str = "SELENOGRAPH_SHARED";
/// Other programs that recipes use, and what for.
const PROGRAMS: [(&str, &str); 1] = [("ffmpeg", "descent videos")];

#[derive(Serialize)]
struct Report {
    version: &'static str,
    processor: Processor,
    memory: Option<Memory>,
    disk: Disk,
    devices: Vec<Device>,
    weights: Vec<Found>,
    programs: Vec<Program>,
    /// The folder of test data, where there is one.
    shared_data: Option<PathBuf>,
}

#[derive(Serialize)]
struct Processor {
    threads: usize,
    /// Instructions that networks are run with.
    engine: &'static str,
    /// Instructions that pictures are rendered with.
    renderer: String,
    product_gflop_per_s: f64,
}

#[derive(Serialize)]
struct Disk {
    folder: PathBuf,
    free_bytes: Option<u64>,
}

#[derive(Serialize)]
struct Program {
    name: &'static str,
    purpose: &'static str,
    path: Option<PathBuf>,
}

/// Tells what runs here.
///
/// # Errors
/// If stdout is closed.
pub fn run(args: &Doctor, ui: &Ui) -> anyhow::Result<Outcome> {
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        processor: Processor {
            threads: rayon::current_num_threads(),
            engine: Simd::detect().name(),
            renderer: format!("{:?}", InstructionSet::best()),
            product_gflop_per_s: ui.timed("products of matrices", product_rate) / 1e9,
        },
        memory: Memory::now(),
        disk: Disk {
            folder: std::env::current_dir().unwrap_or_else(|_| ".".into()),
            free_bytes: disk_free(Path::new(".")),
        },
        devices: Device::list(),
        weights: Found::search(&args.weights, std::env::var_os(WEIGHTS_FOLDER).map(PathBuf::from)),
        programs: PROGRAMS.map(|(name, purpose)| Program { name, purpose, path: on_path(name) }).into(),
        shared_data: std::env::var_os(SHARED_FOLDER).map(PathBuf::from).filter(|folder| folder.is_dir()),
    };
    if ui.json {
        ui.data_json(&report)?;
    } else {
        ui.data(report.text().trim_end())?;
    }
    Ok(if report.weights.iter().any(Found::fails) { Outcome::Faulty } else { Outcome::Done })
}

impl Report {
    fn text(&self) -> String {
        let mut out = String::new();
        let mut lines = |key: &str, values: Vec<String>| {
            for (idx, value) in values.iter().enumerate() {
                // A `String` takes every write.
                let _ = writeln!(out, "{:<12}{value}", if idx == 0 { key } else { "" });
            }
        };
        let Processor { threads, engine, renderer, product_gflop_per_s } = &self.processor;
        let unknown = || "not told by this system".to_owned();
        lines("selenograph", vec![self.version.into()]);
        lines(
            "processor",
            vec![format!(
                "{threads} threads; networks: {engine}, renderer: {renderer}; {product_gflop_per_s:.0} GFLOP/s now"
            )],
        );
        let memory = self
            .memory
            .map(|memory| format!("{} free of {}", shown(memory.free_bytes), shown(memory.total_bytes)));
        lines("memory", vec![memory.unwrap_or_else(unknown)]);
        let free = self.disk.free_bytes.map_or_else(unknown, |bytes| format!("{} free", shown(bytes)));
        lines("disk", vec![format!("{free} at {}", self.disk.folder.display())]);
        lines("devices", self.devices.iter().map(Device::sentence).collect());
        let mut weights: Vec<String> = self.weights.iter().map(Found::sentence).collect();
        if weights.is_empty() {
            weights.push(format!(
                "none here; name files or folders, or the folder in {WEIGHTS_FOLDER}; `selenograph weights random` makes some"
            ));
        }
        lines("weights", weights);
        lines("programs", self.programs.iter().map(Program::sentence).collect());
        let shared = self.shared_data.as_ref().map(|folder| folder.display().to_string());
        lines("test data", vec![shared.unwrap_or_else(|| format!("none: {SHARED_FOLDER} names no folder"))]);
        out
    }
}

impl Program {
    fn sentence(&self) -> String {
        let place = self.path.as_ref().map_or_else(|| "not found".into(), |path| path.display().to_string());
        format!("{} (for {}): {place}", self.name, self.purpose)
    }
}

/// Where a program lies, as a shell would find it.
fn on_path(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file())
}
