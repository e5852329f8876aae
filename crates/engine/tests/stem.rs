//! What a convolutional stem adds to the network, against loops that follow the definition.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;

use selenograph_engine::{Encoding, Engine, Error, HeadOutput, Image, Probe, Simd};
use selenograph_network::config::STEM_VARIANCE_FLOOR;
use selenograph_network::layout::{Init, Layout, TensorSpec};
use selenograph_network::{NetworkConfig, Preset, Transformer, random};

/// Of a tensor's largest value: a few sums of some hundred f32 products each, one after the other.
const ROUNDING: f64 = 2e-5;
const HEIGHT: usize = 32;
const WIDTH: usize = 48;

/// A network with a stem, all its widths different, some above and some below those of the kernel's panels and vectors.
fn config() -> NetworkConfig {
    let transformer =
        |dim: usize, num_blocks| Transformer { dim, num_blocks, num_heads: 2, mlp_dim: 2 * dim };
    NetworkConfig {
        stem_dims: Some([5, 70, 12]),
        encoder: transformer(24, 1),
        decoder: transformer(16, 4),
        dpt_dims: [6, 7, 8, 9],
        dpt_fusion_dim: 34,
        dpt_last_dim: 11,
        descriptor_dim: Some(3),
        ..Preset::Hybrid.config()
    }
}

/// Random weights; biases too, so that none can be forgotten.
fn values(spec: &TensorSpec) -> Vec<f32> {
    let init = if spec.init == Init::Zeros { Init::Uniform { bound: 0.3 } } else { spec.init };
    random::values(&TensorSpec { init, ..spec.clone() }, 11)
}

fn engine(config: &NetworkConfig, level: Simd) -> Engine {
    let layout = Layout::new(config).unwrap();
    Engine::with_simd(config, level, &mut |name| {
        let spec = layout.get(name).ok_or("no such tensor")?;
        Ok((spec.shape.clone(), values(spec)))
    })
    .unwrap()
}

/// Every set of instructions that this processor has.
fn engines(config: &NetworkConfig) -> Vec<Engine> {
    let present = [Simd::Plain, Simd::Avx2, Simd::Avx512].into_iter().filter(|level| level.is_present());
    present.map(|level| engine(config, level)).collect()
}

fn pixels(seed: usize) -> Vec<f32> {
    (0..3 * HEIGHT * WIDTH).map(|k| ((k * 7919 + seed * 131) % 255) as f32 / 127.5 - 1.0).collect()
}

fn image(values: &[f32]) -> Image<'_> {
    Image { height_px: HEIGHT, width_px: WIDTH, values }
}

#[derive(Default)]
struct Seen(BTreeMap<String, Map>);

impl Probe for Seen {
    fn see(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        // Tokens are a map of one row.
        let [height, width, channels] = match *shape {
            [tokens, channels] => [1, tokens, channels],
            [height, width, channels] => [height, width, channels],
            _ => panic!("{name}: {shape:?}"),
        };
        self.0.insert(name.to_owned(), Map::new(values, height, width, channels));
    }
}

/// A map, channels last.
#[derive(Clone)]
struct Map {
    height: usize,
    width: usize,
    channels: usize,
    values: Vec<f64>,
}

impl Map {
    fn new(values: &[f32], height: usize, width: usize, channels: usize) -> Self {
        assert_eq!(values.len(), height * width * channels);
        Self { height, width, channels, values: values.iter().copied().map(f64::from).collect() }
    }

    /// From channels first.
    fn of_planes(values: &[f32]) -> Self {
        Self::of(HEIGHT, WIDTH, 3, |y, x, c| f64::from(values[(c * HEIGHT + y) * WIDTH + x]))
    }

    fn of(height: usize, width: usize, channels: usize, value: impl Fn(usize, usize, usize) -> f64) -> Self {
        let each = |idx: usize| {
            let pixel = idx / channels;
            value(pixel / width, pixel % width, idx % channels)
        };
        Self { height, width, channels, values: (0..height * width * channels).map(each).collect() }
    }

    /// Zero outside.
    fn at(&self, y: isize, x: isize, channel: usize) -> f64 {
        match (usize::try_from(y), usize::try_from(x)) {
            (Ok(y), Ok(x)) if y < self.height && x < self.width => {
                self.values[(y * self.width + x) * self.channels + channel]
            }
            _ => 0.0,
        }
    }

