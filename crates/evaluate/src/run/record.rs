//! `run.toml` of an evaluation: what was asked for, and whether a folder holds the same.

use crate::Error;
use crate::dataset_source::{LightChoice, Source};
use crate::method::Method;
use crate::method::network::NetworkRecord;
use crate::pair_metrics;
use selenograph_reconstruct::pipeline::Method as Pictures;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The file's name.
pub const RUN_NAME: &str = "run.toml";
/// Raised when numbers of an older version must not be mixed with new ones.
const SCHEMA: u32 = 2;

/// What decides the numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Which lights make items.
    pub lights: LightChoice,
    /// The methods, in the order of the tables.
    pub methods: Vec<Method>,
    /// The full frames.
    pub metrics: pair_metrics::Settings,
    /// The central rows of the reference protocol; absent where they are not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_frame: Option<pair_metrics::Settings>,
    /// The network of the method that needs one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network: Option<NetworkRecord>,
}

impl Settings {
    /// What a method does, with which settings, in one line.
    pub fn line_of(&self, method: Method) -> String {
        match &self.network {
            Some(network) if method == Method::Pictures(Pictures::Mast3r) => network.settings(),
            Some(network) if method.needs_network() => {
                format!("{}; {}", network.identity(), method.settings())
            }
            _ => method.settings().to_owned(),
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            lights: LightChoice::Same,
            methods: vec![Method::Truth],
            metrics: pair_metrics::Settings::default(),
            reference_frame: Some(pair_metrics::Settings::paper()),
            network: None,
        }
    }
}

/// What an evaluation has done.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Completed {
    /// Items of all methods in the files now.
    pub num_items: usize,
    /// Those that were there already.
    pub num_resumed: usize,
    /// Mean seconds an item of each method took in this run, in the order of the methods; absent where none was computed. What
    /// methods share, as a network, counts for the first of them.
    pub seconds_per_item: Vec<Option<f64>>,
    /// What was left out, and why.
    pub skipped: Vec<String>,
}

/// The file.
#[derive(Serialize)]
struct RunRecord<'a> {
    program: &'static str,
    version: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    started: Option<&'a str>,
    /// Tells this file from those of other commands.
    evaluated: String,
    settings_blake3: String,
    dataset_blake3: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    half_pixel: Option<&'a str>,
    settings: &'a Settings,
    #[serde(skip_serializing_if = "Option::is_none")]
    result: Option<ResultRecord<'a>>,
}

/// The result as TOML has it: no nulls.
#[derive(Serialize)]
struct ResultRecord<'a> {
    num_items: usize,
    num_resumed: usize,
    skipped: &'a [String],
    #[serde(skip_serializing_if = "std::collections::BTreeMap::is_empty")]
    seconds_per_item: std::collections::BTreeMap<&'static str, f64>,
}

/// What is read back.
#[derive(Deserialize)]
struct Found {
    evaluated: Option<String>,
    settings_blake3: Option<String>,
    dataset_blake3: Option<String>,
}

/// What to do with an output folder that is not empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Existing {
    /// Go on with the same evaluation, refuse anything else.
    #[default]
    Resume,
    /// Remove an evaluation that is there and begin anew.
    Replace,
}

/// Checksum of the settings.
///
/// # Errors
/// [`Error::Format`] if they cannot be written, which no settings do.
pub fn checksum(settings: &Settings) -> Result<String, Error> {
    let text = serde_json::to_string(settings).map_err(|error| Error::Format {
        path: PathBuf::from(RUN_NAME),
        expected: "settings that can be written".into(),
        found: error.to_string(),
    })?;
    let text = format!("selenograph evaluation {} {SCHEMA} {text}", env!("CARGO_PKG_VERSION"));
    Ok(blake3::hash(text.as_bytes()).to_hex().to_string())
}

/// Makes the output folder, or finds out that it may be gone on with.
///
/// # Errors
/// [`Error::OtherEvaluation`] if it holds anything else, [`Error::Io`] if it cannot be made.
pub fn take_folder(
    out: &Path,
    settings: &Settings,
    source: &Source,
    existing: Existing,
) -> Result<(), Error> {
    let occupied = match std::fs::read_dir(out) {
        Ok(mut entries) => entries.next().is_some(),
        Err(_) => out.symlink_metadata().is_ok(),
    };
    if occupied {
        let found = found_in(out);
        let other = |found: &str| Error::OtherEvaluation { path: out.to_owned(), found: found.into() };
        match (existing, found) {
            (_, None) => return Err(other("something else")),
            (Existing::Replace, Some(_)) => {
                std::fs::remove_dir_all(out).map_err(Error::io("empty", out))?;
            }
            (Existing::Resume, Some(found)) => {
                if found.settings_blake3 != Some(checksum(settings)?) {
                    return Err(other("an evaluation with other methods or settings"));
                }
                if found.dataset_blake3.as_deref() != Some(&source.fingerprint) {
                    return Err(other(
                        "the evaluation of another dataset (or of this one before it changed)",
                    ));
                }
            }
        }
    }
    std::fs::create_dir_all(out).map_err(Error::io("make", out))
}

/// The evaluation that a folder holds, if it holds one.
fn found_in(out: &Path) -> Option<Found> {
    let text = std::fs::read_to_string(out.join(RUN_NAME)).ok()?;
    toml::from_str::<Found>(&text).ok().filter(|found| found.evaluated.is_some())
}

/// Writes `run.toml`, before the work (without a result) and after it.
///
/// # Errors
/// [`Error::Io`] if it cannot be written.
pub fn write(
    out: &Path,
    settings: &Settings,
    source: &Source,
    started: Option<&str>,
    completed: Option<&Completed>,
) -> Result<(), Error> {
    let path = out.join(RUN_NAME);
    let result = completed.map(|completed| {
        let times = settings.methods.iter().zip(&completed.seconds_per_item);
        ResultRecord {
            num_items: completed.num_items,
            num_resumed: completed.num_resumed,
            skipped: &completed.skipped,
            seconds_per_item: times.filter_map(|(m, s)| Some((m.as_str(), (*s)?))).collect(),
        }
    });
    let record = RunRecord {
        program: "selenograph",
        version: env!("CARGO_PKG_VERSION"),
        started,
        evaluated: source
            .root
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default(),
        settings_blake3: checksum(settings)?,
        dataset_blake3: &source.fingerprint,
        half_pixel: source.pixels.told.as_deref(),
        settings,
        result,
    };
    let text = toml::to_string(&record).map_err(|error| Error::Format {
        path: path.clone(),
        expected: "a record that can be written".into(),
        found: error.to_string(),
    })?;
    // Beside and renamed: a run that is killed here leaves the old record or the new one, never half of one.
    let partial = out.join(".run.toml.partial");
    std::fs::write(&partial, text).map_err(Error::io("write", &partial))?;
    std::fs::rename(&partial, &path).map_err(Error::io("write", &path))
}
