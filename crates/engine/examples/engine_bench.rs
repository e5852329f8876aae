//! Time of the full-size network on this machine, part by part, with random weights.
//!
//! `engine_bench SHAPES.json`, a map of the full-size checkpoint's tensor names to their shapes;
//! `RAYON_NUM_THREADS` sets the threads.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program talks to its user")]

use std::time::Instant;

use selenograph_engine::{Encoding, Engine, Image, Probe, Stage, Yardstick};
use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};

const RUNS: usize = 3;

/// Stamps the end of the decoders.
#[derive(Default)]
struct Stamps {
    decoded: Option<Instant>,
}

impl Probe for Stamps {
    fn wants_values(&self) -> bool {
        false
    }

    fn finished(&mut self, stage: Stage) {
        if matches!(stage, Stage::DecoderBlock { .. }) {
            self.decoded = Some(Instant::now());
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

fn seconds(work: &mut dyn FnMut()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// The best rate of a product of the encoder's largest shape, GFLOP/s.
fn peak() -> f64 {
    let mut yardstick = Yardstick::new(2048, 1024, 4096);
    let best = (0..8).map(|_| seconds(&mut || yardstick.run())).fold(f64::INFINITY, f64::min);
    yardstick.num_flops() / best / 1e9
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

fn main() {
    let config = full_size();
    println!("threads {}", rayon::current_num_threads());
    let mut engine = None;
    let packing = seconds(&mut || engine = Some(random_engine(&config)));
    let engine = engine.unwrap();
    println!(
        "{}; weights {:.3} GB made and packed in {packing:.1} s; peak memory {:.2} GB",
        engine.simd().name(),
        engine.num_weight_bytes() as f64 / 1e9,
        memory("VmHWM")
    );
    for (height_px, width_px) in [(384, 512), (512, 512)] {
        measure(&config, &engine, height_px, width_px);
    }
    println!("memory now {:.2} GB, peak {:.2} GB", memory("RssAnon"), memory("VmHWM"));
}

fn measure(config: &NetworkConfig, engine: &Engine, height_px: usize, width_px: usize) {
    let top = peak();
    let values: [Vec<f32>; 2] = [1, 2].map(|seed| noise(3 * height_px * width_px, seed).collect());
    let images = [0, 1].map(|idx| Image { height_px, width_px, values: &values[idx] });
    let mut best = [f64::INFINITY; 4];
    for _ in 0..RUNS {
        let start = Instant::now();
        let encodings: Vec<Encoding> = engine.encode(&images).unwrap();
        let encoded = Instant::now();
        let mut stamps = Stamps::default();
        engine.decode_probed(&[(&encodings[0], &encodings[1])], &mut stamps).unwrap();
        let end = Instant::now();
        let decoded = stamps.decoded.unwrap();
        let spans = [encoded - start, decoded - encoded, end - decoded, end - start];
        for (best, span) in best.iter_mut().zip(spans) {
            *best = best.min(span.as_secs_f64());
        }
    }
    let work = gflop(config, height_px, width_px);
    let total: f64 = work.iter().sum();
    println!("{height_px}x{width_px}: peak of GEMM {top:.0} GFLOP/s; best of {RUNS}:");
    for ((name, work), time) in
        ["encoder", "decoders", "heads", "all"].iter().zip(work.iter().chain(&[total])).zip(best)
    {
        println!(
            "  {name:9} {time:7.3} s  {work:6.0} GFLOP  {:5.0} GFLOP/s  {:4.0} % of peak",
            work / time,
            100.0 * work / time / top
        );
    }
    let encodings = engine.encode(&images).unwrap();
    let (a, b) = (&encodings[0], &encodings[1]);
    let symmetric = seconds(&mut || drop(engine.infer_symmetric(images[0], images[1]).unwrap()));
    let cached = seconds(&mut || drop(engine.decode(&[(a, b)]).unwrap()));
    println!("  symmetric pair {symmetric:.3} s; from cached encodings {cached:.3} s");
}
