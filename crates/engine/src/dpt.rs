//! The dense prediction head: four levels of tokens fused into one map.

use rayon::prelude::*;
use selenograph_network::config::NetworkConfig;

use crate::buffer::{Loan, SharedOut};
use crate::conv::Residual;
use crate::error::Result;
use crate::gemm::Finish;
use crate::packed::Packed;
use crate::probe::Watch;
use crate::transformer::Context;
use crate::upsample::{Join, Pixels, place};
use crate::vector::{Activation, dot};
use crate::weights::Reader;

/// Channels of the map: three coordinates and a confidence.
pub(crate) const MAP_CHANNELS: usize = 4;

struct Fusion {
    /// Of the finer level; the coarsest has none.
    join: Option<Residual>,
    smooth: Residual,
    project: Packed,
}

/// The head's layers.
pub(crate) struct DptHead {
    dims: [usize; 4],
    reduce: [Packed; 4],
    /// Levels 0 and 1: to four and two times the resolution.
    unfold: [Packed; 2],
    /// Level 3: to half the resolution.
    shrink: Packed,
    to_fusion: [Packed; 4],
    fusions: [Fusion; 4],
    /// Of the stem's maps: into what is enlarged last, and into level 0.
    joins: Option<[Packed; 2]>,
    last1: Packed,
    last2: Packed,
    weights3: Vec<f32>,
    bias3: Vec<f32>,
    zeros: Vec<f32>,
}

/// One view's tokens at the four hooks, the stem's maps if there is one, their grid, and what its head is called.
pub(crate) struct Hooks<'a> {
    pub tokens: [&'a [f32]; 4],
    pub maps: Option<[&'a [f32]; 2]>,
    pub height: usize,
    pub width: usize,
    pub name: &'static str,
}

/// A map on its way through the head.
pub(crate) struct Level<'a> {
    data: Loan<'a>,
    width: usize,
    height: usize,
}

impl Level<'_> {
    pub(crate) fn pixels(&self) -> Pixels<'_> {
        let channels = self.data.len() / (self.width * self.height);
        Pixels { data: &self.data, width: self.width, height: self.height, channels }
    }
}

impl Fusion {
    fn read(reader: &mut Reader<'_>, prefix: &str, dim: usize, joins: bool) -> Result<Self> {
        let join =
            if joins { Some(Residual::read(reader, &format!("{prefix}.resConfUnit1"), dim)?) } else { None };
        Ok(Self {
            join,
            smooth: Residual::read(reader, &format!("{prefix}.resConfUnit2"), dim)?,
            project: reader.conv1(&format!("{prefix}.out_conv"), dim, dim)?,
        })
    }
}

