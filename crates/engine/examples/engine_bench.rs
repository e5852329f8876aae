//! Time of the full-size network on this machine, part by part, with random weights.
//!
//! `engine_bench SHAPES.json [RUNS]`, a map of the full-size checkpoint's tensor names to their shapes (without it
//! matching alone is timed);
//! `RAYON_NUM_THREADS` sets the threads.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program talks to its user")]

use std::time::Instant;

use selenograph_engine::matching::{DescriptorMap, Matcher};
use selenograph_engine::{Encoding, Engine, Image, Probe, Stage, Yardstick};
use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};

/// Stamps the end of the decoders.
#[derive(Default)]
struct Stamps {
    decoded: Option<Clock>,
}

impl Probe for Stamps {
    fn wants_values(&self) -> bool {
        false
    }

    fn finished(&mut self, stage: Stage) {
        if matches!(stage, Stage::DecoderBlock { .. }) {
            self.decoded = Some(Clock::now());
        }
    }
}

fn full_size() -> NetworkConfig {
    NetworkConfig {
        patch_px: 16,
        encoder: Transformer { dim: 1024, num_blocks: 24, num_heads: 16, mlp_dim: 4096 },
        decoder: Transformer { dim: 768, num_blocks: 12, num_heads: 12, mlp_dim: 3072 },
        rope_base: 100.0,
        dpt_dims: [96, 192, 384, 768],
        dpt_fusion_dim: 256,
        dpt_last_dim: 128,
        descriptor_dim: Some(24),
        depth_mode: DepthMode::Exp,
        confidence: ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY },
        descriptor_confidence: Some(ConfidenceMode::Exp { min: 0.0, max: f64::INFINITY }),
    }
}

/// Numbers from −1 to 1 that look random.
fn noise(count: usize, seed: u64) -> impl Iterator<Item = f32> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    (0..count).map(move |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    })
}

/// Values scaled as initialisations do.
fn random_engine(config: &NetworkConfig) -> Engine {
    let shapes = std::fs::read_to_string(std::env::args_os().nth(1).unwrap()).unwrap();
    let shapes: std::collections::HashMap<String, Vec<usize>> = serde_json::from_str(&shapes).unwrap();
    let mut seed = 0;
    Engine::new(config, &mut |name| {
        let shape = shapes.get(name).ok_or_else(|| format!("no tensor `{name}`"))?.clone();
        let count: usize = shape.iter().product();
        seed += 1;
        let (gain, offset) = match (shape.len(), name.ends_with("weight")) {
            (1, true) => (0.1, 1.0),
            (1, false) => (0.02, 0.0),
            _ => ((1.0 / (count / shape[0]) as f32).sqrt(), 0.0),
        };
        Ok((shape, noise(count, seed).map(|v| v * gain + offset).collect()))
    })
    .unwrap()
}

/// Wall time and the process's processor time, both in seconds: the second tells what a busy machine hides.
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

    fn since(self, start: Self) -> [f64; 2] {
        [(self.wall - start.wall).as_secs_f64(), self.cpu_s - start.cpu_s]
    }
}

fn seconds(work: &mut dyn FnMut()) -> [f64; 2] {
    let start = Clock::now();
    work();
    Clock::now().since(start)
}

fn smaller(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].min(b[1])]
}

/// The rate of products of the encoder's largest shape, GFLOP/s by wall time and per core by processor time.
fn peak() -> [f64; 2] {
    let mut yardstick = Yardstick::new(2048, 1024, 4096);
    let mut best = [f64::INFINITY; 2];
    for _ in 0..3 {
        let runs = 6;
        let spent = seconds(&mut || (0..runs).for_each(|_| yardstick.run()));
        best = smaller(best, spent.map(|s| s / f64::from(runs)));
    }
    best.map(|s| yardstick.num_flops() / s / 1e9)
}

/// Of a transformer's block per token, without attention's products; and of these per pair of tokens.
fn block_gflop(shape: &Transformer, cross: bool, tokens: f64) -> f64 {
    let (dim, mlp) = (shape.dim as f64, shape.mlp_dim as f64);
    let attentions = if cross { 2.0 } else { 1.0 };
    (tokens * (attentions * 8.0 * dim * dim + 4.0 * dim * mlp) + attentions * 4.0 * tokens * tokens * dim)
        / 1e9
}

/// GFLOP of a pair: encoder, decoders, heads.
fn gflop(config: &NetworkConfig, height_px: usize, width_px: usize) -> [f64; 3] {
    let tokens = (height_px * width_px / 256) as f64;
    let encoder = 2.0 * config.encoder.num_blocks as f64 * block_gflop(&config.encoder, false, tokens);
    let decoders = 2.0 * config.decoder.num_blocks as f64 * block_gflop(&config.decoder, true, tokens);
    // The two parts of a head scale with the tokens; the figures are those of 1024 tokens.
    let heads = 2.0 * (249.0 + 120.0) * tokens / 1024.0;
    [encoder, decoders, heads]
}

fn memory(field: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(field)).unwrap_or("0 0");
    line.split_whitespace().nth(1).and_then(|v| v.parse::<f64>().ok()).unwrap_or(0.0) * 1024.0 / 1e9
}

