//! Where an image's samples lie in its file and how they are stored: from its directory to the chunks of a band.

use super::chunk::{Compression, Predictor};
use super::directory::{Directory, TiffFile};
use super::places::{checked_spans, kind_text, places, tags_of_places};
use super::rows::{ChunkLayout, MIN_GROUP_ROWS, Span};
use super::tags::*;
use crate::sample::{ByteOrder, SampleType};
use crate::{Error, bounds};

/// Largest decoded row of chunks, in bytes as stored or as f32: 1024² tiles of f32 across half a million columns.
const MAX_BAND_BYTES: u64 = 1 << 31;

/// Size of one image and its bands.
pub(crate) struct Shape {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) num_bands: usize,
}

pub(crate) fn shape(tiff: &mut TiffFile, directory: &Directory) -> Result<Shape, Error> {
    let mut size = |tag: u16, default: Option<u64>| -> Result<usize, Error> {
        match tiff.integer(directory, tag)?.or(default) {
            Some(value) if (1..=u64::from(u32::MAX)).contains(&value) => Ok(value as usize),
            other => Err(tiff.malformed(
                &format!("TIFF tag {tag} (image size)"),
                "a number from 1 to 2³²",
                other.map_or_else(|| "nothing".to_owned(), |v| v.to_string()),
            )),
        }
    };
    Ok(Shape {
        width: size(IMAGE_WIDTH, None)?,
        height: size(IMAGE_LENGTH, None)?,
        num_bands: size(SAMPLES_PER_PIXEL, Some(1))?.min(usize::from(u16::MAX)),
    })
}

fn sample_type(tiff: &mut TiffFile, directory: &Directory) -> Result<SampleType, Error> {
    let bits = tiff.integers(directory, BITS_PER_SAMPLE)?.unwrap_or_else(|| vec![1]);
    let formats = tiff.integers(directory, SAMPLE_FORMAT)?.unwrap_or_else(|| vec![1]);
    let uniform = |values: &[u64]| values.windows(2).all(|pair| pair[0] == pair[1]);
    let found = match (bits.first(), formats.first()) {
        (Some(&bits_0), Some(&format)) if uniform(&bits) && uniform(&formats) => match (bits_0, format) {
            (8, 1) => return Ok(SampleType::U8),
            (8, 2) => return Ok(SampleType::I8),
            (16, 1) => return Ok(SampleType::U16),
            (16, 2) => return Ok(SampleType::I16),
            (32, 1) => return Ok(SampleType::U32),
            (32, 2) => return Ok(SampleType::I32),
            (32, 3) => return Ok(SampleType::F32),
            (64, 3) => return Ok(SampleType::F64),
            (bits, 1) => format!("unsigned integers of {bits} bits"),
            (bits, 2) => format!("signed integers of {bits} bits"),
            (bits, 3) => format!("floats of {bits} bits"),
            (bits, 4) => format!("untyped samples of {bits} bits"),
            (bits, 5) => format!("complex integers of {bits} bits"),
            (bits, 6) => format!("complex floats of {bits} bits"),
            _ => format!("{bits_0} bits, format {format}"),
        },
        _ => format!("{bits:?} bits, formats {formats:?}"),
    };
    Err(Error::Unsupported {
        path: tiff.path.clone(),
        what: "sample type",
        found,
        supported: "8, 16, 32 bit integers, 32 and 64 bit floats, the same in every band",
    })
}

fn compression(tiff: &mut TiffFile, directory: &Directory) -> Result<Compression, Error> {
    match tiff.integer(directory, COMPRESSION)?.unwrap_or(1) {
        1 => Ok(Compression::None),
        5 => Ok(Compression::Lzw),
        8 | 32946 => Ok(Compression::Deflate),
        32773 => Ok(Compression::PackBits),
        other => {
            let found = match other {
                2..=4 => "CCITT".to_owned(),
                6 => "JPEG of before 1995".to_owned(),
                7 => "JPEG".to_owned(),
                34712 => "JPEG 2000".to_owned(),
                34887 => "LERC".to_owned(),
                34925 => "LZMA".to_owned(),
                50000 => "ZSTD".to_owned(),
                50001 => "WEBP".to_owned(),
                _ => other.to_string(),
            };
            let supported = "none, LZW, deflate, packbits";
            Err(Error::Unsupported { path: tiff.path.clone(), what: "compression", found, supported })
        }
    }
}

