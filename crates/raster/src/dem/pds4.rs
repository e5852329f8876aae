//! PDS4: an XML label and a raw image beside it.
//!
//! # Source
//! PDS4 information model 1.2 (`Array_2D_Image`, `Special_Constants`) and its cartography dictionary
//! (`upperleft_corner_x/y` are the outer corner of the first pixel).

use super::info::{DemFormat, DemInfo, HeightUnit, OpenOptions, PixelIs, turned_to_raster};
use super::opened::{Opened, RowSource};
use super::raw::{Interleave, RawLayout, RawPicture, RawRows, Turn};
use crate::beside::find_beside;
use crate::illumination::{self, Keywords};
use crate::sample::{ByteOrder, HeightLaw, SampleType};
use crate::{Affine, Error};
use roxmltree::{Document, Node};
use selenograph_files::regular;
use selenograph_geometry::proj_string::{self, Crs};
use std::path::{Path, PathBuf};

/// Labels are tens of kilobytes.
const MAX_LABEL_BYTES: u64 = 16 << 20;

/// A label's elements by their local names: the namespaces' prefixes and versions differ from archive to archive.
struct Label<'a> {
    path: &'a Path,
    root: Node<'a, 'a>,
}

/// The first element of that local name inside `node`.
fn find<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.descendants().find(|n| n.is_element() && n.tag_name().name() == name)
}

fn text<'a>(node: Node<'a, 'a>, name: &str) -> Option<&'a str> {
    find(node, name).and_then(|n| n.text()).map(str::trim)
}

fn number(node: Node, name: &str) -> Option<f64> {
    text(node, name)?.parse::<f64>().ok().filter(|v| v.is_finite())
}

/// A length in metres by the element's `unit` attribute (`m`, `km`, `m/pixel` …); metres without one.
fn length_m(node: Node, name: &str) -> Option<f64> {
    let unit = find(node, name)?.attribute("unit").unwrap_or("m");
    let unit = HeightUnit::parse(unit.split('/').next()?)?;
    Some(number(node, name)? * unit.metres())
}

/// An angle by the element's `unit` attribute: `deg`, `deg/pixel` …
fn degrees(node: Node, name: &str) -> Option<f64> {
    let unit = find(node, name)?.attribute("unit")?.to_ascii_lowercase();
    unit.starts_with("deg").then(|| number(node, name))?
}

impl<'a> Label<'a> {
    fn malformed(&self, what: &str, expected: &str, found: impl ToString) -> Error {
        Error::Malformed {
            path: self.path.to_owned(),
            what: what.to_owned(),
            expected: expected.to_owned(),
            found: found.to_string(),
        }
    }

    fn no_georeference(&self, what: &str) -> Error {
        Error::NoGeoreference { path: self.path.to_owned(), what: format!("its label has no usable {what}") }
    }

    fn array(&self) -> Result<Node<'a, 'a>, Error> {
        let is_array = |n: &Node| {
            matches!(
                n.tag_name().name(),
                "Array_2D_Image" | "Array_2D_Map" | "Array_2D" | "Array_3D_Image" | "Array_3D"
            )
        };
        let array = self.root.descendants().find(is_array);
        array.ok_or_else(|| self.malformed("PDS4 label", "an Array_2D_Image", "none"))
    }

