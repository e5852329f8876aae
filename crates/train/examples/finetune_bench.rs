//! Time and memory of whole training steps with a frozen encoder, part by part; `benches/torch` runs it beside PyTorch.
//!
//! `finetune_bench [PRESET [HEIGHT WIDTH [STEPS [everything|inputs [WEIGHTS BATCH]]]]]`, by default
//! `small 256 256 2 everything`: one pair, both ways, with 8192 matches; `inputs` keeps what goes into each block only.
//! WEIGHTS is read (random weights without it); BATCH, the pair as the losses see it, is written. `RAYON_NUM_THREADS` sets
//! the threads. Each step and each part of it is a line of JSON: seconds by the wall and of the processor, and the largest
//! resident memory while it ran.
#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program talks to its user")]

use std::path::Path;
use std::time::Instant;

use burn_tensor::Device;
use selenograph_dataset::correspondence::Matches;
use selenograph_dataset::rng::{Stream, rng};
use selenograph_dataset::sample::{Provenance, TrainingPair, TrainingView, ViewTruth};
use selenograph_geometry::{Camera, Matrix3, Point3, Rigid3};
use selenograph_model::{Model, SavedActivations};
use selenograph_network::layout::Layout;
use selenograph_network::safetensors::{Entry, Writer};
use selenograph_network::{Checkpoint, ElementType, Preset, random};
use selenograph_raster::Raster;
use selenograph_train::batch::{AssemblySettings, HostBatch};
use selenograph_train::loss::training_loss;
use selenograph_train::network::PairNetwork;
use selenograph_train::optimizer::AdamW;
use selenograph_train::run::TrainSettings;
use selenograph_train::run::memory::MemoryEstimate;
use selenograph_train::{Frozen, ModelNetwork};
use serde_json::json;

/// Of the paper.
const MATCHES: usize = 8192;

/// Seconds by the wall and of the processor since the last look, and the most memory since then.
struct Watch {
    wall: Instant,
    cpu_s: f64,
}

impl Watch {
    fn start() -> Self {
        // From here on the system records a new maximum.
        let _ = std::fs::write("/proc/self/clear_refs", "5");
        let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
        let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
        let ticks: f64 = fields.filter_map(|v| v.parse::<f64>().ok()).sum();
        // User and system time, in hundredths of a second.
        Self { wall: Instant::now(), cpu_s: ticks / 100.0 }
    }

    fn lap(&mut self, part: &str) -> f64 {
        let peak_gb = memory_gb("VmHWM");
        let last = std::mem::replace(self, Self::start());
        let wall_s = (self.wall - last.wall).as_secs_f64();
        let cpu_s = self.cpu_s - last.cpu_s;
        println!(
            "{}",
            json!({"part": part, "wall_s": wall_s, "cpu_s": cpu_s, "peak_gb": peak_gb, "after_gb": memory_gb("VmRSS")})
        );
        peak_gb
    }
}

fn memory_gb(key: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(key)).unwrap_or("0 0");
    line.split_whitespace().nth(1).and_then(|v| v.parse::<f64>().ok()).unwrap_or(0.0) * 1024.0 / 1e9
}

/// Noise for pictures, a rolling ground for truth.
fn view(width: usize, height: usize, offset_m: f64, stream: &mut Stream) -> TrainingView {
    let origin = Point3::new(offset_m, 0.0, 1000.0);
    let world_from_cam =
        Rigid3::from_matrix(&Matrix3::from_diagonal(&[1.0, -1.0, -1.0].into()), origin).unwrap();
    TrainingView {
        rgb: Raster::from_fn(width, height, |_, _| [0, 1, 2].map(|_| stream.index(256) as u8)),
        camera: Camera::from_fov(width, height, 1.0).unwrap(),
        truth: ViewTruth {
            depth_z: Raster::from_fn(width, height, |x, y| {
                100.0 + 5.0 * (0.02 * x as f32).sin() * (0.03 * y as f32).cos()
            }),
            world_from_cam,
        },
    }
}

/// A pair with matches anywhere, half of them false.
fn pair(width: usize, height: usize) -> TrainingPair {
    let mut stream = rng(1, "finetune_bench", 0, "pair");
    let views = [0.0, 10.0].map(|offset_m| view(width, height, offset_m, &mut stream));
    let mut anywhere = || -> Vec<[u32; 2]> {
        (0..MATCHES).map(|_| [width, height].map(|side| stream.index(side) as u32)).collect()
    };
    let matches =
        Matches { a: anywhere(), b: anywhere(), valid: (0..MATCHES).map(|n| n < MATCHES / 2).collect() };
    TrainingPair { views, matches, is_metric: false, provenance: Provenance::default() }
}