fn predictor(
    tiff: &mut TiffFile,
    directory: &Directory,
    sample_type: SampleType,
) -> Result<Predictor, Error> {
    match tiff.integer(directory, PREDICTOR)?.unwrap_or(1) {
        1 => Ok(Predictor::None),
        2 => Ok(Predictor::Horizontal),
        3 if sample_type.is_float() => Ok(Predictor::FloatingPoint),
        other => Err(Error::Unsupported {
            path: tiff.path.clone(),
            what: "predictor",
            found: format!("{other} for {sample_type:?} samples"),
            supported: "1, 2, and 3 for floats",
        }),
    }
}

/// Where the samples of a band lie.
pub(crate) fn layout(
    tiff: &mut TiffFile,
    directory: &Directory,
    shape: &Shape,
    band_idx: usize,
) -> Result<ChunkLayout, Error> {
    let sample_type = sample_type(tiff, directory)?;
    layout_of(tiff, directory, shape, band_idx, sample_type, 1)
}

/// The same of an image of one bit a pixel, as one of bytes with eight pixels each.
pub(crate) fn layout_of_bits(
    tiff: &mut TiffFile,
    directory: &Directory,
    shape: &Shape,
) -> Result<ChunkLayout, Error> {
    let bytes = Shape { width: shape.width.div_ceil(8), ..*shape };
    layout_of(tiff, directory, &bytes, 0, SampleType::U8, 8)
}

fn layout_of(
    tiff: &mut TiffFile,
    directory: &Directory,
    shape: &Shape,
    band_idx: usize,
    sample_type: SampleType,
    pixels_per_sample: u64,
) -> Result<ChunkLayout, Error> {
    let mut compression = compression(tiff, directory)?;
    let predictor = match compression {
        Compression::Lzw | Compression::Deflate => predictor(tiff, directory, sample_type)?,
        // The predictor belongs to the compression schemes; libtiff ignores it elsewhere too.
        _ => Predictor::None,
    };
    let planar = tiff.integer(directory, PLANAR_CONFIGURATION)?.unwrap_or(1) == 2;
    let bits_reversed = tiff.integer(directory, FILL_ORDER)? == Some(2);
    let tile_width = tiff.integer(directory, TILE_WIDTH)?.map(|width| width.div_ceil(pixels_per_sample));
    let (chunk_width, chunk_height) = match tile_width {
        Some(width) => (width, tiff.integer(directory, TILE_LENGTH)?.unwrap_or(0)),
        None => {
            let rows = tiff.integer(directory, ROWS_PER_STRIP)?.unwrap_or(u64::MAX);
            (shape.width as u64, rows.min(shape.height as u64))
        }
    };
    let num_interleaved = if planar { 1 } else { shape.num_bands };
    let pixel_bytes = (num_interleaved * sample_type.size()).max(size_of::<f32>());
    // Thick strips without compression are read in pieces, thin ones in groups.
    let cut = compression == Compression::None && tile_width.is_none();
    let group = (shape.height as u64).min(MIN_GROUP_ROWS as u64);
    let rows_at_once =
        if cut || chunk_height == 0 { chunk_height.min(group) } else { chunk_height.max(group) };
    checked_chunk_size(tiff, shape, chunk_width, rows_at_once, pixel_bytes)?;
    let mut layout = ChunkLayout {
        width: shape.width,
        height: shape.height,
        chunk_width: chunk_width as usize,
        chunk_height: chunk_height as usize,
        tiled: tile_width.is_some(),
        swapped_tags: false,
        spans: Vec::new(),
        num_interleaved,
        interleaved_idx: if planar { 0 } else { band_idx },
        sample_type,
        order: tiff.order,
        bits_reversed,
        compression,
        predictor,
    };
    let plane = layout.across() * layout.down();
    let (own, other) = tags_of_places(layout.tiled);
    layout.swapped_tags = !directory.has(own.0) && directory.has(other.0);
    let (offsets, counts) = places(tiff, directory, &layout)?;
    let expected = plane.saturating_mul(if planar { shape.num_bands } else { 1 });
    if offsets.len() != expected || counts.len() != expected {
        return Err(tiff.malformed(
            &format!("table of {}", kind_text(&layout)),
            format!("{expected} chunks"),
            format!("{} offsets and {} sizes", offsets.len(), counts.len()),
        ));
    }
    let first = if planar { band_idx * plane } else { 0 };
    layout.spans = offsets[first..first + plane]
        .iter()
        .zip(&counts[first..first + plane])
        .map(|(&offset, &len)| Span { offset, len })
        .collect();
    checked_spans(tiff, &layout)?;
    if compression == Compression::Lzw && is_old_lzw(tiff, &layout)? {
        compression = Compression::OldLzw;
    }
    layout.compression = compression;
    Ok(layout)
}

