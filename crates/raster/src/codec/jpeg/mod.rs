//! JPEG as the StereoLunar pictures are stored: three equal channels, quality 95, colour halved both ways (4:2:0).

mod bits;
mod entropy;
mod frame;
mod reach;
mod scan;

use super::decoded::{Picture, bytes_of, cannot_encode, malformed};
use crate::{Error, Raster};
use image::{DynamicImage, ImageFormat};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use std::path::Path;

const FORMAT: &str = "JPEG";

/// The quality of the StereoLunar pictures, which is also OpenCV's default.
pub const QUALITY: u8 = 95;

/// Encodes 8-bit grey as three equal channels, 4:2:0.
///
/// # Errors
/// [`Error::Encode`] if a side is 0 or above 65 535.
pub fn encode_grey_as_rgb(raster: &Raster<u8>, quality: u8) -> Result<Vec<u8>, Error> {
    let rgb: Vec<u8> = raster.data.iter().flat_map(|&grey| [grey; 3]).collect();
    encode(&rgb, raster.width, raster.height, quality)
}

/// Encodes 8-bit colour, 4:2:0.
///
/// # Errors
/// [`Error::Encode`] if a side is 0 or above 65 535.
pub fn encode_rgb8(raster: &Raster<[u8; 3]>, quality: u8) -> Result<Vec<u8>, Error> {
    encode(raster.data.as_flattened(), raster.width, raster.height, quality)
}

fn encode(rgb: &[u8], width: usize, height: usize, quality: u8) -> Result<Vec<u8>, Error> {
    let side = |pixels: usize| {
        u16::try_from(pixels).ok().filter(|&side| side > 0).ok_or_else(|| {
            cannot_encode(FORMAT, format!("a picture of {width}×{height} pixels cannot be written"))
        })
    };
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, quality);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder.encode(rgb, side(width)?, side(height)?, ColorType::Rgb).map_err(|e| cannot_encode(FORMAT, e))?;
    Ok(out)
}

/// Decodes; three channels stay three even where they are equal.
///
/// # Errors
/// [`Error::Malformed`] if the bytes are no JPEG, or a block of it is missing or cannot be decoded.
pub fn decode(bytes: &[u8], origin: &Path) -> Result<Picture, Error> {
    check_whole(bytes, origin)?;
    let image = image::load_from_memory_with_format(bytes, ImageFormat::Jpeg)
        .map_err(|e| malformed(FORMAT, origin, e))?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    Ok(match image {
        DynamicImage::ImageLuma8(grey) => Picture::Grey8(Raster { width, height, data: grey.into_raw() }),
        other => Picture::Rgb8(Raster {
            width,
            height,
            data: other.into_rgb8().pixels().map(|pixel| pixel.0).collect(),
        }),
    })
}

/// Makes sure that every block is there: the decoder would make up what is not.
pub(super) fn check_whole(bytes: &[u8], origin: &Path) -> Result<(), Error> {
    entropy::check(bytes).map_err(|found| malformed(FORMAT, origin, found))
}