    /// Size and layout as stored, and how it is shown.
    fn layout(&self, array: Node) -> Result<(RawLayout, Turn), Error> {
        let mut layout = RawLayout {
            offset: number(array, "offset").filter(|v| (0.0..9e15).contains(v)).unwrap_or(0.0) as u64,
            width: 0,
            height: 0,
            num_bands: 1,
            interleave: Interleave::Band,
            prefix_bytes: 0,
            suffix_bytes: 0,
            sample_type: SampleType::U8,
            order: ByteOrder::Little,
        };
        let mut band_position = 1.0;
        let (mut line_position, mut sample_position) = (1.0, 2.0);
        for axis in array.children().filter(|n| n.tag_name().name() == "Axis_Array") {
            let count = number(axis, "elements").filter(|v| (1.0..4.3e9).contains(v) && v.fract() == 0.0);
            let count =
                count.ok_or_else(|| self.malformed("Axis_Array", "a whole number of elements", "none"))?;
            let position = number(axis, "sequence_number").unwrap_or(0.0);
            match text(axis, "axis_name").unwrap_or("").to_ascii_lowercase().as_str() {
                "line" | "latitude" | "y" => (layout.height, line_position) = (count as usize, position),
                "sample" | "longitude" | "x" => (layout.width, sample_position) = (count as usize, position),
                _ => (layout.num_bands, band_position) = (count as usize, position),
            }
        }
        if layout.width == 0 || layout.height == 0 {
            return Err(self.malformed("Axis_Array", "axes Line and Sample", "others"));
        }
        layout.interleave = match band_position {
            p if p >= 3.0 => Interleave::Sample,
            p if p >= 2.0 => Interleave::Line,
            _ => Interleave::Band,
        };
        let name = text(array, "data_type").unwrap_or("");
        let (sample_type, order) = sample_type(name).ok_or_else(|| Error::Unsupported {
            path: self.path.to_owned(),
            what: "sample type",
            found: name.to_owned(),
            supported: "8, 16, 32 bit integers, IEEE754 single and double",
        })?;
        (layout.sample_type, layout.order) = (sample_type, order);
        // Of the two, the axis with the higher number runs faster: stored lines may be columns.
        let first_fastest =
            text(array, "axis_index_order").is_some_and(|t| t.to_ascii_lowercase().starts_with("first"));
        let columns_first = (sample_position < line_position) != first_fastest;
        if columns_first {
            (layout.width, layout.height) = (layout.height, layout.width);
        }
        if first_fastest && layout.num_bands > 1 {
            return Err(self.unsupported(
                "axis_index_order",
                "First Index Fastest, with bands",
                "Last Index Fastest",
            ));
        }
        let turn = self.turn(array, columns_first)?;
        Ok((layout, turn))
    }

    fn unsupported(&self, what: &'static str, found: impl ToString, supported: &'static str) -> Error {
        Error::Unsupported { path: self.path.to_owned(), what, found: found.to_string(), supported }
    }

    /// The display settings; lines downwards and samples to the right where there are none.
    fn turn(&self, array: Node, columns_first: bool) -> Result<Turn, Error> {
        let mut lines = "Top to Bottom".to_owned();
        let mut samples = "Left to Right".to_owned();
        // Settings name the array that they are of; where they name none, they are of all.
        let own = array.children().find(|n| n.tag_name().name() == "local_identifier").and_then(|n| n.text());
        let is_own = |settings: &Node| {
            let name = text(*settings, "local_identifier_reference");
            name.is_none() || own.map(str::trim).is_none() || name == own.map(str::trim)
        };
        let settings =
            self.root.descendants().filter(|n| n.tag_name().name() == "Display_Settings").find(is_own);
        if let Some(display) = settings.and_then(|settings| find(settings, "Display_Direction")) {
            for side in ["horizontal", "vertical"] {
                let axis = text(display, &format!("{side}_display_axis")).unwrap_or("").to_ascii_lowercase();
                let Some(heading) = text(display, &format!("{side}_display_direction")) else { continue };
                match axis.as_str() {
                    "line" | "latitude" | "y" => lines = heading.to_owned(),
                    "sample" | "longitude" | "x" => samples = heading.to_owned(),
                    _ => {
                        return Err(self.unsupported("display axis", axis, "Line and Sample"));
                    }
                }
            }
        }
        // What is stored as a line may be a column.
        let stored = if columns_first { (&samples, &lines) } else { (&lines, &samples) };
        Turn::from_words(stored.0, stored.1).ok_or_else(|| {
            self.unsupported(
                "display direction",
                format!("lines {lines}, samples {samples}"),
                "one up or down, the other left or right",
            )
        })
    }

