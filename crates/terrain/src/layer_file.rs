//! The binary file of one layer: written row by row, mapped read-only.
//!
//! Layout (all numbers little-endian): a 4096-byte header, then page-aligned sections of f32: node heights row by row,
//! max levels one after another, min levels one after another, and, if there is one, the support.

use crate::Block;
use crate::layer::SUPPORT_BLOCK;
use crate::pyramid::FIRST_MIN_LEVEL;
use crate::{Error, Grid, Pyramid, PyramidBuilder, PyramidShape};
use selenograph_files::{checksum, regular};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// First bytes of a layer file.
const MAGIC: [u8; 16] = *b"selenoterrain\0\r\n";
/// Sections start at multiples of this, so that they can be mapped as floats on any page size in use.
const ALIGNMENT: u64 = 4096;
/// A section's writes are gathered up to this size.
const BUFFER_BYTES: usize = 1 << 20;

/// A run of floats in a layer file with its checksum.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Section {
    /// `heights`, `max-1`, `min-3`, …, `support`.
    pub name: String,
    /// First byte.
    pub offset: u64,
    /// Length in bytes.
    pub bytes: u64,
    /// BLAKE3 of these bytes, hexadecimal.
    pub blake3: String,
}

/// Where the parts of a layer file are.
#[derive(Debug, Clone)]
struct Layout {
    shape: PyramidShape,
    heights: u64,
    max: u64,
    min: u64,
    support: Option<u64>,
    total: u64,
}

/// Number of support blocks along a row and rows of them.
pub(crate) fn support_size(grid: &Grid) -> (usize, usize) {
    ((grid.cols - 1).div_ceil(SUPPORT_BLOCK), (grid.rows - 1).div_ceil(SUPPORT_BLOCK))
}

impl Layout {
    fn new(grid: &Grid, has_support: bool) -> Self {
        let shape = PyramidShape::new(grid.cols, grid.rows);
        let after = |start: u64, floats: usize| (start + 4 * floats as u64).next_multiple_of(ALIGNMENT);
        let heights = ALIGNMENT;
        let max = after(heights, grid.cols * grid.rows);
        let min = after(max, shape.max_len);
        let end = after(min, shape.min_len);
        let (cols, rows) = support_size(grid);
        let (support, total) = if has_support { (Some(end), after(end, cols * rows)) } else { (None, end) };
        Self { shape, heights, max, min, support, total }
    }
}

/// One section on its way to the disk: hashed as it comes, in order.
struct Stream {
    name: String,
    offset: u64,
    written: u64,
    buffer: Vec<u8>,
    hasher: checksum::Hasher,
}

impl Stream {
    fn new(name: String, offset: u64) -> Self {
        Self { name, offset, written: 0, buffer: Vec::new(), hasher: checksum::Hasher::new() }
    }

    fn push(&mut self, values: &[f32], file: &mut File) -> std::io::Result<()> {
        self.buffer.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        if self.buffer.len() >= BUFFER_BYTES { self.flush(file) } else { Ok(()) }
    }

    fn flush(&mut self, file: &mut File) -> std::io::Result<()> {
        file.seek(SeekFrom::Start(self.offset + self.written))?;
        file.write_all(&self.buffer)?;
        self.hasher.update(&self.buffer);
        self.written += self.buffer.len() as u64;
        self.buffer.clear();
        Ok(())
    }

    fn finish(mut self, file: &mut File) -> std::io::Result<Section> {
        self.flush(file)?;
        let blake3 = self.hasher.finalize().to_string();
        Ok(Section { name: self.name, offset: self.offset, bytes: self.written, blake3 })
    }
}

/// Writes a layer file from node rows in order; the pyramid grows beside them.
pub(crate) struct LayerWriter {
    path: PathBuf,
    file: File,
    grid: Grid,
    layout: Layout,
    builder: PyramidBuilder,
    heights: Stream,
    max: Vec<Stream>,
    min: Vec<Stream>,
    lowest: f32,
    highest: f32,
    num_absent: u64,
}

