//! Attention with rotary position encoding in two dimensions.

use burn_tensor::ops::AttentionModuleOptions;
use burn_tensor::{Device, FloatDType, Tensor, TensorData, module};

use crate::scope::Scope;
use crate::views::Grid;

/// Cosines and sines of the angles of a batch's tokens, for heads of one size.
///
/// The first half of a head's channels turns with the token's row, the second with its column; within a half, channel `k`
/// pairs with channel `k + half/2`.
pub(crate) struct Rope {
    /// `[1 or images, 1, tokens, channels]`.
    cos: Tensor<4>,
    sin: Tensor<4>,
    /// `t · pairs` is the other channel of each pair, with the sign that it has in the rotation.
    pairs: Tensor<2>,
    /// Channels of a head.
    head_dim: usize,
}

impl Rope {
    pub(crate) fn new(grid: &Grid, head_dim: usize, base: f64, device: &Device) -> Self {
        // One table does for all images of one orientation.
        let orientations = match grid.groups().as_slice() {
            [(orientation, _)] => vec![*orientation],
            _ => grid.transposed.clone(),
        };
        let places = orientations.iter().flat_map(|orientation| {
            let [rows, columns] = grid.upright(*orientation);
            (0..rows * columns).map(move |token| [token / columns, token % columns])
        });
        let places: Vec<_> = places.collect();
        Self::at(&places, orientations.len(), head_dim, base, device)
    }

    /// For tokens at `places`, rows and columns, of as many images as there are tables.
    fn at(places: &[[usize; 2]], num_tables: usize, head_dim: usize, base: f64, device: &Device) -> Self {
        let device = device.clone().without_autodiff();
        let quarter = head_dim / 4;
        let angle = |place: [usize; 2], channel: usize| {
            let k = channel % quarter;
            place[channel / (2 * quarter)] as f64 / base.powf(2.0 * k as f64 / (2 * quarter) as f64)
        };
        let table = |function: fn(f64) -> f64| {
            let channels = |place: &[usize; 2]| {
                let place = *place;
                (0..head_dim).map(move |channel| function(angle(place, channel)) as f32)
            };
            let values: Vec<f32> = places.iter().flat_map(channels).collect();
            let shape = [num_tables, 1, places.len() / num_tables, head_dim];
            Tensor::from_data(TensorData::new(values, shape), &device)
        };
        let mut pairs = vec![0.0_f32; head_dim * head_dim];
        for channel in 0..head_dim {
            let first = (channel / quarter).is_multiple_of(2);
            let partner = if first { channel + quarter } else { channel - quarter };
            pairs[partner * head_dim + channel] = if first { -1.0 } else { 1.0 };
        }
        let pairs = Tensor::from_data(TensorData::new(pairs, [head_dim, head_dim]), &device);
        Self { cos: table(f64::cos), sin: table(f64::sin), pairs, head_dim }
    }

    /// Turns `[images, heads, tokens, channels]`.
    pub(crate) fn turn(&self, t: Tensor<4>) -> Tensor<4> {
        let [images, heads, tokens, channels] = t.dims();
        let partners = t.clone().reshape([images * heads * tokens, channels]).matmul(self.pairs.clone());
        t * self.cos.clone() + partners.reshape([images, heads, tokens, channels]) * self.sin.clone()
    }
}

/// Self-attention at `attn`.
pub(crate) fn self_attention(at: &Scope<'_>, x: Tensor<3>, rope: &Rope) -> Tensor<3> {
    let [images, tokens, dim] = x.dims();
    let heads = dim / rope.head_dim;
    let qkv = at.linear("qkv", x).reshape([images, tokens, 3, heads, rope.head_dim]).permute([2, 0, 3, 1, 4]);
    let part = |idx| qkv.clone().narrow(0, idx, 1).reshape([images, heads, tokens, rope.head_dim]);
    at.linear("proj", attend(at, rope.turn(part(0)), rope.turn(part(1)), part(2)))
}

