//! Crate `model` as an executor. Between calls everything is in the processor's memory, as the engine has it.

use crate::Error;
use selenograph_engine::{Encoding, HeadOutput, Image, Probe, Stage};
use selenograph_model::{Grid, Images, Model, Output, Tensor, Tokens};

/// Encodes images, one after the other: they may differ in size.
pub(super) fn encode(
    model: &Model,
    images: &[Image<'_>],
    watch: &mut dyn Probe,
) -> Result<Vec<Encoding>, Error> {
    let device = model.device();
    let num_blocks = model.config().encoder.num_blocks;
    let one = |image: &Image<'_>| {
        let sizes = [1, image.height_px, image.width_px];
        let tokens = model.encode(&Images::upright(image.values.to_vec(), sizes, &device)?)?;
        let (height, width) = (tokens.grid.rows, tokens.grid.columns);
        watch.finished(Stage::EncoderBlock { idx: num_blocks.saturating_sub(1) });
        let maps = match tokens.maps() {
            Some([half, quarter]) => Some([values(half)?, values(quarter)?]),
            None => None,
        };
        Ok(Encoding { height, width, tokens: values(tokens.values)?, maps })
    };
    images.iter().map(one).collect()
}

/// Decodes pairs, one after the other.
pub(super) fn decode(
    model: &Model,
    pairs: &[(&Encoding, &Encoding)],
    watch: &mut dyn Probe,
) -> Result<Vec<[HeadOutput; 2]>, Error> {
    let device = model.device();
    let tokens = |encoding: &Encoding| -> Result<selenograph_model::Encoding, Error> {
        let grid = Grid { rows: encoding.height, columns: encoding.width, transposed: vec![false] };
        let dim = model.config().encoder.dim;
        let tokens = Tokens::from_values(encoding.tokens.clone(), grid, dim, &device)?;
        match (&encoding.maps, model.config().stem_dims) {
            (Some(maps), Some([half, quarter, _])) => {
                Ok(tokens.with_map_values(maps.clone(), [half, quarter])?)
            }
            _ => Ok(tokens),
        }
    };
    let one = |(pair, (a, b)): (usize, &(&Encoding, &Encoding))| {
        let [first, second] = model.decode(&tokens(a)?, &tokens(b)?)?;
        let outputs = [output(first)?, output(second)?];
        watch.finished(Stage::Head { pair, view: 1 });
        Ok(outputs)
    };
    pairs.iter().enumerate().map(one).collect()
}

/// Into the form that the engine gives.
fn output(output: Output) -> Result<HeadOutput, Error> {
    let [_, height_px, width_px, _] = output.points.dims();
    let descriptor_dim = output.descriptors.as_ref().map_or(0, |each| each.dims()[3]);
    Ok(HeadOutput {
        height_px,
        width_px,
        points: values(output.points)?,
        confidence: values(output.confidence)?,
        descriptor_dim,
        descriptors: output.descriptors.map_or(Ok(Vec::new()), values)?,
        // Without descriptors there is none, as the engine has it.
        descriptor_confidence: match output.descriptor_confidence {
            Some(confidence) if descriptor_dim > 0 => values(confidence)?,
            _ => Vec::new(),
        },
    })
}

fn values<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f32>, Error> {
    tensor
        .try_into_data()
        .map_err(|error| error.to_string())
        .and_then(|data| data.try_into_vec::<f32>().map_err(|error| error.to_string()))
        .map_err(|said| Error::Reading { said })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use super::super::{Executor, Loaded};
    use super::*;
    use selenograph_network::{Checkpoint, NetworkConfig, Preset};

    /// Both executors stay within the goldens' tolerance, 5e-4 of the largest value; of each other within twice that.
    const TOLERANCE: f32 = 1e-3;

    #[test]
    fn burn_says_what_the_engine_says() {
        for preset in [Preset::Tiny, Preset::Hybrid] {
            check(&preset.config());
        }
    }

    fn check(config: &NetworkConfig) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("w.safetensors");
        selenograph_network::random::write(config, 3, &path, &mut |_| {}).unwrap();
        let checkpoint = Checkpoint::open(&path).unwrap();
        // Portrait and landscape.
        let values: Vec<f32> = (0..3 * 48 * 32).map(|k| ((k * 7919) % 255) as f32 / 127.5 - 1.0).collect();
        let images =
            [(48, 32), (32, 48)].map(|(height_px, width_px)| Image { height_px, width_px, values: &values });
        let [ours, theirs] = ["cpu", "burn-cpu"].map(|name| {
            let loaded = Loaded::new(&checkpoint, &Executor::named(name).unwrap(), &mut |_| {}).unwrap();
            let encodings = loaded.encode(&images, &mut |_| {}).unwrap();
            assert!(encodings.iter().all(|each| each.maps.is_some() == config.stem_dims.is_some()));
            let pairs = [(&encodings[0], &encodings[1]), (&encodings[1], &encodings[0])];
            loaded.decode(&pairs, &mut |_| {}).unwrap()
        });
        for (a, b) in ours.iter().flatten().zip(theirs.iter().flatten()) {
            assert_eq!(
                (a.height_px, a.width_px, a.descriptor_dim),
                (b.height_px, b.width_px, b.descriptor_dim)
            );
            for (x, y) in [
                (&a.points, &b.points),
                (&a.confidence, &b.confidence),
                (&a.descriptors, &b.descriptors),
                (&a.descriptor_confidence, &b.descriptor_confidence),
            ] {
                assert_eq!(x.len(), y.len());
                let largest = x.iter().fold(0.0f32, |most, value| most.max(value.abs()));
                let off = x.iter().zip(y).fold(0.0f32, |most, (x, y)| most.max((x - y).abs()));
                assert!(largest > 0.0 && off <= TOLERANCE * largest, "{off} of {largest}");
            }
        }
    }
}
