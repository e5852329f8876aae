//! Networks that have learnt nothing: the same seed, the same weights.
//!
//! Linear layers of the transformers are Xavier-uniform with zero biases, norms are the identity, the heads' layers
//! uniform by their number of inputs, as PyTorch draws them; `mask_token`, which nothing reads, is normal.

use crate::checkpoint::key;
use crate::element::ElementType;
use crate::layout::{Init, Layout, TensorSpec};
use crate::safetensors::{Entry, Writer};
use crate::{Error, NetworkConfig};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::path::Path;

/// Writes a network of random weights as safetensors. `progress` is told after each tensor how many values it had.
///
/// # Errors
/// [`Error::Config`], [`Error::Io`].
pub fn write(
    config: &NetworkConfig,
    seed: u64,
    target: &Path,
    progress: &mut dyn FnMut(usize),
) -> Result<(), Error> {
    let layout = Layout::new(config)?;
    let mut metadata = crate::checkpoint::header(config, Some("CC0-1.0 (random numbers)"));
    metadata.insert(key::PROVENANCE.into(), format!("random weights, seed {seed}: nothing was learnt"));
    let entry = |spec: &TensorSpec| Entry {
        name: spec.name.clone(),
        element: ElementType::F32,
        shape: spec.shape.clone(),
    };
    let mut writer = Writer::create(target, layout.owned().map(entry).collect(), &metadata)?;
    for spec in layout.owned() {
        let values = values(spec, seed);
        writer.write(&values)?;
        progress(values.len());
    }
    writer.finish()
}

/// First values of a tensor: a function of the seed, its name and its shape alone.
pub fn values(spec: &TensorSpec, seed: u64) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream_of(&spec.name));
    match spec.init {
        Init::Zeros => vec![0.0; spec.len()],
        Init::Ones => vec![1.0; spec.len()],
        Init::Uniform { bound } => {
            (0..spec.len()).map(|_| ((2.0 * unit(&mut rng) - 1.0) * bound) as f32).collect()
        }
        Init::Normal { sigma } => (0..spec.len()).map(|_| (bell(&mut rng) * sigma) as f32).collect(),
    }
}

/// FNV-1a, 64 bits: each tensor draws from a stream of its own, whatever other tensors there are.
fn stream_of(name: &str) -> u64 {
    name.bytes()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Uniform in [0, 1).
fn unit(rng: &mut ChaCha8Rng) -> f64 {
    f64::from(rng.next_u32()) / 4_294_967_296.0
}

/// Close to a standard normal, by the sum of twelve uniform numbers: exact arithmetic, the same on every machine.
fn bell(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| unit(rng)).sum::<f64>() - 6.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preset;

    #[test]
    fn a_tensor_depends_on_seed_and_name_only() {
        let layout = Layout::new(&Preset::Tiny.config()).unwrap();
        let [a, b] =
            ["enc_blocks.0.mlp.fc1.weight", "enc_blocks.1.mlp.fc1.weight"].map(|n| layout.get(n).unwrap());
        assert_eq!(values(a, 1), values(a, 1));
        assert_ne!(values(a, 1), values(a, 2));
        assert_ne!(values(a, 1), values(b, 1));
    }

    #[test]
    fn values_have_the_spread_that_is_asked_for() {
        let layout = Layout::new(&Preset::Tiny.config()).unwrap();
        let weight = values(layout.get("enc_blocks.0.mlp.fc1.weight").unwrap(), 7);
        // Xavier: 6 / (512 + 128), a third of whose square is the variance.
        let bound = (6.0f64 / 640.0).sqrt();
        let variance = weight.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / weight.len() as f64;
        // 65 536 samples: the spread of a variance estimate is well below this.
        const TOLERANCE: f64 = 0.02;
        assert!((variance / (bound * bound / 3.0) - 1.0).abs() < TOLERANCE, "{variance}");
        assert!(weight.iter().all(|v| f64::from(v.abs()) <= bound * 1.000_001));
        assert!(values(layout.get("enc_norm.weight").unwrap(), 7).iter().all(|v| *v == 1.0));
        assert!(values(layout.get("enc_blocks.0.mlp.fc1.bias").unwrap(), 7).iter().all(|v| *v == 0.0));
    }
}
