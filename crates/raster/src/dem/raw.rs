//! Rows out of an uncompressed image of any interleaving: what PDS3 and PDS4 labels describe.

use crate::sample::{ByteOrder, HeightLaw, SampleType};
use crate::{Error, Raster};
use selenograph_files::regular;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes read at once.
const BLOCK_BYTES: u64 = 8 << 20;

/// How bands lie in the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Interleave {
    /// One whole band after the other.
    Band,
    /// A line of each band, then the next line.
    Line,
    /// A sample of each band, then the next sample.
    Sample,
}

/// How a picture is shown from how it is stored: first turned over its diagonal, then mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Turn {
    /// Whether stored lines are columns.
    pub(crate) transposed: bool,
    /// Whether the first column is shown at the right.
    pub(crate) from_right: bool,
    /// Whether the first row is shown at the bottom.
    pub(crate) from_bottom: bool,
}

impl Turn {
    /// Whether anything is turned.
    pub(crate) fn is_none(self) -> bool {
        self == Self::default()
    }

    /// From the sides where lines and samples begin, in words: `Top to Bottom`, `Down`, `Right to Left`, `Left` …
    ///
    /// `lines` tells how the stored lines follow each other, `samples` how the samples of a line do.
    pub(crate) fn from_words(lines: &str, samples: &str) -> Option<Self> {
        let heading = |words: &str| match words.to_ascii_lowercase().replace(['_', '-'], " ").as_str() {
            "top to bottom" | "down" => Some((true, false)),
            "bottom to top" | "up" => Some((true, true)),
            "left to right" | "right" => Some((false, false)),
            "right to left" | "left" => Some((false, true)),
            _ => None,
        };
        let ((lines_down, lines_back), (samples_down, samples_back)) = (heading(lines)?, heading(samples)?);
        match (lines_down, samples_down) {
            (true, false) => {
                Some(Self { transposed: false, from_right: samples_back, from_bottom: lines_back })
            }
            (false, true) => {
                Some(Self { transposed: true, from_right: lines_back, from_bottom: samples_back })
            }
            _ => None,
        }
    }

    /// As it is shown.
    pub(crate) fn apply(self, stored: Raster<f32>) -> Raster<f32> {
        if self.is_none() {
            return stored;
        }
        let (width, height) =
            if self.transposed { (stored.height, stored.width) } else { (stored.width, stored.height) };
        Raster::from_fn(width, height, |x, y| {
            let x = if self.from_right { width - 1 - x } else { x };
            let y = if self.from_bottom { height - 1 - y } else { y };
            if self.transposed { stored[(y, x)] } else { stored[(x, y)] }
        })
    }

    /// What was done, for people.
    pub(crate) fn note(self) -> Option<String> {
        let told = [
            (self.transposed, "lines are columns"),
            (self.from_right, "columns run from right to left"),
            (self.from_bottom, "rows run from bottom to top"),
        ];
        let told: Vec<&str> = told.iter().filter(|(is, _)| *is).map(|(_, what)| *what).collect();
        (!told.is_empty()).then(|| format!("turned as its label says: {}", told.join(", ")))
    }
}

/// Size and layout of the image as its label has it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RawLayout {
    pub(crate) offset: u64,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) num_bands: usize,
    pub(crate) interleave: Interleave,
    /// Bytes before and after the samples of each line.
    pub(crate) prefix_bytes: u64,
    pub(crate) suffix_bytes: u64,
    pub(crate) sample_type: SampleType,
    pub(crate) order: ByteOrder,
}

/// An uncompressed picture as its label describes it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RawPicture {
    pub(crate) data_path: PathBuf,
    pub(crate) layout: RawLayout,
    /// Stored number → the label's unit: factor and summand, of each band or of all.
    pub(crate) scale: Vec<f64>,
    pub(crate) offset: Vec<f64>,
    /// How it is shown.
    pub(crate) turn: Turn,
    /// Stored numbers that mean "absent".
    pub(crate) nodata: Vec<f64>,
    /// The largest stored number that the label allows, where it says so.
    pub(crate) white: Option<f64>,
    /// What had to be decided while reading, in sentences.
    pub(crate) notes: Vec<String>,
}

impl RawPicture {
    /// Factor and summand of a band.
    pub(crate) fn law_of(&self, band_idx: usize) -> (f64, f64) {
        (of_band(&self.scale, band_idx, 1.0), of_band(&self.offset, band_idx, 0.0))
    }
}