    fn crs(&self) -> Result<Crs, Error> {
        let radius_m = length_m(self.root, "a_axis_radius")
            .or_else(|| length_m(self.root, "semi_major_radius"))
            .ok_or_else(|| self.no_georeference("a_axis_radius"))?;
        let polar_radius_m = length_m(self.root, "c_axis_radius").unwrap_or(radius_m);
        if text(self.root, "longitude_direction").is_some_and(|t| t.to_ascii_lowercase().contains("west")) {
            return Err(Error::Unsupported {
                path: self.path.to_owned(),
                what: "longitude direction",
                found: "Positive West".to_owned(),
                supported: "Positive East",
            });
        }
        let name = text(self.root, "map_projection_name")
            .ok_or_else(|| self.no_georeference("map_projection_name"))?;
        let lat = number(self.root, "latitude_of_projection_origin");
        let lon = number(self.root, "longitude_of_central_meridian")
            .or_else(|| number(self.root, "straight_vertical_longitude_from_pole"))
            .or_else(|| number(self.root, "longitude_of_projection_center"))
            .unwrap_or(0.0);
        let projection = match name.to_ascii_lowercase().replace([' ', '_'], "").as_str() {
            "polarstereographic" => {
                let lat = lat.ok_or_else(|| self.no_georeference("latitude_of_projection_origin"))?;
                let scale = number(self.root, "scale_factor_at_projection_origin").unwrap_or(1.0);
                match lat.abs() {
                    // A latitude that is not the pole is that of true scale, as GDAL writes and reads it.
                    of_true_scale if of_true_scale > 0.0 && of_true_scale < 90.0 => {
                        if (scale - 1.0).abs() > 1e-9 {
                            let found = format!("{scale}, with a latitude of true scale");
                            return Err(self.unsupported("scale_factor_at_projection_origin", found, "1"));
                        }
                        format!("+proj=stere +lat_0={} +lat_ts={lat}", 90f64.copysign(lat))
                    }
                    _ => format!("+proj=stere +lat_0={lat} +k={scale}"),
                }
            }
            "equirectangular" | "simplecylindrical" | "equidistantcylindrical" => format!(
                "+proj=eqc +lat_ts={} +lat_0={}",
                number(self.root, "standard_parallel_1").unwrap_or(0.0),
                lat.unwrap_or(0.0)
            ),
            "orthographic" => {
                let lat = lat.or_else(|| number(self.root, "latitude_of_projection_center"));
                format!("+proj=ortho +lat_0={}", lat.unwrap_or(0.0))
            }
            _ => return Err(Error::UnknownProjection { path: self.path.to_owned(), name: name.to_owned() }),
        };
        proj_string::parse(&format!("{projection} +lon_0={lon} +a={radius_m} +b={polar_radius_m}"))
            .map_err(|source| Error::CoordinateSystem { path: self.path.to_owned(), source })
    }

    fn map_from_pixel(&self, radius_m: Option<f64>, notes: &mut Vec<String>) -> Result<Affine, Error> {
        let need = |name: &str| length_m(self.root, name).ok_or_else(|| self.no_georeference(name));
        let (x, y) = (need("upperleft_corner_x")?, need("upperleft_corner_y")?);
        // The dictionary has metres in `pixel_resolution` and pixels per degree in `pixel_scale`; LROC's labels have
        // degrees in the one and metres in the other.
        let mut step = |axis: &str| {
            let (resolution, scale) = (format!("pixel_resolution_{axis}"), format!("pixel_scale_{axis}"));
            if let Some(step_m) = length_m(self.root, &resolution) {
                return Ok(step_m);
            }
            if let Some(step_m) = length_m(self.root, &scale) {
                notes.push(format!("{scale} is the size of a cell: {resolution} is no length"));
                return Ok(step_m);
            }
            let step_m =
                degrees(self.root, &resolution).zip(radius_m).map(|(deg, radius)| deg.to_radians() * radius);
            notes.push(format!("{resolution} in degrees is taken along the sphere"));
            step_m.ok_or_else(|| self.no_georeference(&resolution))
        };
        let (step_x, step_y) = (step("x")?, step("y")?);
        let affine = Affine::north_up(x, y, step_x, step_y.abs());
        affine.inverse().map_err(|e| self.no_georeference(&format!("pixel_resolution ({e})")))?;
        Ok(affine)
    }

