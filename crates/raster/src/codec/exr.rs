//! OpenEXR: one layer of named channels, 32-bit float or half, with text and number attributes.

use super::decoded::{bytes_of, cannot_encode, malformed};
use crate::{Error, bounds};
use ::exr::prelude as lib;
use ::exr::prelude::ReadChannels as _;
use ::exr::prelude::ReadLayers as _;
use ::exr::prelude::WritableImage as _;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

const FORMAT: &str = "OpenEXR";

/// How a channel's samples are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleType {
    /// 32-bit float.
    Float,
    /// 16-bit float: 11 significant bits, at most 65 504.
    Half,
    /// 32-bit unsigned integer (read only).
    Uint,
}

/// One named channel, in memory always 32-bit float.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// For example `depth_z`.
    pub name: String,
    /// How the file stores it.
    pub stored: SampleType,
    /// Row-major samples, `width * height`.
    pub samples: Vec<f32>,
}

impl Channel {
    /// A channel stored as 32-bit float.
    pub fn float(name: &str, samples: Vec<f32>) -> Self {
        Self { name: name.to_owned(), stored: SampleType::Float, samples }
    }
}

/// A header attribute.
#[derive(Debug, Clone, PartialEq)]
pub enum Attribute {
    /// Text (Latin-1 in the file).
    Text(String),
    /// A number, stored as 64-bit float.
    Number(f64),
}

/// A picture of named channels.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ExrImage {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// The channels, in alphabetical order after decoding.
    pub channels: Vec<Channel>,
    /// The attributes that the format does not define itself.
    pub attributes: BTreeMap<String, Attribute>,
}

impl ExrImage {
    /// The channel of a name.
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|channel| channel.name == name)
    }
}

/// Encodes with ZIP compression. The same image gives the same bytes.
///
/// # Errors
/// [`Error::Encode`] if a channel's length is not `width * height`, a name is used twice, there is no channel, or a
/// text cannot be written as Latin-1.
pub fn encode(image: &ExrImage) -> Result<Vec<u8>, Error> {
    let text = |text: &str| {
        lib::Text::new_or_none(text)
            .ok_or_else(|| cannot_encode(FORMAT, format!("`{text}` is not Latin-1 text")))
    };
    let mut list = Vec::with_capacity(image.channels.len());
    for channel in &image.channels {
        if channel.samples.len() != image.width * image.height || channel.samples.is_empty() {
            return Err(cannot_encode(
                FORMAT,
                format!(
                    "channel `{}` has {} samples for {}×{} pixels",
                    channel.name,
                    channel.samples.len(),
                    image.width,
                    image.height
                ),
            ));
        }
        let samples = match channel.stored {
            SampleType::Float => lib::FlatSamples::F32(channel.samples.clone()),
            SampleType::Half => {
                lib::FlatSamples::F16(channel.samples.iter().map(|&v| lib::f16::from_f32(v)).collect())
            }
            SampleType::Uint => return Err(cannot_encode(FORMAT, "integer channels are only read")),
        };
        list.push(lib::AnyChannel::new(text(&channel.name)?, samples));
    }
    let encoding = lib::Encoding { compression: lib::Compression::ZIP16, ..lib::Encoding::SMALL_LOSSLESS };
    let channels = lib::AnyChannels::sort(list.into());
    let mut layer =
        lib::Layer::new((image.width, image.height), lib::LayerAttributes::default(), encoding, channels);
    for (name, value) in &image.attributes {
        let value = match value {
            Attribute::Text(value) => lib::AttributeValue::Text(text(value)?),
            Attribute::Number(value) => lib::AttributeValue::F64(*value),
        };
        layer.attributes.other.insert(text(name)?, value);
    }
    let mut bytes = Cursor::new(Vec::new());
    lib::Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| cannot_encode(FORMAT, e))?;
    let mut bytes = bytes.into_inner();
    sort_attributes(&mut bytes);
    Ok(bytes)
}

/// Decodes the first layer of a file.
///
/// # Errors
/// [`Error::Malformed`] for anything that is not a whole, flat OpenEXR image, or claims more than its bytes can hold.
pub fn decode(bytes: &[u8], origin: &Path) -> Result<ExrImage, Error> {
    check_sizes(bytes, origin)?;
    let image = lib::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| malformed(FORMAT, origin, e))?;
    let layer = image.layer_data;
    let attributes = layer
        .attributes
        .other
        .iter()
        .chain(&image.attributes.other)
        .filter_map(|(name, value)| {
            let value = match value {
                lib::AttributeValue::Text(text) => Attribute::Text(text.to_string()),
                lib::AttributeValue::F64(value) => Attribute::Number(*value),
                lib::AttributeValue::F32(value) => Attribute::Number(f64::from(*value)),
                lib::AttributeValue::I32(value) => Attribute::Number(f64::from(*value)),
                _ => return None,
            };
            Some((name.to_string(), value))
        })
        .collect();
    let mut channels = Vec::new();
    for channel in layer.channel_data.list {
        let stored = match &channel.sample_data {
            lib::FlatSamples::F32(_) => SampleType::Float,
            lib::FlatSamples::F16(_) => SampleType::Half,
            lib::FlatSamples::U32(_) => SampleType::Uint,
        };
        let samples: Vec<f32> = channel.sample_data.values_as_f32().collect();
        if samples.len() != layer.size.area() {
            return Err(malformed(FORMAT, origin, format!("channel `{}` is subsampled", channel.name)));
        }
        channels.push(Channel { name: channel.name.to_string(), stored, samples });
    }
    Ok(ExrImage { width: layer.size.width(), height: layer.size.height(), channels, attributes })
}

