//! Elevation models from files: GeoTIFF, PDS3 and PDS4 in, heights in metres out, row by row.
//!
//! What differs between files is resolved here and nowhere later: no-data becomes NaN, radii become heights, pixel
//! centres and corners become one convention ([`DemInfo::map_from_pixel`]).

pub mod geotiff;
pub mod info;
mod opened;
pub(crate) mod pds3;
pub(crate) mod pds4;
pub(crate) mod raw;

pub use crate::sample::{ByteOrder, SampleType};
pub use geotiff::cog;
pub use geotiff::{GeoTiffLayout, GeoTiffWriter, WriteOptions};
pub use info::{DemFormat, DemInfo, HeightUnit, OpenOptions, PixelIs};

use crate::beside::label_beside;
use crate::content::{Content, content_of};
use crate::{Error, Raster};
use opened::{Opened, RowSource};
use std::path::Path;

const FORMATS: &str = "GeoTIFF, a PDS3 label or image, or a PDS4 label";

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
    /// Lowest and highest among them.
    range: [f32; 2],
}

/// Heights larger than this share of the radius are none.
const IMPOSSIBLE_SHARE: f64 = 0.5;

/// Numbers that mean "absent" in many files that do not say so.
const COMMON_NODATA: [f64; 9] = [
    -32_768.0,
    -32_767.0,
    32_767.0,
    65_535.0,
    -9999.0,
    -99_999.0,
    -999_999.0,
    -2_147_483_648.0,
    4_294_967_295.0,
];

impl DemReader {
    /// Opens a `.tif`, `.lbl`, `.img` or `.xml` by its content; an image without a label in itself finds the label
    /// beside it.
    ///
    /// # Errors
    /// [`Error::UnknownFormat`], [`Error::Truncated`], [`Error::Malformed`], [`Error::Unsupported`],
    /// [`Error::MissingFile`], [`Error::NoGeoreference`], [`Error::UnknownProjection`],
    /// [`Error::CoordinateSystem`], [`Error::Band`], [`Error::Io`].
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self, Error> {
        let mut content = content_of(path)?;
        let label = if content.is_raw() { label_beside(path) } else { None };
        if let Some(label) = &label {
            content = content_of(label)?;
        }
        let path = label.as_deref().unwrap_or(path);
        let opened = match content {
            Content::Tiff => geotiff::open(path, options),
            Content::Pds3 => pds3::open(path, options),
            Content::Xml => pds4::open(path, options),
            other => {
                let (path, found) = (path.to_owned(), other.name());
                Err(Error::UnknownFormat { path, expected: FORMATS, found })
            }
        }?;
        let mut reader =
            Self { opened, next_row: 0, num_valid: 0, range: [f32::INFINITY, f32::NEG_INFINITY] };
        reader.bring_radii_down()?;
        Ok(reader)
    }

    /// Looks whether samples are distances from the body's centre (as ISIS writes them): those of the first of a few rows
    /// that has any. Then the sphere's radius is taken off, and a note says so.
    fn bring_radii_down(&mut self) -> Result<(), Error> {
        let Opened { info, law, rows } = &mut self.opened;
        let radius_m = info.crs.body.radius_m;
        let mut row = vec![f32::NAN; info.width];
        for quarter in [2, 1, 3, 0, 4] {
            rows.read((info.height - 1) * quarter / 4, law, &mut row)?;
            let shares = row.iter().filter(|h| !h.is_nan()).map(|h| f64::from(*h) / radius_m);
            let radii = shares.clone().filter(|share| (share - 1.0).abs() < IMPOSSIBLE_SHARE).count();
            let valid = shares.count();
            if valid == 0 {
                continue;
            }
            // Not all need be: a no-data number that the file does not tell may be among them.
            if 2 * radii > valid {
                *law = law.clone().of_radii(radius_m);
                if let RowSource::Tiff(band) = rows {
                    band.forget();
                }
                info.notes.push(format!("samples are radii: the sphere's {radius_m} m are taken off"));
            }
            break;
        }
        Ok(())
    }

    /// Refuses heights that cannot be: a no-data number that the file does not tell, or another unit.
    ///
    /// # Errors
    /// [`Error::ImpossibleHeight`].
    pub fn refuse_impossible(&self, heights: &[f32]) -> Result<(), Error> {
        let radius_m = self.opened.info.crs.body.radius_m;
        match heights.iter().find(|h| f64::from(h.abs()) > IMPOSSIBLE_SHARE * radius_m) {
            Some(&height_m) => {
                Err(Error::ImpossibleHeight { path: self.opened.info.data_path.clone(), height_m, radius_m })
            }
            None => Ok(()),
        }
    }

    /// Notes down what looks like no-data that the file does not tell.
    fn note_doubts(&mut self) {
        let Opened { info, law, .. } = &mut self.opened;
        let [low, high] = self.range;
        let common = COMMON_NODATA.iter().filter(|stored| !info.nodata.contains(stored));
        let told = |end: f32| {
            let impossible = f64::from(end.abs()) > IMPOSSIBLE_SHARE * info.crs.body.radius_m;
            let common = common.clone().any(|stored| law.height(*stored) == end);
            (impossible || common).then(|| {
                let stored = law.stored(end);
                let stored = match info.sample_type {
                    SampleType::F32 => format!("{:?}", stored as f32),
                    _ => format!("{stored:?}"),
                };
                format!("{stored} looks like a no-data number that the file does not tell: --nodata {stored} makes it absent")
            })
        };
        let doubts: Vec<String> = [low, high].into_iter().filter_map(told).collect();
        info.notes.extend(doubts);
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
    /// when the last row has been read downwards from the first and not one sample was valid. Then, what looks like a
    /// no-data number that the file does not tell stands in [`DemInfo::notes`].
    pub fn read_rows(&mut self, first_row: usize, num_rows: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        let Opened { info, law, rows } = &mut self.opened;
        let end = first_row.saturating_add(num_rows);
        if end > info.height {
            return Err(Error::Rows { first: first_row, end, height: info.height });
        }
        out.clear();
        out.resize(num_rows * info.width, f32::NAN);
        rows.read(first_row, law, out)?;
        if first_row == self.next_row {
            self.next_row = end;
            let [mut low, mut high] = self.range;
            for height in out.iter().filter(|h| !h.is_nan()) {
                self.num_valid += 1;
                (low, high) = (low.min(*height), high.max(*height));
            }
            self.range = [low, high];
            if end == info.height && self.num_valid == 0 {
                let num_samples = info.width as u64 * info.height as u64;
                return Err(Error::AllNodata { path: info.data_path.clone(), num_samples });
            }
            if end == info.height {
                self.note_doubts();
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
