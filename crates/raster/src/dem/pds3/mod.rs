//! PDS3: a text label, attached to its image or beside it.

pub(crate) mod label;
mod map;

use super::info::{DemFormat, DemInfo, HeightUnit, OpenOptions, PixelIs, turned_to_raster};
use super::opened::{Opened, RowSource};
use super::raw::{Interleave, RawLayout, RawPicture, RawRows, Turn, of_band};
use crate::Error;
use crate::beside::find_beside;
use crate::illumination::{self, Keywords};
use crate::sample::{ByteOrder, HeightLaw, SampleType};
use label::{Block, Value};
use selenograph_files::regular;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Labels are a few kilobytes; this is where an attached one is given up.
const MAX_LABEL_BYTES: u64 = 1 << 20;

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Opened, Error> {
    let label = read_label(path)?;
    let image = uncompressed_image(path, &label)?;
    let (data_path, offset) = image_place(path, &label)?;
    let layout = raw_layout(path, image, offset)?;
    let band_idx = options.band_idx(path, layout.num_bands)?;
    let turn = turn(path, &label, image)?;
    if !turn.is_none() {
        return Err(Error::Unsupported {
            path: path.to_owned(),
            what: "display direction of a map",
            found: turn.note().unwrap_or_default(),
            supported: "lines downwards, samples to the right: what its offsets count from is not said otherwise",
        });
    }
    let rows = RawRows::open(&data_path, &layout, band_idx)?;

    let map = label.find_block("IMAGE_MAP_PROJECTION").ok_or_else(|| Error::NoGeoreference {
        path: path.to_owned(),
        what: "its label has no IMAGE_MAP_PROJECTION".to_owned(),
    })?;
    let given = options.given_crs(path)?;
    let map = map::read(map, path, layout.width, layout.height, given)?;
    let crs = turned_to_raster(map.crs, &map.map_from_pixel, layout.width, layout.height);

    let (scales, offsets) = factors(path, image, layout.num_bands)?;
    let (scale, file_offset) = (of_band(&scales, band_idx, 1.0), of_band(&offsets, band_idx, 0.0));
    let unit = match options.height_unit {
        Some(unit) => unit,
        None => height_unit(path, image, file_offset, crs.body.radius_m)?,
    };
    let nodata = options.nodata_or(nodata(image, layout.sample_type));
    let law = HeightLaw::new(scale, file_offset, unit.metres(), crs.body.radius_m, &nodata);
    let info = DemInfo {
        path: path.to_owned(),
        data_path,
        format: DemFormat::Pds3,
        storage: format!("raw image at byte {offset}"),
        sample_type: layout.sample_type,
        byte_order: layout.order,
        width: layout.width,
        height: layout.height,
        num_bands: layout.num_bands,
        band: band_idx + 1,
        band_name: image.get("NAME").map(|v| v.text().to_owned()),
        nodata,
        scale,
        offset: file_offset,
        unit_m: unit.metres(),
        crs,
        crs_name: label.find("COORDINATE_SYSTEM_NAME").map(|v| v.text().to_owned()),
        map_from_pixel: map.map_from_pixel,
        pixel_is: PixelIs::Area,
        num_overviews: 0,
        notes: map.notes,
    };
    Ok(Opened { info, law, rows: RowSource::Raw(rows) })
}

/// The label's image as a picture: no map is needed, and 8-bit samples are never signed.
pub(crate) fn picture(path: &Path) -> Result<RawPicture, Error> {
    let label = read_label(path)?;
    let image = uncompressed_image(path, &label)?;
    let (data_path, offset) = image_place(path, &label)?;
    let mut layout = raw_layout(path, image, offset)?;
    let mut notes = Vec::new();
    if layout.sample_type == SampleType::I8 {
        // `LSB_INTEGER` of 8 bits is what raw cameras' labels write for counts of 0 to 255.
        layout.sample_type = SampleType::U8;
        notes.push("8-bit samples are read as unsigned, whatever the label says".to_owned());
    }
    let companded = label.find("LRO:COMPAND_CODE").or_else(|| label.find("LRO:XTERM"));
    if companded.is_some() && layout.sample_type == SampleType::U8 {
        notes.push("raw counts, companded to 8 bits: grey levels are not linear in radiance".to_owned());
    }
    let mask = image.get("SAMPLE_BIT_MASK").and_then(Value::bits).filter(|mask| *mask > 0);
    let (scale, offset) = factors(path, image, layout.num_bands)?;
    Ok(RawPicture {
        data_path,
        scale,
        offset,
        turn: turn(path, &label, image)?,
        nodata: nodata(image, layout.sample_type),
        white: mask.filter(|_| !layout.sample_type.is_float()).map(|mask| mask as f64),
        layout,
        notes,
    })
}

