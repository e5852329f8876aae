//! Cubes of ISIS 3: a PVL label, then samples by lines or in tiles.
//!
//! # Source
//! "Isis Cube Format" and `SpecialPixel.h` of USGS ISIS 3.

use super::found::{PictureFile, PictureFormat};
use super::raw;
use crate::beside::find_beside;
use crate::dem::pds3::label::{self, Block, Value};
use crate::dem::raw::{Interleave, RawLayout, RawPicture, RawRows, Turn};
use crate::illumination::{self, Keywords};
use crate::sample::{ByteOrder, HeightLaw, SampleType};
use crate::{Error, Raster};
use selenograph_files::regular;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Where an attached label is given up; ISIS reserves 65536 bytes and writes more where it must.
const MAX_LABEL_BYTES: u64 = 1 << 20;

pub(super) fn read(path: &Path) -> Result<PictureFile, Error> {
    let core = core_object(path)?;
    let cube = Cube { path, core: &core };
    let picture = cube.picture()?;
    match cube.tile()? {
        None => raw::read(path, picture, PictureFormat::Isis, raw::read_band),
        Some(tile) => {
            raw::read(path, picture, PictureFormat::Isis, |picture, _, law| tile.read(picture, law))
        }
    }
}

/// The `Core` object of the label. Only it is parsed: other parts hold values broken over lines with hyphens.
fn core_object(path: &Path) -> Result<Block, Error> {
    let text = label_text(path)?;
    let is = |line: &str, key: &str, value: &str| {
        let (found, rest) = line.split_once('=').unwrap_or((line, ""));
        found.trim().eq_ignore_ascii_case(key) && rest.trim().eq_ignore_ascii_case(value)
    };
    let lines: Vec<&str> = text
        .lines()
        .map(|line| line.trim_end_matches('\0'))
        .skip_while(|line| !is(line, "object", "core"))
        .take_while(|line| !is(line, "end_object", "") && !is(line, "end_object", "core"))
        .filter(|line| !line.trim_start().starts_with('#'))
        .collect();
    let core = format!("{}\nEnd_Object\nEnd\n", lines.join("\n"));
    let label =
        label::parse(&core).map_err(|(expected, found)| malformed(path, "label", &expected, found))?;
    label.find_block("CORE").cloned().ok_or_else(|| malformed(path, "label", "an object Core", "none"))
}

fn label_text(path: &Path) -> Result<String, Error> {
    let mut bytes = Vec::new();
    let (file, _) = regular::open(path).map_err(Error::io("open", path))?;
    file.take(MAX_LABEL_BYTES).read_to_end(&mut bytes).map_err(Error::io("read", path))?;
    Ok(bytes.iter().map(|&b| char::from(b)).collect())
}

/// What the label says of the Sun, line by line: parts of it hold values broken over lines with hyphens. Times and targets are those of
/// the group `Instrument`, as other groups and tables have times of their own.
pub(crate) fn keywords(path: &Path) -> Result<Keywords, Error> {
    let text = label_text(path)?;
    let (mut group, mut found) = (String::new(), Vec::new());
    let lines = text.lines().map(|line| line.trim_end_matches('\0').trim());
    for line in lines.take_while(|line| !line.eq_ignore_ascii_case("end")) {
        let (key, value) = line.split_once('=').map_or((line, ""), |(key, value)| (key.trim(), value.trim()));
        match key.to_ascii_lowercase().as_str() {
            "group" | "object" => value.to_ascii_lowercase().clone_into(&mut group),
            "end_group" | "end_object" => group.clear(),
            "starttime" | "stoptime" | "targetname" if group != "instrument" => {}
            _ => {
                let Some(name) = illumination::names().find(|name| name.eq_ignore_ascii_case(key)) else {
                    continue;
                };
                let (value, unit) = value.split_once('<').unwrap_or((value, ""));
                let unit = unit.trim_end_matches('>').trim();
                let unit = (!unit.is_empty()).then(|| unit.to_owned());
                found.push((name, (value.trim().trim_matches('"').to_owned(), unit)));
            }
        }
    }
    Ok(Keywords(found))
}

fn malformed(path: &Path, what: &str, expected: &str, found: impl ToString) -> Error {
    Error::Malformed {
        path: path.to_owned(),
        what: format!("ISIS {what}"),
        expected: expected.to_owned(),
        found: found.to_string(),
    }
}

struct Cube<'a> {
    path: &'a Path,
    core: &'a Block,
}

