//! Where the chunks of an image lie: the tables of their offsets and sizes.

use super::chunk::Compression;
use super::directory::{Directory, TiffFile};
use super::rows::ChunkLayout;
use super::tags::*;
use crate::Error;

/// The tags of offsets and sizes: of its own kind of chunks, and of the other one.
pub(super) fn tags_of_places(tiled: bool) -> ((u16, u16), (u16, u16)) {
    let (of_strips, of_tiles) = ((STRIP_OFFSETS, STRIP_BYTE_COUNTS), (TILE_OFFSETS, TILE_BYTE_COUNTS));
    if tiled { (of_tiles, of_strips) } else { (of_strips, of_tiles) }
}

/// What the chunks are and, where it is not the usual one, under which tags they stand.
pub(super) fn kind_text(layout: &ChunkLayout) -> &'static str {
    match (layout.tiled, layout.swapped_tags) {
        (true, false) => "tiles",
        (true, true) => "tiles under the tags of strips",
        (false, false) => "strips",
        (false, true) => "strips under the tags of tiles",
    }
}

/// Offsets and sizes of the chunks. Some writers put those of tiles under the tags of strips, and leave out the sizes of
/// strips that are not compressed.
pub(super) fn places(
    tiff: &mut TiffFile,
    directory: &Directory,
    layout: &ChunkLayout,
) -> Result<(Vec<u64>, Vec<u64>), Error> {
    let (own, other) = tags_of_places(layout.tiled);
    let (offsets, counts) = if layout.swapped_tags { other } else { own };
    let offsets = tiff.integers(directory, offsets)?.unwrap_or_default();
    let counts = match tiff.integers(directory, counts)? {
        None if layout.compression == Compression::None => {
            let rows = |idx: usize| if layout.tiled { layout.chunk_height } else { layout.rows_inside(idx) };
            let down = |idx: usize| (idx / layout.across()) % layout.down();
            (0..offsets.len()).map(|idx| (rows(down(idx)) * layout.row_bytes()) as u64).collect()
        }
        counts => counts.unwrap_or_default(),
    };
    Ok((offsets, counts))
}

/// Every chunk inside the file, and none shorter than its samples where they are not compressed.
pub(super) fn checked_spans(tiff: &TiffFile, layout: &ChunkLayout) -> Result<(), Error> {
    for (idx, span) in layout.spans.iter().enumerate() {
        let end = span.offset.saturating_add(span.len);
        if end > tiff.len {
            return Err(Error::Truncated {
                path: tiff.path.clone(),
                what: format!("chunk {idx} of {}", layout.spans.len()),
                expected: end,
                found: tiff.len,
            });
        }
        if layout.compression == Compression::None && span.len > 0 {
            let down_idx = idx / layout.across();
            let rows = if layout.tiled {
                layout.chunk_height
            } else {
                layout.chunk_height.min(layout.height - down_idx * layout.chunk_height)
            };
            let needed = (rows * layout.row_bytes()) as u64;
            if span.len < needed {
                return Err(tiff.malformed(&format!("chunk {idx}"), format!("{needed} bytes"), span.len));
            }
        }
    }
    Ok(())
}
