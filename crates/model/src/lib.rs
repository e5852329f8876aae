//! The network as differentiable layers on `burn`: training, graphics cards, and a second opinion on the CPU engine.
//!
//! | you want to | open |
//! | --- | --- |
//! | run or train the network | [`Model`] |
//! | know what goes in and comes out | [`Images`], [`Features`], [`Encoding`], [`Output`] |
//! | read or change parameters, read gradients | [`Parameters`], [`Gradients`] |
//! | choose a device | [`device`] |
#![forbid(unsafe_code)]

mod attention;
pub mod device;
mod dpt;
mod error;
mod learn;
mod model;
mod output;
mod parameters;
mod scope;
mod transformer;
mod views;

pub use burn_tensor::{Device, Tensor};
pub use error::{Error, Result, SourceError};
pub use learn::{Inputs, LossAndGradients, SavedActivations};
pub use model::Model;
pub use output::Output;
pub use parameters::{Gradients, NamedTensor, Parameter, Parameters};
pub use scope::{Precision, Probe};
pub use views::{Encoding, Features, Grid, Images, Normed, Raw, Tokens};