/// What a finished layer file holds.
pub(crate) struct Written {
    pub sections: Vec<Section>,
    pub bytes: u64,
    pub height_range: (f32, f32),
    pub num_absent: u64,
}

impl LayerWriter {
    pub fn create(path: &Path, grid: &Grid, has_support: bool) -> Result<Self, Error> {
        let layout = Layout::new(grid, has_support);
        let mut open = File::options();
        let file =
            open.read(true).write(true).create_new(true).open(path).map_err(Error::io("create", path))?;
        let level_stream = |kind: &str, level: usize, start: u64, at: usize| {
            Stream::new(format!("{kind}-{level}"), start + 4 * at as u64)
        };
        let levels = 1..=layout.shape.top();
        let max =
            levels.clone().map(|k| level_stream("max", k, layout.max, layout.shape.max_offset[k])).collect();
        let min = levels
            .filter(|k| *k >= FIRST_MIN_LEVEL)
            .map(|k| level_stream("min", k, layout.min, layout.shape.min_offset[k]))
            .collect();
        Ok(Self {
            path: path.to_owned(),
            file,
            grid: grid.clone(),
            builder: PyramidBuilder::new(grid.cols, grid.rows),
            heights: Stream::new("heights".into(), layout.heights),
            max,
            min,
            layout,
            lowest: f32::INFINITY,
            highest: f32::NEG_INFINITY,
            num_absent: 0,
        })
    }

    /// Takes whole rows, from the top.
    pub fn push_rows(&mut self, nodes: &[f32]) -> Result<(), Error> {
        let Self { file, builder, heights, max, min, .. } = self;
        for row in nodes.chunks_exact(self.grid.cols) {
            let mut failed = heights.push(row, file).err();
            builder.push_row(row, |level| {
                let mut push = |stream: &mut Stream, values| {
                    if failed.is_none() {
                        failed = stream.push(values, file).err();
                    }
                };
                push(&mut max[level.level - 1], level.max);
                if level.level >= FIRST_MIN_LEVEL {
                    push(&mut min[level.level - FIRST_MIN_LEVEL], level.min);
                }
            });
            if let Some(source) = failed {
                return Err(selenograph_files::Error::io("write", &self.path)(source).into());
            }
            for &height in row {
                // Comparisons with NaN are false: absent nodes widen nothing.
                self.lowest = if height < self.lowest { height } else { self.lowest };
                self.highest = if height > self.highest { height } else { self.highest };
            }
            self.num_absent += row.iter().filter(|h| h.is_nan()).count() as u64;
        }
        Ok(())
    }

    /// Completes the file; `support_m` must be there if and only if it was announced.
    pub fn finish(mut self, support_m: Option<&[f32]>) -> Result<Written, Error> {
        if self.lowest > self.highest {
            return Err(Error::AllAbsent {
                name: self.path.display().to_string(),
                cells: self.grid.cols * self.grid.rows,
            });
        }
        let sections =
            self.finish_sections(support_m).map_err(selenograph_files::Error::io("write", &self.path))?;
        let expected = 4 * (self.grid.cols as u64) * (self.grid.rows as u64);
        if sections[0].bytes != expected {
            return Err(Error::Corrupt {
                path: self.path,
                what: "node heights",
                expected: format!("{expected} bytes"),
                found: format!("{} bytes", sections[0].bytes),
            });
        }
        Ok(Written {
            sections,
            bytes: self.layout.total,
            height_range: (self.lowest, self.highest),
            num_absent: self.num_absent,
        })
    }

    fn finish_sections(&mut self, support_m: Option<&[f32]>) -> std::io::Result<Vec<Section>> {
        let heights = std::mem::replace(&mut self.heights, Stream::new(String::new(), 0));
        let mut sections = vec![heights.finish(&mut self.file)?];
        for stream in self.max.drain(..).chain(self.min.drain(..)) {
            sections.push(stream.finish(&mut self.file)?);
        }
        if let (Some(offset), Some(support)) = (self.layout.support, support_m) {
            let mut stream = Stream::new("support".into(), offset);
            stream.push(support, &mut self.file)?;
            sections.push(stream.finish(&mut self.file)?);
        }
        self.file.set_len(self.layout.total)?;
        Ok(sections)
    }
}

