//! PGM: grey pictures, plain (`P2`) and binary (`P5`), 8 or 16 bits.

use super::decoded::{Picture, bytes_of, malformed};
use crate::{Error, Raster};
use std::path::Path;

const FORMAT: &str = "PGM";

/// Decodes. Samples keep their stored values; the largest value of the header is only checked.
///
/// # Errors
/// [`Error::Malformed`] if the header or the number of samples is wrong.
pub fn decode(bytes: &[u8], origin: &Path) -> Result<Picture, Error> {
    decode_with_white(bytes, origin).map(|(picture, _)| picture)
}

/// Decodes, with the header's largest value: the level of white.
///
/// # Errors
/// As [`decode`].
pub(crate) fn decode_with_white(bytes: &[u8], origin: &Path) -> Result<(Picture, u16), Error> {
    let bad = |what: &str| malformed(FORMAT, origin, what);
    let plain = match bytes.get(..2) {
        Some(b"P2") => true,
        Some(b"P5") => false,
        _ => return Err(bad("it does not start with P2 or P5")),
    };
    let mut words = Words { rest: &bytes[2..] };
    let mut number = |what| words.next_number().ok_or_else(|| bad(what));
    let (width, height, largest) = (number("no width")?, number("no height")?, number("no largest value")?);
    if width == 0 || height == 0 || !(1..=65_535).contains(&largest) {
        return Err(bad("the header's numbers are out of range"));
    }
    let count = width.checked_mul(height).ok_or_else(|| bad("the size overflows"))?;
    let wide = largest > 255;
    let samples: Vec<u16> = if plain {
        let mut samples = Vec::new();
        while let Some(sample) = words.next_number().filter(|_| samples.len() < count) {
            samples.push(u16::try_from(sample).map_err(|_| bad("a sample above 65535"))?);
        }
        samples
    } else {
        // Exactly one byte of white space separates the header from the samples.
        let data = words.rest.get(1..).unwrap_or_default();
        let step = if wide { 2 } else { 1 };
        let sample = |pair: &[u8]| pair.iter().fold(0u16, |value, &byte| (value << 8) | u16::from(byte));
        data.chunks_exact(step).take(count).map(sample).collect()
    };
    if samples.len() != count {
        return Err(bad(&format!("{} samples, expected {count}", samples.len())));
    }
    let picture = if wide {
        Picture::Grey16(Raster { width, height, data: samples })
    } else {
        let data = samples.into_iter().map(|sample| sample.min(255) as u8).collect();
        Picture::Grey8(Raster { width, height, data })
    };
    Ok((picture, largest as u16))
}

/// Reads a file.
///
/// # Errors
/// [`Error::Io`], and those of [`decode`].
pub fn read(path: &Path) -> Result<Picture, Error> {
    decode(&bytes_of(path)?, path)
}

/// The header's words, comments left out.
struct Words<'a> {
    rest: &'a [u8],
}

impl Words<'_> {
    fn next_number(&mut self) -> Option<usize> {
        loop {
            let start = self.rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
            self.rest = &self.rest[start..];
            if self.rest[0] != b'#' {
                break;
            }
            let end = self.rest.iter().position(|&byte| byte == b'\n')?;
            self.rest = &self.rest[end..];
        }
        let end = self.rest.iter().position(|byte| !byte.is_ascii_digit()).unwrap_or(self.rest.len());
        let number = std::str::from_utf8(&self.rest[..end]).ok()?.parse().ok()?;
        self.rest = &self.rest[end..];
        Some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_layouts() {
        let origin = Path::new("memory");
        let grey = Picture::Grey8(Raster { width: 3, height: 2, data: vec![0, 10, 32, 9, 200, 255] });
        assert_eq!(decode(b"P5\n# made by hand\n3 2\n255\n\x00\x0a\x20\x09\xc8\xff", origin).unwrap(), grey);
        assert_eq!(decode(b"P2 3 2 255\n0 10 32\n# a comment\n9 200 255\n", origin).unwrap(), grey);
        let deep = Picture::Grey16(Raster { width: 2, height: 1, data: vec![258, 65_535] });
        assert_eq!(decode(b"P5 2 1 65535\n\x01\x02\xff\xff", origin).unwrap(), deep);
    }

    #[test]
    fn broken_bytes_are_errors() {
        for bytes in [
            &b"P6 1 1 255 "[..],
            b"P5",
            b"P5 2 2 255\n\x00",
            b"P5 0 2 255\n",
            b"P2 1 1 255 70000",
            b"P2 99999999999999999999 1 1",
        ] {
            assert!(decode(bytes, Path::new("memory")).is_err());
        }
    }
}
