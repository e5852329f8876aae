//! All of a view's head: the dense map and the descriptors.

use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig};

use crate::dpt::{DptHead, Hooks, MAP_CHANNELS};
use crate::error::Result;
use crate::gemm::{Finish, Input, gemm};
use crate::output::{HeadOutput, unpack_descriptors, unpack_map};
use crate::packed::Packed;
use crate::probe::Watch;
use crate::transformer::Context;
use crate::vector::Activation;
use crate::weights::Reader;

/// Hidden channels of the descriptors' MLP, in units of its input.
const HIDDEN_FACTOR: usize = 4;

struct DescriptorHead {
    fc1: Packed,
    fc2: Packed,
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
        let (enc, dec) = (config.encoder.dim, config.decoder.dim);
        let hidden = HIDDEN_FACTOR * (enc + dec);
        let mode = config.descriptor_confidence;
        let channels = dim + usize::from(mode.is_some());
        let area = config.patch_px * config.patch_px;
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
        Ok(Self { fc1, fc2, dim, mode })
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
        let mlp = self.descriptors.as_ref().map_or(0, |d| d.fc1.num_bytes() + d.fc2.num_bytes());
        self.dpt.num_bytes() + mlp
    }

    pub(crate) fn run(&self, context: &Context<'_>, hooks: &Hooks<'_>, watch: &mut Watch<'_>) -> HeadOutput {
        let (height_px, width_px) = (hooks.height * self.patch_px, hooks.width * self.patch_px);
        let num_pixels = height_px * width_px;
        let mut points = vec![0.0; 3 * num_pixels];
        let mut confidence = vec![0.0; num_pixels];
        {
            let mut map = context.pool.take(MAP_CHANNELS * num_pixels);
            self.dpt.run(context, hooks, watch, &mut map);
            unpack_map(&map, self.modes, &mut points, &mut confidence);
        }
        let mut output = HeadOutput {
            height_px,
            width_px,
            points,
            confidence,
            descriptor_dim: 0,
            descriptors: Vec::new(),
            descriptor_confidence: Vec::new(),
        };
        if let Some(head) = &self.descriptors {
            self.describe(context, head, hooks, watch, &mut output);
        }
        output
    }

    fn describe(
        &self,
        context: &Context<'_>,
        head: &DescriptorHead,
        hooks: &Hooks<'_>,
        watch: &mut Watch<'_>,
        output: &mut HeadOutput,
    ) {
        let num_tokens = hooks.height * hooks.width;
        let [encoded, .., decoded] = hooks.tokens;
        let parts = [(encoded, encoded.len() / num_tokens), (decoded, decoded.len() / num_tokens)];
        let mut hidden = context.pool.take(num_tokens * head.fc1.outputs);
        let finish = Finish::store(&mut hidden, head.fc1.outputs).with(Activation::Gelu);
        gemm(context.level, &Input::Pair { parts }, num_tokens, &head.fc1, &finish);
        let mut raw = context.pool.take(num_tokens * head.fc2.outputs);
        context.linear(&hidden, &head.fc2, &Finish::store(&mut raw, head.fc2.outputs));
        watch.see(|| format!("{}.mlp_out", hooks.name), &[num_tokens, head.fc2.outputs], &raw);
        let num_pixels = output.confidence.len();
        output.descriptor_dim = head.dim;
        output.descriptors = vec![0.0; num_pixels * head.dim];
        output.descriptor_confidence = vec![0.0; num_pixels];
        unpack_descriptors(
            context.level,
            &raw,
            (self.patch_px, output.width_px, head.dim),
            head.mode,
            &mut output.descriptors,
            &mut output.descriptor_confidence,
        );
        if head.mode.is_none() {
            output.descriptor_confidence.copy_from_slice(&output.confidence);
        }
    }
}