/// The number of a band, where there is one for each or one for all.
pub(crate) fn of_band(values: &[f64], band_idx: usize, default: f64) -> f64 {
    values.get(band_idx).or(values.first()).copied().unwrap_or(default)
}

/// Reads rows of one band.
#[derive(Debug)]
pub(crate) struct RawRows {
    file: File,
    path: PathBuf,
    start: u64,
    row_stride: u64,
    row_bytes: u64,
    width: usize,
    sample_type: SampleType,
    order: ByteOrder,
    first_sample: usize,
    sample_stride: usize,
    height: usize,
    /// How rows are shown; never transposed.
    turn: Turn,
    block: Vec<u8>,
}

impl RawRows {
    /// Opens the image and makes sure that it is as long as its label says.
    pub(crate) fn open(path: &Path, layout: &RawLayout, band_idx: usize) -> Result<Self, Error> {
        let (file, found) = regular::open(path).map_err(Error::io("open", path))?;
        let too_large = || Error::Malformed {
            path: path.to_owned(),
            what: "image size in the label".to_owned(),
            expected: "an image below 2⁶³ bytes".to_owned(),
            found: format!("{}×{} in {} band(s)", layout.width, layout.height, layout.num_bands),
        };
        let samples = layout.width as u64 * layout.sample_type.size() as u64;
        let bands = layout.num_bands as u64;
        let interleaved =
            if layout.interleave == Interleave::Sample { samples.checked_mul(bands) } else { Some(samples) };
        let row_bytes = interleaved.ok_or_else(too_large)?;
        let line = row_bytes.saturating_add(layout.prefix_bytes).saturating_add(layout.suffix_bytes);
        let row_stride =
            if layout.interleave == Interleave::Line { line.saturating_mul(bands) } else { line };
        let before = match layout.interleave {
            Interleave::Band => {
                line.checked_mul(layout.height as u64).and_then(|b| b.checked_mul(band_idx as u64))
            }
            Interleave::Line => line.checked_mul(band_idx as u64),
            Interleave::Sample => Some(0),
        };
        let start = before
            .and_then(|b| b.checked_add(layout.offset))
            .and_then(|b| b.checked_add(layout.prefix_bytes))
            .ok_or_else(too_large)?;
        let expected = (layout.height as u64 - 1)
            .checked_mul(row_stride)
            .and_then(|b| b.checked_add(start))
            .and_then(|b| b.checked_add(row_bytes))
            .filter(|end| *end < 1 << 63)
            .ok_or_else(too_large)?;
        if expected > found {
            let what = format!("an image of {}×{} {:?}", layout.width, layout.height, layout.sample_type);
            return Err(Error::Truncated { path: path.to_owned(), what, expected, found });
        }
        let (first_sample, sample_stride) = match layout.interleave {
            Interleave::Sample => (band_idx, layout.num_bands),
            Interleave::Band | Interleave::Line => (0, 1),
        };
        Ok(Self {
            file,
            path: path.to_owned(),
            start,
            row_stride,
            row_bytes,
            width: layout.width,
            sample_type: layout.sample_type,
            order: layout.order,
            first_sample,
            sample_stride,
            height: layout.height,
            turn: Turn::default(),
            block: Vec::new(),
        })
    }

    /// The same rows as a label shows them, mirrored in either direction.
    pub(crate) fn turned(self, turn: Turn) -> Self {
        Self { turn, ..self }
    }

    /// Rows `first..` into `out`, as many as it has room for.
    pub(crate) fn read(&mut self, first: usize, law: &HeightLaw, out: &mut [f32]) -> Result<(), Error> {
        let num_rows = out.len() / self.width;
        let stored_first = if self.turn.from_bottom { self.height - first - num_rows } else { first };
        self.read_stored(stored_first, law, out)?;
        if self.turn.from_bottom {
            for y in 0..num_rows / 2 {
                let (upper, lower) = out.split_at_mut((num_rows - 1 - y) * self.width);
                upper[y * self.width..][..self.width].swap_with_slice(&mut lower[..self.width]);
            }
        }
        if self.turn.from_right {
            out.chunks_exact_mut(self.width).for_each(<[f32]>::reverse);
        }
        Ok(())
    }

