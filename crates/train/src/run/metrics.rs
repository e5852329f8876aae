//! The curve of a run: a line of JSON for each step and each validation.

use crate::Error;
use selenograph_files::regular;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

/// What a step did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// Steps made, this one included.
    pub step: u64,
    /// Epochs gone by.
    pub epoch: f64,
    /// Learning rate.
    pub learning_rate: f64,
    /// What is minimised.
    pub loss: f64,
    /// Its terms before their weights.
    pub terms: BTreeMap<String, f64>,
    /// Length of the gradient before clipping.
    pub gradient_norm: f64,
    /// Whether the weights moved; an overflow under loss scaling leaves them.
    pub moved: bool,
    /// Pairs per second.
    pub pairs_per_s: f64,
    /// Share of the time spent waiting for data.
    pub data_wait_share: f64,
    /// Seconds since the run began, earlier sittings included.
    pub elapsed_s: f64,
}

/// What a validation found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ValidationRecord {
    /// Steps made.
    pub step: u64,
    /// What decides which weights are best: smaller is better.
    pub score: f64,
    /// Values by name.
    pub values: BTreeMap<String, f64>,
}

/// A line of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Record {
    /// A step.
    Step(StepRecord),
    /// A validation.
    Validation(ValidationRecord),
}

impl Record {
    fn step(&self) -> u64 {
        match self {
            Self::Step(record) => record.step,
            Self::Validation(record) => record.step,
        }
    }
}

/// The file `metrics.jsonl`.
#[derive(Debug)]
pub(crate) struct MetricsFile {
    path: PathBuf,
    file: File,
}

impl MetricsFile {
    /// Opens the file, keeping what was recorded up to `step`: what a killed run did after its last checkpoint is done again.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn open(path: &Path, step: u64) -> Result<Self, Error> {
        let kept = read(path)?.into_iter().filter(|record| record.step() <= step);
        let text: String = kept.filter_map(|record| line(&record).ok()).collect();
        // A run may be killed here too.
        selenograph_files::write(path, text)?;
        let file = OpenOptions::new().append(true).open(path).map_err(Error::io("write", path))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Adds a line.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn push(&mut self, record: &Record) -> Result<(), Error> {
        let written = line(record).and_then(|line| self.file.write_all(line.as_bytes()));
        written.map_err(Error::io("write", &self.path))
    }
}

fn line(record: &Record) -> std::io::Result<String> {
    Ok(serde_json::to_string(record)? + "\n")
}

/// The records of a file; none if there is no file, and without a last line that a killed run left unfinished.
///
/// # Errors
/// [`Error::Io`].
pub fn read(path: &Path) -> Result<Vec<Record>, Error> {
    let file = match regular::open(path) {
        Ok((file, _)) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(Error::io("read", path)(error)),
    };
    let mut records = Vec::new();
    for line in BufReader::new(file).lines() {
        match serde_json::from_str(&line.map_err(Error::io("read", path))?) {
            Ok(record) => records.push(record),
            Err(_) => break,
        }
    }
    Ok(records)
}
