//! The network.

use burn_tensor::{Device, Tensor};
use selenograph_network::NetworkConfig;

use crate::attention::Rope;
use crate::dpt::{standardised, stem};
use crate::error::{Error, Result, SourceError};
use crate::output::{HeadInputs, Output, head};
use crate::parameters::{Gradients, NamedTensor, Parameter, Parameters};
use crate::scope::{Precision, Probe, Scope};
use crate::transformer::{decoder_block, encoder_block};
use crate::views::{Encoding, Features, Grid, Images, StemMaps, Tokens, gather, select};

/// The network with its parameters on a device.
#[derive(Debug, Clone)]
pub struct Model {
    config: NetworkConfig,
    parameters: Parameters,
    precision: Precision,
}

impl Model {
    /// Reads every parameter once, by its name in the checkpoint.
    ///
    /// # Errors
    /// [`Error::Network`], [`Error::Weights`], [`Error::TensorShape`], [`Error::TensorLength`].
    pub fn new(
        config: &NetworkConfig,
        device: &Device,
        source: &mut dyn FnMut(&str) -> std::result::Result<NamedTensor, SourceError>,
    ) -> Result<Self> {
        let parameters = Parameters::read(config, device, source)?;
        Ok(Self { config: config.clone(), parameters, precision: Precision::F32 })
    }

    /// The same with products in another precision.
    #[must_use]
    pub fn with_precision(self, precision: Precision) -> Self {
        Self { precision, ..self }
    }

    /// The same with the parameters that `learns` names on the tape: what is computed with them can be derived by them.
    /// The values are shared, not copied. Parameters that no forward pass reads are left off.
    #[must_use]
    pub fn tracked(&self, learns: &dyn Fn(&Parameter) -> bool) -> Self {
        self.changed(&|parameter| {
            let value = parameter.value().clone().without_autodiff();
            if parameter.is_computed() && learns(parameter) { value.autodiff().require_grad() } else { value }
        })
    }

    /// The gradients of a loss (one value) by the parameters on the tape, which it uses up.
    pub fn gradients(&self, loss: &Tensor<1>) -> Gradients {
        Gradients::collect(&self.parameters, &mut loss.backward())
    }

    fn changed(&self, change: &dyn Fn(&Parameter) -> Tensor<1>) -> Self {
        Self {
            config: self.config.clone(),
            parameters: self.parameters.map(change),
            precision: self.precision,
        }
    }

    /// The network's dimensions.
    pub fn config(&self) -> &NetworkConfig {
        &self.config
    }

    /// In which numbers products are computed.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Every parameter, in the order of the checkpoint's layout.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// To replace their values.
    pub fn parameters_mut(&mut self) -> &mut Parameters {
        &mut self.parameters
    }

    /// Where the parameters are.
    pub fn device(&self) -> Device {
        self.parameters.at(0).value().device().without_autodiff()
    }

    /// The encoder without its last normalisation: what can be cached while that learns.
    ///
    /// # Errors
    /// [`Error::Views`] for images that are no whole number of patches.
    pub fn encode_blocks(&self, images: &Images) -> Result<Features> {
        self.encode_blocks_probed(images, None)
    }

    /// The last normalisation of the encoder.
    pub fn normalize(&self, features: &Features) -> Encoding {
        let values = self.root(None).norm("enc_norm", features.values.clone());
        Tokens::new(values, features.grid.clone()).with_maps(features.maps.clone())
    }

    /// Encodes images of one size.
    ///
    /// # Errors
    /// As [`Model::encode_blocks`].
    pub fn encode(&self, images: &Images) -> Result<Encoding> {
        self.encode_probed(images, None)
    }

    /// As [`Model::encode`], with a look at every layer.
    ///
    /// # Errors
    /// As [`Model::encode`].
    pub fn encode_probed(&self, images: &Images, probe: Option<&Probe<'_>>) -> Result<Encoding> {
        let encoding = self.normalize(&self.encode_blocks_probed(images, probe)?);
        self.root(probe).see(|| "enc_norm".into(), &encoding.values);
        Ok(encoding)
    }