/// What the label says of the Sun.
pub(crate) fn keywords(path: &Path) -> Result<Keywords, Error> {
    let label = read_label(path)?;
    let stated = |value: &Value| (value.text().to_owned(), value.unit().map(str::to_owned));
    Ok(Keywords(illumination::names().filter_map(|name| Some((name, stated(label.find(name)?)))).collect()))
}

/// The label's IMAGE object, unless the image is encoded.
fn uncompressed_image<'a>(path: &Path, label: &'a Block) -> Result<&'a Block, Error> {
    let Some(image) = label.find_block("IMAGE") else {
        let pointers = label.entries.iter().filter_map(|(key, _)| key.strip_prefix('^'));
        let objects: Vec<&str> =
            pointers.chain(label.blocks.iter().map(|block| block.name.as_str())).collect();
        return Err(match objects.first() {
            None => malformed(path, "label", "an IMAGE object", "none"),
            Some(object) => Error::Unsupported {
                path: path.to_owned(),
                what: "object",
                found: (*object).to_owned(),
                supported: "IMAGE; gdal_translate turns cubes into GeoTIFF",
            },
        });
    };
    if let Some(encoding) = image.get("ENCODING_TYPE").or_else(|| label.find("ENCODING_TYPE"))
        && !matches!(encoding.text().to_ascii_uppercase().as_str(), "N/A" | "NONE")
    {
        let found = encoding.text().to_owned();
        return Err(Error::Unsupported { path: path.to_owned(), what: "encoding", found, supported: "none" });
    }
    Ok(image)
}

fn malformed(path: &Path, what: &str, expected: &str, found: impl ToString) -> Error {
    Error::Malformed {
        path: path.to_owned(),
        what: what.to_owned(),
        expected: expected.to_owned(),
        found: found.to_string(),
    }
}

fn read_label(path: &Path) -> Result<Block, Error> {
    let mut bytes = Vec::new();
    let (file, _) = regular::open(path).map_err(Error::io("open", path))?;
    file.take(MAX_LABEL_BYTES).read_to_end(&mut bytes).map_err(Error::io("read", path))?;
    // Latin-1: every byte is a character, so an attached image does no harm.
    let text: String = bytes.iter().map(|&b| char::from(b)).collect();
    // A label may follow a SFDU line (`CCSD3ZF0…`), which is no keyword.
    let start = text.find("PDS_VERSION_ID").unwrap_or(0);
    label::parse(&text[start..]).map_err(|(expected, found)| malformed(path, "PDS3 label", &expected, found))
}

/// The image's file and the offset of its first byte: `^IMAGE = "A.IMG" | ("A.IMG", 3) | 3 | 3 <BYTES> …`
fn image_place(path: &Path, label: &Block) -> Result<(PathBuf, u64), Error> {
    let pointer = label.find("^IMAGE").ok_or_else(|| malformed(path, "label", "a pointer ^IMAGE", "none"))?;
    let (name, position) = match pointer {
        Value::Scalar { .. } if pointer.number().is_some() => (None, Some(pointer)),
        Value::Scalar { text, .. } => (Some(text.as_str()), None),
        Value::List(items) => match items.as_slice() {
            [first] if first.number().is_some() => (None, Some(first)),
            [name, rest @ ..] => (Some(name.text()), rest.first()),
            [] => (None, None),
        },
    };
    let data_path = match name {
        Some(name) => find_beside(path, name)
            .ok_or_else(|| Error::MissingFile { path: path.to_owned(), target: name.to_owned() })?,
        None => path.to_owned(),
    };
    let Some(position) = position else { return Ok((data_path, 0)) };
    let number = position.number().filter(|v| (1.0..9e15).contains(v));
    let number =
        number.ok_or_else(|| malformed(path, "^IMAGE", "a position from 1", position.text()))? as u64 - 1;
    if position.unit().is_some_and(|unit| unit.to_ascii_uppercase().starts_with("BYTE")) {
        return Ok((data_path, number));
    }
    let record = label.find("RECORD_BYTES").and_then(Value::number).filter(|v| (1.0..1e12).contains(v));
    let record = record.ok_or_else(|| malformed(path, "label", "RECORD_BYTES for ^IMAGE", "none"))? as u64;
    let offset = number.checked_mul(record);
    Ok((data_path, offset.ok_or_else(|| malformed(path, "^IMAGE", "a position in a file", position.text()))?))
}