/// Two images' descriptors: smooth fields seen with a shift, and some noise; or nothing but noise.
fn descriptors(side: usize, shift: f32, noise_gain: f32, smooth: f32) -> Vec<f32> {
    const DIM: usize = 24;
    let mut values: Vec<f32> = noise(side * side * DIM, 7 + shift as u64).map(|v| v * noise_gain).collect();
    for (pixel, row) in values.chunks_exact_mut(DIM).enumerate() {
        let (x, y) = ((pixel % side) as f32 + shift, (pixel / side) as f32);
        for (k, value) in row.iter_mut().enumerate() {
            let (a, b) = ((k * 7 % 11) as f32 - 5.0, (k * 5 % 13) as f32 - 6.0);
            *value += smooth * ((a * x + b * y) * 0.012 + k as f32).sin();
        }
        let length = row.iter().map(|v| v * v).sum::<f32>().sqrt();
        row.iter_mut().for_each(|v| *v /= length);
    }
    values
}

fn measure_matching() {
    let side = 512;
    for (name, noise_gain, smooth) in [("smooth", 0.1, 1.0), ("noisy", 0.5, 1.0), ("pure noise", 1.0, 0.0)] {
        let both = [0.0, 9.0].map(|shift| descriptors(side, shift, noise_gain, smooth));
        let map = |idx: usize| DescriptorMap { height_px: side, width_px: side, dim: 24, values: &both[idx] };
        let mut count = 0;
        let mut best = [f64::INFINITY; 2];
        for _ in 0..3 {
            let spent = seconds(&mut || {
                count = Matcher::new(map(0), map(1)).unwrap().reciprocal(8).unwrap().len();
            });
            best = smaller(best, spent);
        }
        println!("matching 512x512, {name}: {count} matches, {best:.3?} s (wall, processor)");
    }
}

fn main() {
    measure_matching();
    if std::env::args_os().len() < 2 {
        return;
    }
    let config = full_size();
    println!("threads {}", rayon::current_num_threads());
    let mut engine = None;
    let [packing, _] = seconds(&mut || engine = Some(random_engine(&config)));
    let engine = engine.unwrap();
    println!(
        "{}; weights {:.3} GB made and packed in {packing:.1} s; peak memory {:.2} GB",
        engine.simd().name(),
        engine.num_weight_bytes() as f64 / 1e9,
        memory("VmHWM")
    );
    let runs = std::env::args_os().nth(2).and_then(|v| v.to_str()?.parse().ok()).unwrap_or(3);
    for (height_px, width_px) in [(384, 512), (512, 512)] {
        measure(&config, &engine, (height_px, width_px), runs);
    }
    println!("anonymous memory now {:.2} GB, peak {:.2} GB", memory("RssAnon"), memory("VmHWM"));
}

fn measure(config: &NetworkConfig, engine: &Engine, (height_px, width_px): (usize, usize), runs: usize) {
    let top = peak();
    let values: [Vec<f32>; 2] = [1, 2].map(|seed| noise(3 * height_px * width_px, seed).collect());
    let images = [0, 1].map(|idx| Image { height_px, width_px, values: &values[idx] });
    let mut best = [[f64::INFINITY; 2]; 4];
    let mut encodings: Vec<Encoding> = Vec::new();
    for _ in 0..runs {
        let start = Clock::now();
        encodings = engine.encode(&images).unwrap();
        let encoded = Clock::now();
        let mut stamps = Stamps::default();
        engine.decode_probed(&[(&encodings[0], &encodings[1])], &mut stamps).unwrap();
        let end = Clock::now();
        let decoded = stamps.decoded.unwrap();
        let spans = [encoded.since(start), decoded.since(encoded), end.since(decoded), end.since(start)];
        for (best, span) in best.iter_mut().zip(spans) {
            *best = smaller(*best, span);
        }
    }
    let work = gflop(config, height_px, width_px);
    let all = [work[0], work[1], work[2], work.iter().sum()];
    println!("{height_px}x{width_px}: GEMM {:.0} GFLOP/s, {:.0} per core; best of {runs}:", top[0], top[1]);
    for ((name, work), time) in ["encoder", "decoders", "heads", "all"].iter().zip(all).zip(best) {
        let rates = [work / time[0], work / time[1]];
        println!(
            "  {name:9} {:7.3} s, {:7.2} processor s  {work:5.0} GFLOP  {:4.0} GFLOP/s = {:3.0} % of GEMM; {:3.0} % by processor time",
            time[0],
            time[1],
            rates[0],
            100.0 * rates[0] / top[0],
            100.0 * rates[1] / top[1],
        );
    }
    let (a, b) = (&encodings[0], &encodings[1]);
    let symmetric = seconds(&mut || drop(engine.infer_symmetric(images[0], images[1]).unwrap()));
    let cached = seconds(&mut || drop(engine.decode(&[(a, b)]).unwrap()));
    println!("  symmetric pair {symmetric:.2?} s; from cached encodings {cached:.2?} s (wall, processor)");
}
