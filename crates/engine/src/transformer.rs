//! The blocks of the encoder and the decoders.

use rayon::prelude::*;
use selenograph_network::config::Transformer;

use crate::attention::{Attention, Columns, Grid};
use crate::buffer::Pool;
use crate::error::Result;
use crate::gemm::{Finish, Input, gemm};
use crate::kernel::Simd;
use crate::packed::Packed;
use crate::rope::Rope;
use crate::vector::{Activation, normalize};
use crate::weights::{Norm, Reader};

/// Of every layer normalisation in the network.
const NORM_EPS: f32 = 1e-6;
/// Tokens that one task normalises.
const TASK_TOKENS: usize = 64;

/// What all layers share.
#[derive(Clone, Copy)]
pub(crate) struct Context<'a> {
    pub level: Simd,
    pub pool: &'a Pool,
}

impl Context<'_> {
    /// Layer normalisation of each token.
    pub(crate) fn normalize(&self, tokens: &[f32], norm: &Norm, out: &mut [f32]) {
        let dim = norm.weight.len();
        let parts = out.par_chunks_mut(TASK_TOKENS * dim).zip(tokens.par_chunks(TASK_TOKENS * dim));
        parts.for_each(|(out, tokens)| {
            for (out, token) in out.chunks_exact_mut(dim).zip(tokens.chunks_exact(dim)) {
                normalize(self.level, token, &norm.weight, &norm.bias, NORM_EPS, out);
            }
        });
    }

    /// A linear layer on tokens of `weights.inputs` channels.
    pub(crate) fn linear(&self, tokens: &[f32], weights: &Packed, finish: &Finish<'_>) {
        let input = Input::Rows { data: tokens, stride: weights.inputs };
        gemm(self.level, &input, tokens.len() / weights.inputs, weights, finish);
    }
}

struct Mlp {
    norm: Norm,
    fc1: Packed,
    fc2: Packed,
}

impl Mlp {
    fn read(reader: &mut Reader<'_>, prefix: &str, norm: &str, shape: &Transformer) -> Result<Self> {
        Ok(Self {
            norm: reader.norm(&format!("{prefix}.{norm}"), shape.dim)?,
            fc1: reader.linear(&format!("{prefix}.mlp.fc1"), shape.dim, shape.mlp_dim)?,
            fc2: reader.linear(&format!("{prefix}.mlp.fc2"), shape.mlp_dim, shape.dim)?,
        })
    }

    fn run(&self, context: &Context<'_>, tokens: &mut [f32]) {
        let dim = self.fc1.inputs;
        let mut normed = context.pool.take(tokens.len());
        context.normalize(tokens, &self.norm, &mut normed);
        let mut hidden = context.pool.take(tokens.len() / dim * self.fc1.outputs);
        let finish = Finish::store(&mut hidden, self.fc1.outputs).with(Activation::Gelu);
        context.linear(&normed, &self.fc1, &finish);
        drop(normed);
        context.linear(&hidden, &self.fc2, &Finish::store(tokens, dim).onto());
    }

    fn num_bytes(&self) -> usize {
        self.fc1.num_bytes() + self.fc2.num_bytes()
    }
}

struct SelfAttention {
    norm: Norm,
    qkv: Packed,
    proj: Packed,
    num_heads: usize,
}

impl SelfAttention {
    fn read(reader: &mut Reader<'_>, prefix: &str, shape: &Transformer) -> Result<Self> {
        Ok(Self {
            norm: reader.norm(&format!("{prefix}.norm1"), shape.dim)?,
            qkv: reader.linear(&format!("{prefix}.attn.qkv"), shape.dim, 3 * shape.dim)?,
            proj: reader.linear(&format!("{prefix}.attn.proj"), shape.dim, shape.dim)?,
            num_heads: shape.num_heads,
        })
    }

    fn run(&self, context: &Context<'_>, rope: &Rope, tokens: &mut [f32], grids: &[Grid]) {
        let dim = self.qkv.inputs;
        let mut normed = context.pool.take(tokens.len());
        context.normalize(tokens, &self.norm, &mut normed);
        let mut qkv = context.pool.take(3 * tokens.len());
        context.linear(&normed, &self.qkv, &Finish::store(&mut qkv, 3 * dim));
        let columns = |part: usize| Columns { data: &qkv, stride: 3 * dim, offset: part * dim };
        let pairs: Vec<(Grid, Grid)> = grids.iter().map(|grid| (*grid, *grid)).collect();
        let attention = Attention {
            level: context.level,
            pool: context.pool,
            rope,
            num_heads: self.num_heads,
            head_dim: dim / self.num_heads,
            queries: columns(0),
            keys: columns(1),
            values: columns(2),
            pairs: &pairs,
        };
        // The normalised tokens are used up: their memory takes the result.
        attention.run(&mut normed);
        context.linear(&normed, &self.proj, &Finish::store(tokens, dim).onto());
    }