    /// Decodes a batch of pairs: the first views' output and the second views', each pair in its first camera's frame.
    ///
    /// # Errors
    /// [`Error::Views`] if there are not as many first views as second ones, or for encodings of another network.
    pub fn decode(&self, a: &Encoding, b: &Encoding) -> Result<[Output; 2]> {
        self.decode_probed(a, b, None)
    }

    /// As [`Model::decode`], with a look at every layer.
    ///
    /// # Errors
    /// As [`Model::decode`].
    pub fn decode_probed(
        &self,
        a: &Encoding,
        b: &Encoding,
        probe: Option<&Probe<'_>>,
    ) -> Result<[Output; 2]> {
        for each in [a, b] {
            let expected = self.config.encoder.dim;
            if each.values.dims()[2] != expected {
                return Err(Error::views("channels of an encoding", expected, each.values.dims()[2]));
            }
        }
        if a.grid.count() != b.grid.count() {
            return Err(Error::views("number of second views", a.grid.count(), b.grid.count()));
        }
        let at = self.root(probe);
        let ropes = self.decoder_ropes([&a.grid, &b.grid]);
        let encoded = [a, b].map(|each| each.values.clone());
        let levels = self.decoder_levels(&at, encoded.clone(), &ropes);
        let hooked = self.decoder_hooks().map(|level| levels[level].clone());
        let maps = [a.maps.as_ref(), b.maps.as_ref()];
        if self.config.stem_dims.is_some() && maps.iter().any(Option::is_none) {
            return Err(Error::views("encoding", "with the maps of the stem, from images", "tokens only"));
        }
        Ok(self.heads(&at, encoded, hooked, [&a.grid, &b.grid], maps))
    }

    /// A batch of pairs of any two sizes, each in its first camera's frame.
    ///
    /// # Errors
    /// As [`Model::encode`] and [`Model::decode`].
    pub fn infer(&self, a: &Images, b: &Images) -> Result<[Output; 2]> {
        self.decode(&self.encode(a)?, &self.encode(b)?)
    }

    /// The pairs both ways, each image encoded once: `[a, b]` in the frame of `a`, then `[b, a]` in that of `b`.
    ///
    /// # Errors
    /// As [`Model::infer`].
    pub fn infer_symmetric(&self, a: &Images, b: &Images) -> Result<[[Output; 2]; 2]> {
        let (a, b) = (self.encode(a)?, self.encode(b)?);
        Ok([self.decode(&a, &b)?, self.decode(&b, &a)?])
    }

