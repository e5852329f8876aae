//! Lunar terrain that a renderer can trace: regular grids of node heights with max/min pyramids, nested finest first.
//!
//! The surface is *defined* as sphere radius + interpolated height on the map grid, which is what a DEM's label means;
//! see `docs/conventions.md`.

pub mod cover;
pub mod error;
pub mod grid;
pub mod import;
pub mod layer;
mod layer_file;
pub mod nest;
pub mod pyramid;
pub mod store;
pub mod synth;
pub mod terrain;

pub use error::Error;
pub use grid::Grid;
pub use layer::{Layer, Patch};
pub use pyramid::{Block, Pyramid, PyramidBuilder, PyramidShape};
pub use terrain::{SurfaceSample, Terrain};
