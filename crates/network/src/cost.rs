//! What a forward pass costs, from the network's dimensions alone.

use crate::config::{IMAGE_CHANNELS, NetworkConfig, POINT_CHANNELS, Transformer};

/// Which ways a pair is decoded; each picture is encoded once either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Directions {
    /// Both views in the frame of the first.
    #[default]
    Forward,
    /// Then also in that of the second.
    Both,
}

impl Directions {
    /// Passes through the decoders and the heads.
    pub fn count(self) -> usize {
        match self {
            Self::Forward => 1,
            Self::Both => 2,
        }
    }
}

/// Floating-point operations of a pair, two for each multiplication with its addition; normalisations, activations and
/// interpolation, a percent at most, are left out.
///
/// # Source
/// The architecture as published; an executor that reorders linear layers may need fewer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flops {
    /// Patches, or the stem and its tokens, and the encoder, both pictures.
    pub encoder: f64,
    /// Both decoders.
    pub decoders: f64,
    /// Both heads: points and descriptors.
    pub heads: f64,
}

impl Flops {
    /// Of a pair of inputs, `[width, height]` in pixels each, whole patches.
    pub fn of_pair(config: &NetworkConfig, inputs: [[usize; 2]; 2], directions: Directions) -> Self {
        let grids = inputs.map(|[width, height]| Grid {
            width: (width / config.patch_px) as f64,
            height: (height / config.patch_px) as f64,
        });
        let [a, b] = grids.map(|grid| grid.width * grid.height);
        let decoders = decoder(config, a, b) + decoder(config, b, a);
        let heads: f64 = grids.iter().map(|grid| points(config, *grid) + descriptors(config, *grid)).sum();
        let passes = directions.count() as f64;
        // A multiplication and an addition.
        Self {
            encoder: 2.0 * (encoder(config, a) + encoder(config, b)),
            decoders: 2.0 * passes * decoders,
            heads: 2.0 * passes * heads,
        }
    }

    /// All of them.
    pub fn total(&self) -> f64 {
        self.encoder + self.decoders + self.heads
    }
}

/// Patches of an input.
#[derive(Clone, Copy)]
struct Grid {
    width: f64,
    height: f64,
}

/// Multiplications of attention's two products: `queries` tokens look at `keys` tokens.
fn attention(queries: f64, keys: f64, dim: usize) -> f64 {
    2.0 * queries * keys * dim as f64
}

/// Multiplications of a block without cross-attention.
fn block(shape: &Transformer, tokens: f64) -> f64 {
    let (dim, mlp) = (shape.dim as f64, shape.mlp_dim as f64);
    tokens * (4.0 * dim * dim + 2.0 * dim * mlp) + attention(tokens, tokens, shape.dim)
}

fn encoder(config: &NetworkConfig, tokens: f64) -> f64 {
    let [channels, side] = config.token_input();
    let patch = channels * side * side * config.encoder.dim;
    tokens * (patch as f64 + stem(config)) + config.encoder.num_blocks as f64 * block(&config.encoder, tokens)
}

/// Multiplications of the stem for each token: three convolutions of three by three at each of its levels.
fn stem(config: &NetworkConfig) -> f64 {
    let mut inputs = IMAGE_CHANNELS as f64;
    let mut pixels = config.patch_area() as f64;
    config.stem_dims.into_iter().flatten().fold(0.0, |sum, dim| {
        let dim = dim as f64;
        pixels /= 4.0;
        let level = pixels * 9.0 * dim * (inputs + 2.0 * dim);
        inputs = dim;
        sum + level
    })
}

/// Of one view's decoder: its tokens look at `other` tokens of the other view.
fn decoder(config: &NetworkConfig, tokens: f64, other: f64) -> f64 {
    let shape = &config.decoder;
    let dim = shape.dim as f64;
    let cross = 2.0 * (tokens + other) * dim * dim + attention(tokens, other, shape.dim);
    tokens * config.encoder.dim as f64 * dim + shape.num_blocks as f64 * (block(shape, tokens) + cross)
}

/// Of one view's point head.
fn points(config: &NetworkConfig, grid: Grid) -> f64 {
    let dims = config.dpt_dims.map(|dim| dim as f64);
    let (fusion, half, last) =
        (config.dpt_fusion_dim as f64, config.dpt_half_dim() as f64, config.dpt_last_dim as f64);
    let (enc, dec) = (config.encoder.dim as f64, config.decoder.dim as f64);
    let tokens = grid.width * grid.height;
    let coarse = (grid.width / 2.0).ceil() * (grid.height / 2.0).ceil();
    let levels = [16.0 * tokens, 4.0 * tokens, tokens, coarse];
    let reduce = tokens * (enc * dims[0] + dec * (dims[1] + dims[2] + dims[3]));
    let resample =
        tokens * (16.0 * dims[0] * dims[0] + 4.0 * dims[1] * dims[1]) + coarse * 9.0 * dims[3] * dims[3];
    let square = fusion * fusion;
    let fused: f64 = (0..4)
        .map(|level| {
            // The coarsest level has nothing to join: one residual unit of two convolutions instead of two.
            let convolutions = if level == 3 { 2.0 } else { 4.0 };
            // The projection reads the enlarged map.
            levels[level] * (9.0 * dims[level] * fusion + convolutions * 9.0 * square + 4.0 * square)
        })
        .sum();
    let fine = 64.0 * tokens;
    let joined = config
        .stem_dims
        .map_or(0.0, |[half, quarter, _]| fusion * (fine * half as f64 + levels[0] * quarter as f64));
    let pixels = tokens * config.patch_area() as f64;
    // With a stem the last layers work at half the size.
    let pixels = if config.stem_dims.is_some() { fine } else { pixels };
    let finish = fine * 9.0 * fusion * half + pixels * (9.0 * half * last + last * POINT_CHANNELS as f64);
    reduce + resample + fused + joined + finish
}