    pub(crate) fn root<'a>(&'a self, probe: Option<&'a Probe<'a>>) -> Scope<'a> {
        Scope::root(&self.parameters, self.precision, probe)
    }

    /// Which of the decoders' levels the heads read beside the encoder's output; level 0 is what `decoder_embed` gives.
    pub(crate) fn decoder_hooks(&self) -> [usize; 3] {
        let [_, hooks @ ..] = self.config.hooks();
        hooks
    }

    pub(crate) fn encoder_rope(&self, grid: &Grid) -> Rope {
        Rope::new(grid, self.config.encoder.head_dim(), self.config.rope_base, &self.device())
    }

    pub(crate) fn decoder_ropes(&self, grids: [&Grid; 2]) -> [Rope; 2] {
        let (head_dim, base) = (self.config.decoder.head_dim(), self.config.rope_base);
        grids.map(|grid| Rope::new(grid, head_dim, base, &self.device()))
    }

    pub(crate) fn encoder_level(&self, at: &Scope<'_>, block: usize, x: Tensor<3>, rope: &Rope) -> Tensor<3> {
        encoder_block(&at.under(format!("enc_blocks.{block}")), x, rope)
    }

    /// What `decoder_embed` gives, then what each block of the decoders gives.
    pub(crate) fn decoder_levels(
        &self,
        at: &Scope<'_>,
        encoded: [Tensor<3>; 2],
        ropes: &[Rope; 2],
    ) -> Vec<[Tensor<3>; 2]> {
        let see = |levels: &[Tensor<3>; 2], name: &dyn Fn(usize) -> String| {
            for (side, level) in levels.iter().enumerate() {
                at.see(|| name(side + 1), level);
            }
        };
        let mut levels = vec![encoded.map(|each| at.linear("decoder_embed", each))];
        see(&levels[0], &|side| format!("decoder_embed.{side}"));
        for block in 0..self.config.decoder.num_blocks {
            let next = self.decoder_level(at, block, levels[block].clone(), ropes);
            see(&next, &|side| format!("dec{side}_block{block}"));
            levels.push(next);
        }
        levels
    }

    /// A block of both decoders: each side reads the other's previous level.
    pub(crate) fn decoder_level(
        &self,
        at: &Scope<'_>,
        block: usize,
        [a, b]: [Tensor<3>; 2],
        [rope_a, rope_b]: &[Rope; 2],
    ) -> [Tensor<3>; 2] {
        let first = at.under(format!("dec_blocks.{block}"));
        let second = at.under(format!("dec_blocks2.{block}"));
        [
            decoder_block(&first, a.clone(), b.clone(), [rope_a, rope_b]),
            decoder_block(&second, b, a, [rope_b, rope_a]),
        ]
    }

    /// Both heads, from the encoder's output and the decoders' levels at the three hooks.
    pub(crate) fn heads(
        &self,
        at: &Scope<'_>,
        encoded: [Tensor<3>; 2],
        [first, second, last]: [[Tensor<3>; 2]; 3],
        grids: [&Grid; 2],
        maps: [Option<&StemMaps>; 2],
    ) -> [Output; 2] {
        [0, 1].map(|side: usize| {
            let last = at.norm("dec_norm", last[side].clone());
            at.see(|| format!("dec_norm.{}", side + 1), &last);
            let tokens = [encoded[side].clone(), first[side].clone(), second[side].clone(), last];
            let label = format!("head{}", side + 1);
            let inputs = HeadInputs { hooks: tokens, maps: maps[side] };
            head(&at.under(format!("downstream_{label}")), &label, &self.config, &inputs, grids[side])
        })
    }

    fn encode_blocks_probed(&self, images: &Images, probe: Option<&Probe<'_>>) -> Result<Features> {
        let at = self.root(probe);
        let grid = images.grid(self.config.patch_px)?;
        let rope = self.encoder_rope(&grid);
        let (mut x, maps) = self.patches(&at, images, &grid);
        at.see(|| "patch_embed".into(), &x);
        for block in 0..self.config.encoder.num_blocks {
            x = self.encoder_level(&at, block, x, &rope);
            at.see(|| format!("enc_block{block}"), &x);
        }
        Ok(Tokens::new(x, grid).with_maps(maps))
    }

    /// Tokens of images, in the order of the upright patches, and the maps of the stem if there is one.
    pub(crate) fn patches(
        &self,
        at: &Scope<'_>,
        images: &Images,
        grid: &Grid,
    ) -> (Tensor<3>, Option<StemMaps>) {
        let groups = grid.groups();
        let [_, side] = self.config.token_input();
        let (mut tokens, mut fine, mut coarse) = (Vec::new(), Vec::new(), Vec::new());
        for (transposed, places) in &groups {
            let turned = |map: Tensor<4>| if *transposed { map.swap_dims(2, 3) } else { map };
            let mut map = turned(select(images.pixels.clone(), places));
            if self.config.stem_dims.is_some() {
                let [half, quarter, eighth] = stem(&at.under("stem"), standardised(map));
                fine.push(turned(half));
                coarse.push(turned(quarter));
                map = eighth;
            }
            let [count, channels, height, width] = map.dims();
            let (rows, columns) = (height / side, width / side);
            let patches = map
                .reshape([count, channels, rows, side, columns, side])
                .permute([0, 2, 4, 1, 3, 5])
                .reshape([count, rows * columns, channels * side * side]);
            tokens.push(at.linear("patch_embed.proj", patches));
        }
        let maps = self.config.stem_dims.map(|_| [fine, coarse].map(|parts| gather(&groups, parts)));
        (gather(&groups, tokens), maps)
    }
}
