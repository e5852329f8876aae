//! From images to tokens.

use rayon::prelude::*;
use selenograph_network::config::{IMAGE_CHANNELS, NetworkConfig};

use crate::attention::Grid;
use crate::error::Result;
use crate::gemm::Finish;
use crate::image::Image;
use crate::packed::Packed;
use crate::stem::{Stem, StemMaps};
use crate::transformer::Context;
use crate::weights::Reader;

/// Tokens are linear in a patch's pixels or, with a stem, in the pixels of its last map.
pub(crate) struct Embedding {
    stem: Option<Stem>,
    proj: Packed,
    /// Side of a patch, pixels.
    pub patch_px: usize,
}

impl Embedding {
    pub(crate) fn read(reader: &mut Reader<'_>, config: &NetworkConfig) -> Result<Self> {
        let dim = config.encoder.dim;
        let [channels, side] = config.token_input();
        let (area, inputs) = (side * side, channels * side * side);
        let stem = config.stem_dims.map(|dims| Stem::read(reader, dims)).transpose()?;
        let weights = reader.values("patch_embed.proj.weight", &[dim, channels, side, side])?;
        let bias = reader.values("patch_embed.proj.bias", &[dim])?;
        let proj = match stem {
            None => Packed::linear(&weights, inputs, dim, Some(&bias)),
            // The checkpoint has a channel's pixels together, the stem's map a pixel's channels.
            Some(_) => Packed::new(&[inputs], dim, Some(&bias), |output, input| {
                weights[output * inputs + input % channels * area + input / channels]
            }),
        };
        Ok(Self { stem, proj, patch_px: config.patch_px })
    }

    pub(crate) fn num_bytes(&self) -> usize {
        self.proj.num_bytes() + self.stem.as_ref().map_or(0, Stem::num_bytes)
    }

    /// The tokens of all images, and each image's maps of the stem.
    pub(crate) fn run(
        &self,
        context: &Context<'_>,
        images: &[Image<'_>],
        grids: &[Grid],
        tokens: &mut [f32],
    ) -> Vec<Option<StemMaps>> {
        let len = self.proj.inputs;
        let mut patches = context.pool.take(tokens.len() / self.proj.outputs * len);
        let of = |(image, grid): (&Image<'_>, &Grid)| {
            let patches = &mut patches[grid.first * len..][..grid.num_tokens() * len];
            if let Some(stem) = &self.stem {
                return Some(stem.run(context, image, patches));
            }
            cut(image, self.patch_px, *grid, patches);
            None
        };
        let maps = images.iter().zip(grids).map(of).collect();
        context.linear(&patches, &self.proj, &Finish::store(tokens, self.proj.outputs));
        maps
    }
}

/// An image's patches, one row each: channel, row, column.
fn cut(image: &Image<'_>, patch: usize, grid: Grid, out: &mut [f32]) {
    let plane = image.height_px * image.width_px;
    out.par_chunks_mut(IMAGE_CHANNELS * patch * patch).enumerate().for_each(|(token, row)| {
        let (y, x) = (token / grid.width * patch, token % grid.width * patch);
        for (line, to) in row.chunks_exact_mut(patch).enumerate() {
            let from = line / patch * plane + (y + line % patch) * image.width_px + x;
            to.copy_from_slice(&image.values[from..from + patch]);
        }
    });
}
