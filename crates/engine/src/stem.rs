//! The convolutional stem: maps at a half, a quarter and an eighth of an image's size.

use rayon::prelude::*;
use selenograph_network::config::{IMAGE_CHANNELS, STEM_VARIANCE_FLOOR};

use crate::conv::Residual;
use crate::error::Result;
use crate::gemm::Finish;
use crate::image::Image;
use crate::packed::Packed;
use crate::transformer::Context;
use crate::upsample::Pixels;
use crate::vector::Activation;
use crate::weights::Reader;

/// What the dense heads read of a stem: maps at a half and a quarter of the image's size, channels last.
pub(crate) type StemMaps = [Vec<f32>; 2];

/// To half the size, and a residual unit there.
struct Level {
    down: Packed,
    residual: Residual,
}

/// The stem's layers.
pub(crate) struct Stem {
    levels: [Level; 3],
    zeros: Vec<f32>,
}

impl Stem {
    pub(crate) fn read(reader: &mut Reader<'_>, dims: [usize; 3]) -> Result<Self> {
        let mut level = |idx: usize, inputs: usize| {
            let prefix = format!("stem.{idx}");
            let down = reader.conv3(&format!("{prefix}.down"), inputs, dims[idx], true)?;
            Ok(Level { down, residual: Residual::read(reader, &prefix, dims[idx])? })
        };
        let levels = [level(0, IMAGE_CHANNELS)?, level(1, dims[0])?, level(2, dims[1])?];
        let widest = dims.into_iter().fold(IMAGE_CHANNELS, usize::max);
        Ok(Self { levels, zeros: vec![0.0; widest] })
    }

    pub(crate) fn num_bytes(&self) -> usize {
        self.levels.iter().map(|level| level.down.num_bytes() + level.residual.num_bytes()).sum()
    }

    /// The finer maps, and the last one's patches of two by two pixels, one row each: row, column, channel.
    pub(crate) fn run(&self, context: &Context<'_>, image: &Image<'_>, patches: &mut [f32]) -> StemMaps {
        let (width, height) = (image.width_px, image.height_px);
        let area = width * height;
        let [fine, coarse, last] = &self.levels;
        let mut half = vec![0.0; area / 4 * fine.down.outputs];
        let map = {
            let mut pixels = context.pool.take(image.values.len());
            interleave(image, &mut pixels);
            let map = Pixels { data: &pixels, width, height, channels: IMAGE_CHANNELS };
            self.level(context, fine, &map, &mut half)
        };
        let mut quarter = vec![0.0; area / 16 * coarse.down.outputs];
        let map = self.level(context, coarse, &map, &mut quarter);
        let mut eighth = context.pool.take(area / 64 * last.down.outputs);
        cut(&self.level(context, last, &map, &mut eighth), patches);
        [half, quarter]
    }

    /// `from` at half its size, in `out`.
    fn level<'o>(
        &self,
        context: &Context<'_>,
        Level { down, residual }: &Level,
        from: &Pixels<'_>,
        out: &'o mut [f32],
    ) -> Pixels<'o> {
        let channels = down.outputs;
        let (width, height) = (from.width / 2, from.height / 2);
        let [mut positive, mut hidden] = [0, 1].map(|_| context.pool.take(out.len()));
        let finish = Finish::store(out, channels).with_positive(&mut positive);
        context.conv3(from, 2, down, &self.zeros, &finish);
        let map = Pixels { data: &positive, width, height, channels };
        let finish = Finish::store(&mut hidden, channels).with(Activation::Relu);
        context.conv3(&map, 1, &residual.conv1, &self.zeros, &finish);
        let map = Pixels { data: &hidden, ..map };
        context.conv3(&map, 1, &residual.conv2, &self.zeros, &Finish::store(out, channels).onto());
        Pixels { data: out, width, height, channels }
    }
}

/// An image's channels side by side, pixel by pixel, all values together with mean 0 and variance 1.
fn interleave(image: &Image<'_>, out: &mut [f32]) {
    let count = image.values.len() as f64;
    let mean = image.values.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
    let variance = image.values.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / count;
    let (mean, factor) = (mean as f32, (1.0 / (variance + STEM_VARIANCE_FLOOR).sqrt()) as f32);
    let width = image.width_px;
    let plane = width * image.height_px;
    out.par_chunks_mut(IMAGE_CHANNELS * width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(IMAGE_CHANNELS).enumerate() {
            for (channel, value) in pixel.iter_mut().enumerate() {
                *value = (image.values[channel * plane + y * width + x] - mean) * factor;
            }
        }
    });
}

/// A map's patches of two by two pixels.
fn cut(map: &Pixels<'_>, out: &mut [f32]) {
    let per_row = map.width / 2;
    let run = 2 * map.channels;
    out.par_chunks_mut(2 * run).enumerate().for_each(|(token, patch)| {
        let (y, x) = (token / per_row * 2, token % per_row * 2);
        for (line, to) in patch.chunks_exact_mut(run).enumerate() {
            to.copy_from_slice(&map.data[((y + line) * map.width + x) * map.channels..][..run]);
        }
    });
}