    fn read_stored(&mut self, first: usize, law: &HeightLaw, out: &mut [f32]) -> Result<(), Error> {
        let rows_per_block = (BLOCK_BYTES / self.row_stride).max(1) as usize;
        for (block_idx, heights) in out.chunks_mut(rows_per_block * self.width).enumerate() {
            let num_rows = (heights.len() / self.width) as u64;
            let row = (first + block_idx * rows_per_block) as u64;
            let size = (num_rows - 1) * self.row_stride + self.row_bytes;
            self.block.resize(size as usize, 0);
            self.file
                .seek(SeekFrom::Start(self.start + row * self.row_stride))
                .and_then(|_| self.file.read_exact(&mut self.block))
                .map_err(Error::io("read", &self.path))?;
            let lines = self.block.chunks(self.row_stride as usize);
            for (line, heights) in lines.zip(heights.chunks_exact_mut(self.width)) {
                let samples = &line[..self.row_bytes as usize];
                law.decode(
                    samples,
                    self.sample_type,
                    self.order,
                    self.first_sample,
                    self.sample_stride,
                    heights,
                );
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_and_rows_are_turned_alike() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.img");
        std::fs::write(&path, [1, 2, 3, 4, 5, 6]).unwrap();
        let layout = RawLayout {
            offset: 0,
            width: 3,
            height: 2,
            num_bands: 1,
            interleave: Interleave::Band,
            prefix_bytes: 0,
            suffix_bytes: 0,
            sample_type: SampleType::U8,
            order: ByteOrder::Little,
        };
        let stored = Raster { width: 3, height: 2, data: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
        let law = HeightLaw::new(1.0, 0.0, 1.0, 1.0, &[]);
        for (lines, samples, expected) in [
            ("Top to Bottom", "Left to Right", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            ("UP", "RIGHT", [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]),
            ("Down", "Right to Left", [3.0, 2.0, 1.0, 6.0, 5.0, 4.0]),
            ("Bottom to Top", "Right to Left", [6.0, 5.0, 4.0, 3.0, 2.0, 1.0]),
        ] {
            let turn = Turn::from_words(lines, samples).unwrap();
            assert_eq!(turn.apply(stored.clone()).data, expected);
            let mut rows = RawRows::open(&path, &layout, 0).unwrap().turned(turn);
            let mut out = [0.0; 6];
            for (y, row) in out.chunks_exact_mut(3).enumerate() {
                rows.read(y, &law, row).unwrap();
            }
            assert_eq!(out, expected);
            rows.read(0, &law, &mut out).unwrap();
            assert_eq!(out, expected);
        }
        let across = Turn::from_words("Left to Right", "Bottom to Top").unwrap();
        let turned = across.apply(stored);
        assert_eq!((turned.width, turned.height, turned.data), (2, 3, vec![3.0, 6.0, 2.0, 5.0, 1.0, 4.0]));
        assert_eq!(Turn::from_words("Up", "Down"), None);
        assert_eq!(Turn::from_words("sideways", "Right"), None);
    }

    /// Three bands of 2×2 with a prefix of one byte and a suffix of two per line.
    #[test]
    fn interleavings_and_line_margins() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.img");
        let value = |band: u8, y: u8, x: u8| 100 * band + 10 * y + x;
        let line = |samples: Vec<u8>| [vec![255], samples, vec![255, 255]].concat();
        let law = HeightLaw::new(1.0, 0.0, 1.0, 1.0, &[]);
        for interleave in [Interleave::Band, Interleave::Line, Interleave::Sample] {
            let lines: Vec<Vec<u8>> = match interleave {
                Interleave::Band => {
                    (0..6).map(|i| line((0..2).map(|x| value(i / 2, i % 2, x)).collect())).collect()
                }
                Interleave::Line => {
                    (0..6).map(|i| line((0..2).map(|x| value(i % 3, i / 3, x)).collect())).collect()
                }
                Interleave::Sample => {
                    (0..2).map(|y| line((0..6).map(|i| value(i % 3, y, i / 3)).collect())).collect()
                }
            };
            std::fs::write(&path, [vec![9; 7], lines.concat()].concat()).unwrap();
            let layout = RawLayout {
                offset: 7,
                width: 2,
                height: 2,
                num_bands: 3,
                interleave,
                prefix_bytes: 1,
                suffix_bytes: 2,
                sample_type: SampleType::U8,
                order: ByteOrder::Little,
            };
            let mut rows = RawRows::open(&path, &layout, 1).unwrap();
            let mut out = [0.0; 4];
            rows.read(0, &law, &mut out).unwrap();
            assert_eq!(out, [100.0, 101.0, 110.0, 111.0], "{interleave:?}");
            let taller = RawLayout { height: 9, ..layout };
            assert!(matches!(RawRows::open(&path, &taller, 1), Err(Error::Truncated { .. })));
        }
    }
}
