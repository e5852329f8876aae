//! What is known about an elevation model before its samples are read, and how to read it otherwise than it says.

use crate::sample::{ByteOrder, SampleType};
use crate::{Affine, Error};
use selenograph_geometry::proj_string::{self, Crs};
use selenograph_geometry::{Body, Projection};
use serde::{Deserialize, Serialize, Serializer};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// Unit of stored heights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HeightUnit {
    /// 1 m.
    Metre,
    /// 1000 m.
    Kilometre,
}

impl HeightUnit {
    /// Metres per unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Kilometre => 1000.0,
        }
    }

    /// From what labels write: `m`, `METER`, `metres`, `KILOMETER`, `<KM>` …
    pub(crate) fn parse(text: &str) -> Option<Self> {
        match text.trim().trim_matches(['<', '>']).to_ascii_lowercase().as_str() {
            "m" | "meter" | "meters" | "metre" | "metres" => Some(Self::Metre),
            "km" | "kilometer" | "kilometers" | "kilometre" | "kilometres" => Some(Self::Kilometre),
            _ => None,
        }
    }
}

/// How to read a file otherwise than it says itself.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OpenOptions {
    /// The band that holds heights, counted from 1 (default 1).
    pub band: Option<usize>,
    /// Coordinate system in place of the file's: a PROJ string or an `IAU_2015` code.
    pub crs: Option<String>,
    /// No-data number in place of the file's, as stored (before scale and offset).
    pub nodata: Option<f64>,
    /// Unit of stored heights in place of the file's.
    pub height_unit: Option<HeightUnit>,
}

impl OpenOptions {
    /// The coordinate system given here.
    pub(crate) fn given_crs(&self, path: &Path) -> Result<Option<Crs>, Error> {
        let parsed = self.crs.as_deref().map(proj_string::parse).transpose();
        parsed.map_err(|source| Error::CoordinateSystem { path: path.to_owned(), source })
    }

    /// The band asked for, as an index from 0.
    pub(crate) fn band_idx(&self, path: &Path, num_bands: usize) -> Result<usize, Error> {
        match self.band.unwrap_or(1) {
            band if (1..=num_bands).contains(&band) => Ok(band - 1),
            found => Err(Error::Band { path: path.to_owned(), num_bands, found }),
        }
    }

    /// The no-data numbers: the one given here, else the file's.
    pub(crate) fn nodata_or(&self, own: Vec<f64>) -> Vec<f64> {
        self.nodata.map_or(own, |value| vec![value])
    }
}

/// The kinds of files read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DemFormat {
    /// TIFF 6 with GeoKeys (also cloud-optimised).
    GeoTiff,
    /// The same with 64-bit offsets.
    BigTiff,
    /// Planetary Data System, version 3: text label and raw image.
    Pds3,
    /// Planetary Data System, version 4: XML label and raw image.
    Pds4,
}

/// Where the file's own coordinates lie in a pixel. [`DemInfo::map_from_pixel`] has it resolved already.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PixelIs {
    /// At its corner: the pixel is an area.
    Area,
    /// At its centre: the pixel is a point.
    Point,
}

/// What a file says about itself.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct DemInfo {
    /// The file that was opened.
    pub path: PathBuf,
    /// The file that holds the samples: another one where the label is detached.
    pub data_path: PathBuf,
    /// Its format.
    pub format: DemFormat,
    /// How samples are stored, for people: `tiles 256×256, deflate, predictor 3`.
    pub storage: String,
    /// Type of stored samples.
    pub sample_type: SampleType,
    /// Their byte order.
    pub byte_order: ByteOrder,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Number of bands in the file.
    pub num_bands: usize,
    /// The band read, counted from 1.
    pub band: usize,
    /// Its name, where the file has one.
    pub band_name: Option<String>,
    /// Stored numbers that mean "absent", besides NaN and the special pixels of ISIS.
    pub nodata: Vec<f64>,
    /// Stored number → file unit: factor.
    pub scale: f64,
    /// Stored number → file unit: summand. One of planetary size means that the file holds radii.
    pub offset: f64,
    /// Metres per file unit.
    pub unit_m: f64,
    /// Body and map projection.
    #[serde(serialize_with = "crs_as_text")]
    pub crs: Crs,
    /// What the file calls its coordinate system.
    pub crs_name: Option<String>,
    /// Corner-based pixel coordinates → map units (metres; degrees if geographic).
    pub map_from_pixel: Affine,
    /// Where the file's own coordinates lie.
    pub pixel_is: PixelIs,
    /// Number of reduced copies in the file (they are not read).
    pub num_overviews: usize,
    /// What had to be decided while reading, in sentences.
    pub notes: Vec<String>,
}

fn crs_as_text<S: Serializer>(crs: &Crs, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&proj_string::format(crs))
}

impl DemInfo {
    /// The body whose sphere heights are measured from.
    pub fn body(&self) -> &Body {
        &self.crs.body
    }
}

/// Turns a map's longitude range so that it holds the whole raster.
///
/// Longitudes are taken within ±180° of a centre. Files count them from 0 to 360 as well as from −180 to 180, with
/// the same central meridian, so the raster decides.
pub(crate) fn turned_to_raster(mut crs: Crs, map_from_pixel: &Affine, width: usize, height: usize) -> Crs {
    let [x, _] = map_from_pixel.apply(width as f64 / 2.0, height as f64 / 2.0);
    match &mut crs.projection {
        Projection::Geographic { lon_center_deg } => *lon_center_deg = x,
        Projection::Equirectangular { lat_ts_rad, lon0_rad, false_easting_m, radius_m, .. } => {
            let half_turn = PI * *radius_m * lat_ts_rad.cos();
            let [step_x, _] = map_from_pixel.steps();
            let reach = (x - *false_easting_m).abs() + step_x * (width as f64 - 1.0) / 2.0;
            if reach > half_turn {
                let half_turns = ((x - *false_easting_m) / half_turn).round();
                *lon0_rad += half_turns * PI;
                *false_easting_m += half_turns * half_turn;
            }
        }
        Projection::PolarStereographic { .. } | Projection::Orthographic { .. } => {}
    }
    crs
}
