//! What a pair will take, before anything is loaded.

use crate::{Density, Error, Passes, PredictOptions};
use selenograph_engine::MemoryFootprint;
use selenograph_network::NetworkConfig;
use selenograph_network::cost::{Directions, Flops};
use selenograph_network::input::InputTransform;
use selenograph_reconstruct::evidence::FocalKnowledge;

/// What the engine reaches of the rate of large products: attention and small layers are slower.
const EFFICIENCY: f64 = 0.8;
/// Jumps to the nearest and back until a start stays, on average.
const JUMPS: f64 = 2.0;
/// Bytes of a picture's pixel: its grey level, and its point with a confidence, twice while they are gathered.
const PICTURE_PIXEL_BYTES: usize = 4 + 2 * 16;
/// Bytes of a channel of a descriptor that is packed for matching: exact, and for a first look.
const MATCHED_CHANNEL_BYTES: usize = 4 + 1;
/// Bytes of a pixel beside: where it lies, and its nearest.
const MATCHED_PIXEL_BYTES: usize = 8;

/// Work and memory of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Width and height of both inputs.
    pub inputs: [[usize; 2]; 2],
    /// Floating-point operations.
    pub flops: Flops,
    /// Floating-point operations of the matching: products of descriptors.
    pub matching_flops: f64,
    /// Memory of the engine.
    pub footprint: MemoryFootprint,
    /// Bytes of pictures, of points on their grids, and of matching.
    pub beside: usize,
}

/// Of the nearest descriptors that are looked for: from the starts on a grid, and from every pixel where matches are dense.
fn matching_flops(
    config: &NetworkConfig,
    [[width_a, height_a], [width_b, height_b]]: [[usize; 2]; 2],
    options: &PredictOptions,
) -> f64 {
    let (a, b) = ((width_a * height_a) as f64, (width_b * height_b) as f64);
    let starts = a / (options.subsample_px.max(1) as f64).powi(2);
    let published = 2.0 * JUMPS * starts;
    // Forth from every pixel of A, and back from those of B that are somebody's nearest: all, at most.
    let dense = if options.density == Density::Dense { a + b } else { 0.0 };
    let ways = if options.passes == Passes::Symmetric { 2.0 } else { 1.0 };
    let length = config.descriptor_dim.unwrap_or(0) as f64;
    2.0 * length * 0.5 * (a + b) * (ways * published + dense)
}

impl Estimate {
    /// Of two pictures, `[width, height]` in pixels each. Where the focal length is guessed, a pair is decoded both ways.
    ///
    /// # Errors
    /// [`Error::Network`] for a picture below one patch, [`Error::Engine`] for dimensions that no network has.
    pub fn new(
        config: &NetworkConfig,
        pictures: [[usize; 2]; 2],
        options: &PredictOptions,
        focal: FocalKnowledge,
        num_threads: usize,
    ) -> Result<Self, Error> {
        let input = |[width, height]: [usize; 2]| -> Result<[usize; 2], Error> {
            Ok(InputTransform::new(width, height, options.input, config.patch_px)?.input)
        };
        let inputs = [input(pictures[0])?, input(pictures[1])?];
        let both_ways = options.passes == Passes::Symmetric || focal == FocalKnowledge::Guessed;
        let directions = if both_ways { Directions::Both } else { Directions::Forward };
        let area = |sizes: [[usize; 2]; 2]| sizes.iter().map(|[width, height]| width * height).sum::<usize>();
        let matched =
            config.descriptor_dim.map_or(0, |dim| MATCHED_CHANNEL_BYTES * dim + MATCHED_PIXEL_BYTES);
        // Matches of both ways are held until both are there.
        let num_matched = if options.passes == Passes::Symmetric { 2 } else { 1 };
        Ok(Self {
            inputs,
            flops: Flops::of_pair(config, inputs, directions),
            matching_flops: matching_flops(config, inputs, options),
            footprint: MemoryFootprint::of_pair(config, inputs, directions, num_threads)?,
            beside: PICTURE_PIXEL_BYTES * area(pictures) + num_matched * matched * area(inputs),
        })
    }

    /// Bytes at most.
    pub fn bytes(&self) -> u64 {
        (self.footprint.peak() + self.beside) as u64
    }

    /// Seconds, on a machine that does so many floating-point operations per second in large products; loading comes once on top.
    pub fn seconds(&self, product_rate: f64) -> f64 {
        (self.flops.total() + self.matching_flops) / (EFFICIENCY * product_rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_network::Preset;

    #[test]
    fn a_second_direction_and_larger_pictures_cost_more() {
        let config = Preset::Mast3rVitl.config();
        let of = |side: usize, passes, focal| {
            let options = PredictOptions { passes, ..PredictOptions::default() };
            Estimate::new(&config, [[side; 2]; 2], &options, focal, 2).unwrap()
        };
        let one = of(512, Passes::Forward, FocalKnowledge::Known);
        assert_eq!(one.inputs, [[512; 2]; 2]);
        let symmetric = of(512, Passes::Symmetric, FocalKnowledge::Known);
        // Without a focal length both ways are decoded, and one is matched.
        let guessed = of(512, Passes::Forward, FocalKnowledge::Guessed);
        assert!(symmetric.flops == guessed.flops && symmetric.bytes() > guessed.bytes());
        assert!(symmetric.bytes() > one.bytes() && symmetric.seconds(1e11) > one.seconds(1e11));
        assert!(of(256, Passes::Forward, FocalKnowledge::Known).bytes() < one.bytes());
        // Matching every pixel is most of what a small network takes.
        let small = Preset::Tiny.config();
        let matched = |density| {
            let options = PredictOptions { density, ..PredictOptions::default() };
            Estimate::new(&small, [[512; 2]; 2], &options, FocalKnowledge::Known, 2).unwrap()
        };
        let (published, dense) = (matched(Density::Published), matched(Density::Dense));
        assert!(published.matching_flops > 0.0 && dense.seconds(1e11) > 2.0 * published.seconds(1e11));
        // What is larger than the input is made smaller; the picture itself is still held.
        let large = of(4096, Passes::Forward, FocalKnowledge::Known);
        assert!(large.flops == one.flops && large.bytes() > one.bytes());
        assert!(
            Estimate::new(&config, [[8; 2]; 2], &PredictOptions::default(), FocalKnowledge::Known, 2)
                .is_err()
        );
    }
}
