//! The network, ready to run.

use selenograph_network::config::NetworkConfig;

use crate::attention::Grid;
use crate::buffer::Loan;
use crate::config::check;
use crate::dpt::Hooks;
use crate::encoder::{Encoder, grids_of, rope};
use crate::error::{Error, Result, SourceError};
use crate::gemm::Finish;
use crate::head::Head;
use crate::image::Image;
use crate::kernel::Simd;
use crate::output::HeadOutput;
use crate::packed::Packed;
use crate::probe::{Probe, Stage, Watch};
use crate::stem::StemMaps;
use crate::transformer::{Context, DecoderBlock};
use crate::weights::{NamedTensor, Norm, Reader};

/// What the encoder knows of an image: enough to decode it against any number of others.
#[derive(Debug, Clone, PartialEq)]
pub struct Encoding {
    /// Rows of patches.
    pub height: usize,
    /// Columns of patches.
    pub width: usize,
    /// Tokens `[height · width, encoder channels]`, after the last normalisation.
    pub tokens: Vec<f32>,
    /// Maps of the stem at a half and a quarter of the image's size, `[rows, columns, channels]` each; `None` for networks
    /// without a stem.
    pub maps: Option<[Vec<f32>; 2]>,
}

/// The network with its weights packed for this processor.
pub struct Engine {
    config: NetworkConfig,
    encoder: Encoder,
    encoder_norm: Norm,
    decoder_embed: Packed,
    decoders: [Vec<DecoderBlock>; 2],
    decoder_norm: Norm,
    heads: [Head; 2],
}

impl Engine {
    /// Reads every tensor once, by its name in the checkpoint, and packs it.
    ///
    /// # Errors
    /// A configuration that fits no network; a tensor that `source` does not deliver or whose shape is not
    /// the configuration's.
    pub fn new(
        config: &NetworkConfig,
        source: &mut dyn FnMut(&str) -> std::result::Result<NamedTensor, SourceError>,
    ) -> Result<Self> {
        Self::with_simd(config, Simd::detect(), source)
    }