/// Of one view's descriptor head.
fn descriptors(config: &NetworkConfig, grid: Grid) -> f64 {
    let outputs = config.descriptor_channels().unwrap_or(0) * config.patch_area();
    if outputs == 0 {
        return 0.0;
    }
    if config.stem_dims.is_some() {
        return grid.width * grid.height * (config.dpt_last_dim * outputs) as f64 / 4.0;
    }
    let hidden = config.descriptor_hidden_dim();
    grid.width * grid.height * (hidden * (config.descriptor_input_dim() + outputs)) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preset;
    use crate::layout::{Layout, Part, Purpose};

    /// The table of published figures gives whole GFLOP.
    const ROUNDING: f64 = 0.5;

    #[test]
    fn the_published_network_costs_what_is_stated() {
        let config = Preset::Mast3rVitl.config();
        let stated =
            [([512, 512], [1446.0, 622.0, 738.0, 2806.0]), ([512, 384], [1046.0, 437.0, 554.0, 2037.0])];
        for (size, expected) in stated {
            let flops = Flops::of_pair(&config, [size; 2], Directions::Forward);
            let found = [flops.encoder, flops.decoders, flops.heads, flops.total()].map(|flop| flop / 1e9);
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() <= ROUNDING, "{size:?}: {found} instead of {expected}");
            }
        }
    }

    /// How often a view's pass multiplies with each value of a weight, by the weight's name.
    fn applications(name: &str, [width, height]: [usize; 2], other: usize, has_stem: bool) -> usize {
        let tokens = width * height;
        let levels = [16 * tokens, 4 * tokens, tokens, width.div_ceil(2) * height.div_ceil(2)];
        let digit_after = |start: &str| {
            let (_, rest) = name.split_once(start)?;
            rest.chars().next()?.to_digit(10).map(|digit| digit as usize)
        };
        let has = |part: &str| name.contains(part);
        if has("projk") || has("projv") {
            other
        } else if let Some(level) = digit_after("scratch.stem") {
            [64, 16][level] * tokens
        } else if let Some(level) = digit_after("stem.") {
            [64, 16, 4][level] * tokens
        } else if let Some(level) = digit_after("scratch.layer") {
            levels[level - 1]
        } else if let Some(level) = digit_after("refinenet") {
            // The projection reads the enlarged map.
            levels[level - 1] * if has("out_conv") { 4 } else { 1 }
        } else if has("act_postprocess.3.1") {
            levels[3]
        } else if has("dpt.head.0") || (has_stem && (has("dpt.head.") || has("head_local_features"))) {
            64 * tokens
        } else if has("dpt.head.") {
            256 * tokens
        } else {
            tokens
        }
    }

    #[test]
    fn every_weight_is_counted_as_often_as_it_is_used() {
        let grids = [[4, 3], [2, 5]];
        let inputs = grids.map(|grid| grid.map(|side| 16 * side));
        for preset in [Preset::Hybrid, Preset::Tiny] {
            let config = preset.config();
            let mut products = [0; 3];
            for view in 0..2 {
                let [tokens, other] = [view, 1 - view].map(|view: usize| grids[view][0] * grids[view][1]);
                for spec in Layout::new(&config).unwrap().owned() {
                    let stage = match spec.part {
                        Part::Stem | Part::PatchEmbed | Part::Encoder => 0,
                        Part::DecoderEmbed | Part::Decoder1 | Part::Decoder2 => 1,
                        _ => 2,
                    };
                    // What a view does not pass through is the other view's.
                    let of_other = match spec.part {
                        Part::Decoder1 | Part::Head1Points | Part::Head1Descriptors => view == 1,
                        Part::Decoder2 | Part::Head2Points | Part::Head2Descriptors => view == 0,
                        _ => false,
                    };
                    if spec.shape.len() < 2 || spec.purpose != Purpose::Computed || of_other {
                        continue;
                    }
                    let has_stem = config.stem_dims.is_some();
                    products[stage] += spec.len() * applications(&spec.name, grids[view], other, has_stem);
                }
                let (enc, dec) = (config.encoder, config.decoder);
                products[0] += enc.num_blocks * 2 * tokens * tokens * enc.dim;
                products[1] += dec.num_blocks * 2 * tokens * (tokens + other) * dec.dim;
            }
            let flops = Flops::of_pair(&config, inputs, Directions::Forward);
            let found = [flops.encoder, flops.decoders, flops.heads];
            assert_eq!(found, products.map(|count| 2.0 * count as f64), "{}", preset.name());
        }
    }

    #[test]
    fn pairs_are_symmetric_and_a_second_direction_saves_the_encoder() {
        let config = Preset::Small.config();
        let (wide, tall) = ([96, 48], [32, 80]);
        let forward = Flops::of_pair(&config, [wide, tall], Directions::Forward);
        assert_eq!(forward, Flops::of_pair(&config, [tall, wide], Directions::Forward));
        let both = Flops::of_pair(&config, [wide, tall], Directions::Both);
        assert_eq!(both.encoder, forward.encoder);
        assert_eq!((both.decoders, both.heads), (2.0 * forward.decoders, 2.0 * forward.heads));
    }

    #[test]
    fn without_descriptors_the_heads_are_cheaper() {
        let mut config = Preset::Tiny.config();
        let with = Flops::of_pair(&config, [[64, 64]; 2], Directions::Forward);
        config.descriptor_dim = None;
        let without = Flops::of_pair(&config, [[64, 64]; 2], Directions::Forward);
        assert!(without.heads < with.heads && without.encoder == with.encoder);
    }
}