/// Reads a file.
///
/// # Errors
/// [`Error::Io`], and those of [`decode`].
pub fn read(path: &Path) -> Result<Picture, Error> {
    decode(&bytes_of(path)?, path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_comes_back_as_three_equal_channels() {
        let data = (0..64 * 48).map(|i| (128.0 + 90.0 * (f64::from(i) * 0.01).sin()) as u8).collect();
        let grey = Raster { width: 64, height: 48, data };
        let bytes = encode_grey_as_rgb(&grey, QUALITY).unwrap();
        let Picture::Rgb8(back) = decode(&bytes, Path::new("memory")).unwrap() else { panic!("not colour") };
        for (colour, grey) in back.data.iter().zip(&grey.data) {
            assert!(colour[0] == colour[1] && colour[1] == colour[2]);
            assert!(colour[0].abs_diff(*grey) <= 4);
        }
        // The frame header says 2×2 sampling of the first of three components.
        let header = bytes.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
        assert_eq!((bytes[header + 9], bytes[header + 11]), (3, 0x22));
    }

    fn sequential() -> Vec<u8> {
        let grey = Raster::from_fn(70, 50, |x, y| (x * x + 3 * y) as u8);
        encode_grey_as_rgb(&grey, 80).unwrap()
    }

    fn progressive(restart_interval: u16) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, 80);
        encoder.set_progressive(true);
        encoder.set_restart_interval(restart_interval);
        encoder.set_sampling_factor(SamplingFactor::F_2_2);
        let rgb: Vec<u8> = (0..70 * 50).flat_map(|i| [i as u8, (i / 70) as u8, (i * i / 9) as u8]).collect();
        encoder.encode(&rgb, 70, 50, ColorType::Rgb).unwrap();
        bytes
    }

    /// Where the coded samples of the first scan begin.
    fn first_scan(bytes: &[u8]) -> usize {
        let header = bytes.windows(2).position(|marker| marker == [0xFF, 0xDA]).unwrap();
        header + 2 + usize::from(bytes[header + 3])
    }

    #[test]
    fn whole_pictures_of_every_kind_pass() {
        let origin = Path::new("memory");
        for bytes in [sequential(), progressive(0), progressive(3)] {
            assert_eq!(decode(&bytes, origin).unwrap().size(), (70, 50));
        }
    }

    /// Cut anywhere, and given the end marker that a repair tool writes.
    #[test]
    fn cut_pictures_are_refused_with_and_without_an_end_marker() {
        let origin = Path::new("memory");
        for bytes in [sequential(), progressive(0), progressive(3)] {
            for end in (first_scan(&bytes)..bytes.len() - 3).step_by(5) {
                assert!(decode(&bytes[..end], origin).is_err(), "cut at {end} of {}", bytes.len());
                let ended = [&bytes[..end], &[0xFF, 0xD9]].concat();
                assert!(decode(&ended, origin).is_err(), "cut at {end} of {} and ended", bytes.len());
            }
        }
    }

    /// Bytes that are missing inside the scans leave codes that mean something else. What then fits the picture by chance, block for
    /// block, is a picture to every decoder; the shares that do not fit are those measured, rounded down.
    #[test]
    fn bytes_missing_inside_the_scans_are_refused_where_they_can_be_told() {
        let origin = Path::new("memory");
        for (name, bytes, num_missing, least_share) in [
            ("sequential", sequential(), 1, 0.58),
            ("sequential", sequential(), 24, 0.86),
            ("progressive", progressive(0), 1, 0.72),
            ("progressive", progressive(0), 24, 0.99),
            ("progressive with restarts", progressive(3), 1, 0.81),
            ("progressive with restarts", progressive(3), 24, 0.99),
        ] {
            let (mut num_refused, mut num_all) = (0, 0);
            for at in first_scan(&bytes)..bytes.len() - 2 - num_missing {
                let damaged = [&bytes[..at], &bytes[at + num_missing..]].concat();
                num_refused += usize::from(decode(&damaged, origin).is_err());
                num_all += 1;
            }
            let share = num_refused as f64 / f64::from(num_all);
            assert!(
                share >= least_share,
                "{name}, {num_missing} missing: {num_refused} of {num_all} refused"
            );
        }
    }

    /// Each code is whole and known, and there is a row of units too many or too few.
    #[test]
    fn another_number_of_units_than_the_frame_s_is_refused() {
        let origin = Path::new("memory");
        for bytes in [sequential(), progressive(0), progressive(3)] {
            let frame = bytes.windows(2).position(|w| w == [0xFF, 0xC0] || w == [0xFF, 0xC2]).unwrap();
            assert_eq!(bytes[frame + 5..frame + 7], [0, 50]);
            for (rows, fits) in [(50, true), (64, true), (48, false), (65, false)] {
                let mut other = bytes.clone();
                other[frame + 6] = rows;
                let units_fit = check_whole(&other, origin);
                // Scans of one component hold no blocks below the picture, so that 64 rows fit whole units only.
                let is_whole_units = bytes[frame + 1] == 0xC0;
                if fits && (rows == 50 || is_whole_units) {
                    units_fit.unwrap();
                } else {
                    assert!(units_fit.is_err(), "{rows} rows");
                }
            }
        }
    }

    #[test]
    fn a_block_past_white_is_refused() {
        let white = encode_grey_as_rgb(&Raster::filled(32, 32, 255u8), 95).unwrap();
        assert!(decode(&white, Path::new("memory")).is_ok());
        // The first step of the first table is that of the mean: with a larger one, the same codes are beyond white.
        let table = white.windows(2).position(|w| w == [0xFF, 0xDB]).unwrap();
        let mut beyond = white;
        assert!(beyond[table + 5] < 16, "a step of {}", beyond[table + 5]);
        beyond[table + 5] *= 4;
        let error = decode(&beyond, Path::new("memory")).unwrap_err().to_string();
        assert!(error.contains("black or white"), "{error}");
    }

    #[test]
    fn broken_bytes_are_errors() {
        assert!(decode(b"\xff\xd8\xff", Path::new("memory")).is_err());
        assert!(decode(b"not a picture", Path::new("memory")).is_err());
        assert!(encode_grey_as_rgb(&Raster { width: 70_000, height: 1, data: vec![0; 70_000] }, 95).is_err());
    }
}
