//! YUV4MPEG2: a line of parameters, then frames of uncompressed planes.
//!
//! # Source
//! MJPEG tools, `yuv4mpeg(5)`; the names of deeper and of grey samples as FFmpeg writes them.

use crate::Error;
use selenograph_raster::Raster;
use selenograph_raster::codec::Picture;
use std::io::{BufRead, Read};
use std::path::Path;

pub(super) const MAGIC: &[u8] = b"YUV4MPEG2";

/// Longest parameter line: a longer one is no such stream.
const MAX_LINE: u64 = 4096;
/// Larger frames are refused before memory is taken for them.
const MAX_PIXELS: usize = 1 << 28;

/// The stream's parameters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    width: usize,
    height: usize,
    /// Significant bits of a sample.
    bits: u32,
    /// Samples of a frame, luma and chroma.
    num_samples: usize,
}

impl Header {
    /// Reads the first line.
    pub(super) fn read(source: &mut impl BufRead, origin: &Path) -> Result<Self, Error> {
        let bad = |found: &str| Error::Format {
            path: origin.to_owned(),
            expected: "a line of YUV4MPEG2 parameters (W, H, C)".to_owned(),
            found: found.to_owned(),
        };
        let line = read_line(source, origin)?.ok_or_else(|| bad("no whole line"))?;
        let line = String::from_utf8(line).map_err(|_| bad("bytes that are no text"))?;
        let mut words = line.split_ascii_whitespace();
        if words.next().map(str::as_bytes) != Some(MAGIC) {
            return Err(bad("another first word"));
        }
        let (mut width, mut height, mut colour) = (0, 0, "420");
        for word in words {
            match word.split_at_checked(1) {
                Some(("W", number)) => width = number.parse().unwrap_or(0),
                Some(("H", number)) => height = number.parse().unwrap_or(0),
                Some(("C", name)) => colour = name,
                _ => {}
            }
        }
        let num_pixels = usize::checked_mul(width, height).filter(|n| (1..=MAX_PIXELS).contains(n));
        let num_pixels = num_pixels.ok_or_else(|| bad(&format!("a frame of {width}×{height}")))?;
        let (layout, bits) = layout(colour).ok_or_else(|| bad(&format!("the colour space `{colour}`")))?;
        let [across, down] = layout.chroma_step();
        let chroma = if across == 0 { 0 } else { 2 * width.div_ceil(across) * height.div_ceil(down) };
        Ok(Self { width, height, bits, num_samples: num_pixels + chroma })
    }

    /// The next frame's luma; `None` at the end, `Some(None)` if it is not wanted.
    pub(super) fn read_frame(
        &self,
        source: &mut impl BufRead,
        origin: &Path,
        frame_idx: usize,
        wanted: bool,
    ) -> Result<Option<Option<Picture>>, Error> {
        if source.fill_buf().map_err(Error::io("read", origin))?.is_empty() {
            return Ok(None);
        }
        let truncated = || Error::Truncated { path: origin.to_owned(), num_whole: frame_idx };
        let line = read_line(source, origin)?.ok_or_else(truncated)?;
        if !line.starts_with(b"FRAME") {
            return Err(Error::Format {
                path: origin.to_owned(),
                expected: format!("the beginning of frame {frame_idx}"),
                found: "other bytes".to_owned(),
            });
        }
        let bytes_per_sample = if self.bits > 8 { 2 } else { 1 };
        let num_luma = self.width * self.height;
        let mut luma = Vec::new();
        if wanted {
            let num_bytes = num_luma * bytes_per_sample;
            source.take(num_bytes as u64).read_to_end(&mut luma).map_err(Error::io("read", origin))?;
            if luma.len() < num_bytes {
                return Err(truncated());
            }
        }
        let rest = self.num_samples - if wanted { num_luma } else { 0 };
        let rest = (rest * bytes_per_sample) as u64;
        let passed = std::io::copy(&mut source.take(rest), &mut std::io::sink());
        if passed.map_err(Error::io("read", origin))? < rest {
            return Err(truncated());
        }
        Ok(Some(wanted.then(|| self.picture(luma))))
    }

    /// Deeper samples fill 16 bits from the top, so that white stays white.
    fn picture(&self, bytes: Vec<u8>) -> Picture {
        let (width, height) = (self.width, self.height);
        if self.bits <= 8 {
            return Picture::Grey8(Raster { width, height, data: bytes });
        }
        let sample = |pair: &[u8]| u16::from_le_bytes([pair[0], pair[1]]) << (16 - self.bits);
        Picture::Grey16(Raster { width, height, data: bytes.chunks_exact(2).map(sample).collect() })
    }
}

/// How much chroma there is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Layout {
    Half,
    HalfAcross,
    QuarterAcross,
    Full,
    None,
}

impl Layout {
    /// Pixels per chroma sample across and down; zeros without chroma.
    fn chroma_step(self) -> [usize; 2] {
        match self {
            Self::Half => [2, 2],
            Self::HalfAcross => [2, 1],
            Self::QuarterAcross => [4, 1],
            Self::Full => [1, 1],
            Self::None => [0, 0],
        }
    }
}

/// Layout and bits of a colour space by its name; an alpha plane is not read.
fn layout(name: &str) -> Option<(Layout, u32)> {
    let (layout, rest) = [
        ("420", Layout::Half),
        ("422", Layout::HalfAcross),
        ("411", Layout::QuarterAcross),
        ("444", Layout::Full),
        ("mono", Layout::None),
    ]
    .into_iter()
    .find_map(|(prefix, layout)| Some((layout, name.strip_prefix(prefix)?)))?;
    match rest {
        // The names after 420 say where chroma lies, which does not matter here.
        "" | "jpeg" | "mpeg2" | "paldv" => Some((layout, 8)),
        _ => {
            let bits = rest.strip_prefix('p').unwrap_or(rest).parse().ok()?;
            (9..=16).contains(&bits).then_some((layout, bits))
        }
    }
}

/// Bytes up to the end of the line, without it; `None` if the stream ends before, or the line is too long.
fn read_line(source: &mut impl BufRead, origin: &Path) -> Result<Option<Vec<u8>>, Error> {
    let mut line = Vec::new();
    source.take(MAX_LINE).read_until(b'\n', &mut line).map_err(Error::io("read", origin))?;
    Ok((line.pop() == Some(b'\n')).then_some(line))
}
