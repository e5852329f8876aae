//! A checkpoint and two views into points and matches, from which `reconstruct::learned` makes a pose.
//!
//! ```no_run
//! use selenograph_predict::{HeadCounts, PredictOptions, Predictor};
//! use selenograph_reconstruct::evidence::FocalKnowledge;
//! # fn show(views: [selenograph_reconstruct::View; 2]) -> Result<(), selenograph_predict::Error> {
//! let predictor = Predictor::open("weights.safetensors".as_ref(), HeadCounts::default(), &PredictOptions::default())?;
//! let said = predictor.predict(&views, FocalKnowledge::Known, &mut |_| {})?;
//! println!("{} matches", said.input.learned.matches.len());
//! # Ok(())
//! # }
//! ```
#![forbid(unsafe_code)]

mod encoded;
mod error;
mod estimate;
mod executor;
mod gather;
mod grid;
mod matches;
mod options;
mod picture;
mod predictor;
mod progress;

pub use encoded::EncodedView;
pub use error::Error;
pub use estimate::Estimate;
pub use executor::Executor;
pub use options::{Density, Passes, PredictOptions};
pub use predictor::{About, Predicted, Predictor};
pub use progress::{Progress, Step};
pub use selenograph_network::checkpoint::HeadCounts;
pub use selenograph_network::input::{Border, Rule, SquareCrop};