fn raw_layout(path: &Path, image: &Block, offset: u64) -> Result<RawLayout, Error> {
    let count = |key: &str, default: Option<f64>| -> Result<usize, Error> {
        let value = image.get(key).and_then(Value::number).or(default);
        match value {
            Some(v) if (1.0..4.3e9).contains(&v) && v.fract() == 0.0 => Ok(v as usize),
            Some(v) => Err(malformed(path, key, "a whole number from 1", v)),
            None => Err(malformed(path, "label", key, "none")),
        }
    };
    let margin = |key: &str| {
        let bytes = image.get(key).and_then(Value::number).unwrap_or(0.0);
        if (0.0..1e9).contains(&bytes) {
            Ok(bytes as u64)
        } else {
            Err(malformed(path, key, "a byte count", bytes))
        }
    };
    let interleave =
        match image.get("BAND_STORAGE_TYPE").map(|v| v.text().to_ascii_uppercase().replace(' ', "_")) {
            Some(text) if text.starts_with("LINE") => Interleave::Line,
            Some(text) if text.starts_with("SAMPLE") => Interleave::Sample,
            _ => Interleave::Band,
        };
    let (sample_type, order) = sample_type(path, image)?;
    Ok(RawLayout {
        offset,
        width: count("LINE_SAMPLES", None)?,
        height: count("LINES", None)?,
        num_bands: count("BANDS", Some(1.0))?,
        interleave,
        prefix_bytes: margin("LINE_PREFIX_BYTES")?,
        suffix_bytes: margin("LINE_SUFFIX_BYTES")?,
        sample_type,
        order,
    })
}

/// `SAMPLE_TYPE` and `SAMPLE_BITS` (Standards Reference 3.8, appendix C).
fn sample_type(path: &Path, image: &Block) -> Result<(SampleType, ByteOrder), Error> {
    let name = image.get("SAMPLE_TYPE").map_or("", Value::text).to_ascii_uppercase().replace(' ', "_");
    let bits = image.get("SAMPLE_BITS").and_then(Value::number).unwrap_or(0.0);
    let order = if ["LSB", "PC", "VAX"].iter().any(|word| name.starts_with(word)) {
        ByteOrder::Little
    } else {
        ByteOrder::Big
    };
    let float = name.ends_with("REAL") || name.ends_with("FLOAT");
    let sample_type = match (bits as u32, float, name.contains("UNSIGNED")) {
        (32, true, _) if !name.starts_with("VAX") => Some(SampleType::F32),
        (64, true, _) if !name.starts_with("VAX") => Some(SampleType::F64),
        (8, false, true) => Some(SampleType::U8),
        (8, false, false) => Some(SampleType::I8),
        (16, false, true) => Some(SampleType::U16),
        (16, false, false) => Some(SampleType::I16),
        (32, false, true) => Some(SampleType::U32),
        (32, false, false) => Some(SampleType::I32),
        _ => None,
    };
    sample_type.filter(|_| float || name.ends_with("INTEGER")).map(|t| (t, order)).ok_or_else(|| {
        Error::Unsupported {
            path: path.to_owned(),
            what: "sample type",
            found: format!("{name} of {bits} bits"),
            supported: "MSB/LSB (UNSIGNED_)INTEGER of 8, 16, 32 bits, PC_REAL and IEEE_REAL of 32, 64",
        }
    })
}

