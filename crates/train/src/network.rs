//! What a network must offer to be trained here.

use crate::Error;
use crate::batch::{PairImages, ViewOutput};
use burn_tensor::{Device, Tensor};
use std::collections::BTreeMap;

/// Gradients by the name of their parameter, flat, outside autodiff.
pub type Gradients = BTreeMap<String, Tensor<1>>;

/// Is shown each parameter's name, shape and values, and returns new values where it changes them.
pub type Changes<'a> = dyn FnMut(&str, &[usize], Tensor<1>) -> Option<Tensor<1>> + 'a;

/// A network that gives pointmaps, confidences and descriptors of pairs, and its parameters by name.
///
/// Of P pairs it gives 2P items: `2p` is pair p as (A, B), `2p + 1` as (B, A), each in the frame of its first view.
pub trait PairNetwork: Sync {
    /// The outputs of both views.
    ///
    /// # Errors
    /// [`Error::Layers`] for pictures that do not fit the network.
    fn forward(&self, images: &PairImages) -> Result<[ViewOutput; 2], Error>;

    /// The gradients, by the parameters that learn, of the loss (one value) that `loss` makes of the outputs.
    ///
    /// # Errors
    /// As [`PairNetwork::forward`], and what `loss` says.
    fn learn(
        &self,
        images: &PairImages,
        loss: &mut dyn FnMut(&[ViewOutput; 2]) -> Result<Tensor<1>, Error>,
    ) -> Result<Gradients, Error>;

    /// Every parameter with its shape and its values, flat, in an order that does not change.
    fn visit(&self, visitor: &mut dyn FnMut(&str, &[usize], Tensor<1>));

    /// As [`PairNetwork::visit`]; a value that is returned takes the parameter's place.
    ///
    /// # Errors
    /// [`Error::Layers`] for a value of another length.
    fn update(&mut self, changes: &mut Changes<'_>) -> Result<(), Error>;

    /// Whether a parameter learns.
    fn learns(&self, name: &str) -> bool;

    /// Where the parameters are.
    fn device(&self) -> Device;

    /// Texts for the header of a file of its weights: what makes it readable as this network, licence, provenance.
    fn metadata(&self) -> BTreeMap<String, String>;

    /// Bytes that one pair of pictures of `size` (rows, columns) takes while it is learnt from.
    fn activation_bytes(&self, size: [usize; 2]) -> u64;

    /// Bytes that it holds from the first step on, beside its parameters.
    fn resident_bytes(&self) -> u64 {
        0
    }
}
