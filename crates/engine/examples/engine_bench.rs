//! Times the network on this machine, part by part; `benches/torch` runs it beside PyTorch.
//!
//! `engine_bench WEIGHTS` packs a checkpoint and obeys the lines it is given, answering each with a line of JSON:
//! `pair HEIGHT WIDTH IMAGES OUTPUTS` (two images as the network wants them, raw f32; both views' outputs, likewise),
//! `match` (their descriptors), `symmetric` (the pair both ways), `gemm`.
//! `engine_bench` alone times the matching of made-up descriptors. `RAYON_NUM_THREADS` sets the threads.
#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program talks to its user")]

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use selenograph_engine::matching::{DescriptorMap, Matcher};
use selenograph_engine::{Engine, GemmBenchmark, HeadOutput, Image, Probe, Stage};
use selenograph_network::Checkpoint;
use serde_json::{Value, json};

/// Subsampling of the matching, as it is published.
const SUBSAMPLE: usize = 8;

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

/// The engine, and the pair it was last given.
struct Bench {
    engine: Engine,
    size_px: (usize, usize),
    images: Vec<f32>,
    outputs: Vec<HeadOutput>,
}

impl Bench {
    fn open(path: &Path) -> Self {
        let checkpoint = Checkpoint::open(path).unwrap();
        checkpoint.check_complete().unwrap();
        let mut source = |name: &str| checkpoint.read_with_shape(name).map_err(Into::into);
        let engine = Engine::new(checkpoint.config(), &mut source).unwrap();
        Self { engine, size_px: (0, 0), images: Vec::new(), outputs: Vec::new() }
    }

    fn image(&self, idx: usize) -> Image<'_> {
        let (height_px, width_px) = self.size_px;
        let len = 3 * height_px * width_px;
        Image { height_px, width_px, values: &self.images[idx * len..][..len] }
    }

    fn pair(&mut self, height_px: usize, width_px: usize, images: &str, outputs: &str) -> Value {
        self.size_px = (height_px, width_px);
        self.images = floats(&std::fs::read(images).unwrap());
        self.outputs.clear();
        let start = Clock::now();
        let encodings = self.engine.encode(&[self.image(0), self.image(1)]).unwrap();
        let encoded = Clock::now();
        let mut stamps = Stamps::default();
        let pair = (&encodings[0], &encodings[1]);
        self.outputs.extend(self.engine.decode_probed(&[pair], &mut stamps).unwrap().swap_remove(0));
        let (decoded, end) = (stamps.decoded.unwrap(), Clock::now());
        let mut file = std::io::BufWriter::new(std::fs::File::create(outputs).unwrap());
        for output in &self.outputs {
            let maps =
                [&output.points, &output.confidence, &output.descriptors, &output.descriptor_confidence];
            for value in maps.into_iter().flatten() {
                file.write_all(&value.to_le_bytes()).unwrap();
            }
        }
        json!({
            "encoder": encoded.since(start), "decoders": decoded.since(encoded), "heads": end.since(decoded),
            "total": end.since(start),
        })
    }

    fn matched(&self) -> Value {
        let map = |idx: usize| {
            let output = &self.outputs[idx];
            let (height_px, width_px, dim) = (output.height_px, output.width_px, output.descriptor_dim);
            DescriptorMap { height_px, width_px, dim, values: &output.descriptors }
        };
        time_matching([map(0), map(1)])
    }

    fn symmetric(&mut self) -> Value {
        // Nobody who wants both ways holds a former result, too.
        self.outputs.clear();
        let (engine, a, b) = (&self.engine, self.image(0), self.image(1));
        json!(seconds(&mut || engine.infer_symmetric(a, b).map(drop).unwrap()))
    }

    fn obey(&mut self, line: &str) -> Value {
        let words: Vec<&str> = line.split_whitespace().collect();
        let whole = |word: &str| word.parse::<usize>().unwrap();
        match words[..] {
            ["pair", height, width, images, outputs] => {
                self.pair(whole(height), whole(width), images, outputs)
            }
            ["symmetric"] => self.symmetric(),
            ["match"] => self.matched(),
            ["gemm"] => json!(gemm_gflop_s()),
            _ => json!({ "error": format!("cannot obey `{line}`") }),
        }
    }
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

/// The rate of products of the encoder's largest shape, by wall time and per core by processor time.
fn gemm_gflop_s() -> [f64; 2] {
    const RUNS: u32 = 6;
    let mut product = GemmBenchmark::new(2048, 1024, 4096);
    let mut best = [f64::INFINITY; 2];
    for _ in 0..3 {
        let spent = seconds(&mut || (0..RUNS).for_each(|_| product.run()));
        best = [0, 1].map(|idx| spent[idx].min(best[idx]));
    }
    best.map(|spent| f64::from(RUNS) * product.num_flops() / spent / 1e9)
}

/// The better of three times.
fn time_matching(maps: [DescriptorMap<'_>; 2]) -> Value {
    let mut count = 0;
    let mut best = [f64::INFINITY; 2];
    for _ in 0..3 {
        let spent = seconds(&mut || {
            count = Matcher::new(maps[0], maps[1]).unwrap().reciprocal(SUBSAMPLE).unwrap().len();
        });
        best = [0, 1].map(|idx| spent[idx].min(best[idx]));
    }
    json!({ "matches": count, "wall_s": best[0], "cpu_s": best[1] })
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

fn made_up() -> Value {
    let side = 512;
    let cases =
        [("smooth", 0.1, 1.0), ("noisy", 0.5, 1.0), ("noise", 1.0, 0.0)].map(|(name, noise_gain, smooth)| {
            let both = [0.0, 9.0].map(|shift| descriptors(side, shift, noise_gain, smooth));
            let map =
                |idx: usize| DescriptorMap { height_px: side, width_px: side, dim: 24, values: &both[idx] };
            (name.to_owned(), time_matching([map(0), map(1)]))
        });
    Value::Object(cases.into_iter().collect())
}

fn main() {
    let Some(path) = std::env::args_os().nth(1) else {
        println!("{}", made_up());
        return;
    };
    let mut bench = None;
    let spent = seconds(&mut || bench = Some(Bench::open(Path::new(&path))));
    let mut bench = bench.unwrap();
    println!(
        "{}",
        json!({
            "simd": bench.engine.simd().name(), "threads": rayon::current_num_threads(),
            "weights_gb": bench.engine.num_weight_bytes() as f64 / 1e9, "packed": spent,
        })
    );
    for line in std::io::stdin().lines() {
        println!("{}", bench.obey(&line.unwrap()));
    }
}
