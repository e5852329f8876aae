//! Memory that a network will take, from its dimensions alone: the pool's bookkeeping without its memory.
//!
//! The functions below take and give back what the layers of the same name do, in their order.

use selenograph_network::config::{IMAGE_CHANNELS, NetworkConfig, Transformer};
use selenograph_network::cost::Directions;
use selenograph_network::layout::{Layout, Purpose, TensorSpec};

use crate::attention;
use crate::buffer::{choose, padded};
use crate::dpt::MAP_CHANNELS;
use crate::error::{Error, Result};
use crate::gemm;
use crate::packed::Packed;
use crate::upsample;

/// Bytes of a value.
const F32: usize = size_of::<f32>();
/// After two blocks the pool holds what all of them need.
const BLOCKS_UNTIL_STEADY: usize = 2;

/// Bytes that [`Engine`](crate::Engine) takes for a pair; pictures and checkpoint are the caller's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryFootprint {
    /// Held from loading on: packed weights.
    pub weights: usize,
    /// While loading, on top of the weights at most: the largest tensor as the checkpoint has it.
    pub loading: usize,
    /// While running, on top of the weights: buffers, each thread's scratch memory, encodings and results.
    pub running: usize,
    /// The part of `running` that is handed out: both views' points, descriptors and confidences.
    pub results: usize,
}

impl MemoryFootprint {
    /// For a pair of inputs, `[width, height]` in pixels each, whole patches.
    ///
    /// # Errors
    /// Dimensions that no network has.
    pub fn of_pair(
        config: &NetworkConfig,
        inputs: [[usize; 2]; 2],
        directions: Directions,
        num_threads: usize,
    ) -> Result<Self> {
        let layout = Layout::new(config).map_err(|error| Error::Config {
            what: "network",
            expected: "dimensions of a network".to_owned(),
            found: error.to_string(),
        })?;
        let read = || layout.owned().filter(|spec| spec.purpose == Purpose::Computed);
        let pass = Pass { config, grids: inputs.map(|side| side.map(|px| px / config.patch_px)), directions };
        let mut ledger = Ledger::default();
        pass.encode(&mut ledger);
        pass.decode(&mut ledger);
        Ok(Self {
            weights: read().map(weight_bytes).sum(),
            loading: F32 * read().map(TensorSpec::len).max().unwrap_or(0),
            running: F32 * (ledger.peak + num_threads * pass.scratch()),
            results: F32
                * directions.count()
                * pass.grids.iter().map(|grid| pass.result(*grid)).sum::<usize>(),
        })
    }

    /// The most that is held at any moment.
    #[must_use]
    pub fn peak(&self) -> usize {
        self.weights + self.loading.max(self.running)
    }
}

/// Bytes of what becomes of a tensor (a packed layer's bias comes with its weight).
fn weight_bytes(spec: &TensorSpec) -> usize {
    let ends_with = |endings: &[&str]| endings.iter().any(|ending| spec.name.ends_with(ending));
    match spec.shape[..] {
        [len] if spec.name.contains("norm") => F32 * len,
        // Keys and values are one layer.
        [outputs, inputs] if ends_with(&["projk.weight"]) => Packed::bytes_of(inputs, 2 * outputs),
        [_, _] if ends_with(&["projv.weight"]) => 0,
        [outputs, inputs] => Packed::bytes_of(inputs, outputs),
        // Transposed convolutions: a layer to all pixels of the patch.
        [inputs, outputs, height, width]
            if ends_with(&["postprocess.0.1.weight", "postprocess.1.1.weight"]) =>
        {
            Packed::bytes_of(inputs, outputs * height * width)
        }
        [_, _, _, _] if ends_with(&["dpt.head.4.weight"]) => F32 * spec.len(),
        [outputs, inputs, height, width] => Packed::bytes_of(inputs * height * width, outputs),
        _ => 0,
    }
}

/// What a [`Pool`](crate::buffer::Pool) would hold, in values.
#[derive(Default)]
struct Ledger {
    resting: Vec<usize>,
    held: usize,
    peak: usize,
}

impl Ledger {
    /// Lends a buffer; its capacity.
    fn take(&mut self, len: usize) -> usize {
        let old = choose(self.resting.iter().copied(), len).map_or(0, |idx| self.resting.swap_remove(idx));
        let capacity = old.max(padded(len));
        self.keep(capacity - old);
        capacity
    }

    fn give(&mut self, capacities: impl IntoIterator<Item = usize>) {
        self.resting.extend(capacities);
    }

    /// A buffer that is needed for a moment.
    fn pass_by(&mut self, len: usize) {
        let taken = self.take(len);
        self.give([taken]);
    }

