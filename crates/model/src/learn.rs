//! A loss and its gradients, with as much of the forward pass kept as one wants to pay for.

use burn_tensor::{Gradients as Tape, Tensor};
use selenograph_network::layout::Part;

use crate::attention::Rope;
use crate::error::{Error, Result};
use crate::model::Model;
use crate::output::Output;
use crate::parameters::{Gradients, Parameter};
use crate::views::{Encoding, Features, Grid, Images, Tokens, select};

/// What a backward pass finds of the forward pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SavedActivations {
    /// All that it needs: fastest.
    #[default]
    Everything,
    /// What goes into each block of the transformers; the rest is computed a second time, a block at a time. Heads and loss
    /// are kept whole.
    BlockInputs,
}

/// What a learning step starts from.
#[derive(Debug, Clone, Copy)]
pub enum Inputs<'a> {
    /// Images.
    Images(&'a Images),
    /// What a frozen encoder made of them.
    Features(&'a Features),
}

/// A loss and its gradients.
#[derive(Debug, Clone)]
pub struct LossAndGradients {
    /// The loss, off the tape.
    pub loss: Tensor<1>,
    /// By each parameter.
    pub gradients: Gradients,
}

impl Model {
    /// The loss of pairs of a batch, and its gradients by the parameters that `learns` names. Each image is encoded once;
    /// `pairs` are places of first and second views in the batch, and a place may come more than once. `loss` gets the
    /// outputs of the first views and of the second ones, and gives one value.
    ///
    /// # Errors
    /// As [`Model::encode`] and [`Model::decode`]; [`Error::Views`] for a place that is not there; whatever `loss` says.
    pub fn learn<E: From<Error>>(
        &self,
        learns: &dyn Fn(&Parameter) -> bool,
        inputs: Inputs<'_>,
        pairs: &[[usize; 2]],
        keep: SavedActivations,
        loss: &mut dyn FnMut(&[Output; 2]) -> std::result::Result<Tensor<1>, E>,
    ) -> std::result::Result<LossAndGradients, E> {
        let tracked = self.tracked(learns);
        if keep == SavedActivations::BlockInputs {
            if self.config().stem_dims.is_some() {
                let what = "what is kept of a network with a stem";
                return Err(Error::views(what, "everything: it is small", "block inputs only").into());
            }
            let gradients = Gradients::none(self.parameters().len());
            let plain = self.tracked(&|_| false);
            return Recomputing { plain, tracked, pairs, gradients }.learn(inputs, loss);
        }
        let features = match inputs {
            Inputs::Images(images) => tracked.encode_blocks(images)?,
            Inputs::Features(features) => features.clone(),
        };
        let [a, b] = sides(&tracked.normalize(&features), pairs)?;
        let loss = loss(&tracked.decode(&a, &b)?)?;
        let gradients = tracked.gradients(&loss);
        Ok(LossAndGradients { loss: loss.without_autodiff(), gradients })
    }
}

/// The encodings of the first views and of the second.
fn sides(all: &Encoding, pairs: &[[usize; 2]]) -> Result<[Encoding; 2]> {
    Ok([all.select(&places(pairs, 0))?, all.select(&places(pairs, 1))?])
}

fn places(pairs: &[[usize; 2]], side: usize) -> Vec<usize> {
    pairs.iter().map(|pair| pair[side]).collect()
}

/// The same parameters off and on the tape, and the gradients so far. Each part runs a second time, on the tape, from what
/// went into it, and its outputs are weighted by the gradients of what followed.
struct Recomputing<'a> {
    plain: Model,
    tracked: Model,
    pairs: &'a [[usize; 2]],
    gradients: Gradients,
}

