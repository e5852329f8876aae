//! Views that are encoded.

use selenograph_engine::Encoding;
use selenograph_geometry::Camera;
use selenograph_network::input::Plan;

/// A view that is encoded: for any number of pairs.
#[derive(Debug, Clone)]
pub struct EncodedView {
    pub(crate) camera: Camera,
    pub(crate) plan: Plan,
    pub(crate) encoding: Encoding,
    pub(crate) is_blank: bool,
    pub(crate) notes: Vec<String>,
}
