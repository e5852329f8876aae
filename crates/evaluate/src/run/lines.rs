//! `metrics.jsonl`: one line an item, appended whole, read back after an interruption.

use crate::Error;
use crate::dataset_source::load::ItemRecord;
use crate::pair_metrics::PairMetrics;
use selenograph_files::regular;
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The file's name.
pub const METRICS_NAME: &str = "metrics.jsonl";

/// One line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// The method's name.
    pub method: String,
    /// What was evaluated.
    #[serde(flatten)]
    pub item: ItemRecord,
    /// Why there is no pose, where there is none.
    pub cannot_say: Option<String>,
    /// The full frames.
    #[serde(flatten)]
    pub metrics: PairMetrics,
    /// The central rows of the reference protocol: its own pose, and the prediction's part inside them.
    #[serde(default)]
    pub reference_frame: Option<PairMetrics>,
}

impl Line {
    /// What tells an item from another: pair and lights.
    pub fn key(&self) -> (String, u64, u64) {
        (self.item.pair.clone(), self.item.light_a, self.item.light_b)
    }
}

/// The lines of a file; a last line without its end, as a killed run leaves it, is cut off from the file.
///
/// # Errors
/// [`Error::Format`] for a whole line that is no record, [`Error::Io`] if the file cannot be read or mended. A file that does
/// not exist has no lines.
pub fn read_mended(path: &Path) -> Result<Vec<Line>, Error> {
    let bytes = match regular::read(path, regular::ANY_LENGTH) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(Error::io("read", path)(error)),
    };
    let mut whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    let mut lines = Vec::new();
    let mut start = 0;
    for (number, text) in bytes[..whole].split_inclusive(|byte| *byte == b'\n').enumerate() {
        match serde_json::from_slice::<Line>(text) {
            Ok(line) => lines.push(line),
            // A machine that lost power may leave a last line of the right length and the wrong bytes.
            Err(_) if start + text.len() == whole => {
                whole = start;
                break;
            }
            Err(error) => {
                return Err(Error::Format {
                    path: path.to_owned(),
                    expected: "one record a line".into(),
                    found: format!("line {}: {error}", number + 1),
                });
            }
        }
        start += text.len();
    }
    if whole < bytes.len() {
        let file = OpenOptions::new().write(true).open(path).map_err(Error::io("mend", path))?;
        file.set_len(whole as u64).map_err(Error::io("mend", path))?;
    }
    Ok(lines)
}

/// Appends lines.
#[derive(Debug)]
pub struct Appender {
    path: PathBuf,
    file: File,
}

impl Appender {
    /// Opens or makes the file and the folder above it.
    ///
    /// # Errors
    /// [`Error::Io`] if that is refused.
    pub fn open(path: &Path) -> Result<Self, Error> {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(Error::io("make", folder))?;
        }
        let file =
            OpenOptions::new().create(true).append(true).open(path).map_err(Error::io("write", path))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Appends a line in one write.
    ///
    /// # Errors
    /// [`Error::Io`] if the file system refuses, [`Error::Format`] if the record cannot be written.
    pub fn append(&mut self, line: &Line) -> Result<(), Error> {
        let mut text = serde_json::to_vec(line).map_err(|error| Error::Format {
            path: self.path.clone(),
            expected: "a record that can be written".into(),
            found: error.to_string(),
        })?;
        text.push(b'\n');
        Ok(self.file.write_all(&text).map_err(selenograph_files::Error::io("write", &self.path))?)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A line of a pair, with errors of the pose and of the points.
    pub fn line(
        method: &str,
        pair: &str,
        light: u64,
        pose_error_deg: Option<f64>,
        point_error_rel: f64,
    ) -> Line {
        let mut metrics = PairMetrics { pose_failed: pose_error_deg.is_none(), ..PairMetrics::default() };
        metrics.numbers.rra_deg = pose_error_deg;
        metrics.numbers.rta_deg = pose_error_deg;
        metrics.overlap.numbers.point_error_rel = Some(point_error_rel);
        Line {
            method: method.into(),
            item: ItemRecord {
                pair: pair.into(),
                trajectory: Some(selenograph_dataset::pair::Trajectory::Nadir),
                light_a: light,
                light_b: light,
                illumination_difference_deg: Some(0.0),
                sun_a_deg: None,
                sun_b_deg: None,
                altitude_m: 4000.0,
                gsd_m: 6.0,
                overlap_share: 0.8,
                baseline_over_height: 0.1,
                relative_rotation_deg: 1.0,
                truth_is_half_float: false,
            },
            cannot_say: None,
            metrics,
            reference_frame: None,
        }
    }

    #[test]
    fn lines_come_back_and_a_cut_one_goes() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("sift").join(METRICS_NAME);
        assert!(read_mended(&path).unwrap().is_empty());
        let lines = [line("sift", "a", 0, Some(0.1), 0.001), line("sift", "a", 1, None, 0.25)];
        let mut appender = Appender::open(&path).unwrap();
        lines.iter().for_each(|line| appender.append(line).unwrap());
        assert_eq!(read_mended(&path).unwrap(), lines);
        let whole = std::fs::read(&path).unwrap();
        let first = whole.iter().position(|b| *b == b'\n').unwrap() + 1;
        for cut in [first + 1, whole.len() - 1] {
            std::fs::write(&path, &whole[..cut]).unwrap();
            assert_eq!(read_mended(&path).unwrap(), lines[..1]);
            assert_eq!(std::fs::read(&path).unwrap(), whole[..first]);
        }
        std::fs::write(&path, [b"{}\n".as_slice(), &whole].concat()).unwrap();
        assert!(matches!(read_mended(&path), Err(Error::Format { .. })));
    }
}