    /// Memory beside the pool.
    fn keep(&mut self, len: usize) {
        self.held += len;
        self.peak = self.peak.max(self.held);
    }
}

/// A forward pass of a pair.
struct Pass<'a> {
    config: &'a NetworkConfig,
    /// Columns and rows of patches of both inputs.
    grids: [[usize; 2]; 2],
    directions: Directions,
}

fn area([width, height]: [usize; 2]) -> usize {
    width * height
}

impl Pass<'_> {
    /// Values of a view's results.
    fn result(&self, grid: [usize; 2]) -> usize {
        // Points and their confidence; descriptors and theirs.
        let channels = 4 + self.config.descriptor_dim.map_or(0, |dim| dim + 1);
        area(grid) * self.config.patch_area() * channels
    }

    fn encode(&self, ledger: &mut Ledger) {
        let shape = &self.config.encoder;
        let sizes = self.grids.map(area);
        let num_tokens: usize = sizes.iter().sum();
        let tokens = ledger.take(num_tokens * shape.dim);
        let [channels, side] = self.config.token_input();
        let patches = ledger.take(num_tokens * channels * side * side);
        for size in sizes {
            self.stem(ledger, size * self.config.patch_area());
        }
        ledger.give([patches]);
        for _ in 0..BLOCKS_UNTIL_STEADY {
            self_attention(ledger, shape, &sizes);
            mlp(ledger, shape, num_tokens);
        }
        let normed = ledger.take(num_tokens * shape.dim);
        ledger.keep(num_tokens * shape.dim);
        ledger.give([normed, tokens]);
    }

    /// Of an image of so many pixels; the finer maps stay with the encoding.
    fn stem(&self, ledger: &mut Ledger, num_pixels: usize) {
        let mut from = None;
        for (level, dim) in self.config.stem_dims.iter().flatten().enumerate() {
            let len = num_pixels / [4, 16, 64][level] * dim;
            let last = (level == 2).then(|| ledger.take(len));
            if last.is_none() {
                ledger.keep(len);
            }
            if level == 0 {
                from = Some(ledger.take(num_pixels * IMAGE_CHANNELS));
            }
            let loans = [len; 2].map(|len| ledger.take(len));
            // The second is lent last, and given back first.
            ledger.give(loans.into_iter().rev());
            ledger.give(from.take());
            ledger.give(last);
        }
    }

    fn decode(&self, ledger: &mut Ledger) {
        let [a, b] = self.grids;
        let sides = match self.directions {
            Directions::Forward => [vec![a], vec![b]],
            Directions::Both => [vec![a, b], vec![b, a]],
        };
        let hooks = self.decoders(ledger, &sides);
        for pair in 0..self.directions.count() {
            for side in &sides {
                self.head(ledger, side[pair]);
            }
        }
        ledger.give(hooks);
    }

    /// Leaves the hooks on loan.
    fn decoders(&self, ledger: &mut Ledger, sides: &[Vec<[usize; 2]>; 2]) -> Vec<usize> {
        let shape = &self.config.decoder;
        let sizes = sides.each_ref().map(|grids| grids.iter().copied().map(area).collect::<Vec<_>>());
        let lens = sizes.each_ref().map(|sizes| sizes.iter().sum::<usize>() * shape.dim);
        let tokens = lens.map(|len| ledger.take(len));
        let hooks = lens.iter().flat_map(|len| [*len; 3]).map(|len| ledger.take(len)).collect();
        for _ in 0..BLOCKS_UNTIL_STEADY {
            let others = [lens[1], lens[0]].map(|len| {
                let other = ledger.take(2 * len);
                ledger.pass_by(len);
                other
            });
            for side in 0..2 {
                self_attention(ledger, shape, &sizes[side]);
                let loans = [lens[side]; 2].map(|len| ledger.take(len));
                attend(ledger, shape, &sizes[1 - side]);
                ledger.give(loans);
                mlp(ledger, shape, lens[side] / shape.dim);
            }
            ledger.give(others);
        }
        ledger.give(tokens);
        hooks
    }

    fn head(&self, ledger: &mut Ledger, grid: [usize; 2]) {
        let config = self.config;
        ledger.keep(self.result(grid));
        if config.stem_dims.is_some() {
            return self.features(ledger, grid);
        }
        let map = ledger.take(MAP_CHANNELS * area(grid) * config.patch_area());
        let fused = self.fused(ledger, grid);
        let middle = ledger.take(64 * area(grid) * config.dpt_half_dim());
        ledger.give([middle]);
        ledger.give(fused);
        ledger.give([map]);
        if let Some(channels) = config.descriptor_channels() {
            let hidden = ledger.take(area(grid) * config.descriptor_hidden_dim());
            let raw = ledger.take(area(grid) * channels * config.patch_area());
            ledger.give([raw, hidden]);
        }
    }

    /// What a head does where there is a stem.
    fn features(&self, ledger: &mut Ledger, grid: [usize; 2]) {
        let pixels = 64 * area(grid);
        let fused = self.fused(ledger, grid);
        let middle = ledger.take(pixels * self.config.dpt_half_dim());
        ledger.give(fused);
        let features = ledger.take(pixels * self.config.dpt_last_dim);
        ledger.give([middle]);
        let raw = ledger.take(pixels * self.raw_channels());
        ledger.give([features, raw]);
    }

    /// Channels of a pixel before its outputs are computed from them.
    fn raw_channels(&self) -> usize {
        MAP_CHANNELS + self.config.descriptor_channels().unwrap_or(0)
    }

    fn fused(&self, ledger: &mut Ledger, grid: [usize; 2]) -> Option<usize> {
        (0..4).rev().fold(None, |fused, level| Some(self.level(ledger, grid, level, fused)))
    }

    /// A level of the point head, fused with the coarser ones and enlarged.
    fn level(&self, ledger: &mut Ledger, grid: [usize; 2], level: usize, coarser: Option<usize>) -> usize {
        let (dim, fusion) = (self.config.dpt_dims[level], self.config.dpt_fusion_dim);
        let coarse = area(grid.map(|side| side.div_ceil(2)));
        let pixels = [16 * area(grid), 4 * area(grid), area(grid), coarse][level];
        let reduced = ledger.take(area(grid) * dim);
        let prepared = match level {
            0 | 1 => {
                let pieces = ledger.take(pixels * dim);
                let data = ledger.take(pixels * dim);
                ledger.give([pieces, reduced]);
                data
            }
            2 => reduced,
            _ => {
                let data = ledger.take(pixels * dim);
                ledger.give([reduced]);
                data
            }
        };
        let [sum, positive, hidden] = [pixels * fusion; 3].map(|len| ledger.take(len));
        ledger.give([prepared]);
        ledger.give(coarser);
        ledger.give([hidden, sum]);
        if level == 0 {
            return positive;
        }
        let enlarged = ledger.take(if level == 3 { area(grid) } else { 4 * pixels } * fusion);
        ledger.give([positive]);
        enlarged
    }

    /// Values of a thread's scratch memory: rows of the widest operation, their results, and tiles.
    fn scratch(&self) -> usize {
        let (half, last) = (self.config.dpt_half_dim(), self.config.dpt_last_dim);
        let keys = self.grids.map(area).into_iter().max().unwrap_or(0);
        let shapes = [&self.config.encoder, &self.config.decoder];
        let scores = shapes.map(|shape| attention::scratch_len(keys, shape.head_dim())).into_iter().max();
        let width = self.config.patch_px * self.grids.iter().map(|grid| grid[0]).max().unwrap_or(0);
        // With a stem nothing is enlarged into the last convolution, but the raw channels that come after it.
        let (last_width, raw) = match self.config.stem_dims {
            None => (width / 2, 0),
            Some(_) => (0, width * self.raw_channels()),
        };
        let layers = [(width / 4, self.config.dpt_fusion_dim, half), (last_width, half, last)];
        let [rows, out] = [0, 1].map(|part| {
            let lens =
                layers.map(|(width, inputs, outputs)| upsample::scratch_lens(width, inputs, outputs)[part]);
            lens.into_iter().max().unwrap_or(0)
        });
        rows.max(scores.unwrap_or(0)).max(raw) + out + gemm::SCRATCH_LEN
    }
}

/// Packed keys and values, one group of tokens after the other.
fn attend(ledger: &mut Ledger, shape: &Transformer, keys: &[usize]) {
    for keys in keys {
        ledger.pass_by(shape.num_heads * attention::packed_len(*keys, shape.head_dim()));
    }
}

fn self_attention(ledger: &mut Ledger, shape: &Transformer, sizes: &[usize]) {
    let len = sizes.iter().sum::<usize>() * shape.dim;
    let (normed, qkv) = (ledger.take(len), ledger.take(3 * len));
    attend(ledger, shape, sizes);
    ledger.give([qkv, normed]);
}

fn mlp(ledger: &mut Ledger, shape: &Transformer, num_tokens: usize) {
    let (normed, hidden) = (ledger.take(num_tokens * shape.dim), ledger.take(num_tokens * shape.mlp_dim));
    ledger.give([normed, hidden]);
}