    /// A convolution with the tensor of that name: three by three or one by one.
    fn conv(&self, name: &str, stride: usize) -> Self {
        let layout = Layout::new(&config()).unwrap();
        let spec = layout.get(&format!("{name}.weight")).unwrap();
        let &[outputs, inputs, side, _] = spec.shape.as_slice() else { panic!("{name}") };
        assert_eq!(inputs, self.channels, "{name}");
        let weights = values(spec);
        let bias = layout.get(&format!("{name}.bias")).map(values);
        Self::of(self.height / stride, self.width / stride, outputs, |y, x, output| {
            let mut sum = bias.as_ref().map_or(0.0, |bias| f64::from(bias[output]));
            for (tap, channel) in (0..side * side).flat_map(|tap| (0..inputs).map(move |c| (tap, c))) {
                let from = |at: usize, tap: usize| (at * stride + tap) as isize - (side / 2) as isize;
                let weight = weights[(output * inputs + channel) * side * side + tap];
                sum += f64::from(weight) * self.at(from(y, tap / side), from(x, tap % side), channel);
            }
            sum
        })
    }

    fn standardised(&self) -> Self {
        let count = self.values.len() as f64;
        let mean = self.values.iter().sum::<f64>() / count;
        let variance = self.values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / count;
        let one = |v: &f64| (v - mean) / (variance + STEM_VARIANCE_FLOOR).sqrt();
        Self { values: self.values.iter().map(one).collect(), ..self.clone() }
    }

    fn relu(&self) -> Self {
        Self { values: self.values.iter().map(|value| value.max(0.0)).collect(), ..self.clone() }
    }

    fn plus(&self, other: &Self) -> Self {
        assert_eq!([self.height, self.width, self.channels], [other.height, other.width, other.channels]);
        let values = self.values.iter().zip(&other.values).map(|(a, b)| a + b).collect();
        Self { values, ..self.clone() }
    }

    /// Twice the size, bilinear, corners on corners.
    fn doubled(&self) -> Self {
        let source = |at: usize, len: usize| {
            let position = at as f64 * (len - 1) as f64 / (2 * len - 1) as f64;
            (position.floor() as isize, position.fract())
        };
        Self::of(2 * self.height, 2 * self.width, self.channels, |y, x, c| {
            let ((y, down), (x, right)) = (source(y, self.height), source(x, self.width));
            let row = |y: isize| (1.0 - right) * self.at(y, x, c) + right * self.at(y, x + 1, c);
            (1.0 - down) * row(y) + down * row(y + 1)
        })
    }

    fn assert_close(&self, found: &[f32], what: &str) {
        assert_eq!(self.values.len(), found.len(), "{what}");
        let top = self.values.iter().fold(0.0_f64, |top, value| top.max(value.abs()));
        for (idx, (expected, found)) in self.values.iter().zip(found).enumerate() {
            let off = (expected - f64::from(*found)).abs();
            assert!(off <= ROUNDING * top, "{what}: value {idx} off by {off}, largest {top}");
        }
    }
}

/// A level of the stem.
fn level(from: &Map, name: &str) -> Map {
    let x = from.conv(&format!("{name}.down"), 2);
    let inner = x.relu().conv(&format!("{name}.conv1"), 1).relu();
    x.plus(&inner.conv(&format!("{name}.conv2"), 1))
}

/// Tokens from the stem's last map: the layer is a convolution of patches of two by two.
fn tokens(eighth: &Map) -> Map {
    let layout = Layout::new(&config()).unwrap();
    let [weights, bias] =
        ["weight", "bias"].map(|end| values(layout.get(&format!("patch_embed.proj.{end}")).unwrap()));
    let (width, dim) = (eighth.width / 2, config().encoder.dim);
    Map::of(1, eighth.height / 2 * width, dim, |_, token, output| {
        let mut sum = f64::from(bias[output]);
        for idx in 0..4 * eighth.channels {
            let (channel, y, x) = (idx / 4, token / width * 2 + idx / 2 % 2, token % width * 2 + idx % 2);
            let weight = weights[output * 4 * eighth.channels + idx];
            sum += f64::from(weight) * eighth.at(y as isize, x as isize, channel);
        }
        sum
    })
}

#[test]
fn maps_and_tokens_are_what_the_definition_says() {
    let values = pixels(0);
    let half = level(&Map::of_planes(&values).standardised(), "stem.0");
    let quarter = level(&half, "stem.1");
    let expected = tokens(&level(&quarter, "stem.2"));
    for engine in engines(&config()) {
        let mut seen = Seen::default();
        let encoding = engine.encode_probed(&[image(&values)], &mut seen).unwrap().swap_remove(0);
        let maps = encoding.maps.unwrap();
        let name = engine.simd().name();
        half.assert_close(&maps[0], &format!("{name}: half"));
        quarter.assert_close(&maps[1], &format!("{name}: quarter"));
        let found: Vec<f32> = seen.0["patch_embed"].values.iter().map(|value| *value as f32).collect();
        expected.assert_close(&found, &format!("{name}: tokens"));
    }
}