    fn height_unit(&self, array: Node, offset: f64, radius_m: f64) -> Result<HeightUnit, Error> {
        match find(array, "Element_Array").and_then(|n| text(n, "unit")) {
            None | Some("") => {
                let in_km = (offset * 1000.0 / radius_m - 1.0).abs() < 0.05;
                Ok(if in_km { HeightUnit::Kilometre } else { HeightUnit::Metre })
            }
            Some(unit) => HeightUnit::parse(unit).ok_or_else(|| Error::Unsupported {
                path: self.path.to_owned(),
                what: "height unit",
                found: unit.to_owned(),
                supported: "metres and kilometres",
            }),
        }
    }
}

fn sample_type(name: &str) -> Option<(SampleType, ByteOrder)> {
    let order = if name.contains("MSB") { ByteOrder::Big } else { ByteOrder::Little };
    let sample_type = match name {
        "UnsignedByte" => SampleType::U8,
        "SignedByte" => SampleType::I8,
        "UnsignedLSB2" | "UnsignedMSB2" => SampleType::U16,
        "SignedLSB2" | "SignedMSB2" => SampleType::I16,
        "UnsignedLSB4" | "UnsignedMSB4" => SampleType::U32,
        "SignedLSB4" | "SignedMSB4" => SampleType::I32,
        "IEEE754LSBSingle" | "IEEE754MSBSingle" => SampleType::F32,
        "IEEE754LSBDouble" | "IEEE754MSBDouble" => SampleType::F64,
        _ => return None,
    };
    Some((sample_type, order))
}

/// Every special constant means "no height here"; limits of the valid range are none.
fn nodata(array: Node, sample_type: SampleType) -> Vec<f64> {
    let Some(constants) = find(array, "Special_Constants") else { return Vec::new() };
    let mut values = Vec::new();
    for node in constants.children().filter(|n| n.tag_name().name().ends_with("_constant")) {
        let text = node.text().unwrap_or("").trim();
        let bits =
            text.strip_prefix("0x").or_else(|| text.strip_prefix("16#")).map(|t| t.trim_end_matches('#'));
        let value = match (bits.map(|digits| u64::from_str_radix(digits, 16)), sample_type) {
            (Some(Ok(bits)), SampleType::F32) => Some(f64::from(f32::from_bits(bits as u32))),
            (Some(Ok(bits)), SampleType::F64) => Some(f64::from_bits(bits)),
            (Some(Ok(bits)), SampleType::I16) => Some(f64::from(bits as u16 as i16)),
            (Some(Ok(bits)), _) => Some(bits as f64),
            _ => text.parse().ok(),
        };
        values.extend(value.filter(|v| !values.contains(v)));
    }
    values
}

fn read_xml(path: &Path) -> Result<String, Error> {
    let xml = regular::read(path, MAX_LABEL_BYTES).map_err(Error::io("read", path))?;
    Ok(String::from_utf8_lossy(&xml).into_owned())
}

fn parse<'a>(path: &Path, xml: &'a str) -> Result<Document<'a>, Error> {
    Document::parse(xml).map_err(|e| Error::Malformed {
        path: path.to_owned(),
        what: "PDS4 label".to_owned(),
        expected: "well-formed XML".to_owned(),
        found: e.to_string(),
    })
}