impl Recomputing<'_> {
    fn learn<E: From<Error>>(
        mut self,
        inputs: Inputs<'_>,
        loss: &mut dyn FnMut(&[Output; 2]) -> std::result::Result<Tensor<1>, E>,
    ) -> std::result::Result<LossAndGradients, E> {
        let (grid, mut blocks, features) = match inputs {
            Inputs::Images(images) => self.encode(images)?,
            Inputs::Features(features) => (features.grid.clone(), Vec::new(), features.values.clone()),
        };
        let [a, b] = sides(&self.plain.normalize(&Tokens::new(features.clone(), grid.clone())), self.pairs)?;
        let grids = [&a.grid, &b.grid];
        let ropes = self.plain.decoder_ropes(grids);
        let encoded = [a.values, b.values];
        let levels = self.plain.decoder_levels(&self.plain.root(None), encoded.clone(), &ropes);
        let hooked = self.plain.decoder_hooks().map(|level| levels[level].clone());
        let (loss, by_read) = self.heads(encoded, hooked, grids, loss)?;
        let by_entry = self.decoders(&levels, &ropes, by_read);
        let mut by_features = self.entry(features, by_entry);
        if let Inputs::Images(images) = inputs
            && self.encoder_learns()
        {
            let rope = self.plain.encoder_rope(&grid);
            for block in (0..blocks.len()).rev() {
                let Some(input) = blocks.pop() else { break };
                by_features = self.pull(vec![input], vec![by_features], &|model, leaves| {
                    vec![model.encoder_level(&model.root(None), block, leaves[0].clone(), &rope)]
                })[0]
                    .clone();
            }
            self.pull(Vec::new(), vec![by_features], &|model, _| {
                vec![model.patches(&model.root(None), images, &grid).0]
            });
        }
        Ok(LossAndGradients { loss, gradients: self.gradients })
    }

    fn encoder_learns(&self) -> bool {
        let encoder = [Part::PatchEmbed, Part::Encoder];
        let mut own = self.tracked.parameters().iter().filter(|each| encoder.contains(&each.spec().part));
        own.any(|each| each.value().is_require_grad())
    }

    /// What goes into each block of the encoder, and what comes out of the last.
    fn encode(&self, images: &Images) -> Result<(Grid, Vec<Tensor<3>>, Tensor<3>)> {
        let (model, at) = (&self.plain, self.plain.root(None));
        let grid = images.grid(model.config().patch_px)?;
        let rope = model.encoder_rope(&grid);
        let (mut x, _) = model.patches(&at, images, &grid);
        let mut inputs = Vec::new();
        for block in 0..model.config().encoder.num_blocks {
            inputs.push(x.clone());
            x = model.encoder_level(&at, block, x, &rope);
        }
        Ok((grid, inputs, x))
    }

    /// Heads and loss, whole: the loss, and its gradients by the encoder's output and the hooked levels, both sides of each.
    fn heads<E>(
        &mut self,
        encoded: [Tensor<3>; 2],
        hooked: [[Tensor<3>; 2]; 3],
        grids: [&Grid; 2],
        loss: &mut dyn FnMut(&[Output; 2]) -> std::result::Result<Tensor<1>, E>,
    ) -> std::result::Result<(Tensor<1>, [[Tensor<3>; 2]; 4]), E> {
        let [first, second, last] = hooked;
        let leaves = [encoded, first, second, last].map(|level| level.map(leaf));
        let [encoded, hooked @ ..] = leaves.clone();
        let loss = loss(&self.tracked.heads(&self.tracked.root(None), encoded, hooked, grids, [None; 2]))?;
        let mut tape = loss.backward();
        self.collect(&mut tape);
        Ok((loss.without_autodiff(), leaves.map(|level| level.map(|each| gradient(each, &mut tape)))))
    }

    /// The decoders' blocks, the last first: gradients by the encoder's output and by what `decoder_embed` gives.
    fn decoders(
        &mut self,
        levels: &[[Tensor<3>; 2]],
        ropes: &[Rope; 2],
        [by_encoded, by_hooked @ ..]: [[Tensor<3>; 2]; 4],
    ) -> Vec<Tensor<3>> {
        let hooks = self.plain.decoder_hooks();
        let hooked_at = |level: usize, below: Vec<Tensor<3>>| -> Vec<Tensor<3>> {
            let own = hooks.iter().zip(&by_hooked).filter(|(hook, _)| **hook == level);
            own.fold(below, |sum, (_, by)| sum.into_iter().zip(by.clone()).map(|(a, b)| a + b).collect())
        };
        let last = levels.len() - 1;
        let mut wanted = hooked_at(last, levels[last].iter().map(Tensor::zeros_like).collect());
        for block in (0..last).rev() {
            let below = self.pull(levels[block].to_vec(), wanted, &|model, leaves| {
                let input = [leaves[0].clone(), leaves[1].clone()];
                model.decoder_level(&model.root(None), block, input, ropes).to_vec()
            });
            wanted = hooked_at(block, below);
        }
        by_encoded.into_iter().chain(wanted).collect()
    }

    /// From the features to the decoders: gradients by the features.
    fn entry(&mut self, features: Tensor<3>, wanted: Vec<Tensor<3>>) -> Tensor<3> {
        let pairs = self.pairs;
        self.pull(vec![features], wanted, &|model, leaves| {
            let at = model.root(None);
            let all = at.norm("enc_norm", leaves[0].clone());
            let encoded = [0, 1].map(|side| select(all.clone(), &places(pairs, side)));
            let embedded = encoded.clone().map(|each| at.linear("decoder_embed", each));
            encoded.into_iter().chain(embedded).collect()
        })[0]
            .clone()
    }

    /// Runs a part on the tape and pulls gradients by its outputs back to its inputs.
    fn pull(
        &mut self,
        inputs: Vec<Tensor<3>>,
        by_outputs: Vec<Tensor<3>>,
        run: &dyn Fn(&Model, &[Tensor<3>]) -> Vec<Tensor<3>>,
    ) -> Vec<Tensor<3>> {
        let leaves: Vec<_> = inputs.into_iter().map(leaf).collect();
        let terms =
            run(&self.tracked, &leaves).into_iter().zip(by_outputs).map(|(output, by)| (output * by).sum());
        let Some(sum) = terms.reduce(|a, b| a + b).filter(Tensor::is_tracked) else {
            return leaves.iter().map(|each| each.clone().without_autodiff().zeros_like()).collect();
        };
        let mut tape = sum.backward();
        self.collect(&mut tape);
        leaves.into_iter().map(|each| gradient(each, &mut tape)).collect()
    }

    fn collect(&mut self, tape: &mut Tape) {
        let own = Gradients::collect(self.tracked.parameters(), tape);
        self.gradients = std::mem::replace(&mut self.gradients, Gradients::none(0)).plus(own);
    }
}

fn leaf(value: Tensor<3>) -> Tensor<3> {
    value.without_autodiff().autodiff().require_grad()
}

/// The gradient by a leaf, zero if nothing depends on it.
fn gradient(leaf: Tensor<3>, tape: &mut Tape) -> Tensor<3> {
    leaf.grad_remove(tape).unwrap_or_else(|| leaf.without_autodiff().zeros_like())
}