/// A head's joins and outputs, from the intermediates before them.
fn check_head(seen: &Seen, maps: &[Vec<f32>; 2], head: usize, output: &HeadOutput, name: &str) {
    let config = config();
    let [dim_half, dim_quarter, _] = config.stem_dims.unwrap();
    let half = Map::new(&maps[0], HEIGHT / 2, WIDTH / 2, dim_half);
    let quarter = Map::new(&maps[1], HEIGHT / 4, WIDTH / 4, dim_quarter);
    let prefix = format!("downstream_head{head}");
    let scratch = format!("{prefix}.dpt.scratch");
    let saw = |part: &str| &seen.0[&format!("head{head}.{part}")];
    let found = |part: &str| -> Vec<f32> { saw(part).values.iter().map(|value| *value as f32).collect() };

    let joined = saw("act0").conv(&format!("{scratch}.layer1_rn"), 1);
    let joined = joined.plus(&quarter.conv(&format!("{scratch}.stem1_rn"), 1));
    joined.assert_close(&found("layer_rn0"), &format!("{name}: head {head}, level 0"));

    let fused = saw("refinenet1").plus(&half.conv(&format!("{scratch}.stem0_rn"), 1));
    let middle = fused.conv(&format!("{prefix}.dpt.head.0"), 1);
    let features = middle.conv(&format!("{prefix}.dpt.head.2"), 1).relu();
    let map = features.conv(&format!("{prefix}.dpt.head.4"), 1).doubled();
    map.assert_close(&found("dpt_out"), &format!("{name}: head {head}, map"));

    let raw = features.conv(&format!("{prefix}.head_local_features"), 1).doubled();
    let dim = config.descriptor_dim.unwrap();
    let described = Map::of(HEIGHT, WIDTH, dim, |y, x, channel| {
        let (y, x) = (y as isize, x as isize);
        let length = (0..dim).map(|c| raw.at(y, x, c).powi(2)).sum::<f64>().sqrt();
        raw.at(y, x, channel) / length
    });
    described.assert_close(&output.descriptors, &format!("{name}: head {head}, descriptors"));
    let confidence = match config.descriptor_confidence {
        Some(_) => Map::of(HEIGHT, WIDTH, 1, |y, x, _| raw.at(y as isize, x as isize, dim).exp()),
        None => Map::new(&output.confidence, HEIGHT, WIDTH, 1),
    };
    confidence.assert_close(&output.descriptor_confidence, &format!("{name}: head {head}, confidence"));
}

#[test]
fn the_maps_join_the_heads_and_descriptors_come_from_their_features() {
    let values = [pixels(0), pixels(1)];
    for engine in engines(&config()) {
        let encodings = engine.encode(&[image(&values[0]), image(&values[1])]).unwrap();
        let mut seen = Seen::default();
        let pair = (&encodings[0], &encodings[1]);
        let outputs = engine.decode_probed(&[pair], &mut seen).unwrap().swap_remove(0);
        for (idx, (output, encoding)) in outputs.iter().zip(&encodings).enumerate() {
            let maps = encoding.maps.as_ref().unwrap();
            check_head(&seen, maps, idx + 1, output, engine.simd().name());
        }
        // Alone, from a cache, with any number of threads: the same bits.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let again = pool.install(|| engine.infer(image(&values[0]), image(&values[1])).unwrap());
        assert_eq!(again, outputs);
    }
}

#[test]
fn descriptors_may_share_the_confidence_of_the_points_or_be_absent() {
    let shared = NetworkConfig { descriptor_confidence: None, ..config() };
    let without = NetworkConfig { descriptor_dim: None, ..shared.clone() };
    let values = pixels(2);
    for (config, dim) in [(shared, 3), (without, 0)] {
        let [output, _] = engine(&config, Simd::detect()).infer(image(&values), image(&values)).unwrap();
        assert_eq!((output.descriptor_dim, output.descriptors.len()), (dim, dim * HEIGHT * WIDTH));
        let expected = if dim > 0 { output.confidence } else { Vec::new() };
        assert_eq!(output.descriptor_confidence, expected);
    }
}

#[test]
fn encodings_without_their_maps_are_refused() {
    let engine = engine(&config(), Simd::detect());
    let values = pixels(0);
    let whole = engine.encode(&[image(&values)]).unwrap().swap_remove(0);
    let bare = Encoding { maps: None, ..whole.clone() };
    let short = Encoding { maps: whole.maps.clone().map(|[half, _]| [half, Vec::new()]), ..whole.clone() };
    for broken in [bare, short] {
        let error = engine.decode(&[(&whole, &broken)]).unwrap_err();
        assert!(matches!(error, Error::Image { .. }) && error.to_string().contains("maps"), "{error}");
    }
}