/// The file that holds the array.
fn data_path(label: &Label, array: Node) -> Result<PathBuf, Error> {
    let file_area = array.parent().unwrap_or(label.root);
    let name =
        text(file_area, "file_name").ok_or_else(|| label.malformed("PDS4 label", "a file_name", "none"))?;
    find_beside(label.path, name)
        .ok_or_else(|| Error::MissingFile { path: label.path.to_owned(), target: name.to_owned() })
}

/// What the label says of the Sun.
pub(crate) fn keywords(path: &Path) -> Result<Keywords, Error> {
    let xml = read_xml(path)?;
    let document = parse(path, &xml)?;
    let stated = |name: &str| {
        // A name inside another element: `Target_Identification/name`.
        let mut parts = name.split('/');
        let node = parts.try_fold(document.root_element(), find)?;
        Some((node.text()?.trim().to_owned(), node.attribute("unit").map(str::to_owned)))
    };
    Ok(Keywords(illumination::names().filter_map(|name| Some((name, stated(name)?))).collect()))
}

/// The label's array as a picture: no map is needed.
pub(crate) fn picture(path: &Path) -> Result<RawPicture, Error> {
    let xml = read_xml(path)?;
    let document = parse(path, &xml)?;
    let label = Label { path, root: document.root() };
    let array = label.array()?;
    let (layout, turn) = label.layout(array)?;
    Ok(RawPicture {
        data_path: data_path(&label, array)?,
        scale: vec![number(array, "scaling_factor").filter(|v| *v != 0.0).unwrap_or(1.0)],
        offset: vec![number(array, "value_offset").unwrap_or(0.0)],
        turn,
        nodata: nodata(array, layout.sample_type),
        white: None,
        layout,
        notes: Vec::new(),
    })
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Opened, Error> {
    let xml = read_xml(path)?;
    let document = parse(path, &xml)?;
    let label = Label { path, root: document.root() };
    let array = label.array()?;
    let (layout, turn) = label.layout(array)?;
    let band_idx = options.band_idx(path, layout.num_bands)?;
    if turn.transposed {
        let found = turn.note().unwrap_or_default();
        return Err(label.unsupported(
            "axis order of a map",
            found,
            "lines across the map, one below the other",
        ));
    }

    let data_path = data_path(&label, array)?;
    let rows = RawRows::open(&data_path, &layout, band_idx)?.turned(turn);

    let mut notes: Vec<String> = turn.note().into_iter().collect();
    let crs = options.given_crs(path)?.map_or_else(|| label.crs(), Ok)?;
    let map_from_pixel = label.map_from_pixel(crs.projection.radius_m(), &mut notes)?;
    let crs = turned_to_raster(crs, &map_from_pixel, layout.width, layout.height);
    let scale = number(array, "scaling_factor").filter(|v| *v != 0.0).unwrap_or(1.0);
    let offset = number(array, "value_offset").unwrap_or(0.0);
    let unit = match options.height_unit {
        Some(unit) => unit,
        None => label.height_unit(array, offset, crs.body.radius_m)?,
    };
    let nodata = options.nodata_or(nodata(array, layout.sample_type));
    let law = HeightLaw::new(scale, offset, unit.metres(), crs.body.radius_m, &nodata);
    let info = DemInfo {
        path: path.to_owned(),
        data_path,
        format: DemFormat::Pds4,
        storage: format!("raw image at byte {}", layout.offset),
        sample_type: layout.sample_type,
        byte_order: layout.order,
        width: layout.width,
        height: layout.height,
        num_bands: layout.num_bands,
        band: band_idx + 1,
        band_name: text(array, "name").map(str::to_owned),
        nodata,
        scale,
        offset,
        unit_m: unit.metres(),
        crs,
        crs_name: text(label.root, "coordinate_system_name").map(str::to_owned),
        map_from_pixel,
        pixel_is: PixelIs::Area,
        num_overviews: 0,
        notes,
    };
    Ok(Opened { info, law, rows: RowSource::Raw(rows) })
}
