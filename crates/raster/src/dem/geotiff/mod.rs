//! GeoTIFF, BigTIFF and cloud-optimised GeoTIFF.

pub(crate) mod bands;
mod chunk;
pub mod cog;
mod directory;
mod geokeys;
mod metadata;
mod rows;
mod write;
mod write_keys;

pub use chunk::{Compression, Predictor};
pub(super) use rows::TiffRows;
pub use write::{GeoTiffLayout, GeoTiffWriter, WriteOptions};

use super::info::{DemFormat, DemInfo, OpenOptions, PixelIs, turned_to_raster};
use super::sample::{ByteOrder, HeightLaw, SampleType};
use super::{Opened, RowSource};
use crate::Error;
use directory::{Directory, TiffFile};
use geokeys::{GeoKeys, affine_of_tags};
use metadata::GdalMetadata;
use rows::{ChunkLayout, MIN_GROUP_ROWS, Span};
use std::path::Path;

const NEW_SUBFILE_TYPE: u16 = 254;
const IMAGE_WIDTH: u16 = 256;
const IMAGE_LENGTH: u16 = 257;
const BITS_PER_SAMPLE: u16 = 258;
const COMPRESSION: u16 = 259;
const PHOTOMETRIC: u16 = 262;
const STRIP_OFFSETS: u16 = 273;
const SAMPLES_PER_PIXEL: u16 = 277;
const ROWS_PER_STRIP: u16 = 278;
const STRIP_BYTE_COUNTS: u16 = 279;
const PLANAR_CONFIGURATION: u16 = 284;
const PREDICTOR: u16 = 317;
const TILE_WIDTH: u16 = 322;
const TILE_LENGTH: u16 = 323;
const TILE_OFFSETS: u16 = 324;
const TILE_BYTE_COUNTS: u16 = 325;
const SAMPLE_FORMAT: u16 = 339;
const MODEL_PIXEL_SCALE: u16 = 33550;
const MODEL_TIEPOINT: u16 = 33922;
const MODEL_TRANSFORMATION: u16 = 34264;
const GEO_KEY_DIRECTORY: u16 = 34735;
const GEO_DOUBLE_PARAMS: u16 = 34736;
const GEO_ASCII_PARAMS: u16 = 34737;
const GDAL_METADATA: u16 = 42112;
const GDAL_NODATA: u16 = 42113;

/// Largest decoded row of chunks, in bytes as stored or as f32: 1024² tiles of f32 across half a million columns.
const MAX_BAND_BYTES: usize = 1 << 31;

/// Directories looked at for overviews and masks.
const MAX_DIRECTORIES: usize = 64;

