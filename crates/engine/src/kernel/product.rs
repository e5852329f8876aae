//! What is multiplied.

/// Rows of a tile.
pub(crate) const ROWS: usize = 6;
/// Columns of a panel.
pub(crate) const PANEL: usize = 64;

/// One product `tile (+)= rows · panel`.
pub(crate) struct Product<'a> {
    /// Pointers to the rows: for each segment six.
    pub rows: &'a [*const f32],
    /// Values of each segment.
    pub segments: &'a [usize],
    /// Packed columns: for each value of a row 64 numbers.
    pub panel: *const f32,
    /// Where the tile goes: six rows of 64 numbers.
    pub tile: *mut f32,
    /// From one row of the tile to the next.
    pub stride: usize,
    /// Add to what the tile holds.
    pub accumulate: bool,
}