/// Whether LZW streams have the form of before 1993: they begin with the clearing code the other way round.
fn is_old_lzw(tiff: &mut TiffFile, layout: &ChunkLayout) -> Result<bool, Error> {
    let Some(span) = layout.spans.iter().find(|span| span.len >= 2) else { return Ok(false) };
    let mut head = tiff.bytes_at(span.offset, 2, "a strip or tile")?;
    if layout.bits_reversed {
        head.iter_mut().for_each(|byte| *byte = byte.reverse_bits());
    }
    Ok(head[0] == 0 && head[1] & 1 == 1)
}

/// Refuses chunks of no size and such that a band of them would not fit into memory.
fn checked_chunk_size(
    tiff: &TiffFile,
    shape: &Shape,
    width: u64,
    height: u64,
    pixel_bytes: usize,
) -> Result<(), Error> {
    let across = (shape.width as u64).div_ceil(width.max(1));
    let band_bytes = across
        .checked_mul(width)
        .and_then(|n| n.checked_mul(height))
        .and_then(|n| n.checked_mul(pixel_bytes as u64));
    if band_bytes == Some(0) {
        return Err(tiff.malformed("size of strips or tiles", "at least 1×1", format!("{width}×{height}")));
    }
    if band_bytes.is_none_or(|bytes| bytes > MAX_BAND_BYTES) {
        return Err(Error::Unsupported {
            path: tiff.path.clone(),
            what: "size of strips or tiles",
            found: format!("{width}×{height}"),
            supported: "a row of chunks up to 2 GiB; cut the file into smaller strips or tiles",
        });
    }
    bounds::check(&tiff.path, "a row of strips or tiles", band_bytes, tiff.len)
}

/// How a band is stored, for people.
pub(crate) fn storage_text(layout: &ChunkLayout, shape: &Shape) -> String {
    let mut chunks = if layout.tiled {
        format!("tiles {}×{}", layout.chunk_width, layout.chunk_height)
    } else {
        format!("strips of {} row(s)", layout.chunk_height)
    };
    if let Some((_, tags)) = kind_text(layout).split_once(' ') {
        chunks = format!("{chunks} {tags}");
    }
    let compression = match layout.compression {
        Compression::None => "uncompressed",
        Compression::Lzw => "LZW",
        Compression::OldLzw => "LZW of before 1993",
        Compression::Deflate => "deflate",
        Compression::PackBits => "packbits",
    };
    let predictor = match layout.predictor {
        Predictor::None => "",
        Predictor::Horizontal => ", predictor 2",
        Predictor::FloatingPoint => ", predictor 3",
    };
    let planes = match (shape.num_bands, layout.num_interleaved) {
        (1, _) => "",
        (_, 1) => ", bands apart",
        _ => ", bands interleaved",
    };
    let order = if layout.order == ByteOrder::Big { ", big-endian" } else { "" };
    format!("{chunks}, {compression}{predictor}{planes}{order}")
}