/// Judges the sizes of the header before the library takes memory for them.
fn check_sizes(bytes: &[u8], origin: &Path) -> Result<(), Error> {
    let meta = ::exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false)
        .map_err(|e| malformed(FORMAT, origin, e))?;
    let length = bytes.len() as u64;
    for header in &meta.headers {
        let pixel = header.channels.bytes_per_pixel.max(header.channels.list.len() * size_of::<f32>()) as u64;
        let sides = [header.layer_size.width() as u64, header.layer_size.height() as u64];
        bounds::check(origin, "data window", bounds::product(&[sides[0], sides[1], pixel]), length)?;
        // Each chunk has an offset and a head of its own.
        if bounds::product(&[header.chunk_count as u64, 16]).is_none_or(|least| least > length) {
            let found = format!("{} chunks in {length} bytes", header.chunk_count);
            return Err(malformed(FORMAT, origin, found));
        }
        if let ::exr::meta::BlockDescription::Tiles(tiles) = &header.blocks {
            let tile = [tiles.tile_size.width() as u64, tiles.tile_size.height() as u64];
            bounds::check(origin, "tile", bounds::product(&[tile[0], tile[1], pixel]), length)?;
        }
    }
    Ok(())
}

/// Reads a file.
///
/// # Errors
/// [`Error::Io`], and those of [`decode`].
pub fn read(path: &Path) -> Result<ExrImage, Error> {
    decode(&bytes_of(path)?, path)
}

/// Puts the header's attributes in alphabetical order, as the reference library writes them: the encoder keeps its
/// own in a hash map, whose order changes from run to run. The header's length stays, so all offsets stay valid.
fn sort_attributes(file: &mut [u8]) {
    const MAGIC_AND_VERSION: usize = 8;
    let mut entries = Vec::new();
    let mut at = MAGIC_AND_VERSION;
    while file.get(at).is_some_and(|&first| first != 0) {
        let Some(end) = attribute_end(file, at) else { return };
        entries.push(file[at..end].to_vec());
        at = end;
    }
    entries.sort();
    file[MAGIC_AND_VERSION..at].copy_from_slice(&entries.concat());
}

/// Where the attribute that starts at a position ends: two zero-terminated texts, a length, the value.
fn attribute_end(file: &[u8], start: usize) -> Option<usize> {
    let after_text = |at: usize| Some(at + file.get(at..)?.iter().position(|&byte| byte == 0)? + 1);
    let length_at = after_text(after_text(start)?)?;
    let length = u32::from_le_bytes(file.get(length_at..length_at + 4)?.try_into().ok()?);
    let end = length_at + 4 + length as usize;
    (end <= file.len()).then_some(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> ExrImage {
        let ramp = |k: f32| (0..35).map(|i| 1.0 + k * i as f32).collect::<Vec<_>>();
        let mut depth_z = ramp(1234.567);
        depth_z[3] = f32::NAN;
        depth_z[4] = f32::INFINITY;
        ExrImage {
            width: 7,
            height: 5,
            channels: vec![Channel::float("normal.X", ramp(0.1)), Channel::float("depth_z", depth_z)],
            attributes: BTreeMap::from([
                ("unit".to_owned(), Attribute::Text("metre".to_owned())),
                ("kind".to_owned(), Attribute::Text("truth".to_owned())),
                ("fx".to_owned(), Attribute::Number(618.038_670_571_959_7)),
            ]),
        }
    }

    #[test]
    fn round_trip_is_exact_and_repeatable() {
        let image = sample();
        let bytes = encode(&image).unwrap();
        let back = decode(&bytes, Path::new("memory")).unwrap();
        assert_eq!((back.width, back.height), (7, 5));
        assert_eq!(back.attributes, image.attributes);
        assert_eq!(back.channels[0].name, "depth_z");
        for channel in &image.channels {
            let read = back.channel(&channel.name).unwrap();
            assert_eq!(read.stored, SampleType::Float);
            assert!(read.samples.iter().zip(&channel.samples).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
        for _ in 0..5 {
            assert_eq!(encode(&image).unwrap(), bytes);
        }
    }

    #[test]
    fn half_is_reported_as_half() {
        let mut image = sample();
        image.channels[1].stored = SampleType::Half;
        let back = decode(&encode(&image).unwrap(), Path::new("memory")).unwrap();
        let depth_z = back.channel("depth_z").unwrap();
        assert_eq!(depth_z.stored, SampleType::Half);
        assert_eq!(depth_z.samples[1], 1236.0);
    }

    /// The data window stands in the header as four whole numbers behind its name and type.
    #[test]
    fn a_window_larger_than_the_file_is_refused_before_memory_is_taken() {
        let bytes = encode(&sample()).unwrap();
        let name = b"dataWindow\0box2i\0\x10\0\0\0";
        let at = bytes.windows(name.len()).position(|part| part == name).unwrap() + name.len();
        for (right, lower) in [((1 << 28) - 1, 4), (6, (1 << 28) - 1), (i32::MAX / 2 - 1, i32::MAX / 2 - 1)] {
            let mut forged = bytes.clone();
            forged[at + 8..at + 12].copy_from_slice(&right.to_le_bytes());
            forged[at + 12..at + 16].copy_from_slice(&lower.to_le_bytes());
            assert!(matches!(decode(&forged, Path::new("memory")), Err(Error::Malformed { .. })));
        }
    }

    #[test]
    fn wrong_lengths_and_broken_bytes_are_errors() {
        let mut image = sample();
        let bytes = encode(&image).unwrap();
        image.channels[0].samples.pop();
        assert!(encode(&image).is_err());
        for end in (0..bytes.len()).step_by(7) {
            assert!(decode(&bytes[..end], Path::new("memory")).is_err(), "truncated at {end}");
        }
    }
}