/// Cross-attention at `cross_attn`: `x` asks, `other` answers.
pub(crate) fn cross_attention(
    at: &Scope<'_>,
    x: Tensor<3>,
    other: Tensor<3>,
    ropes: [&Rope; 2],
) -> Tensor<3> {
    let split = |t: Tensor<3>| {
        let [images, tokens, dim] = t.dims();
        let head_dim = ropes[0].head_dim;
        t.reshape([images, tokens, dim / head_dim, head_dim]).swap_dims(1, 2)
    };
    let q = ropes[0].turn(split(at.linear("projq", x)));
    let k = ropes[1].turn(split(at.linear("projk", other.clone())));
    let v = split(at.linear("projv", other));
    at.linear("proj", attend(at, q, k, v))
}

/// `softmax(q kᵀ / √channels) v`, heads side by side again.
fn attend(at: &Scope<'_>, q: Tensor<4>, k: Tensor<4>, v: Tensor<4>) -> Tensor<3> {
    let [images, heads, tokens, channels] = q.dims();
    let tracked = [&q, &k, &v].iter().any(|each| each.is_tracked());
    let mixed = if tracked {
        learning(at, q, k, v)
    } else {
        let [q, k, v] = [q, k, v].map(|each| at.factor(each));
        module::attention(q, k, v, None, None, AttentionModuleOptions::default()).cast(FloatDType::F32)
    };
    mixed.swap_dims(1, 2).reshape([images, tokens, heads * channels])
}

/// Attention for learning: of all that has the size of the scores, the tape keeps one tensor, their exponentials.
fn learning(at: &Scope<'_>, q: Tensor<4>, k: Tensor<4>, v: Tensor<4>) -> Tensor<4> {
    let scale = 1.0 / (q.dims()[3] as f64).sqrt();
    let scores = at.product(q * scale, k.transpose());
    let top = scores.clone().detach().max_dim(3);
    let weights = (scores - top).exp();
    let sum = weights.clone().sum_dim(3);
    at.product(weights, v) / sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of f32 for values of a few units.
    const ROUNDING: f32 = 2e-6;

    #[test]
    fn shared_golden_rope() {
        let shared = std::env::var_os("SELENOGRAPH_SHARED")
            .unwrap_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared").into());
        let Ok(bytes) = std::fs::read(std::path::Path::new(&shared).join("golden/rope.safetensors")) else {
            println!("SKIP shared-data: no goldens");
            return;
        };
        println!("RAN shared-data: golden rope");
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let device = Device::flex();
        for case in 0..4 {
            let view = |name: &str| file.tensor(&format!("case{case}.{name}")).unwrap();
            let floats = |name: &str| -> Vec<f32> {
                view(name).data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
            };
            let shape: [usize; 4] = view("tokens").shape().try_into().unwrap();
            let numbers =
                view("pos").data().as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b) as usize);
            let numbers: Vec<usize> = numbers.collect();
            let rope = Rope::at(numbers.as_chunks().0, shape[0], shape[3], 100.0, &device);
            let tokens = Tensor::from_data(TensorData::new(floats("tokens"), shape), &device);
            let found = rope.turn(tokens).try_into_vec_as::<f32>().unwrap();
            for (found, expected) in found.iter().zip(floats("out")) {
                assert!((found - expected).abs() < ROUNDING, "case {case}");
            }
        }
    }

    #[test]
    fn attention_is_the_same_on_the_tape_and_off_it() {
        // As many tokens as make the backend choose its tiled kernel.
        let numbers =
            |count: usize, step: f32| (0..count).map(|idx| (idx as f32 * step).sin()).collect::<Vec<_>>();
        for [tokens, others] in [[6, 9], [600, 500]] {
            let tensor = |tokens: usize, step| {
                let data = TensorData::new(numbers(2 * 3 * tokens * 8, step), [2, 3, tokens, 8]);
                Tensor::<4>::from_data(data, &Device::flex())
            };
            let (q, k, v) = (tensor(tokens, 0.37), tensor(others, 0.71), tensor(others, 0.13));
            let parameters = crate::Parameters::none();
            let at = Scope::root(&parameters, crate::Precision::F32, None);
            let plain = attend(&at, q.clone(), k.clone(), v.clone());
            let tracked = attend(&at, q.autodiff().require_grad(), k, v);
            let difference = (plain - tracked.without_autodiff()).abs().max().into_scalar::<f32>();
            assert!(difference < ROUNDING, "{difference}");
        }
    }
}
