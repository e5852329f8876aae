//! What is written, and where it lies.

use crate::Affine;
use selenograph_geometry::proj_string::Crs;

/// Where a raster lies.
#[derive(Debug, Clone, PartialEq)]
pub enum CogPlace {
    /// On a body's map.
    Map {
        /// Body and projection.
        crs: Crs,
        /// Corner-based pixels → map units.
        map_from_pixel: Affine,
    },
    /// On a grid of its own that is not tied to a body. It is written as an engineering (local) system with a name:
    /// unlike a file without any system, GIS programs then know its unit, measure in it, and do not place it on the Earth.
    Local {
        /// What the grid is, for people (ASCII).
        name: String,
        /// Whether its unit is a metre; else the unit stays undefined.
        metric: bool,
        /// Corner-based pixels → grid units.
        local_from_pixel: Affine,
    },
}

/// How samples are stored. In memory they are f32, NaN where absent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CogSamples {
    /// 32-bit float with the floating-point predictor; overviews average what is there.
    Float32 {
        /// The number written where absent; NaN if `None`.
        nodata: Option<f32>,
    },
    /// One byte, for whole numbers from 0 to 255 such as classes.
    Byte {
        /// The number written where absent.
        nodata: u8,
        /// What overviews show.
        overviews: ByteOverviews,
    },
}

/// What a cell of an overview of bytes shows of its four cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ByteOverviews {
    /// The most frequent value that is there; of equally frequent ones the first, row by row.
    Mode,
    /// The largest value that is there: a hazard does not vanish in an overview.
    Largest,
}

/// A band's name and unit as GIS programs show them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CogBand {
    /// For example `height`.
    pub name: String,
    /// For example `m`; empty if there is none.
    pub unit: String,
}

impl CogBand {
    /// From its name and unit.
    pub fn new(name: &str, unit: &str) -> Self {
        Self { name: name.to_owned(), unit: unit.to_owned() }
    }
}

/// What a number of a raster of classes means, and how GIS programs show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CogClass {
    /// The number in the file.
    pub number: u8,
    /// What it means.
    pub name: String,
    /// Its colour.
    pub color: [u8; 3],
}

/// What is written.
#[derive(Debug, Clone, PartialEq)]
pub struct CogOptions {
    /// Side of a tile: a multiple of 16.
    pub tile_side: usize,
    /// How samples are stored.
    pub samples: CogSamples,
    /// The bands, at least one.
    pub bands: Vec<CogBand>,
    /// What the numbers of one band of bytes mean: the file then holds a table of colours and the names. Empty for
    /// everything else.
    pub classes: Vec<CogClass>,
}

impl CogOptions {
    /// One band of 32-bit floats, NaN where absent, tiles of 512.
    pub fn float(name: &str, unit: &str) -> Self {
        let bands = vec![CogBand::new(name, unit)];
        Self { tile_side: 512, samples: CogSamples::Float32 { nodata: None }, bands, classes: Vec::new() }
    }

    /// The same with a number where floats are absent, in place of NaN; classes keep theirs.
    pub fn with_nodata(mut self, number: Option<f32>) -> Self {
        if let CogSamples::Float32 { nodata } = &mut self.samples {
            *nodata = number;
        }
        self
    }

    /// One band of classes, tiles of 512.
    pub fn classes(name: &str, nodata: u8, overviews: ByteOverviews, classes: Vec<CogClass>) -> Self {
        let bands = vec![CogBand::new(name, "")];
        Self { tile_side: 512, samples: CogSamples::Byte { nodata, overviews }, bands, classes }
    }
}