/// Writes the header of a finished layer file: it ties the file to one description.
pub(crate) fn write_header(path: &Path, version: u32, description: &checksum::Checksum) -> Result<(), Error> {
    let mut header = Vec::from(MAGIC);
    header.extend(version.to_le_bytes());
    header.extend(description.as_bytes());
    let write = || -> std::io::Result<()> {
        let mut file = File::options().write(true).open(path)?;
        file.write_all(&header)?;
        file.sync_all()
    };
    write().map_err(Error::io("write", path))
}

/// Reads a header back: format version and hash of the description it belongs to.
pub(crate) fn read_header(path: &Path) -> Result<(u32, [u8; 32]), Error> {
    let mut header = [0u8; MAGIC.len() + 4 + 32];
    let (mut file, _) = regular::open(path).map_err(Error::io("open", path))?;
    let found = file.read_exact(&mut header);
    let (magic, rest) = header.split_at(MAGIC.len());
    if found.is_err() || magic != MAGIC {
        return Err(Error::Corrupt {
            path: path.to_owned(),
            what: "first bytes",
            expected: "the header of a terrain layer".into(),
            found: "something else".into(),
        });
    }
    let (version, hash) = rest.split_at(4);
    let to_array = |bytes: &[u8]| std::array::from_fn(|n| bytes[n]);
    Ok((u32::from_le_bytes(std::array::from_fn(|n| version[n])), to_array(hash)))
}

/// Floats in a mapped file.
struct MappedFloats {
    map: Arc<memmap2::Mmap>,
    offset: usize,
    len: usize,
}

impl AsRef<[f32]> for MappedFloats {
    #[inline]
    fn as_ref(&self) -> &[f32] {
        let bytes = &self.map[self.offset..self.offset + 4 * self.len];
        // SAFETY: `bytes` is `4 * len` readable bytes that live as long as `self.map`; the map starts on a page and
        // `offset` is a multiple of 4096, so they are aligned for f32, of which every bit pattern is a value.
        unsafe { std::slice::from_raw_parts(bytes.as_ptr().cast::<f32>(), self.len) }
    }
}

/// The blocks of a mapped layer file.
pub(crate) struct Mapped {
    pub heights: Block,
    pub pyramid: Pyramid,
    pub support_m: Option<Block>,
}

/// Maps a layer file of a grid, read-only. Its size must fit exactly.
pub(crate) fn map(path: &Path, grid: &Grid, has_support: bool) -> Result<Mapped, Error> {
    let layout = Layout::new(grid, has_support);
    let (file, found) = regular::open(path).map_err(Error::io("open", path))?;
    if found != layout.total {
        return Err(Error::Corrupt {
            path: path.to_owned(),
            what: "file size",
            expected: format!("{} bytes", layout.total),
            found: format!("{found} bytes"),
        });
    }
    if cfg!(target_endian = "big") {
        return Err(Error::Corrupt {
            path: path.to_owned(),
            what: "byte order",
            expected: "a little-endian machine".into(),
            found: "a big-endian one".into(),
        });
    }
    // SAFETY: the map is read-only and private to this process. The folder belongs to this program: files in it are
    // written under another name and never changed after they are renamed into place.
    let map = unsafe { memmap2::Mmap::map(&file) }.map_err(Error::io("map", path))?;
    let map = Arc::new(map);
    let block = |offset: u64, len: usize| -> Block {
        Arc::new(MappedFloats { map: Arc::clone(&map), offset: offset as usize, len })
    };
    let heights = block(layout.heights, grid.cols * grid.rows);
    let max = block(layout.max, layout.shape.max_len);
    let min = block(layout.min, layout.shape.min_len);
    let (cols, rows) = support_size(grid);
    let support_m = layout.support.map(|offset| block(offset, cols * rows));
    Ok(Mapped { heights, pyramid: Pyramid { shape: layout.shape, max, min }, support_m })
}