impl Cube<'_> {
    fn count(&self, key: &str, default: Option<f64>) -> Result<usize, Error> {
        match self.core.find(key).and_then(Value::number).or(default) {
            Some(v) if (1.0..4.3e9).contains(&v) && v.fract() == 0.0 => Ok(v as usize),
            Some(v) => Err(malformed(self.path, key, "a whole number from 1", v)),
            None => Err(malformed(self.path, "label", key, "none")),
        }
    }

    fn text(&self, key: &str) -> String {
        self.core.find(key).map_or("", Value::text).to_ascii_lowercase()
    }

    fn number(&self, key: &str, default: f64) -> Result<f64, Error> {
        match self.core.find(key) {
            None => Ok(default),
            Some(value) => value.number().ok_or_else(|| malformed(self.path, key, "a number", value.text())),
        }
    }

    fn unsupported(&self, what: &'static str, found: String, supported: &'static str) -> Error {
        Error::Unsupported { path: self.path.to_owned(), what, found, supported }
    }

    fn data_path(&self) -> Result<PathBuf, Error> {
        let Some(target) = self.core.find("^CORE") else { return Ok(self.path.to_owned()) };
        let target = target.text();
        find_beside(self.path, target)
            .ok_or_else(|| Error::MissingFile { path: self.path.to_owned(), target: target.to_owned() })
    }

    fn picture(&self) -> Result<RawPicture, Error> {
        let order = match self.text("BYTEORDER").as_str() {
            "msb" => ByteOrder::Big,
            _ => ByteOrder::Little,
        };
        let (sample_type, nodata) = sample_type(&self.text("TYPE")).ok_or_else(|| {
            let supported = "UnsignedByte, SignedWord, UnsignedWord, Real, Double";
            self.unsupported("sample type", self.text("TYPE"), supported)
        })?;
        let layout = RawLayout {
            offset: self.count("STARTBYTE", Some(1.0))? as u64 - 1,
            width: self.count("SAMPLES", None)?,
            height: self.count("LINES", None)?,
            num_bands: self.count("BANDS", Some(1.0))?,
            interleave: Interleave::Band,
            prefix_bytes: 0,
            suffix_bytes: 0,
            sample_type,
            order,
        };
        Ok(RawPicture {
            data_path: self.data_path()?,
            layout,
            scale: vec![self.number("MULTIPLIER", 1.0)?],
            offset: vec![self.number("BASE", 0.0)?],
            turn: Turn::default(),
            nodata: nodata.to_vec(),
            white: None,
            notes: Vec::new(),
        })
    }

    fn tile(&self) -> Result<Option<Tile>, Error> {
        match self.text("FORMAT").as_str() {
            "tile" => {
                let tile =
                    Tile { width: self.count("TILESAMPLES", None)?, height: self.count("TILELINES", None)? };
                if tile.width.max(tile.height) > MAX_TILE_SIDE {
                    let found = format!("{}×{}", tile.width, tile.height);
                    return Err(self.unsupported("tile", found, "sides up to 65536"));
                }
                Ok(Some(tile))
            }
            "bandsequential" => Ok(None),
            other => Err(self.unsupported("layout", other.to_owned(), "Tile, BandSequential")),
        }
    }
}

/// Longer sides than any cube's tiles have.
const MAX_TILE_SIDE: usize = 1 << 16;

/// Rows of a tile read at once.
const ROWS_AT_ONCE: usize = 64;

/// The sample type of a name, and its special pixels (null, and saturations low and high).
fn sample_type(name: &str) -> Option<(SampleType, &'static [f64])> {
    Some(match name {
        "unsignedbyte" => (SampleType::U8, &[0.0, 255.0]),
        "signedword" => (SampleType::I16, &[-32_768.0, -32_767.0, -32_766.0, -32_765.0, -32_764.0]),
        "unsignedword" => (SampleType::U16, &[0.0, 1.0, 2.0, 65_534.0, 65_535.0]),
        // The special pixels of floats lie at the ends of their range, which are absent in any file.
        "real" => (SampleType::F32, &[]),
        "double" => (SampleType::F64, &[]),
        _ => return None,
    })
}

/// Size of a cube's tiles: rows of tiles from the top, each tile whole, rows first.
struct Tile {
    width: usize,
    height: usize,
}

impl Tile {
    /// The first band. Its tiles lie one below the other in the file: an image of the width of one tile.
    fn read(&self, picture: &RawPicture, law: &HeightLaw) -> Result<Raster<f32>, Error> {
        let (width, height) = (picture.layout.width, picture.layout.height);
        let (across, down) = (width.div_ceil(self.width), height.div_ceil(self.height));
        let column = RawLayout {
            width: self.width,
            height: (across * down).saturating_mul(self.height),
            num_bands: 1,
            ..picture.layout.clone()
        };
        let mut rows = RawRows::open(&picture.data_path, &column, 0)?;
        let mut grey = Raster::filled(width, height, f32::NAN);
        let mut block = Vec::new();
        for tile_idx in 0..across * down {
            let (left, top) = (tile_idx % across * self.width, tile_idx / across * self.height);
            let (columns, inside) = (self.width.min(width - left), self.height.min(height - top));
            for first in (0..inside).step_by(ROWS_AT_ONCE) {
                let num_rows = ROWS_AT_ONCE.min(inside - first);
                block.resize(num_rows * self.width, f32::NAN);
                rows.read(tile_idx * self.height + first, law, &mut block)?;
                for (y, row) in block.chunks_exact(self.width).enumerate() {
                    grey.row_mut(top + first + y)[left..left + columns].copy_from_slice(&row[..columns]);
                }
            }
        }
        Ok(grey)
    }
}
