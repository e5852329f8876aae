//! Reads every tensor of a checkpoint, keeps them all, and tells time and memory.
//!
//! ```text
//! python3 crates/network/testdata/full_checkpoint.py full_shapes.json full.pth
//! cargo run --release -p selenograph-network --example read_checkpoint -- full.pth
//! ```
#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use selenograph_network::{Checkpoint, Error};
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Error> {
    let Some(path) = std::env::args_os().nth(1) else {
        println!("usage: read_checkpoint FILE");
        return Ok(());
    };
    let start = Instant::now();
    let checkpoint = Checkpoint::open(Path::new(&path))?;
    checkpoint.check_complete()?;
    println!("{:?}: {} parameters", checkpoint.family(), checkpoint.layout().num_parameters());
    println!("opened after {:.3} s", start.elapsed().as_secs_f64());
    let mut kept = Vec::new();
    for spec in checkpoint.layout().owned() {
        kept.push(checkpoint.read(&spec.name)?);
    }
    let finite = kept.iter().flatten().filter(|value| value.is_finite()).count();
    println!("{finite} finite values read after {:.3} s", start.elapsed().as_secs_f64());
    // Only Linux tells; elsewhere there is nothing to print.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    for line in status.lines().filter(|line| line.starts_with("VmHWM")) {
        let peak_kib: f64 =
            line.split_whitespace().nth(1).and_then(|text| text.parse().ok()).unwrap_or(f64::NAN);
        let file_kib = checkpoint.file_bytes() as f64 / 1024.0;
        println!("peak memory {:.2} GB, {:.3} of the file", peak_kib * 1024.0 / 1e9, peak_kib / file_kib);
    }
    Ok(())
}
