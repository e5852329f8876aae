//! Elevation models from files: GeoTIFF, PDS3 and PDS4 in, heights in metres out, row by row.
//!
//! What differs between files is resolved here and nowhere later: no-data becomes NaN, radii become heights, pixel
//! centres and corners become one convention ([`DemInfo::map_from_pixel`]).

pub mod geotiff;
pub mod info;
pub(crate) mod pds3;
pub(crate) mod pds4;
pub(crate) mod raw;
pub mod sample;

pub use geotiff::cog;
pub use geotiff::{GeoTiffLayout, GeoTiffWriter, WriteOptions};
pub use info::{DemFormat, DemInfo, HeightUnit, OpenOptions, PixelIs};
pub use sample::{ByteOrder, SampleType};

use crate::{Error, Raster};
use geotiff::TiffRows;
use raw::RawRows;
use sample::HeightLaw;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes that tell the format of a file.
const SNIFF_BYTES: u64 = 4096;

const FORMATS: &str = "GeoTIFF, a PDS3 label or image, or a PDS4 label";

/// Where rows come from.
enum RowSource {
    Tiff(TiffRows),
    Raw(RawRows),
}

/// What opening a file of any format gives.
struct Opened {
    info: DemInfo,
    law: HeightLaw,
    rows: RowSource,
}

/// An open elevation model.
///
/// # Example
/// ```no_run
/// use selenograph_raster::dem::{DemReader, OpenOptions};
/// let mut dem = DemReader::open("ldem_4.lbl".as_ref(), &OpenOptions::default())?;
/// let (height, mut rows) = (dem.info().height, Vec::new());
/// for first in (0..height).step_by(256) {
///     dem.read_rows(first, 256.min(height - first), &mut rows)?;
/// }
/// # Ok::<(), selenograph_raster::Error>(())
/// ```
pub struct DemReader {
    opened: Opened,
    /// Rows seen so far without a gap from the top, and valid samples among them.
    next_row: usize,
    num_valid: u64,
}

impl DemReader {
    /// Opens a `.tif`, `.lbl`, `.img` or `.xml` by its content; an image without a label in itself finds the label
    /// beside it.
    ///
    /// # Errors
    /// [`Error::UnknownFormat`], [`Error::Truncated`], [`Error::Malformed`], [`Error::Unsupported`],
    /// [`Error::MissingFile`], [`Error::NoGeoreference`], [`Error::UnknownProjection`],
    /// [`Error::CoordinateSystem`], [`Error::Band`], [`Error::Io`].
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self, Error> {
        let opened = match sniff(path)? {
            Content::Tiff => geotiff::open(path, options),
            Content::Pds3 => pds3::open(path, options),
            Content::Xml => pds4::open(path, options),
            Content::Other(found) => match label_beside(path) {
                Some(label) if matches!(sniff(&label)?, Content::Xml) => pds4::open(&label, options),
                Some(label) => pds3::open(&label, options),
                None => Err(Error::UnknownFormat { path: path.to_owned(), expected: FORMATS, found }),
            },
        }?;
        Ok(Self { opened, next_row: 0, num_valid: 0 })
    }

    /// What the file says about itself.
    pub fn info(&self) -> &DemInfo {
        &self.opened.info
    }

    /// Heights of rows `first_row..first_row + num_rows` into `out` (its former content is dropped): metres above the
    /// body's sphere, NaN where absent. Holds at most one row of tiles (or 64 rows of thin strips) in memory; reading
    /// downwards decodes nothing twice.
    ///
    /// # Errors
    /// [`Error::Rows`] outside the raster; [`Error::Malformed`] for a damaged strip or tile; [`Error::AllNodata`]
    /// when the last row has been read downwards from the first and not one sample was valid.
    pub fn read_rows(&mut self, first_row: usize, num_rows: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        let Opened { info, law, rows } = &mut self.opened;
        let end = first_row.saturating_add(num_rows);
        if end > info.height {
            return Err(Error::Rows { first: first_row, end, height: info.height });
        }
        out.clear();
        out.resize(num_rows * info.width, f32::NAN);
        match rows {
            RowSource::Tiff(tiff) => tiff.read(first_row, law, out)?,
            RowSource::Raw(raw) => raw.read(first_row, law, out)?,
        }
        if first_row == self.next_row {
            self.next_row = end;
            self.num_valid += out.iter().filter(|h| !h.is_nan()).count() as u64;
            if end == info.height && self.num_valid == 0 {
                let num_samples = info.width as u64 * info.height as u64;
                return Err(Error::AllNodata { path: info.data_path.clone(), num_samples });
            }
        }
        Ok(())
    }

    /// The whole raster: for small ones and tests.
    ///
    /// # Errors
    /// As [`DemReader::read_rows`].
    pub fn read_all(&mut self) -> Result<Raster<f32>, Error> {
        let (width, height) = (self.opened.info.width, self.opened.info.height);
        let mut data = Vec::new();
        self.read_rows(0, height, &mut data)?;
        Raster::new(width, height, data)
    }
}

/// What a file looks like from its first bytes.
enum Content {
    Tiff,
    Pds3,
    Xml,
    Other(String),
}

fn sniff(path: &Path) -> Result<Content, Error> {
    let mut head = Vec::new();
    let file = File::open(path).map_err(Error::io("open", path))?;
    file.take(SNIFF_BYTES).read_to_end(&mut head).map_err(Error::io("read", path))?;
    Ok(match head.as_slice() {
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Content::Tiff,
        [] => Content::Other("an empty file".to_owned()),
        [0x89, b'P', b'N', b'G', ..] => Content::Other("a PNG picture".to_owned()),
        [0xFF, 0xD8, 0xFF, ..] => Content::Other("a JPEG picture".to_owned()),
        [0, 0, 0, 12, b'j', b'P', ..] => Content::Other("a JPEG 2000 picture".to_owned()),
        [0x89, b'H', b'D', b'F', ..] => Content::Other("an HDF5 file".to_owned()),
        _ => sniff_text(&head),
    })
}

fn sniff_text(head: &[u8]) -> Content {
    let text = String::from_utf8_lossy(head);
    let start = text.trim_start_matches('\u{feff}').trim_start();
    if start.starts_with('<') {
        Content::Xml
    } else if text.contains("PDS_VERSION_ID") {
        Content::Pds3
    } else if text.contains("Object = IsisCube") {
        Content::Other("an ISIS cube".to_owned())
    } else {
        let bytes: Vec<String> = head.iter().take(4).map(|b| format!("{b:02x}")).collect();
        Content::Other(format!("bytes {}", bytes.join(" ")))
    }
}

/// The label of a raw image: the same name with another ending, of any case.
pub(crate) fn label_beside(path: &Path) -> Option<PathBuf> {
    let stem = path.file_stem()?.to_str()?;
    ["lbl", "xml"].iter().find_map(|ending| find_beside(path, &format!("{stem}.{ending}")))
}

/// The file of that name in the folder of `path`, whatever its case; the same case is preferred.
pub(crate) fn find_beside(path: &Path, name: &str) -> Option<PathBuf> {
    // Labels made on other systems may name folders; archives are rarely unpacked with them.
    let name = name.rsplit(['/', '\\']).next().filter(|name| !name.is_empty())?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let exact = folder.join(name);
    if exact.is_file() {
        return Some(exact);
    }
    let mut matches: Vec<PathBuf> = std::fs::read_dir(folder)
        .ok()?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|p| p.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.eq_ignore_ascii_case(name)))
        .filter(|p| p.is_file())
        .collect();
    matches.sort();
    matches.into_iter().next()
}
