//! Weights in the order in which the kernel reads them.

use rayon::prelude::*;

use crate::buffer::Buffer;
use crate::kernel::PANEL;

/// Longest part of a row multiplied at once: a panel of that length stays in a core's second-level cache.
const MAX_CHUNK: usize = 2304;
/// Segments of a chunk.
pub(crate) const MAX_SEGMENTS: usize = 9;

/// A part of a row that lies in one piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Segment {
    /// Which source of the input: the first or second of a pair, or a convolution's tap.
    pub source: usize,
    /// First value within the source's row.
    pub offset: usize,
    /// Values.
    pub len: usize,
}

/// Segments multiplied at once.
pub(crate) struct Chunk {
    pub segments: Vec<Segment>,
    /// Their lengths, as the kernel wants them.
    pub lens: Vec<usize>,
    /// Values of a row before this chunk.
    pub start: usize,
}

/// A matrix of `inputs` rows and `outputs` columns in panels of 64 columns.
pub(crate) struct Packed {
    data: Buffer,
    bias: Buffer,
    pub chunks: Vec<Chunk>,
    pub inputs: usize,
    pub outputs: usize,
}

impl Packed {
    /// From the lengths of the input's sources and `value(output, input)`.
    pub(crate) fn new(
        sources: &[usize],
        outputs: usize,
        bias: Option<&[f32]>,
        value: impl Fn(usize, usize) -> f32 + Sync,
    ) -> Self {
        let inputs: usize = sources.iter().sum();
        let num_panels = outputs.div_ceil(PANEL);
        let mut data = Buffer::zeroed(num_panels * inputs * PANEL);
        data.par_chunks_mut((inputs * PANEL).max(1)).enumerate().for_each(|(panel, lines)| {
            let first = panel * PANEL;
            let count = PANEL.min(outputs - first);
            for (input, line) in lines.chunks_exact_mut(PANEL).enumerate() {
                for (col, slot) in line[..count].iter_mut().enumerate() {
                    *slot = value(first + col, input);
                }
            }
        });
        let mut padded = Buffer::zeroed(num_panels * PANEL);
        if let Some(bias) = bias {
            padded[..outputs].copy_from_slice(bias);
        }
        Self { data, bias: padded, chunks: chunks_of(sources), inputs, outputs }
    }

    /// A linear layer's weights `[outputs, inputs]`.
    pub(crate) fn linear(weights: &[f32], inputs: usize, outputs: usize, bias: Option<&[f32]>) -> Self {
        Self::new(&[inputs], outputs, bias, |output, input| weights[output * inputs + input])
    }

    /// A 3×3 convolution's weights `[outputs, inputs, 3, 3]`.
    pub(crate) fn conv3(weights: &[f32], inputs: usize, outputs: usize, bias: Option<&[f32]>) -> Self {
        Self::new(&[inputs; 9], outputs, bias, |output, input| {
            weights[(output * inputs + input % inputs) * 9 + input / inputs]
        })
    }

    pub(crate) fn num_panels(&self) -> usize {
        self.outputs.div_ceil(PANEL)
    }

    /// The panel's lines that belong to a chunk.
    pub(crate) fn lines(&self, panel: usize, chunk: &Chunk) -> &[f32] {
        let first = (panel * self.inputs + chunk.start) * PANEL;
        &self.data[first..first + chunk.lens.iter().sum::<usize>() * PANEL]
    }

    /// The panel's bias, zeros where there is none.
    pub(crate) fn bias(&self, panel: usize) -> &[f32] {
        &self.bias[panel * PANEL..(panel + 1) * PANEL]
    }

    /// Bytes of a layer of these sizes.
    pub(crate) fn bytes_of(inputs: usize, outputs: usize) -> usize {
        // The bias is one row more.
        4 * (inputs + 1) * outputs.next_multiple_of(PANEL)
    }

    /// Bytes held.
    pub(crate) fn num_bytes(&self) -> usize {
        4 * (self.data.len() + self.bias.len())
    }
}

fn chunks_of(sources: &[usize]) -> Vec<Chunk> {
    let mut pieces = Vec::new();
    for (source, len) in sources.iter().enumerate() {
        let parts = len.div_ceil(MAX_CHUNK).max(1);
        let size = len.div_ceil(parts);
        let mut offset = 0;
        while offset < *len {
            let piece = size.min(len - offset);
            pieces.push(Segment { source, offset, len: piece });
            offset += piece;
        }
    }
    let mut chunks: Vec<Chunk> = Vec::new();
    let mut start = 0;
    for piece in pieces {
        match chunks.last_mut() {
            Some(chunk)
                if chunk.segments.len() < MAX_SEGMENTS
                    && chunk.lens.iter().sum::<usize>() + piece.len <= MAX_CHUNK =>
            {
                chunk.segments.push(piece);
                chunk.lens.push(piece.len);
            }
            _ => chunks.push(Chunk { segments: vec![piece], lens: vec![piece.len], start }),
        }
        start += piece.len;
    }
    chunks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_cover_the_row_once() {
        for sources in
            [vec![1024], vec![4096], vec![7168], vec![1024, 768], vec![256; 9], vec![768; 9], vec![5]]
        {
            let total: usize = sources.iter().sum();
            let chunks = chunks_of(&sources);
            assert_eq!(chunks.iter().flat_map(|c| &c.lens).sum::<usize>(), total);
            let mut start = 0;
            for chunk in &chunks {
                assert_eq!(chunk.start, start);
                let len: usize = chunk.lens.iter().sum();
                assert!(len <= MAX_CHUNK && chunk.segments.len() <= MAX_SEGMENTS);
                start += len;
            }
        }
    }
}
