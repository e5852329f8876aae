//! What can go wrong with terrain.

use std::path::{Path, PathBuf};

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A grid too small to carry a surface, or whose georeference cannot be inverted.
    #[error("terrain grid: expected {expected}, found {found}")]
    Grid {
        /// What was expected.
        expected: &'static str,
        /// What was found.
        found: String,
    },
    /// A grid without a single height.
    #[error("terrain `{name}` has no height at all ({cells} nodes, all absent)")]
    AllAbsent {
        /// File or layer.
        name: String,
        /// Number of nodes looked at.
        cells: usize,
    },
    /// The operating system refused.
    #[error("cannot {action} `{}`: {source}", path.display())]
    Io {
        /// `open`, `write`, `rename` …
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file or folder that cannot be written.
    #[error(transparent)]
    Files(#[from] selenograph_files::Error),
    /// Elevation models on different spheres.
    #[error(transparent)]
    Geometry(#[from] selenograph_geometry::Error),
    /// An elevation model that cannot be read.
    #[error(transparent)]
    Raster(#[from] selenograph_raster::Error),
    /// A folder without a terrain in it.
    #[error("`{}` is not a terrain: {what}", path.display())]
    NotATerrain {
        /// The folder.
        path: PathBuf,
        /// What is missing or wrong.
        what: String,
    },
    /// A terrain written by another version of this program.
    #[error("terrain `{}` has format version {found}, this program reads version {expected}", path.display())]
    Version {
        /// The folder.
        path: PathBuf,
        /// The version read here.
        expected: u32,
        /// The version found.
        found: u32,
    },
    /// A terrain whose files contradict each other.
    #[error("terrain file `{}` is corrupt: {what}: expected {expected}, found {found}", path.display())]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// Which part.
        what: &'static str,
        /// What the description asks for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A place that another surface should cover and does not.
    #[error("{what} does not cover map position ({x:.1}, {y:.1})")]
    NotCovered {
        /// What should cover it.
        what: &'static str,
        /// Map x.
        x: f64,
        /// Map y.
        y: f64,
    },
    /// A setting outside its range.
    #[error("setting `{name}`: expected {expected}, found {found}")]
    Settings {
        /// Its name.
        name: &'static str,
        /// The range.
        expected: String,
        /// The value.
        found: String,
    },
}

impl Error {
    /// Wraps an error of the system: `.map_err(Error::io("open", path))`.
    pub(crate) fn io<'a>(action: &'static str, path: &'a Path) -> impl FnOnce(std::io::Error) -> Self + 'a {
        move |source| Self::Io { action, path: path.to_owned(), source }
    }

    /// What the user can do about it, where that is known.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Raster(error) => error.hint(),
            Self::Files(error) => error.hint(),
            Self::NotATerrain { .. } => {
                Some("`selenograph dem import FILE --out DIR` makes one of elevation models")
            }
            Self::Version { .. } | Self::Corrupt { .. } => Some("import the elevation models again"),
            Self::AllAbsent { .. } => Some("check the no-data value and the band"),
            Self::NotCovered { .. } => Some("take a smaller grid, or a base that reaches further"),
            _ => None,
        }
    }
}