impl DptHead {
    pub(crate) fn read(reader: &mut Reader<'_>, config: &NetworkConfig, prefix: &str) -> Result<Self> {
        let (dims, fusion) = (config.dpt_dims, config.dpt_fusion_dim);
        let act = format!("{prefix}.act_postprocess");
        let scratch = format!("{prefix}.scratch");
        let (enc, dec, last) = (config.encoder.dim, config.decoder.dim, config.dpt_last_dim);
        let half = fusion / 2;
        let level = |reader: &mut Reader<'_>, idx: usize| {
            reader.conv3(&format!("{scratch}.layer{}_rn", idx + 1), dims[idx], fusion, false)
        };
        let fuse = |reader: &mut Reader<'_>, idx: usize| {
            Fusion::read(reader, &format!("{scratch}.refinenet{idx}"), fusion, idx < 4)
        };
        let widest = [dims[0], dims[1], dims[2], dims[3], fusion, last].into_iter().max().unwrap_or(0);
        Ok(Self {
            dims,
            reduce: [
                reader.conv1(&format!("{act}.0.0"), enc, dims[0])?,
                reader.conv1(&format!("{act}.1.0"), dec, dims[1])?,
                reader.conv1(&format!("{act}.2.0"), dec, dims[2])?,
                reader.conv1(&format!("{act}.3.0"), dec, dims[3])?,
            ],
            unfold: [
                reader.unfold(&format!("{act}.0.1"), dims[0], 4)?,
                reader.unfold(&format!("{act}.1.1"), dims[1], 2)?,
            ],
            shrink: reader.conv3(&format!("{act}.3.1"), dims[3], dims[3], true)?,
            to_fusion: [level(reader, 0)?, level(reader, 1)?, level(reader, 2)?, level(reader, 3)?],
            fusions: [fuse(reader, 1)?, fuse(reader, 2)?, fuse(reader, 3)?, fuse(reader, 4)?],
            joins: config
                .stem_dims
                .map(|[half, quarter, _]| {
                    let half = reader.conv1(&format!("{scratch}.stem0_rn"), half, fusion)?;
                    Ok([half, reader.conv1(&format!("{scratch}.stem1_rn"), quarter, fusion)?])
                })
                .transpose()?,
            last1: reader.conv3(&format!("{prefix}.head.0"), fusion, half, true)?,
            last2: reader.conv3(&format!("{prefix}.head.2"), half, last, true)?,
            weights3: reader.values(&format!("{prefix}.head.4.weight"), &[MAP_CHANNELS, last, 1, 1])?,
            bias3: reader.values(&format!("{prefix}.head.4.bias"), &[MAP_CHANNELS])?,
            zeros: vec![0.0; widest],
        })
    }

    /// The map's channels as a layer on the features, and `(weights, bias)` of more channels after them.
    pub(crate) fn last_layer(&self, (weights, bias): (&[f32], &[f32])) -> Packed {
        let (weights, bias) = ([&self.weights3, weights].concat(), [&self.bias3, bias].concat());
        Packed::linear(&weights, self.last2.outputs, bias.len(), Some(&bias))
    }

    pub(crate) fn num_bytes(&self) -> usize {
        let fusion = |fusion: &Fusion| {
            let join = fusion.join.as_ref().map_or(0, Residual::num_bytes);
            join + fusion.smooth.num_bytes() + fusion.project.num_bytes()
        };
        let fusions: usize = self.fusions.iter().map(fusion).sum();
        let layers = self.reduce.iter().chain(&self.unfold).chain(&self.to_fusion);
        let layers = layers.chain(self.joins.iter().flatten());
        let rest = [&self.shrink, &self.last1, &self.last2];
        fusions + layers.chain(rest).map(Packed::num_bytes).sum::<usize>()
    }

    /// To `[16 height, 16 width, 4]`: networks without a stem.
    pub(crate) fn run(
        &self,
        context: &Context<'_>,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
        out: &mut [f32],
    ) {
        let fused = self.fused(context, hooks, watch);
        self.finish(context, &fused, hooks, watch, out);
    }

    /// What the view's map and descriptors are linear in, `[8 height, 8 width, last width]`: networks with a stem.
    pub(crate) fn features<'p>(
        &self,
        context: &Context<'p>,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
    ) -> Level<'p> {
        let fused = self.fused(context, hooks, watch);
        let middle = self.middle(context, &fused, hooks);
        drop(fused);
        let dim = self.last2.outputs;
        let mut data = context.pool.take(middle.width * middle.height * dim);
        let finish = Finish::store(&mut data, dim).with(Activation::Relu);
        self.conv(context, &middle, 1, &self.last2, &finish);
        Level { data, ..middle }
    }

    /// All levels, before their last enlargement.
    fn fused<'p>(&self, context: &Context<'p>, hooks: &Hooks<'_>, watch: &mut Watch<'_>) -> Level<'p> {
        let coarsest = self.prepare(context, 3, hooks, watch);
        let mut fused = self.fuse(context, 3, coarsest, None, hooks, watch);
        for idx in (0..3).rev() {
            let level = self.prepare(context, idx, hooks, watch);
            fused = self.fuse(context, idx, level, Some(fused), hooks, watch);
        }
        fused
    }

    fn conv(
        &self,
        context: &Context<'_>,
        from: &Level<'_>,
        stride: usize,
        layer: &Packed,
        finish: &Finish<'_>,
    ) {
        context.conv3(&from.pixels(), stride, layer, &self.zeros, finish);
    }

    /// What the stem's maps add.
    fn joins<'a>(&'a self, hooks: &Hooks<'a>) -> Option<[Join<'a>; 2]> {
        let ([fine, coarse], [half, quarter]) = (self.joins.as_ref()?, hooks.maps?);
        Some([Join { map: half, layer: fine }, Join { map: quarter, layer: coarse }])
    }

    /// A hook's tokens at the level's own resolution.
    fn prepare<'p>(
        &self,
        context: &Context<'p>,
        idx: usize,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
    ) -> Level<'p> {
        let (dim, width, height) = (self.dims[idx], hooks.width, hooks.height);
        let mut data = context.pool.take(height * width * dim);
        context.linear(hooks.tokens[idx], &self.reduce[idx], &Finish::store(&mut data, dim));
        let reduced = Level { data, width, height };
        let level = match idx {
            0 | 1 => self.unfolded(context, idx, &reduced),
            2 => reduced,
            _ => {
                let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
                let mut data = context.pool.take(half_width * half_height * dim);
                self.conv(context, &reduced, 2, &self.shrink, &Finish::store(&mut data, dim));
                Level { data, width: half_width, height: half_height }
            }
        };
        watch.see(|| format!("{}.act{idx}", hooks.name), &[level.height, level.width, dim], &level.data);
        level
    }

    fn unfolded<'p>(&self, context: &Context<'p>, idx: usize, from: &Level<'_>) -> Level<'p> {
        let (dim, side, layer) = (self.dims[idx], 4 >> idx, &self.unfold[idx]);
        let mut pieces = context.pool.take(from.width * from.height * layer.outputs);
        context.linear(&from.data, layer, &Finish::store(&mut pieces, layer.outputs));
        let mut data = context.pool.take(pieces.len());
        let run = side * dim;
        data.par_chunks_mut(from.width * run).enumerate().for_each(|(y, row)| {
            for (x, to) in row.chunks_exact_mut(run).enumerate() {
                let token = (y / side) * from.width + x;
                to.copy_from_slice(&pieces[token * layer.outputs + y % side * run..][..run]);
            }
        });
        Level { data, width: side * from.width, height: side * from.height }
    }

    /// Joins a level with what the coarser ones gave, and enlarges the result.
    fn fuse<'p>(
        &self,
        context: &Context<'p>,
        idx: usize,
        level: Level<'p>,
        coarser: Option<Level<'p>>,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
    ) -> Level<'p> {
        let fusion = &self.fusions[idx];
        let dim = fusion.project.inputs;
        let (level_width, level_height) = (level.width, level.height);
        let len = level_width * level_height * dim;
        let take = || Level { data: context.pool.take(len), width: level_width, height: level_height };
        let (mut sum, mut positive, mut hidden) = (take(), take(), take());
        let joins = self.joins(hooks).filter(|_| idx == 0);
        if let Some([_, Join { map, layer }]) = joins {
            context.linear(map, layer, &Finish::store(&mut sum.data, dim));
        }
        let finish = Finish { onto: joins.is_some(), ..Finish::store(&mut sum.data, dim) };
        let finish = finish.with_positive(&mut positive.data);
        self.conv(context, &level, 1, &self.to_fusion[idx], &finish);
        drop(level);
        watch.see(|| format!("{}.layer_rn{idx}", hooks.name), &[level_height, level_width, dim], &sum.data);
        if let (Some(join), Some(coarser)) = (&fusion.join, &coarser) {
            let finish = Finish::store(&mut hidden.data, dim).with(Activation::Relu);
            self.conv(context, &positive, 1, &join.conv1, &finish);
            let finish = Finish::store(&mut sum.data, dim).onto();
            let finish = finish.plus(&coarser.data).with_positive(&mut positive.data);
            self.conv(context, &hidden, 1, &join.conv2, &finish);
        }
        drop(coarser);
        let finish = Finish::store(&mut hidden.data, dim).with(Activation::Relu);
        self.conv(context, &positive, 1, &fusion.smooth.conv1, &finish);
        self.conv(context, &hidden, 1, &fusion.smooth.conv2, &Finish::store(&mut sum.data, dim).onto());
        drop(hidden);
        // A 1×1 convolution and a weighted mean with weights of sum one commute: before the enlargement
        // it has a quarter of the pixels.
        context.linear(&sum.data, &fusion.project, &Finish::store(&mut positive.data, dim));
        drop(sum);
        self.enlarge(context, idx, positive, hooks, watch)
    }

    /// Twice the size, cut to the next level's; the last one is enlarged by the convolution that reads it.
    fn enlarge<'p>(
        &self,
        context: &Context<'p>,
        idx: usize,
        from: Level<'p>,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
    ) -> Level<'p> {
        let pixels = from.pixels();
        let channels = pixels.channels;
        let name = || format!("{}.refinenet{}", hooks.name, idx + 1);
        let (full_width, full_height) = (2 * from.width, 2 * from.height);
        if watch.wants_values() {
            let mut all = context.pool.take(full_width * full_height * channels);
            pixels.enlarge(context.level, full_width, &mut all);
            watch.see(name, &[full_height, full_width, channels], &all);
        }
        if idx == 0 {
            return from;
        }
        // Only the coarsest level can be larger than needed: its resolution was rounded up.
        let (width, height) = if idx == 3 { (hooks.width, hooks.height) } else { (full_width, full_height) };
        let mut data = context.pool.take(width * height * channels);
        pixels.enlarge(context.level, width, &mut data);
        Level { data, width, height }
    }

    /// The first of the last convolutions, of the enlarged levels.
    fn middle<'p>(&self, context: &Context<'p>, fused: &Level<'_>, hooks: &Hooks<'_>) -> Level<'p> {
        let (width, height) = (2 * fused.width, 2 * fused.height);
        let last = self.last1.outputs;
        let mut data = context.pool.take(width * height * last);
        let to = SharedOut::new(&mut data);
        fused.pixels().enlarge_into_conv(
            context.level,
            &self.last1,
            &self.zeros,
            self.joins(hooks).map(|[half, _]| half),
            |finish| finish,
            |row, band| {
                // SAFETY: each band has rows of its own; `data` outlives the call.
                unsafe { place(to, row, width * last, band) };
            },
        );
        Level { data, width, height }
    }

    fn finish(
        &self,
        context: &Context<'_>,
        fused: &Level<'_>,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
        out: &mut [f32],
    ) {
        let middle = self.middle(context, fused, hooks);
        let (width, height) = (middle.width, middle.height);
        let to = SharedOut::new(out);
        middle.pixels().enlarge_into_conv(
            context.level,
            &self.last2,
            &self.zeros,
            None,
            |finish| finish.with(Activation::Relu),
            |row, band| {
                // SAFETY: each band has rows of its own; the caller holds `out`.
                let out = unsafe {
                    to.row(row * 2 * width * MAP_CHANNELS, band.len() / self.last2.outputs * MAP_CHANNELS)
                };
                let weights = self.weights3.chunks_exact(self.last2.outputs);
                for (channel, (weights, bias)) in weights.zip(&self.bias3).enumerate() {
                    for (pixel, out) in
                        band.chunks_exact(self.last2.outputs).zip(out.chunks_exact_mut(MAP_CHANNELS))
                    {
                        out[channel] = dot(context.level, pixel, weights) + bias;
                    }
                }
            },
        );
        watch.see(|| format!("{}.dpt_out", hooks.name), &[2 * height, 2 * width, MAP_CHANNELS], out);
    }
}
