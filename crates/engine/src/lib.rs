//! The network on CPUs, in f32: packed weights, fused attention, direct convolutions.
//!
//! Everything is built on one kernel (`kernel`): six rows, read where they lie, against a panel of 64 packed
//! columns. Results are the same for any number of threads: each output value is summed by one task in one
//! order.

mod attention;
mod buffer;
mod config;
mod conv;
mod dpt;
mod embed;
mod encoder;
mod engine;
mod error;
pub mod focal;
mod footprint;
mod gemm;
mod gemm_benchmark;
mod head;
mod image;
mod kernel;
pub mod matching;
mod output;
mod packed;
mod probe;
mod rope;
mod stem;
mod transformer;
mod upsample;
mod vector;
mod weights;

pub use encoder::Encoder;
pub use engine::{Encoding, Engine};
pub use error::{Error, Result, SourceError};
pub use footprint::MemoryFootprint;
pub use gemm_benchmark::GemmBenchmark;
pub use image::Image;
pub use kernel::Simd;
pub use output::HeadOutput;
pub use probe::{Probe, Stage};
pub use weights::NamedTensor;
