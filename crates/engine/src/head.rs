//! All of a view's head: the dense map and the descriptors.

use selenograph_network::config::NetworkConfig;

use crate::dpt::{DptHead, Hooks, MAP_CHANNELS};
use crate::error::Result;
use crate::gemm::{Finish, Input, gemm};
use crate::output::{HeadOutput, Modes, unpack_descriptors, unpack_halves, unpack_map};
use crate::packed::Packed;
use crate::probe::Watch;
use crate::transformer::Context;
use crate::upsample::Pixels;
use crate::vector::Activation;
use crate::weights::Reader;

/// Hidden channels of the descriptors' MLP, in units of its input.
const HIDDEN_FACTOR: usize = 4;

/// Descriptors from tokens of encoder and decoder, patch by patch.
struct Mlp {
    fc1: Packed,
    fc2: Packed,
}

/// What the head's outputs are computed from.
enum Source {
    /// The dense head's map and, where there are descriptors, tokens.
    Map(Option<Mlp>),
    /// Features of the dense head at half the image's size, for everything: networks with a stem.
    Features(Packed),
}

/// One of the two heads.
pub(crate) struct Head {
    dpt: DptHead,
    source: Source,
    descriptor_dim: usize,
    patch_px: usize,
    modes: Modes,
}

impl Mlp {
    fn read(reader: &mut Reader<'_>, config: &NetworkConfig, prefix: &str, channels: usize) -> Result<Self> {
        let (enc, dec) = (config.encoder.dim, config.decoder.dim);
        let hidden = HIDDEN_FACTOR * (enc + dec);
        let area = config.patch_area();
        let outputs = channels * area;
        let weights1 = reader.values(&format!("{prefix}.fc1.weight"), &[hidden, enc + dec])?;
        let bias1 = reader.values(&format!("{prefix}.fc1.bias"), &[hidden])?;
        let fc1 = Packed::new(&[enc, dec], hidden, Some(&bias1), |output, input| {
            weights1[output * (enc + dec) + input]
        });
        let weights2 = reader.values(&format!("{prefix}.fc2.weight"), &[outputs, hidden])?;
        let bias2 = reader.values(&format!("{prefix}.fc2.bias"), &[outputs])?;
        // The checkpoint has a channel's pixels together; here a pixel's channels are.
        let from = |output: usize| output % channels * area + output / channels;
        let bias2: Vec<f32> = (0..outputs).map(|output| bias2[from(output)]).collect();
        let fc2 = Packed::new(&[hidden], outputs, Some(&bias2), |output, input| {
            weights2[from(output) * hidden + input]
        });
        Ok(Self { fc1, fc2 })
    }
}

impl Source {
    /// A layer on the features: the map's channels, then the descriptors'.
    fn features(
        reader: &mut Reader<'_>,
        config: &NetworkConfig,
        prefix: &str,
        dpt: &DptHead,
    ) -> Result<Self> {
        let Some(channels) = config.descriptor_channels() else {
            return Ok(Self::Features(dpt.last_layer((&[], &[]))));
        };
        let shape = [channels, config.dpt_last_dim, 1, 1];
        let weights = reader.values(&format!("{prefix}.weight"), &shape)?;
        let bias = reader.values(&format!("{prefix}.bias"), &shape[..1])?;
        Ok(Self::Features(dpt.last_layer((&weights, &bias))))
    }

    fn num_bytes(&self) -> usize {
        match self {
            Self::Map(mlp) => mlp.as_ref().map_or(0, |mlp| mlp.fc1.num_bytes() + mlp.fc2.num_bytes()),
            Self::Features(layer) => layer.num_bytes(),
        }
    }
}

impl Head {
    pub(crate) fn read(reader: &mut Reader<'_>, config: &NetworkConfig, prefix: &str) -> Result<Self> {
        let local = format!("{prefix}.head_local_features");
        let read_dpt = |reader: &mut Reader<'_>| DptHead::read(reader, config, &format!("{prefix}.dpt"));
        let (source, dpt) = if config.stem_dims.is_some() {
            let dpt = read_dpt(reader)?;
            (Source::features(reader, config, &local, &dpt)?, dpt)
        } else {
            // The largest tensors before the others: they are held twice while they are packed.
            let channels = config.descriptor_channels();
            let mlp = channels.map(|channels| Mlp::read(reader, config, &local, channels)).transpose()?;
            (Source::Map(mlp), read_dpt(reader)?)
        };
        Ok(Self {
            source,
            dpt,
            descriptor_dim: config.descriptor_dim.unwrap_or(0),
            patch_px: config.patch_px,
            modes: Modes {
                points: config.depth_mode,
                confidence: config.confidence,
                descriptors: config.descriptor_confidence,
            },
        })
    }

