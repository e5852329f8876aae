//! What can go wrong with a raster or its file.

use std::path::{Path, PathBuf};

/// What can go wrong with a raster or its file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("cannot {action} `{}`: {source}", path.display())]
    Io {
        /// `open`, `read`, `write` …
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file or folder that cannot be written.
    #[error(transparent)]
    Files(#[from] selenograph_files::Error),
    /// Another kind of file than those we read.
    #[error("`{}` is not a format read here: expected {expected}, found {found}", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// The formats read.
        expected: &'static str,
        /// What the first bytes look like.
        found: String,
    },
    /// The file ends before its data does.
    #[error("`{}` is truncated: {what} needs {expected} bytes, the file has {found}", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Which part is cut off.
        what: String,
        /// Bytes needed.
        expected: u64,
        /// Bytes there.
        found: u64,
    },
    /// The file contradicts its format.
    #[error("`{}` is corrupt: {what}: expected {expected}, found {found}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Which part.
        what: String,
        /// What the format asks for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The file is well-formed, in a variant that is not read here.
    #[error("`{}`: {what} `{found}` is not supported (supported: {supported})", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// For example `compression`.
        what: &'static str,
        /// The variant found.
        found: String,
        /// What is supported.
        supported: &'static str,
    },
    /// A label points to a file that is not there.
    #[error("label `{}` points to `{target}`, which is not beside it", path.display())]
    MissingFile {
        /// The label.
        path: PathBuf,
        /// The name in the label.
        target: String,
    },
    /// Nothing in the file says where on the body it lies.
    #[error("`{}` has no georeference: {what}", path.display())]
    NoGeoreference {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: String,
    },
    /// A projection or coordinate system without a closed form here.
    #[error("`{}`: projection `{name}` is not supported", path.display())]
    UnknownProjection {
        /// The file.
        path: PathBuf,
        /// The projection's name in the file or option.
        name: String,
    },
    /// A coordinate system whose parameters cannot be used.
    #[error("`{}`: {source}", path.display())]
    CoordinateSystem {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: selenograph_geometry::Error,
    },
    /// The file has no such band.
    #[error("`{}` has {num_bands} band(s), band {found} was asked for", path.display())]
    Band {
        /// The file.
        path: PathBuf,
        /// Number of bands in the file.
        num_bands: usize,
        /// The band asked for.
        found: usize,
    },
    /// Not one sample of the raster is valid.
    #[error("`{}` holds no valid sample: all {num_samples} are no-data or NaN", path.display())]
    AllNodata {
        /// The file.
        path: PathBuf,
        /// Number of samples looked at.
        num_samples: u64,
    },
    /// Samples that cannot be heights on this body.
    #[error("`{}`: a height of {height_m:e} m cannot be on a sphere of {radius_m} m", path.display())]
    ImpossibleHeight {
        /// The file.
        path: PathBuf,
        /// The height found.
        height_m: f32,
        /// Radius of the sphere.
        radius_m: f64,
    },
    /// Rows outside the raster were asked for.
    #[error("rows {first}..{end} were asked for, the raster has {height}")]
    Rows {
        /// First row asked for.
        first: usize,
        /// One past the last row asked for.
        end: usize,
        /// Rows there are.
        height: usize,
    },
    /// Arrays that should agree in size do not.
    #[error("{what}: expected {expected}, found {found}")]
    SizeMismatch {
        /// Which array.
        what: &'static str,
        /// The size expected.
        expected: String,
        /// The size found.
        found: String,
    },
    /// A picture or array that a file format cannot hold.
    #[error("cannot encode {format}: {what}")]
    Encode {
        /// The format.
        format: &'static str,
        /// Why not.
        what: String,
    },
    /// An affine map that cannot be inverted.
    #[error("the affine transform {coefficients:?} is singular")]
    SingularAffine {
        /// Its six coefficients.
        coefficients: [f64; 6],
    },
}

impl Error {
    /// What the user can do about it, where that is known.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::UnknownProjection { .. } | Self::CoordinateSystem { .. } => Some(
                "pass --crs with a PROJ string (`+proj=stere +lat_0=-90 +R=1737400`) or an IAU_2015 code of the same map",
            ),
            Self::NoGeoreference { .. } => Some(
                "pass --crs if only the coordinate system is missing; otherwise add a transform (gdal_translate -a_ullr)",
            ),
            Self::Band { .. } => Some("bands count from 1; `dem info` lists them"),
            Self::MissingFile { .. } => {
                Some("put the image beside its label; the case of its name does not matter")
            }
            Self::AllNodata { .. } => Some("check --band and --nodata"),
            Self::ImpossibleHeight { .. } => Some(
                "if it is a no-data number that the file does not tell, pass --nodata; else check --height-unit",
            ),
            Self::Unsupported { what, found, .. } => Self::unsupported_hint(what, found),
            Self::Truncated { .. } => Some("the download may be incomplete: fetch the file again"),
            _ => None,
        }
    }

    /// What turns an unsupported variant into one that is read.
    fn unsupported_hint(what: &str, found: &str) -> Option<&'static str> {
        match what {
            "compression" | "predictor" => {
                Some("`gdal_translate -co COMPRESS=DEFLATE in out.tif` writes what is read here")
            }
            "sample type" if found.starts_with("complex") => Some(
                "choose the amplitude, for example: `gdal_translate DERIVED_SUBDATASET:AMPLITUDE:in.tif out.tif`",
            ),
            "sample type" => {
                Some("`gdal_translate -ot Float32 in out.tif` writes samples that are read here")
            }
            "photometric interpretation" if found == "palette" => {
                Some("`gdal_translate -expand rgb in out.tif` looks the palette up")
            }
            "size of strips or tiles" => Some("`gdal_translate -co TILED=YES in out.tif` cuts it into tiles"),
            "height unit" => Some("--height-unit says what the file does not, or not in words known here"),
            "no-data text" => Some("--nodata gives the number in its place"),
            "angular unit" | "prime meridian" | "longitude direction" => Some(
                "`gdalwarp -t_srs \"+proj=longlat +R=1737400\" in out.tif` writes a map that is read here",
            ),
            "picture size" => {
                Some("cut a window out of it: `gdal_translate -srcwin X Y WIDTH HEIGHT in out.tif`")
            }
            "encoding" | "object" | "layout" | "display direction of a map" | "axis order of a map" => {
                Some("`gdal_translate in out.tif` turns most layouts into GeoTIFF")
            }
            _ => None,
        }
    }

    /// For `map_err` on the results of file operations.
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }
}