    fn num_bytes(&self) -> usize {
        self.qkv.num_bytes() + self.proj.num_bytes()
    }
}

/// A block of the encoder.
pub(crate) struct EncoderBlock {
    attention: SelfAttention,
    mlp: Mlp,
}

impl EncoderBlock {
    pub(crate) fn read(reader: &mut Reader<'_>, prefix: &str, shape: &Transformer) -> Result<Self> {
        Ok(Self {
            attention: SelfAttention::read(reader, prefix, shape)?,
            mlp: Mlp::read(reader, prefix, "norm2", shape)?,
        })
    }

    pub(crate) fn run(&self, context: &Context<'_>, rope: &Rope, tokens: &mut [f32], grids: &[Grid]) {
        self.attention.run(context, rope, tokens, grids);
        self.mlp.run(context, tokens);
    }

    pub(crate) fn num_bytes(&self) -> usize {
        self.attention.num_bytes() + self.mlp.num_bytes()
    }
}

/// A block of a decoder.
pub(crate) struct DecoderBlock {
    attention: SelfAttention,
    norm_query: Norm,
    norm_other: Norm,
    query: Packed,
    key_value: Packed,
    proj: Packed,
    mlp: Mlp,
}

impl DecoderBlock {
    pub(crate) fn read(reader: &mut Reader<'_>, prefix: &str, shape: &Transformer) -> Result<Self> {
        let (dim, cross) = (shape.dim, format!("{prefix}.cross_attn"));
        let (key, value) = (format!("{cross}.projk"), format!("{cross}.projv"));
        Ok(Self {
            attention: SelfAttention::read(reader, prefix, shape)?,
            norm_query: reader.norm(&format!("{prefix}.norm2"), dim)?,
            norm_other: reader.norm(&format!("{prefix}.norm_y"), dim)?,
            query: reader.linear(&format!("{cross}.projq"), dim, dim)?,
            key_value: reader.joined([&key, &value], dim, dim)?,
            proj: reader.linear(&format!("{cross}.proj"), dim, dim)?,
            mlp: Mlp::read(reader, prefix, "norm3", shape)?,
        })
    }

    /// Keys and values of the other view's tokens: `2 · dim` columns.
    pub(crate) fn read_other(&self, context: &Context<'_>, other: &[f32], out: &mut [f32]) {
        let mut normed = context.pool.take(other.len());
        context.normalize(other, &self.norm_other, &mut normed);
        context.linear(&normed, &self.key_value, &Finish::store(out, self.key_value.outputs));
    }

    /// Changes this view's tokens; `pairs` says which of them look at which tokens of the other view.
    pub(crate) fn run(
        &self,
        context: &Context<'_>,
        rope: &Rope,
        tokens: &mut [f32],
        other: &[f32],
        pairs: &[(Grid, Grid)],
    ) {
        let dim = self.query.inputs;
        let own: Vec<Grid> = pairs.iter().map(|pair| pair.0).collect();
        self.attention.run(context, rope, tokens, &own);
        let mut normed = context.pool.take(tokens.len());
        context.normalize(tokens, &self.norm_query, &mut normed);
        let mut query = context.pool.take(tokens.len());
        context.linear(&normed, &self.query, &Finish::store(&mut query, dim));
        let attention = Attention {
            level: context.level,
            pool: context.pool,
            rope,
            num_heads: self.attention.num_heads,
            head_dim: dim / self.attention.num_heads,
            queries: Columns { data: &query, stride: dim, offset: 0 },
            keys: Columns { data: other, stride: 2 * dim, offset: 0 },
            values: Columns { data: other, stride: 2 * dim, offset: dim },
            pairs,
        };
        attention.run(&mut normed);
        context.linear(&normed, &self.proj, &Finish::store(tokens, dim).onto());
        drop((normed, query));
        self.mlp.run(context, tokens);
    }

    pub(crate) fn num_bytes(&self) -> usize {
        let cross = self.query.num_bytes() + self.key_value.num_bytes() + self.proj.num_bytes();
        self.attention.num_bytes() + cross + self.mlp.num_bytes()
    }
}