    pub(crate) fn num_bytes(&self) -> usize {
        self.dpt.num_bytes() + self.source.num_bytes()
    }

    pub(crate) fn run(&self, context: &Context<'_>, hooks: &Hooks<'_>, watch: &mut Watch<'_>) -> HeadOutput {
        let (height_px, width_px) = (hooks.height * self.patch_px, hooks.width * self.patch_px);
        let num_pixels = height_px * width_px;
        let described = if self.descriptor_dim > 0 { num_pixels } else { 0 };
        let mut output = HeadOutput {
            height_px,
            width_px,
            points: vec![0.0; 3 * num_pixels],
            confidence: vec![0.0; num_pixels],
            descriptor_dim: self.descriptor_dim,
            descriptors: vec![0.0; self.descriptor_dim * num_pixels],
            descriptor_confidence: vec![0.0; described],
        };
        match &self.source {
            Source::Map(mlp) => {
                self.locate(context, hooks, watch, &mut output);
                if let Some(mlp) = mlp {
                    self.describe(context, mlp, hooks, watch, &mut output);
                }
            }
            Source::Features(layer) => self.enlarge(context, layer, hooks, watch, &mut output),
        }
        if self.descriptor_dim > 0 && self.modes.descriptors.is_none() {
            output.descriptor_confidence.copy_from_slice(&output.confidence);
        }
        output
    }

    fn locate(
        &self,
        context: &Context<'_>,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
        output: &mut HeadOutput,
    ) {
        let mut map = context.pool.take(MAP_CHANNELS * output.confidence.len());
        self.dpt.run(context, hooks, watch, &mut map);
        unpack_map(&map, &self.modes, &mut output.points, &mut output.confidence);
    }

    fn describe(
        &self,
        context: &Context<'_>,
        Mlp { fc1, fc2 }: &Mlp,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
        output: &mut HeadOutput,
    ) {
        let num_tokens = hooks.height * hooks.width;
        let [encoded, .., decoded] = hooks.tokens;
        let parts = [(encoded, encoded.len() / num_tokens), (decoded, decoded.len() / num_tokens)];
        let mut hidden = context.pool.take(num_tokens * fc1.outputs);
        let finish = Finish::store(&mut hidden, fc1.outputs).with(Activation::Gelu);
        gemm(context.level, &Input::Pair { parts }, num_tokens, fc1, &finish);
        let mut raw = context.pool.take(num_tokens * fc2.outputs);
        context.linear(&hidden, fc2, &Finish::store(&mut raw, fc2.outputs));
        watch.see(|| format!("{}.mlp_out", hooks.name), &[num_tokens, fc2.outputs], &raw);
        unpack_descriptors(
            context.level,
            &raw,
            (self.patch_px, output.width_px, self.descriptor_dim),
            &self.modes,
            &mut output.descriptors,
            &mut output.descriptor_confidence,
        );
    }

    /// Everything, from raw channels at half the image's size.
    fn enlarge(
        &self,
        context: &Context<'_>,
        layer: &Packed,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
        output: &mut HeadOutput,
    ) {
        let features = self.dpt.features(context, hooks, watch);
        let Pixels { data, width, height, .. } = features.pixels();
        let channels = layer.outputs;
        let mut raw = context.pool.take(width * height * channels);
        context.linear(data, layer, &Finish::store(&mut raw, channels));
        drop(features);
        let halves = Pixels { data: &raw, width, height, channels };
        if watch.wants_values() {
            let mut all = context.pool.take(4 * raw.len());
            halves.enlarge(context.level, 2 * width, &mut all);
            let map: Vec<f32> =
                all.chunks_exact(channels).flat_map(|raw| &raw[..MAP_CHANNELS]).copied().collect();
            watch.see(|| format!("{}.dpt_out", hooks.name), &[2 * height, 2 * width, MAP_CHANNELS], &map);
        }
        unpack_halves(context.level, &halves, &self.modes, output);
    }
}
