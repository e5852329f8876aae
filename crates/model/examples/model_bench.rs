//! Time and processor time of a network's parts on a device, with random weights.
//!
//! `model_bench [PRESET [HEIGHT WIDTH [DEVICE [f32|bf16]]]]`, by default `small 256 256 cpu f32`; `RAYON_NUM_THREADS` sets
//! the threads. Each figure is the least of three runs.
#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program talks to its user")]

use std::time::Instant;

use selenograph_model::{
    Device, Error, Images, Inputs, Model, Output, Parameter, Precision, SavedActivations, Tensor, device,
};
use selenograph_network::layout::{Layout, Part};
use selenograph_network::{Preset, random};

/// Wall time and the process's processor time, seconds; the second tells what a busy machine hides.
#[derive(Clone, Copy)]
struct Clock {
    wall: Instant,
    cpu_s: f64,
}

impl Clock {
    fn now() -> Self {
        // User and system time are the 14th and 15th fields, in hundredths of a second.
        let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
        let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
        let ticks: f64 = fields.filter_map(|v| v.parse::<f64>().ok()).sum();
        Self { wall: Instant::now(), cpu_s: ticks / 100.0 }
    }
}

fn measure(name: &str, device: &Device, work: &mut dyn FnMut()) {
    let mut best = [f64::INFINITY; 2];
    for _ in 0..3 {
        let start = Clock::now();
        work();
        device.sync().unwrap();
        let end = Clock::now();
        best[0] = best[0].min((end.wall - start.wall).as_secs_f64());
        best[1] = best[1].min(end.cpu_s - start.cpu_s);
    }
    println!("{name:42} {:8.3} s wall {:8.2} s processor, {:.2} GB", best[0], best[1], memory_gb());
}

/// The largest resident memory so far.
fn memory_gb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or("0 0");
    line.split_whitespace().nth(1).and_then(|v| v.parse::<f64>().ok()).unwrap_or(0.0) * 1024.0 / 1e9
}

fn loss(outputs: &[Output; 2]) -> Result<Tensor<1>, Error> {
    let sums = outputs.each_ref().map(|output| {
        let descriptors = output.descriptors.clone().map(|each| each.square().slice_dim(3, 0..2).mean());
        let points = (output.points.clone().square().sum_dim(3).squeeze_dim::<3>(3)
            * output.confidence.clone())
        .mean();
        descriptors.map_or(points.clone(), |each| points + each)
    });
    let [a, b] = sums;
    Ok(a + b)
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let arg = |idx: usize, default: &str| args.get(idx).cloned().unwrap_or_else(|| default.into());
    let preset = Preset::from_name(&arg(0, "small")).unwrap();
    let (height, width) = (arg(1, "256").parse().unwrap(), arg(2, "256").parse().unwrap());
    let device = device::parse(&arg(3, "cpu")).unwrap();
    let precision = if arg(4, "f32") == "bf16" { Precision::Bf16 } else { Precision::F32 };
    let config = preset.config();
    let layout = Layout::new(&config).unwrap();
    let model = Model::new(&config, &device, &mut |name| {
        let spec = layout.get(name).unwrap();
        Ok((spec.shape.clone(), random::values(spec, 1)))
    })
    .unwrap()
    .with_precision(precision);
    let values = (0..2 * 3 * height * width).map(|idx| (idx as f32 * 0.731).sin()).collect();
    let images = Images::upright(values, [2, height, width], &device).unwrap();
    println!("{} {height}×{width}, {precision:?}, on {device:?}", preset.name());
    measure("encode two images", &device, &mut || drop(model.encode(&images).unwrap()));
    let all = model.encode(&images).unwrap();
    let (a, b) = (all.select(&[0]).unwrap(), all.select(&[1]).unwrap());
    measure("decode one pair, heads included", &device, &mut || drop(model.decode(&a, &b).unwrap()));
    let tracked = model.tracked(&|_| true);
    measure("the same on the tape", &device, &mut || drop(tracked.decode(&a, &b).unwrap()));
    let frozen = |each: &Parameter| ![Part::PatchEmbed, Part::Encoder].contains(&each.spec().part);
    let features = model.encode_blocks(&images).unwrap();
    let step = |name: &str, learns: &dyn Fn(&Parameter) -> bool, inputs: Inputs<'_>, keep| {
        let mut run = || drop(model.learn::<Error>(learns, inputs, &[[0, 1]], keep, &mut loss).unwrap());
        measure(name, &device, &mut run);
    };
    // What needs least memory first: the figure is the largest so far.
    step(
        "step from features, blocks recomputed",
        &frozen,
        Inputs::Features(&features),
        SavedActivations::BlockInputs,
    );
    step("step from features", &frozen, Inputs::Features(&features), SavedActivations::Everything);
    step("step, blocks recomputed", &|_| true, Inputs::Images(&images), SavedActivations::BlockInputs);
    step("step", &|_| true, Inputs::Images(&images), SavedActivations::Everything);
}
