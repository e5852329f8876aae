//! PNG, JPEG and PGM: decoded from the bytes of the whole file.

use super::super::decoded::{Picture, bytes_of, malformed};
use super::super::{jpeg, pgm, png};
use super::found::{GreyUnit, PictureFile, PictureFormat, checked_size, luma};
use crate::{Error, Raster, bounds};
use image::{ColorType, DynamicImage, ImageDecoder, ImageReader, Limits};
use std::io::Cursor;
use std::path::Path;

/// Bytes that a decoder may take: 16-bit colour of the largest picture.
const MAX_DECODED_BYTES: u64 = 8 * super::found::MAX_PIXELS;

pub(super) fn read(path: &Path, format: PictureFormat) -> Result<PictureFile, Error> {
    let bytes = bytes_of(path)?;
    let decoded = match format {
        PictureFormat::Png => {
            png::check_whole(&bytes, path)?;
            with_image(&bytes, path, format, image::ImageFormat::Png)
        }
        PictureFormat::Jpeg => {
            jpeg::check_whole(&bytes, path)?;
            with_image(&bytes, path, format, image::ImageFormat::Jpeg)
        }
        _ => with_pgm(&bytes, path),
    }?;
    let Decoded { grey, white, bits, was_colour, notes } = decoded;
    Ok(PictureFile {
        path: path.to_owned(),
        data_path: path.to_owned(),
        format,
        grey,
        unit: GreyUnit::White(white),
        bits,
        was_colour,
        notes,
    })
}

/// PNG's colour type of a picture whose samples are numbers of a palette.
const PNG_PALETTE: u8 = 3;

struct Decoded {
    grey: Raster<f32>,
    white: f64,
    bits: u32,
    was_colour: bool,
    notes: Vec<String>,
}

fn with_pgm(bytes: &[u8], path: &Path) -> Result<Decoded, Error> {
    let (picture, largest) = pgm::decode_with_white(bytes, path)?;
    let (width, height) = picture.size();
    checked_size(path, width as u64, height as u64)?;
    let white = f64::from(largest);
    let (levels, bits): (Vec<u16>, u32) = match picture {
        Picture::Grey16(raster) => (raster.data, 16),
        Picture::Grey8(raster) => (raster.data.into_iter().map(u16::from).collect(), 8),
        Picture::Rgb8(_) => return Err(malformed("PGM", path, "colour")),
    };
    if let Some(above) = levels.iter().find(|level| **level > largest) {
        return Err(malformed("PGM", path, format!("a sample of {above} above the largest value {largest}")));
    }
    let data = levels.into_iter().map(|level| (f64::from(level) / white) as f32).collect();
    Ok(Decoded { grey: Raster { width, height, data }, white, bits, was_colour: false, notes: Vec::new() })
}

fn with_image(
    bytes: &[u8],
    path: &Path,
    format: PictureFormat,
    kind: image::ImageFormat,
) -> Result<Decoded, Error> {
    let bad = |e: image::ImageError| malformed(format.name(), path, one_line(&e.to_string()));
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), kind);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(bad)?;
    let (width, height) = decoder.dimensions();
    checked_size(path, u64::from(width), u64::from(height))?;
    let colour = decoder.color_type();
    bounds::check(path, "picture size", Some(decoder.total_bytes()), bytes.len() as u64)?;
    let image = DynamicImage::from_decoder(decoder).map_err(bad)?;
    let mut notes = Vec::new();
    // The decoder tells of samples as it widens them; the header's bytes 24 and 25 say how they are stored.
    let bits = match (format, bytes.get(24..26)) {
        (PictureFormat::Png, Some([bits, PNG_PALETTE])) => {
            notes.push(format!("palette of {bits} bits, looked up"));
            u32::from(*bits)
        }
        (PictureFormat::Png, Some([bits, _])) => u32::from(*bits),
        _ => 8,
    };
    if colour.has_color() {
        notes.push("colour, made grey by the luma of BT.601".to_owned());
    }
    let (grey, num_clear) = grey_of(&image);
    if colour.has_alpha() {
        notes.push(format!("{num_clear} fully transparent pixels are absent; other alpha is left aside"));
    }
    let wide = matches!(colour, ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16);
    let white = if wide { 65_535.0 } else { 255.0 };
    Ok(Decoded { grey, white, bits, was_colour: colour.has_color(), notes })
}

/// Fractions of white, and the number of fully transparent pixels, which are absent.
fn grey_of(image: &DynamicImage) -> (Raster<f32>, usize) {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let bytes = |level: u8| (f64::from(level) / 255.0) as f32;
    let words = |level: u16| (f64::from(level) / 65_535.0) as f32;
    let mut num_clear = 0;
    let mut seen = |opaque: bool, grey: f32| {
        num_clear += usize::from(!opaque);
        if opaque { grey } else { f32::NAN }
    };
    let data: Vec<f32> = match image {
        DynamicImage::ImageLuma8(p) => p.pixels().map(|p| bytes(p.0[0])).collect(),
        DynamicImage::ImageLumaA8(p) => p.pixels().map(|p| seen(p.0[1] > 0, bytes(p.0[0]))).collect(),
        DynamicImage::ImageRgb8(p) => p.pixels().map(|p| luma_of(p.0.map(bytes))).collect(),
        DynamicImage::ImageLuma16(p) => p.pixels().map(|p| words(p.0[0])).collect(),
        DynamicImage::ImageLumaA16(p) => p.pixels().map(|p| seen(p.0[1] > 0, words(p.0[0]))).collect(),
        DynamicImage::ImageRgb16(p) => p.pixels().map(|p| luma_of(p.0.map(words))).collect(),
        DynamicImage::ImageRgba16(p) => p
            .pixels()
            .map(|p| {
                let [red, green, blue, alpha] = p.0;
                seen(alpha > 0, luma_of([red, green, blue].map(words)))
            })
            .collect(),
        other => other
            .to_rgba8()
            .pixels()
            .map(|p| {
                let [red, green, blue, alpha] = p.0;
                seen(alpha > 0, luma_of([red, green, blue].map(bytes)))
            })
            .collect(),
    };
    (Raster { width, height, data }, num_clear)
}

fn luma_of([red, green, blue]: [f32; 3]) -> f32 {
    luma(red, green, blue)
}

/// The decoder's words on one line.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