/// Size of one image and its bands.
struct Shape {
    width: usize,
    height: usize,
    num_bands: usize,
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Opened, Error> {
    let mut tiff = TiffFile::open(path)?;
    let directory = tiff.directory(tiff.first_directory)?;
    let shape = shape(&mut tiff, &directory)?;
    let band_idx = options.band_idx(path, shape.num_bands)?;
    let layout = layout(&mut tiff, &directory, &shape, band_idx)?;
    let num_overviews = num_overviews(&mut tiff, &directory, &shape)?;

    let keys = GeoKeys::parse(
        &tiff.integers(&directory, GEO_KEY_DIRECTORY)?.unwrap_or_default(),
        &tiff.doubles(&directory, GEO_DOUBLE_PARAMS)?.unwrap_or_default(),
        &tiff.text(&directory, GEO_ASCII_PARAMS)?.unwrap_or_default(),
    );
    let map_from_pixel = map_from_pixel(&mut tiff, &directory, &keys)?;
    let crs = options.given_crs(path)?.map_or_else(|| keys.crs(path), Ok)?;
    let crs = turned_to_raster(crs, &map_from_pixel, shape.width, shape.height);

    let metadata = GdalMetadata::parse(&tiff.text(&directory, GDAL_METADATA)?.unwrap_or_default(), band_idx);
    let unit = match (options.height_unit, &metadata.unit) {
        (Some(unit), _) => unit,
        (None, text) => metadata::height_unit(path, text.as_deref())?,
    };
    let nodata = options.nodata_or(nodata(&mut tiff, &directory)?);
    let law = HeightLaw::new(metadata.scale, metadata.offset, unit.metres(), crs.body.radius_m, &nodata);
    let info = DemInfo {
        path: path.to_owned(),
        data_path: path.to_owned(),
        format: if tiff.big { DemFormat::BigTiff } else { DemFormat::GeoTiff },
        storage: storage_text(&layout, &shape),
        sample_type: layout.sample_type,
        byte_order: tiff.order,
        width: shape.width,
        height: shape.height,
        num_bands: shape.num_bands,
        band: band_idx + 1,
        band_name: metadata.band_name,
        nodata,
        scale: metadata.scale,
        offset: metadata.offset,
        unit_m: unit.metres(),
        crs,
        crs_name: keys.citation().map(str::to_owned),
        map_from_pixel,
        pixel_is: if keys.is_point() { PixelIs::Point } else { PixelIs::Area },
        num_overviews,
        notes: Vec::new(),
    };
    Ok(Opened { info, law, rows: RowSource::Tiff(TiffRows::new(tiff, layout.with_thin_strips())) })
}

fn shape(tiff: &mut TiffFile, directory: &Directory) -> Result<Shape, Error> {
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
                6 | 7 => "JPEG".to_owned(),
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

fn layout(
    tiff: &mut TiffFile,
    directory: &Directory,
    shape: &Shape,
    band_idx: usize,
) -> Result<ChunkLayout, Error> {
    let sample_type = sample_type(tiff, directory)?;
    let compression = compression(tiff, directory)?;
    let predictor = match compression {
        // The predictor belongs to the compression schemes; libtiff ignores it elsewhere too.
        Compression::None | Compression::PackBits => Predictor::None,
        Compression::Lzw | Compression::Deflate => predictor(tiff, directory, sample_type)?,
    };
    let planar = tiff.integer(directory, PLANAR_CONFIGURATION)?.unwrap_or(1) == 2;
    let tile_width = tiff.integer(directory, TILE_WIDTH)?;
    let (offsets_tag, counts_tag) = if tile_width.is_some() {
        (TILE_OFFSETS, TILE_BYTE_COUNTS)
    } else {
        (STRIP_OFFSETS, STRIP_BYTE_COUNTS)
    };
    let (chunk_width, chunk_height) = match tile_width {
        Some(width) => (width, tiff.integer(directory, TILE_LENGTH)?.unwrap_or(0)),
        None => {
            let rows = tiff.integer(directory, ROWS_PER_STRIP)?.unwrap_or(u64::MAX);
            (shape.width as u64, rows.min(shape.height as u64))
        }
    };
    let num_interleaved = if planar { 1 } else { shape.num_bands };
    let pixel_bytes = (num_interleaved * sample_type.size()).max(size_of::<f32>());
    // Thick strips without compression are read in pieces.
    let cut = compression == Compression::None && tile_width.is_none();
    let rows_at_once = if cut { chunk_height.min(MIN_GROUP_ROWS as u64) } else { chunk_height };
    checked_chunk_size(tiff, shape, chunk_width, rows_at_once, pixel_bytes)?;
    let mut layout = ChunkLayout {
        width: shape.width,
        height: shape.height,
        chunk_width: chunk_width as usize,
        chunk_height: chunk_height as usize,
        tiled: tile_width.is_some(),
        spans: Vec::new(),
        num_interleaved,
        interleaved_idx: if planar { 0 } else { band_idx },
        sample_type,
        order: tiff.order,
        compression,
        predictor,
    };
    let plane = layout.across() * layout.down();
    let offsets = tiff.integers(directory, offsets_tag)?.unwrap_or_default();
    let counts = tiff.integers(directory, counts_tag)?.unwrap_or_default();
    let expected = plane.saturating_mul(if planar { shape.num_bands } else { 1 });
    if offsets.len() != expected || counts.len() != expected {
        return Err(tiff.malformed(
            "table of strips or tiles",
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
    Ok(layout)
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
    match band_bytes {
        Some(0) => {
            Err(tiff.malformed("size of strips or tiles", "at least 1×1", format!("{width}×{height}")))
        }
        Some(bytes) if bytes <= MAX_BAND_BYTES as u64 => Ok(()),
        _ => Err(Error::Unsupported {
            path: tiff.path.clone(),
            what: "size of strips or tiles",
            found: format!("{width}×{height}"),
            supported: "a row of chunks up to 2 GiB; cut the file into smaller strips or tiles",
        }),
    }
}

/// Every chunk inside the file, and none shorter than its samples where they are not compressed.
fn checked_spans(tiff: &TiffFile, layout: &ChunkLayout) -> Result<(), Error> {
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

/// Counts the reduced images behind the first; refuses a mask of its size, which would be no-data left unread.
fn num_overviews(tiff: &mut TiffFile, first: &Directory, shape: &Shape) -> Result<usize, Error> {
    let (mut count, mut next) = (0, first.next);
    for _ in 0..MAX_DIRECTORIES {
        // A damaged directory behind the image does not touch the image.
        let Ok(directory) = (if next == 0 { break } else { tiff.directory(next) }) else { break };
        let kind = tiff.integer(&directory, NEW_SUBFILE_TYPE).ok().flatten().unwrap_or(0);
        let width = tiff.integer(&directory, IMAGE_WIDTH).ok().flatten();
        if kind & 4 != 0 && width == Some(shape.width as u64) {
            return Err(Error::Unsupported {
                path: tiff.path.clone(),
                what: "no-data by",
                found: "an internal mask".to_owned(),
                supported: "a no-data number or NaN: gdal_translate -a_nodata",
            });
        }
        count += usize::from(kind & 1 != 0 && kind & 4 == 0);
        next = directory.next;
    }
    Ok(count)
}

fn map_from_pixel(
    tiff: &mut TiffFile,
    directory: &Directory,
    keys: &GeoKeys,
) -> Result<crate::Affine, Error> {
    let matrix = tiff.doubles(directory, MODEL_TRANSFORMATION)?;
    let scale = tiff.doubles(directory, MODEL_PIXEL_SCALE)?;
    let tie = tiff.doubles(directory, MODEL_TIEPOINT)?;
    let path = tiff.path.clone();
    let missing = |what: &str| Error::NoGeoreference { path: path.clone(), what: what.to_owned() };
    let affine = affine_of_tags(matrix.as_deref(), scale.as_deref(), tie.as_deref()).ok_or_else(|| {
        missing(if tie.is_some() {
            "it has control points but no transform"
        } else {
            "it has no transform (neither pixel scale with tiepoint nor a matrix)"
        })
    })?;
    let unit_m =
        keys.linear_unit_m().ok_or_else(|| missing("its GeoKeys name a length unit without its size"))?;
    let affine = crate::Affine::new(affine.coefficients.map(|a| a * unit_m));
    affine.inverse().map_err(|e| missing(&e.to_string()))?;
    Ok(if keys.is_point() { affine.pixel_from_grid() } else { affine })
}

fn nodata(tiff: &mut TiffFile, directory: &Directory) -> Result<Vec<f64>, Error> {
    let Some(text) = tiff.text(directory, GDAL_NODATA)? else { return Ok(Vec::new()) };
    let text = text.trim();
    match text.parse::<f64>() {
        Ok(value) => Ok(vec![value]),
        Err(_) if text.is_empty() => Ok(Vec::new()),
        Err(_) => Err(tiff.malformed("no-data tag", "a number", text)),
    }
}

fn storage_text(layout: &ChunkLayout, shape: &Shape) -> String {
    let chunks = if layout.tiled {
        format!("tiles {}×{}", layout.chunk_width, layout.chunk_height)
    } else {
        format!("strips of {} row(s)", layout.chunk_height)
    };
    let compression = match layout.compression {
        Compression::None => "uncompressed",
        Compression::Lzw => "LZW",
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
