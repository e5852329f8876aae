//! Pictures as the network takes them.

use selenograph_network::config::IMAGE_CHANNELS;

use crate::error::{Error, Result};

/// An image as the network wants it: values from −1 to 1, channels first.
#[derive(Debug, Clone, Copy)]
pub struct Image<'a> {
    /// Rows, a multiple of the patch.
    pub height_px: usize,
    /// Columns, a multiple of the patch.
    pub width_px: usize,
    /// `[3, height, width]`.
    pub values: &'a [f32],
}

impl Image<'_> {
    /// Whether it is a whole number of patches, and filled.
    pub(crate) fn check(&self, patch: usize) -> Result<()> {
        for (what, side) in [("height", self.height_px), ("width", self.width_px)] {
            if side == 0 || side % patch != 0 {
                let expected = format!("a multiple of {patch} pixels");
                return Err(Error::Image { what, expected, found: side.to_string() });
            }
        }
        let expected = IMAGE_CHANNELS * self.height_px * self.width_px;
        if self.values.len() != expected {
            let found = self.values.len().to_string();
            return Err(Error::Image { what: "number of values", expected: expected.to_string(), found });
        }
        Ok(())
    }
}
