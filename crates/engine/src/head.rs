//! All of a view's head: the dense map and the descriptors.

use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig};

use crate::buffer::{SharedOut, with_scratch};
use crate::dpt::{DptHead, Hooks, MAP_CHANNELS};
use crate::error::Result;
use crate::gemm::{Finish, Input, gemm, gemm_part};
use crate::kernel::Simd;
use crate::output::{HeadOutput, describe, unpack_descriptors, unpack_map};
use crate::packed::Packed;
use crate::probe::Watch;
use crate::transformer::Context;
use crate::vector::Activation;
use crate::weights::Reader;

/// Hidden channels of the descriptors' MLP, in units of its input.
const HIDDEN_FACTOR: usize = 4;

/// Pixels that are described at once.
const DESCRIBED_PIXELS: usize = 192;

/// Values of scratch memory that pixels of so many raw channels take.
pub(crate) const fn scratch_len(channels: usize) -> usize {
    DESCRIBED_PIXELS * channels
}

/// What descriptors are computed from.
enum Source {
    /// Tokens of encoder and decoder, patch by patch.
    Tokens { fc1: Packed, fc2: Packed },
    /// Features of the dense head, pixel by pixel: networks with a stem.
    Features(Packed),
}

struct DescriptorHead {
    source: Source,
    dim: usize,
    mode: Option<ConfidenceMode>,
}

/// One of the two heads.
pub(crate) struct Head {
    dpt: DptHead,
    descriptors: Option<DescriptorHead>,
    patch_px: usize,
    modes: (DepthMode, ConfidenceMode),
}

impl DescriptorHead {
    fn read(reader: &mut Reader<'_>, config: &NetworkConfig, prefix: &str, dim: usize) -> Result<Self> {
        let mode = config.descriptor_confidence;
        let channels = dim + usize::from(mode.is_some());
        let source = match config.stem_dims {
            Some(_) => Source::Features(reader.conv1(prefix, config.dpt_last_dim, channels)?),
            None => Source::read_mlp(reader, config, prefix, channels)?,
        };
        Ok(Self { source, dim, mode })
    }

    /// Descriptors of consecutive pixels and their confidences.
    fn describe(&self, level: Simd, layer: &Packed, features: &[f32], to: &mut [f32], conf: &mut [f32]) {
        let (inputs, channels) = (layer.inputs, layer.outputs);
        with_scratch(scratch_len(channels), |raw| {
            let parts = to.chunks_mut(DESCRIBED_PIXELS * self.dim).zip(conf.chunks_mut(DESCRIBED_PIXELS));
            for ((to, conf), data) in parts.zip(features.chunks(DESCRIBED_PIXELS * inputs)) {
                let finish = Finish::store(raw, channels);
                let input = Input::Rows { data, stride: inputs };
                gemm_part(level, &input, (0, conf.len()), (0, layer.num_panels()), layer, &finish);
                let pixels = to.chunks_exact_mut(self.dim).zip(conf).zip(raw.chunks_exact(channels));
                pixels.for_each(|((to, conf), raw)| describe(level, raw, self.mode, to, conf));
            }
        });
    }
}

impl Source {
    fn read_mlp(
        reader: &mut Reader<'_>,
        config: &NetworkConfig,
        prefix: &str,
        channels: usize,
    ) -> Result<Self> {
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
        Ok(Self::Tokens { fc1, fc2 })
    }

    fn num_bytes(&self) -> usize {
        match self {
            Self::Tokens { fc1, fc2 } => fc1.num_bytes() + fc2.num_bytes(),
            Self::Features(layer) => layer.num_bytes(),
        }
    }
}

impl Head {
    pub(crate) fn read(reader: &mut Reader<'_>, config: &NetworkConfig, prefix: &str) -> Result<Self> {
        let local = format!("{prefix}.head_local_features");
        let descriptors = match config.descriptor_dim {
            Some(dim) => Some(DescriptorHead::read(reader, config, &local, dim)?),
            None => None,
        };
        Ok(Self {
            dpt: DptHead::read(reader, config, &format!("{prefix}.dpt"))?,
            descriptors,
            patch_px: config.patch_px,
            modes: (config.depth_mode, config.confidence),
        })
    }

    pub(crate) fn num_bytes(&self) -> usize {
        self.dpt.num_bytes() + self.descriptors.as_ref().map_or(0, |head| head.source.num_bytes())
    }

    pub(crate) fn run(&self, context: &Context<'_>, hooks: &Hooks<'_>, watch: &mut Watch<'_>) -> HeadOutput {
        let (height_px, width_px) = (hooks.height * self.patch_px, hooks.width * self.patch_px);
        let num_pixels = height_px * width_px;
        let described = if self.descriptors.is_some() { num_pixels } else { 0 };
        let descriptor_dim = self.descriptors.as_ref().map_or(0, |head| head.dim);
        let mut output = HeadOutput {
            height_px,
            width_px,
            points: vec![0.0; 3 * num_pixels],
            confidence: vec![0.0; num_pixels],
            descriptor_dim,
            descriptors: vec![0.0; described * descriptor_dim],
            descriptor_confidence: vec![0.0; described],
        };
        {
            let mut map = context.pool.take(MAP_CHANNELS * num_pixels);
            match &self.descriptors {
                Some(head @ DescriptorHead { source: Source::Features(layer), .. }) => {
                    let descriptors = SharedOut::new(&mut output.descriptors);
                    let confidences = SharedOut::new(&mut output.descriptor_confidence);
                    self.dpt.run(context, hooks, watch, &mut map, |first, features| {
                        let count = features.len() / layer.inputs;
                        // SAFETY: no two calls have pixels in common; `output` outlives them all.
                        let to = unsafe { descriptors.row(first * head.dim, count * head.dim) };
                        // SAFETY: as above.
                        let conf = unsafe { confidences.row(first, count) };
                        head.describe(context.level, layer, features, to, conf);
                    });
                }
                _ => self.dpt.run(context, hooks, watch, &mut map, |_, _| {}),
            }
            unpack_map(&map, self.modes, &mut output.points, &mut output.confidence);
        }
        if let Some(head) = &self.descriptors {
            if let Source::Tokens { fc1, fc2 } = &head.source {
                self.describe_tokens(context, [fc1, fc2], head, hooks, watch, &mut output);
            }
            if head.mode.is_none() {
                output.descriptor_confidence.copy_from_slice(&output.confidence);
            }
        }
        output
    }

    fn describe_tokens(
        &self,
        context: &Context<'_>,
        [fc1, fc2]: [&Packed; 2],
        head: &DescriptorHead,
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
            (self.patch_px, output.width_px, head.dim),
            head.mode,
            &mut output.descriptors,
            &mut output.descriptor_confidence,
        );
    }
}
