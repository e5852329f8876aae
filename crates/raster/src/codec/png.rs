//! PNG: 8 and 16-bit grey, 8-bit colour.

use super::decoded::{Picture, bytes_of, cannot_encode, malformed};
use crate::{Error, Raster};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder as _, ImageFormat};
use std::path::Path;

const FORMAT: &str = "PNG";

/// Encodes 8-bit grey.
///
/// # Errors
/// [`Error::Encode`] for an empty raster.
pub fn encode_grey8(raster: &Raster<u8>) -> Result<Vec<u8>, Error> {
    encode(&raster.data, raster.width, raster.height, ExtendedColorType::L8)
}

/// Encodes 16-bit grey.
///
/// # Errors
/// [`Error::Encode`] for an empty raster.
pub fn encode_grey16(raster: &Raster<u16>) -> Result<Vec<u8>, Error> {
    // The encoder takes samples in the machine's byte order and writes the file's.
    let bytes: Vec<u8> = raster.data.iter().flat_map(|sample| sample.to_ne_bytes()).collect();
    encode(&bytes, raster.width, raster.height, ExtendedColorType::L16)
}

/// Encodes 8-bit colour.
///
/// # Errors
/// [`Error::Encode`] for an empty raster.
pub fn encode_rgb8(raster: &Raster<[u8; 3]>) -> Result<Vec<u8>, Error> {
    encode(raster.data.as_flattened(), raster.width, raster.height, ExtendedColorType::Rgb8)
}

fn encode(bytes: &[u8], width: usize, height: usize, color: ExtendedColorType) -> Result<Vec<u8>, Error> {
    let side = |pixels: usize| {
        u32::try_from(pixels).ok().filter(|&side| side > 0).ok_or_else(|| {
            cannot_encode(FORMAT, format!("a picture of {width}×{height} pixels cannot be written"))
        })
    };
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(bytes, side(width)?, side(height)?, color)
        .map_err(|e| cannot_encode(FORMAT, e))?;
    Ok(out)
}

/// Decodes; palettes become colour and an alpha channel is dropped.
///
/// # Errors
/// [`Error::Malformed`] if the bytes are no whole PNG or hold 16-bit colour.
pub fn decode(bytes: &[u8], origin: &Path) -> Result<Picture, Error> {
    check_whole(bytes, origin)?;
    let image = image::load_from_memory_with_format(bytes, ImageFormat::Png)
        .map_err(|e| malformed(FORMAT, origin, e))?;
    picture(image).ok_or_else(|| malformed(FORMAT, origin, "16-bit colour is not supported"))
}

/// Makes sure that every chunk is there with its checksum, up to the last: the decoder stops where it has all samples.
pub(super) fn check_whole(bytes: &[u8], origin: &Path) -> Result<(), Error> {
    let bad = |found: &str| malformed(FORMAT, origin, found);
    let mut rest = bytes.get(8..).unwrap_or_default();
    loop {
        let Some((head, body)) = rest.split_at_checked(8) else {
            return Err(bad("the end of the file before IEND"));
        };
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let kind = &head[4..];
        let Some((data, after)) = body.split_at_checked(length.saturating_add(4)) else {
            return Err(bad("the end of the file inside a chunk"));
        };
        let (data, sum) = data.split_at(length);
        let mut crc = flate2::Crc::new();
        crc.update(kind);
        crc.update(data);
        // Bit 5 of a name's first letter marks chunks that a picture can do without.
        if crc.sum().to_be_bytes() != sum && kind[0] & 32 == 0 {
            return Err(bad(&format!(
                "a chunk {} whose checksum does not fit",
                String::from_utf8_lossy(kind)
            )));
        }
        if kind == b"IEND" {
            return Ok(());
        }
        rest = after;
    }
}

/// Reads a file.
///
/// # Errors
/// [`Error::Io`], and those of [`decode`].
pub fn read(path: &Path) -> Result<Picture, Error> {
    decode(&bytes_of(path)?, path)
}

fn picture(image: DynamicImage) -> Option<Picture> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    Some(match image {
        DynamicImage::ImageLuma8(_) | DynamicImage::ImageLumaA8(_) => {
            Picture::Grey8(Raster { width, height, data: image.into_luma8().into_raw() })
        }
        DynamicImage::ImageLuma16(_) | DynamicImage::ImageLumaA16(_) => {
            Picture::Grey16(Raster { width, height, data: image.into_luma16().into_raw() })
        }
        DynamicImage::ImageRgb8(_) | DynamicImage::ImageRgba8(_) => Picture::Rgb8(Raster {
            width,
            height,
            data: image.into_rgb8().pixels().map(|pixel| pixel.0).collect(),
        }),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_round_trips() {
        let origin = Path::new("memory");
        let grey = Raster { width: 5, height: 3, data: (0..15u8).map(|v| v * 17).collect() };
        assert_eq!(decode(&encode_grey8(&grey).unwrap(), origin).unwrap(), Picture::Grey8(grey));
        let deep = Raster { width: 3, height: 5, data: (0..15u16).map(|v| v * 4369).collect() };
        assert_eq!(decode(&encode_grey16(&deep).unwrap(), origin).unwrap(), Picture::Grey16(deep));
        let colour =
            Raster { width: 4, height: 1, data: vec![[1, 2, 3], [255, 0, 9], [7, 7, 7], [0, 128, 64]] };
        assert_eq!(decode(&encode_rgb8(&colour).unwrap(), origin).unwrap(), Picture::Rgb8(colour));
    }

    #[test]
    fn empty_rasters_and_broken_bytes_are_errors() {
        assert!(encode_grey8(&Raster { width: 0, height: 4, data: vec![] }).is_err());
        let bytes = encode_grey8(&Raster { width: 9, height: 9, data: vec![7; 81] }).unwrap();
        for end in 0..bytes.len() {
            assert!(decode(&bytes[..end], Path::new("memory")).is_err(), "truncated at {end}");
        }
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            assert!(decode(&damaged, Path::new("memory")).is_err(), "changed at {at}");
        }
    }
}