/// The unit of heights; where the label has none, an offset that is the radius in kilometres tells.
fn height_unit(path: &Path, image: &Block, offset: f64, radius_m: f64) -> Result<HeightUnit, Error> {
    let text = image.get("UNIT").map_or("", Value::text);
    if text.is_empty() || matches!(text.to_ascii_uppercase().as_str(), "N/A" | "NONE" | "NULL" | "UNK") {
        let in_km = (offset * 1000.0 / radius_m - 1.0).abs() < 0.05;
        return Ok(if in_km { HeightUnit::Kilometre } else { HeightUnit::Metre });
    }
    HeightUnit::parse(text).ok_or_else(|| Error::Unsupported {
        path: path.to_owned(),
        what: "height unit",
        found: text.to_owned(),
        supported: "metres and kilometres",
    })
}

/// `SCALING_FACTOR` and `OFFSET`: one number for all bands, or a list with one for each.
fn factors(path: &Path, image: &Block, num_bands: usize) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let list = |key: &str, default: f64| {
        let Some(value) = image.get(key) else { return Ok(vec![default]) };
        let items = value.items();
        if items.len() != 1 && items.len() != num_bands {
            return Err(malformed(path, key, &format!("1 or {num_bands} numbers"), items.len()));
        }
        Ok(items.into_iter().map(|item| item.number().unwrap_or(default)).collect())
    };
    let mut scales: Vec<f64> = list("SCALING_FACTOR", 1.0)?;
    scales.iter_mut().filter(|scale| **scale == 0.0).for_each(|scale| *scale = 1.0);
    Ok((scales, list("OFFSET", 0.0)?))
}

/// `LINE_DISPLAY_DIRECTION` and `SAMPLE_DISPLAY_DIRECTION`: down and to the right where the label does not say.
fn turn(path: &Path, label: &Block, image: &Block) -> Result<Turn, Error> {
    let word = |key: &str, default: &str| {
        let text = image.get(key).or_else(|| label.find(key)).map_or("", Value::text).to_ascii_uppercase();
        if matches!(text.as_str(), "" | "N/A" | "UNK" | "NULL" | "NONE") { default.to_owned() } else { text }
    };
    let lines = word("LINE_DISPLAY_DIRECTION", "DOWN");
    let samples = word("SAMPLE_DISPLAY_DIRECTION", "RIGHT");
    Turn::from_words(&lines, &samples).ok_or_else(|| Error::Unsupported {
        path: path.to_owned(),
        what: "display direction",
        found: format!("lines {lines}, samples {samples}"),
        supported: "one of them UP or DOWN, the other LEFT or RIGHT",
    })
}

/// The stored numbers that mean "absent"; hexadecimal ones are the bits of a float where samples are floats.
fn nodata(image: &Block, sample_type: SampleType) -> Vec<f64> {
    const KEYS: [&str; 22] = [
        "MISSING_CONSTANT",
        "MISSING",
        "MISSING_VALUE",
        "INVALID_CONSTANT",
        "INVALID_VALUE",
        "INVALID",
        "NULL",
        "NULL_CONSTANT",
        "UNKNOWN_CONSTANT",
        "CORE_NULL",
        "DUMMY_DATA",
        "DUMMY_VALUE",
        "OUT_OF_IMAGE_BOUNDS_VALUE",
        "CORE_LOW_REPR_SATURATION",
        "CORE_LOW_INSTR_SATURATION",
        "CORE_HIGH_REPR_SATURATION",
        "CORE_HIGH_INSTR_SATURATION",
        "LOW_REPR_SATURATION",
        "LOW_INSTR_SATURATION",
        "HIGH_REPR_SATURATION",
        "HIGH_INSTR_SATURATION",
        "NOT_APPLICABLE_CONSTANT",
    ];
    let number = |value: &Value| match (value.bits(), sample_type) {
        (Some(bits), SampleType::F32) => Some(f64::from(f32::from_bits(bits as u32))),
        (Some(bits), SampleType::F64) => Some(f64::from_bits(bits)),
        (Some(bits), SampleType::I8) => Some(f64::from(bits as u8 as i8)),
        (Some(bits), SampleType::I16) => Some(f64::from(bits as u16 as i16)),
        (Some(bits), SampleType::I32) => Some(f64::from(bits as u32 as i32)),
        _ => value.number(),
    };
    let mut values: Vec<f64> = Vec::new();
    for item in KEYS.iter().filter_map(|key| image.get(key)).flat_map(Value::items) {
        values.extend(number(item).filter(|v| !values.contains(v)));
    }
    values
}
