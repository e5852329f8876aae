//! Views that are encoded.

use selenograph_engine::Encoding;
use selenograph_geometry::Camera;
use selenograph_network::input::InputTransform;

/// A view that is encoded: for any number of pairs.
#[derive(Debug, Clone)]
pub struct EncodedView {
    pub(crate) camera: Camera,
    pub(crate) transform: InputTransform,
    pub(crate) encoding: Encoding,
    pub(crate) is_blank: bool,
    pub(crate) notes: Vec<String>,
}
