//! Fields on rasters: filters, the thin plate, and the equations that hold them to data.

pub(crate) mod conjugate;
pub(crate) mod cosine;
pub(crate) mod filter;
pub(crate) mod plate;