/// Pictures, points and matches, for whoever computes the same.
fn write_batch(path: &Path, batch: &HostBatch, pair: &TrainingPair) {
    let width = pair.views[0].camera.width;
    let flat = |pixels: &[[u32; 2]]| -> Vec<f32> {
        pixels.iter().map(|[x, y]| (*y as usize * width + *x as usize) as f32).collect()
    };
    let matches = &pair.matches;
    let pixels = [flat(&matches.a), flat(&matches.b)];
    let valid: Vec<f32> = matches.valid.iter().map(|valid| f32::from(u8::from(*valid))).collect();
    let mut arrays = batch.arrays();
    arrays.push(("pixels_a", vec![MATCHES], &pixels[0]));
    arrays.push(("pixels_b", vec![MATCHES], &pixels[1]));
    arrays.push(("valid", vec![MATCHES], &valid));
    let entry = |(name, shape, _): &(&str, Vec<usize>, &[f32])| Entry {
        name: (*name).to_owned(),
        element: ElementType::F32,
        shape: shape.clone(),
    };
    let mut writer =
        Writer::create(path, arrays.iter().map(entry).collect(), &std::collections::BTreeMap::new()).unwrap();
    for (_, _, values) in &arrays {
        writer.write(values).unwrap();
    }
    writer.finish().unwrap();
}

fn model(preset: Preset, weights: Option<&String>) -> Model {
    let device = Device::flex();
    if let Some(path) = weights {
        let checkpoint = Checkpoint::open(Path::new(path)).unwrap();
        return Model::new(checkpoint.config(), &device, &mut |name| Ok(checkpoint.read_with_shape(name)?))
            .unwrap();
    }
    let config = preset.config();
    let layout = Layout::new(&config).unwrap();
    let mut source = |name: &str| {
        let spec = layout.get(name).unwrap();
        Ok((spec.shape.clone(), random::values(spec, 1)))
    };
    Model::new(&config, &device, &mut source).unwrap()
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let arg = |idx: usize, default: &str| args.get(idx).cloned().unwrap_or_else(|| default.into());
    let preset = Preset::from_name(&arg(0, "small")).unwrap();
    let (height, width) = (arg(1, "256").parse().unwrap(), arg(2, "256").parse().unwrap());
    let num_steps: usize = arg(3, "2").parse().unwrap();
    let recompute = arg(4, "everything") == "inputs";
    let keep = if recompute { SavedActivations::BlockInputs } else { SavedActivations::Everything };

    let pair = pair(width, height);
    let settings = AssemblySettings { match_block: MATCHES, epipolar: false };
    let mut stream = rng(1, "finetune_bench", 0, "matches");
    let batch = HostBatch::assemble(std::slice::from_ref(&pair), &settings, &mut stream).unwrap();
    if let Some(path) = args.get(6) {
        write_batch(Path::new(path), &batch, &pair);
    }
    let mut watch = Watch::start();
    // What `features` keeps, `learn` finds: so the encoder is timed by itself.
    let mut network = ModelNetwork::new(model(preset, args.get(5)), Frozen::Encoder, keep, None, "a bench")
        .with_encoding_cache(64 << 20);
    watch.lap("load");
    let settings = TrainSettings { recompute, ..TrainSettings::default() };
    let estimate = MemoryEstimate::new(&network, &settings, [height, width], MATCHES, 1);
    println!(
        "{}",
        json!({"estimate_gb": estimate.bytes(1) as f64 / 1e9, "parameters_gb": estimate.parameters as f64 / 1e9})
    );
    let targets = batch.targets(&network.device());
    let mut optimizer = AdamW::new(settings.optimizer);
    let mut images = batch.images.clone();
    for step in 1..=num_steps {
        // Another picture each time, so that none is found among those kept, and almost the same loss.
        images.values[0] = step as f32 / 256.0;
        watch.lap("between");
        let mut peak_gb = 0.0f64;
        network.features(&images).unwrap();
        peak_gb = peak_gb.max(watch.lap("encode"));
        let mut total = f32::NAN;
        let gradients = network
            .learn(&images, &mut |output| {
                peak_gb = peak_gb.max(watch.lap("forward"));
                let loss = training_loss(output, &targets, &settings.loss);
                total = loss.total.clone().inner().into_scalar::<f32>();
                peak_gb = peak_gb.max(watch.lap("loss"));
                Ok(loss.total)
            })
            .unwrap();
        peak_gb = peak_gb.max(watch.lap("backward"));
        optimizer.step(&mut network, gradients, settings.learning_rate).unwrap();
        peak_gb = peak_gb.max(watch.lap("optimizer"));
        println!("{}", json!({"step": step, "loss": total, "peak_gb": peak_gb}));
    }
}
