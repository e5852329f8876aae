//! The encoder's blocks.

use selenograph_network::config::{NetworkConfig, Transformer};

use crate::attention::Grid;
use crate::buffer::{Loan, Pool};
use crate::config::check;
use crate::embed::Embedding;
use crate::error::{Error, Result, SourceError};
use crate::image::Image;
use crate::kernel::Simd;
use crate::probe::{Stage, Watch};
use crate::rope::Rope;
use crate::stem::StemMaps;
use crate::transformer::{Context, EncoderBlock};
use crate::weights::{NamedTensor, Reader};

/// The encoder without its last normalisation: what stays the same while a network that is fine-tuned learns the rest.
pub struct Encoder {
    shape: Transformer,
    rope_base: f64,
    pub(crate) level: Simd,
    pub(crate) pool: Pool,
    embedding: Embedding,
    blocks: Vec<EncoderBlock>,
}

impl Encoder {
    /// Reads and packs every tensor of the encoder's patches and blocks, and no other.
    ///
    /// # Errors
    /// A configuration that fits no network, or one with a stem; a tensor that `source` does not deliver or whose shape is
    /// not the configuration's.
    pub fn new(
        config: &NetworkConfig,
        source: &mut dyn FnMut(&str) -> std::result::Result<NamedTensor, SourceError>,
    ) -> Result<Self> {
        check(config)?;
        if let Some(dims) = config.stem_dims {
            let (what, expected) = ("stem_dims", "none: the heads read a stem's maps too".to_owned());
            return Err(Error::Config { what, expected, found: format!("{dims:?}") });
        }
        Self::read(config, Simd::detect(), &mut Reader::new(source))
    }

    pub(crate) fn read(config: &NetworkConfig, level: Simd, reader: &mut Reader<'_>) -> Result<Self> {
        let shape = config.encoder;
        Ok(Self {
            shape,
            rope_base: config.rope_base,
            level,
            pool: Pool::default(),
            embedding: Embedding::read(reader, config)?,
            blocks: (0..shape.num_blocks)
                .map(|idx| EncoderBlock::read(reader, &format!("enc_blocks.{idx}"), &shape))
                .collect::<Result<_>>()?,
        })
    }

    /// Bytes of packed weights.
    #[must_use]
    pub fn num_weight_bytes(&self) -> usize {
        self.embedding.num_bytes() + self.blocks.iter().map(EncoderBlock::num_bytes).sum::<usize>()
    }

    /// The tokens of each image before the last normalisation, `[patches, channels]`, row by row of patches.
    ///
    /// # Errors
    /// An image that is empty, not a whole number of patches, or whose values do not fill it.
    pub fn encode(&self, images: &[Image<'_>]) -> Result<Vec<Vec<f32>>> {
        let (tokens, grids, _) = self.run(images, &mut Watch(None))?;
        let of = |grid: &Grid| {
            tokens[grid.first * self.shape.dim..][..grid.num_tokens() * self.shape.dim].to_vec()
        };
        Ok(grids.iter().map(of).collect())
    }

    /// The tokens of all images, one after the other, where they lie, and each image's maps of the stem.
    pub(crate) fn run(
        &self,
        images: &[Image<'_>],
        watch: &mut Watch<'_>,
    ) -> Result<(Loan<'_>, Vec<Grid>, Vec<Option<StemMaps>>)> {
        for image in images {
            image.check(self.embedding.patch_px)?;
        }
        let context = Context { level: self.level, pool: &self.pool };
        let (dim, patch) = (self.shape.dim, self.embedding.patch_px);
        let grids = grids_of(images.iter().map(|image| (image.height_px / patch, image.width_px / patch)));
        let num_tokens: usize = grids.iter().map(Grid::num_tokens).sum();
        let mut tokens = self.pool.take(num_tokens * dim);
        let maps = self.embedding.run(&context, images, &grids, &mut tokens);
        watch.see(|| "patch_embed".to_owned(), &[num_tokens, dim], &tokens);
        let rope = rope(&self.shape, self.rope_base, &grids);
        for (idx, block) in self.blocks.iter().enumerate() {
            block.run(&context, &rope, &mut tokens, &grids);
            watch.see(|| format!("enc_block{idx}"), &[num_tokens, dim], &tokens);
            watch.finished(Stage::EncoderBlock { idx });
        }
        Ok((tokens, grids, maps))
    }
}

/// The angles for heads of `shape` and tokens of any of the grids.
pub(crate) fn rope(shape: &Transformer, base: f64, grids: &[Grid]) -> Rope {
    let side = grids.iter().map(|grid| grid.height.max(grid.width)).max().unwrap_or(1);
    Rope::new(shape.dim / shape.num_heads, base, side)
}

/// Grids one after the other.
pub(crate) fn grids_of(sizes: impl Iterator<Item = (usize, usize)>) -> Vec<Grid> {
    let mut first = 0;
    sizes
        .map(|(height, width)| {
            let grid = Grid { first, height, width };
            first += grid.num_tokens();
            grid
        })
        .collect()
}
