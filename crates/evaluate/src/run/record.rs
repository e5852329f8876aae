//! `run.toml` of an evaluation: what was asked for, and whether a folder holds the same.

use super::overrides::Overrides;
use crate::Error;
use crate::dataset_source::{LightChoice, Source};
use crate::method::Method;
use crate::method::network::NetworkRecord;
use crate::pair_metrics;
use selenograph_files::record::{self, RUN_NAME, RunRecord};
use selenograph_files::{FolderKind, HeldFolder, is_occupied};
use selenograph_reconstruct::pipeline::Method as Pictures;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Raised when numbers of an older version must not be mixed with new ones.
const SCHEMA: u32 = 3;

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
    /// Settings of the methods that are not the usual ones.
    #[serde(default, skip_serializing_if = "Overrides::is_empty")]
    pub set: Overrides,
    /// The network of the method that needs one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network: Option<NetworkRecord>,
}

impl Settings {
    /// What a method does, with which settings, in one line.
    pub fn line_of(&self, method: Method) -> String {
        let line = match &self.network {
            Some(network) if method == Method::Pictures(Pictures::Mast3r) => network.settings(),
            Some(network) if method.needs_network() => {
                format!("{}; {}", network.identity(), method.settings())
            }
            _ => method.settings().to_owned(),
        };
        if self.set.is_empty() || !method.looks_at_pictures() {
            return line;
        }
        format!("{line}; with {}", self.set)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            lights: LightChoice::Same,
            methods: vec![Method::Truth],
            metrics: pair_metrics::Settings::default(),
            reference_frame: Some(pair_metrics::Settings::paper()),
            set: Overrides::default(),
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

/// The result as TOML has it: no nulls.
#[derive(Serialize)]
struct ResultRecord<'a> {
    num_items: usize,
    num_resumed: usize,
    skipped: &'a [String],
    #[serde(skip_serializing_if = "std::collections::BTreeMap::is_empty")]
    seconds_per_item: std::collections::BTreeMap<&'static str, f64>,
}

/// The settings, and what else decides the numbers and is told for the reader.
#[derive(Serialize)]
struct SettingsRecord<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    half_pixel: Option<&'a str>,
    #[serde(flatten)]
    settings: &'a Settings,
}

/// An evaluation's folder, as one that may be gone on with or replaced by another.
pub static EVALUATION: FolderKind = FolderKind {
    command: COMMAND,
    what: "an evaluation",
    is_own: |folder| record::is_of(folder, COMMAND),
    names: &[
        "run.toml",
        "summary.json",
        "report.html",
        "metrics.jsonl",
        "*/metrics.jsonl",
        // By name: a table that somebody made of them and put beside them is none of ours.
        "tables/pose.*",
        "tables/pose_paper.*",
        "tables/terrain_overlap.*",
        "tables/terrain_full.*",
        "tables/terrain_paper.*",
        "tables/depth_and_sigma.*",
        "tables/hazards.*",
        "tables/hard_cases.*",
        "tables/by_trajectory.*",
        "tables/by_light.*",
        "tables/by_altitude.*",
        "tables/by_overlap.*",
        "tables/by_illumination.*",
        "plots/*.svg",
        "worst/*/*.svg",
        "worst/*/*.png",
        "figures/*/*.svg",
        "figures/*/*.png",
    ],
    parts: &[],
};
const COMMAND: &str = "evaluate";

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
    Ok(selenograph_files::checksum::of_bytes(text.as_bytes()).to_string())
}

/// Empties the folder if it was taken to be replaced, and finds out whether what is in it is of this evaluation; true if it is new.
///
/// # Errors
/// [`Error::OtherEvaluation`] if it holds another one, [`Error::Files`] if it cannot be emptied.
pub(super) fn begin(out: &HeldFolder, settings: &Settings, source: &Source) -> Result<bool, Error> {
    out.begin()?;
    if !is_occupied(out.path()) {
        return Ok(true);
    }
    let other = |found: &str| Error::OtherEvaluation { path: out.path().to_owned(), found: found.into() };
    let found = record::read(&out.path().join(RUN_NAME))?;
    if found.settings_blake3 != Some(checksum(settings)?) {
        return Err(other("an evaluation with other methods or settings"));
    }
    if !found.inputs.values().eq([&source.fingerprint]) {
        return Err(other("the evaluation of another dataset (or of this one before it changed)"));
    }
    Ok(false)
}

/// Writes `run.toml`, before the work (without a result) and after it.
///
/// # Errors
/// [`Error::Files`] if it cannot be written.
pub(super) fn write(
    out: &Path,
    settings: &Settings,
    source: &Source,
    started: Option<&str>,
    completed: Option<&Completed>,
) -> Result<(), Error> {
    let result = completed.map(|completed| {
        let times = settings.methods.iter().zip(&completed.seconds_per_item);
        ResultRecord {
            num_items: completed.num_items,
            num_resumed: completed.num_resumed,
            skipped: &completed.skipped,
            seconds_per_item: times.filter_map(|(m, s)| Some((m.as_str(), (*s)?))).collect(),
        }
    });
    let recorded = SettingsRecord { half_pixel: source.pixels.told.as_deref(), settings };
    let mut record = RunRecord::new(COMMAND, &recorded);
    record.started = started;
    record.settings_blake3 = Some(checksum(settings)?);
    let name = source.root.file_name().map(|name| name.to_string_lossy().into_owned());
    record.inputs.insert(name.unwrap_or_default(), source.fingerprint.clone());
    record.outcome = result.as_ref();
    Ok(record.write(&out.join(RUN_NAME))?)
}
