//! Rows out of strips and tiles: a band of chunks is decoded once and kept until the next one is needed.

use super::chunk::{Compression, Predictor, decompress, undo_predictor};
use super::directory::TiffFile;
use crate::Error;
use crate::sample::{ByteOrder, HeightLaw, SampleType};
use rayon::prelude::*;

/// Fewer rows than this are not worth waking the thread pool for; thin strips are decoded in groups.
pub(crate) const MIN_GROUP_ROWS: usize = 64;

/// Where a chunk lies in the file. No bytes: a chunk that was never written (all absent).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Span {
    pub(crate) offset: u64,
    pub(crate) len: u64,
}

/// How one band's samples are cut into chunks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ChunkLayout {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) chunk_width: usize,
    pub(crate) chunk_height: usize,
    pub(crate) tiled: bool,
    /// Whether the file has the places of tiles under the tags of strips, or those of strips under the tags of tiles.
    pub(crate) swapped_tags: bool,
    pub(crate) spans: Vec<Span>,
    pub(crate) num_interleaved: usize,
    pub(crate) interleaved_idx: usize,
    pub(crate) sample_type: SampleType,
    pub(crate) order: ByteOrder,
    /// Whether the bits of each byte in the file stand the other way round (FillOrder 2).
    pub(crate) bits_reversed: bool,
    pub(crate) compression: Compression,
    pub(crate) predictor: Predictor,
}

impl ChunkLayout {
    pub(crate) fn across(&self) -> usize {
        self.width.div_ceil(self.chunk_width)
    }

    pub(crate) fn down(&self) -> usize {
        self.height.div_ceil(self.chunk_height)
    }

    pub(crate) fn row_bytes(&self) -> usize {
        self.chunk_width * self.num_interleaved * self.sample_type.size()
    }

    /// Rows of chunk row `down_idx` that lie inside the image.
    pub(crate) fn rows_inside(&self, down_idx: usize) -> usize {
        self.chunk_height.min(self.height - down_idx * self.chunk_height)
    }

    /// Cuts thick uncompressed strips into thin ones, so that one strip for the whole image is not one piece.
    pub(crate) fn with_thin_strips(mut self) -> Self {
        if self.tiled || self.compression != Compression::None || self.chunk_height <= MIN_GROUP_ROWS {
            return self;
        }
        // Several strips are cut evenly, so that all pieces but the last of the image are alike.
        let rows = match self.spans.len() {
            1 => MIN_GROUP_ROWS,
            _ => (1..=MIN_GROUP_ROWS).rev().find(|n| self.chunk_height.is_multiple_of(*n)).unwrap_or(1),
        };
        let row_bytes = self.row_bytes() as u64;
        let mut spans = Vec::with_capacity(self.height.div_ceil(rows));
        for (idx, span) in self.spans.iter().enumerate() {
            let inside = self.rows_inside(idx);
            for first in (0..inside).step_by(rows) {
                let count = rows.min(inside - first) as u64;
                let len = if span.len == 0 { 0 } else { count * row_bytes };
                spans.push(Span { offset: span.offset + first as u64 * row_bytes, len });
            }
        }
        self.spans = spans;
        self.chunk_height = rows;
        self
    }

    fn decode(
        &self,
        down_idx: usize,
        across_idx: usize,
        mut packed: Vec<u8>,
        law: &HeightLaw,
    ) -> Result<Vec<f32>, String> {
        if self.bits_reversed {
            packed.iter_mut().for_each(|byte| *byte = byte.reverse_bits());
        }
        let inside = self.rows_inside(down_idx);
        let columns = self.chunk_width.min(self.width - across_idx * self.chunk_width);
        if packed.is_empty() {
            return Ok(vec![f32::NAN; inside * columns]);
        }
        let stored_rows = if self.tiled { self.chunk_height } else { inside };
        let row_bytes = self.row_bytes();
        let mut bytes = decompress(self.compression, packed, stored_rows * row_bytes)?;
        let mut heights = vec![f32::NAN; inside * columns];
        let (interleaved, size) = (self.num_interleaved, self.sample_type.size());
        let order = undo_predictor(self.predictor, &mut bytes, row_bytes, interleaved, size, self.order);
        for (row, out) in bytes.chunks_exact(row_bytes).zip(heights.chunks_exact_mut(columns)) {
            law.decode(row, self.sample_type, order, self.interleaved_idx, interleaved, out);
        }
        Ok(heights)
    }
}

/// Reads rows of one band.
#[derive(Debug)]
pub(crate) struct TiffRows {
    tiff: TiffFile,
    layout: ChunkLayout,
    /// Chunk rows decoded at once.
    group: usize,
    cached: Option<usize>,
    cache: Vec<f32>,
}

impl TiffRows {
    pub(crate) fn new(tiff: TiffFile, layout: ChunkLayout) -> Self {
        let group = (MIN_GROUP_ROWS / layout.chunk_height).max(1);
        Self { tiff, layout, group, cached: None, cache: Vec::new() }
    }

    /// Rows `first..` into `out`, as many as it has room for.
    pub(crate) fn read(&mut self, first: usize, law: &HeightLaw, out: &mut [f32]) -> Result<(), Error> {
        let width = self.layout.width;
        let group_rows = self.group * self.layout.chunk_height;
        let end = first + out.len() / width;
        let mut row = first;
        while row < end {
            let group_idx = row / group_rows;
            if self.cached != Some(group_idx) {
                self.load(group_idx, law)?;
            }
            let in_group = row - group_idx * group_rows;
            let count = (group_rows - in_group).min(end - row);
            out[(row - first) * width..][..count * width]
                .copy_from_slice(&self.cache[in_group * width..][..count * width]);
            row += count;
        }
        Ok(())
    }

    /// Drops what is decoded: for another law.
    pub(crate) fn forget(&mut self) {
        self.cached = None;
    }

    fn load(&mut self, group_idx: usize, law: &HeightLaw) -> Result<(), Error> {
        self.cached = None;
        let layout = &self.layout;
        let (across, first) = (layout.across(), group_idx * self.group);
        let last = (first + self.group).min(layout.down());
        let mut packed = Vec::with_capacity((last - first) * across);
        for idx in first * across..last * across {
            let span = layout.spans[idx];
            packed.push((idx, self.tiff.bytes_at(span.offset, span.len, "a strip or tile")?));
        }
        let chunks: Vec<Result<Vec<f32>, String>> = packed
            .into_par_iter()
            .map(|(idx, bytes)| {
                let decoded = layout.decode(idx / across, idx % across, bytes, law);
                decoded.map_err(|found| format!("chunk {idx}: {found}"))
            })
            .collect();
        let start_row = first * layout.chunk_height;
        let num_rows = (last * layout.chunk_height).min(layout.height) - start_row;
        self.cache.resize(num_rows * layout.width, f32::NAN);
        for (idx, chunk) in (first * across..).zip(chunks) {
            let heights = chunk.map_err(|found| {
                self.tiff.malformed("compressed samples", "a stream of the size of the chunk", found)
            })?;
            let (down_idx, across_idx) = (idx / across, idx % across);
            let x = across_idx * layout.chunk_width;
            let columns = layout.chunk_width.min(layout.width - x);
            let top = down_idx * layout.chunk_height - start_row;
            for (y, row) in heights.chunks_exact(columns).enumerate() {
                self.cache[(top + y) * layout.width + x..][..columns].copy_from_slice(row);
            }
        }
        self.cached = Some(group_idx);
        Ok(())
    }
}
