//! Lunar terrain that a renderer can trace: regular grids of node heights with max/min pyramids, nested finest first.
//!
//! The surface is *defined* as sphere radius + interpolated height on the map grid, which is what a DEM's label means;
//! see `docs/conventions.md`.

pub mod cover;
mod error;
mod grid;
pub mod import;
mod layer;
mod layer_file;
pub mod nest;
mod pyramid;
pub mod store;
pub mod synth;
mod terrain;

pub use error::Error;
pub use grid::Grid;
pub use layer::{Layer, Patch};
pub(crate) use pyramid::PyramidBuilder;
pub use pyramid::{Block, Pyramid, PyramidShape};
pub use terrain::{SurfaceSample, Terrain};