    /// As [`Engine::new`], with instructions of the caller's choice.
    ///
    /// # Errors
    /// As [`Engine::new`], and instructions that this processor does not have.
    pub fn with_simd(
        config: &NetworkConfig,
        level: Simd,
        source: &mut dyn FnMut(&str) -> std::result::Result<NamedTensor, SourceError>,
    ) -> Result<Self> {
        check(config)?;
        let level = level.checked()?;
        let reader = &mut Reader::new(source);
        let (enc, dec) = (config.encoder, config.decoder);
        let decoder = |reader: &mut Reader<'_>, name: &str| {
            (0..dec.num_blocks)
                .map(|idx| DecoderBlock::read(reader, &format!("{name}.{idx}"), &dec))
                .collect::<Result<Vec<_>>>()
        };
        Ok(Self {
            config: config.clone(),
            encoder: Encoder::read(config, level, reader)?,
            encoder_norm: reader.norm("enc_norm", enc.dim)?,
            decoder_embed: reader.linear("decoder_embed", enc.dim, dec.dim)?,
            decoders: [decoder(reader, "dec_blocks")?, decoder(reader, "dec_blocks2")?],
            decoder_norm: reader.norm("dec_norm", dec.dim)?,
            heads: [
                Head::read(reader, config, "downstream_head1")?,
                Head::read(reader, config, "downstream_head2")?,
            ],
        })
    }

    /// The network's dimensions.
    #[must_use]
    pub fn config(&self) -> &NetworkConfig {
        &self.config
    }

    /// The instructions in use.
    #[must_use]
    pub fn simd(&self) -> Simd {
        self.encoder.level
    }

    /// Bytes of packed weights.
    #[must_use]
    pub fn num_weight_bytes(&self) -> usize {
        let decoders: usize = self.decoders.iter().flatten().map(DecoderBlock::num_bytes).sum();
        let heads: usize = self.heads.iter().map(Head::num_bytes).sum();
        self.encoder.num_weight_bytes() + decoders + heads + self.decoder_embed.num_bytes()
    }

    /// Frees the buffers kept for the next run.
    pub fn release_buffers(&self) {
        self.encoder.pool.clear();
    }

    /// Encodes images, of any sizes, together.
    ///
    /// # Errors
    /// An image that is empty, not a whole number of patches, or whose values do not fill it.
    pub fn encode(&self, images: &[Image<'_>]) -> Result<Vec<Encoding>> {
        self.encode_watched(images, &mut Watch(None))
    }

    /// As [`Engine::encode`], with progress and, if wanted, a look at every layer (all images' tokens together).
    ///
    /// # Errors
    /// As [`Engine::encode`].
    pub fn encode_probed(&self, images: &[Image<'_>], probe: &mut dyn Probe) -> Result<Vec<Encoding>> {
        self.encode_watched(images, &mut Watch(Some(probe)))
    }

    /// Decodes pairs: for each the first view's output and the second's, both in the first camera's frame.
    ///
    /// # Errors
    /// An encoding of another network.
    pub fn decode(&self, pairs: &[(&Encoding, &Encoding)]) -> Result<Vec<[HeadOutput; 2]>> {
        self.decode_watched(pairs, &mut Watch(None))
    }

    /// As [`Engine::decode`], with progress and, if wanted, a look at every layer (all pairs' tokens together).
    ///
    /// # Errors
    /// As [`Engine::decode`].
    pub fn decode_probed(
        &self,
        pairs: &[(&Encoding, &Encoding)],
        probe: &mut dyn Probe,
    ) -> Result<Vec<[HeadOutput; 2]>> {
        self.decode_watched(pairs, &mut Watch(Some(probe)))
    }

    /// Both views of a pair in the frame of `a`.
    ///
    /// # Errors
    /// As [`Engine::encode`].
    pub fn infer(&self, a: Image<'_>, b: Image<'_>) -> Result<[HeadOutput; 2]> {
        let encodings = self.encode(&[a, b])?;
        let mut outputs = self.decode(&[(&encodings[0], &encodings[1])])?;
        Ok(outputs.swap_remove(0))
    }

    /// The pair both ways, each image encoded once: `[a, b]` in the frame of `a`, then `[b, a]` in that of `b`.
    ///
    /// # Errors
    /// As [`Engine::encode`].
    pub fn infer_symmetric(&self, a: Image<'_>, b: Image<'_>) -> Result<[[HeadOutput; 2]; 2]> {
        let encodings = self.encode(&[a, b])?;
        let (a, b) = (&encodings[0], &encodings[1]);
        let mut outputs = self.decode(&[(a, b), (b, a)])?;
        let backward = outputs.swap_remove(1);
        Ok([outputs.swap_remove(0), backward])
    }

    fn context(&self) -> Context<'_> {
        Context { level: self.encoder.level, pool: &self.encoder.pool }
    }

    fn encode_watched(&self, images: &[Image<'_>], watch: &mut Watch<'_>) -> Result<Vec<Encoding>> {
        let (tokens, grids, maps) = self.encoder.run(images, watch)?;
        let (context, dim) = (self.context(), self.config.encoder.dim);
        let num_tokens = tokens.len() / dim;
        let mut normed = context.pool.take(tokens.len());
        context.normalize(&tokens, &self.encoder_norm, &mut normed);
        watch.see(|| "enc_norm".to_owned(), &[num_tokens, dim], &normed);
        let encoding = |(grid, maps): (&Grid, Option<StemMaps>)| Encoding {
            height: grid.height,
            width: grid.width,
            tokens: normed[grid.first * dim..][..grid.num_tokens() * dim].to_vec(),
            maps,
        };
        Ok(grids.iter().zip(maps).map(encoding).collect())
    }

    fn check_encoding(&self, encoding: &Encoding) -> Result<()> {
        let num_tokens = encoding.height * encoding.width;
        let area = num_tokens * self.config.patch_area();
        let expected = self.config.stem_dims.map(|[half, quarter, _]| [area / 4 * half, area / 16 * quarter]);
        let expected = (num_tokens * self.config.encoder.dim, expected);
        let found = (encoding.tokens.len(), encoding.maps.as_ref().map(|maps| maps.each_ref().map(Vec::len)));
        if found == expected && num_tokens > 0 {
            return Ok(());
        }
        let told = |(tokens, maps): (usize, Option<[usize; 2]>)| match maps {
            Some([half, quarter]) => format!("{tokens}, and {half} and {quarter} of the stem's maps"),
            None => tokens.to_string(),
        };
        Err(Error::Image { what: "values of an encoding", expected: told(expected), found: told(found) })
    }

    fn decode_watched(
        &self,
        pairs: &[(&Encoding, &Encoding)],
        watch: &mut Watch<'_>,
    ) -> Result<Vec<[HeadOutput; 2]>> {
        let sides = [pairs.iter().map(|p| p.0).collect(), pairs.iter().map(|p| p.1).collect::<Vec<_>>()];
        for encoding in sides.iter().flatten() {
            self.check_encoding(encoding)?;
        }
        let grids = [0, 1].map(|side| grids_of(sides[side].iter().map(|e| (e.height, e.width))));
        let hooks = self.decoded(&sides, &grids, watch);
        let dim = self.config.decoder.dim;
        let context = self.context();
        let mut outputs = Vec::with_capacity(pairs.len());
        for idx in 0..pairs.len() {
            let [first, second] = [0, 1].map(|side| {
                let grid = grids[side][idx];
                let level = |hook: usize| &hooks[side][hook][grid.first * dim..][..grid.num_tokens() * dim];
                let tokens = [sides[side][idx].tokens.as_slice(), level(0), level(1), level(2)];
                let name = ["head1", "head2"][side];
                let maps = sides[side][idx].maps.as_ref().map(|maps| maps.each_ref().map(Vec::as_slice));
                let hooks = Hooks { tokens, maps, height: grid.height, width: grid.width, name };
                let output = self.heads[side].run(&context, &hooks, watch);
                watch.finished(Stage::Head { pair: idx, view: side });
                output
            });
            outputs.push([first, second]);
        }
        Ok(outputs)
    }

    /// Both sides' tokens at the three hooks inside the decoders.
    fn decoded(
        &self,
        sides: &[Vec<&Encoding>; 2],
        grids: &[Vec<Grid>; 2],
        watch: &mut Watch<'_>,
    ) -> [[Loan<'_>; 3]; 2] {
        let (context, dim) = (self.context(), self.config.decoder.dim);
        let counts = [0, 1].map(|side: usize| grids[side].iter().map(Grid::num_tokens).sum::<usize>());
        let mut tokens = [0, 1].map(|side| {
            let mut tokens = context.pool.take(counts[side] * dim);
            for (encoding, grid) in sides[side].iter().zip(&grids[side]) {
                let part = &mut tokens[grid.first * dim..][..grid.num_tokens() * dim];
                context.linear(&encoding.tokens, &self.decoder_embed, &Finish::store(part, dim));
            }
            watch.see(|| format!("decoder_embed.{}", side + 1), &[counts[side], dim], &tokens);
            tokens
        });
        let all: Vec<Grid> = grids.iter().flatten().copied().collect();
        let rope = rope(&self.config.decoder, self.config.rope_base, &all);
        let pairs = [0, 1].map(|side: usize| {
            grids[side].iter().copied().zip(grids[1 - side].iter().copied()).collect::<Vec<_>>()
        });
        let mut hooks = [0, 1].map(|side| [0, 1, 2].map(|_| context.pool.take(counts[side] * dim)));
        let depth_of = |quarters: usize| self.config.decoder.num_blocks * quarters / 4;
        for idx in 0..self.config.decoder.num_blocks {
            // Both sides read the other's previous level: what they need of it is computed first.
            let others = [0, 1].map(|side| {
                let mut other = context.pool.take(counts[1 - side] * 2 * dim);
                self.decoders[side][idx].read_other(&context, &tokens[1 - side], &mut other);
                other
            });
            for side in 0..2 {
                let block = &self.decoders[side][idx];
                block.run(&context, &rope, &mut tokens[side], &others[side], &pairs[side]);
                watch.see(|| format!("dec{}_block{idx}", side + 1), &[counts[side], dim], &tokens[side]);
                for (hook, quarters) in [2, 3].into_iter().enumerate() {
                    if depth_of(quarters) == idx + 1 {
                        hooks[side][hook].copy_from_slice(&tokens[side]);
                    }
                }
            }
            watch.finished(Stage::DecoderBlock { idx });
        }
        for side in 0..2 {
            context.normalize(&tokens[side], &self.decoder_norm, &mut hooks[side][2]);
            watch.see(|| format!("dec_norm.{}", side + 1), &[counts[side], dim], &hooks[side][2]);
        }
        hooks
    }
}
