//! The run record: what was run, on what, with which settings, and what came of it.

use crate::names::is_own_name;
use crate::{Error, FolderKind, checksum, write};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use toml::{Table, Value};

/// The file's name; parts of one run have names of their own.
pub const RUN_NAME: &str = "run.toml";

/// Before the checksum of the text above it, in the last line: a comment, so that it is no key of any table.
const SUM: &str = "# BLAKE3 of all above: ";

/// What is written: the same keys for every command, then its own settings.
#[derive(Debug, Clone, Serialize)]
pub struct RunRecord<'a, S: Serialize, O: Serialize = ()> {
    program: &'static str,
    version: &'static str,
    /// The words after `selenograph`.
    command: &'static str,
    /// When it began, as the program that called says it: libraries do not read the clock.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub started: Option<&'a str>,
    /// Threads it ran on, where they are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threads: Option<usize>,
    /// Checksum of the settings, of commands whose folders are gone on with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settings_blake3: Option<String>,
    /// What was read, with its BLAKE3.
    pub inputs: BTreeMap<String, String>,
    /// What came of it; absent while it runs, and for commands whose folder says it all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outcome: Option<&'a O>,
    settings: &'a S,
}

impl<'a, S: Serialize, O: Serialize> RunRecord<'a, S, O> {
    /// Of a command that has done nothing yet.
    pub fn new(command: &'static str, settings: &'a S) -> Self {
        Self {
            program: "selenograph",
            version: env!("CARGO_PKG_VERSION"),
            command,
            started: None,
            threads: None,
            settings_blake3: None,
            inputs: BTreeMap::new(),
            outcome: None,
            settings,
        }
    }

    /// The file's text.
    ///
    /// # Errors
    /// [`Error::Record`] for a value that has no form in TOML.
    pub fn to_toml(&self) -> Result<String, Error> {
        let text = toml::to_string(self).map_err(|source| Error::Record { path: RUN_NAME.into(), source })?;
        Ok(with_sum(&text))
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`Error::Record`], [`Error::Full`], [`Error::Io`].
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        write(path, self.to_toml()?)
    }
}

/// What is read back: of this version's files, and of those of older ones.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadRecord {
    /// The words after `selenograph`.
    pub command: String,
    /// Checksum of the settings, where it was taken.
    pub settings_blake3: Option<String>,
    /// What was read, with its BLAKE3.
    pub inputs: BTreeMap<String, String>,
    /// What came of it: absent while the command runs, and where it records none.
    pub outcome: Option<Table>,
    /// Whether the text is the one that was written, by the checksum in its last line; older versions wrote none.
    pub is_as_written: Option<bool>,
    /// The command's own.
    pub settings: Table,
    /// The files that were written beside it, below its folder; absent for folders that are filled bit by bit.
    pub files: Option<BTreeSet<String>>,
}

/// What is put on record when a folder is complete.
#[derive(Default, Serialize, Deserialize)]
struct Written {
    files: BTreeSet<String>,
}

/// The common part.
#[derive(Deserialize)]
struct Common {
    command: String,
    settings_blake3: Option<String>,
    #[serde(default)]
    inputs: BTreeMap<String, String>,
    outcome: Option<Table>,
    #[serde(default)]
    settings: Table,
    written: Option<Written>,
}

/// Reads a record.
///
/// # Errors
/// [`Error::Io`]; [`Error::NoRecord`] for a file of something else.
pub fn read(path: &Path) -> Result<ReadRecord, Error> {
    let text = crate::regular::read_to_string(path).map_err(Error::io("read", path))?;
    let no_record = |what: String| Error::NoRecord { path: path.to_owned(), what };
    let table: Table =
        text.parse().map_err(|error: toml::de::Error| no_record(error.message().to_owned()))?;
    if !table.contains_key("command") {
        return of_old_release(table).ok_or_else(|| no_record("it names no command".into()));
    }
    let common: Common =
        table.try_into().map_err(|error: toml::de::Error| no_record(error.message().to_owned()))?;
    Ok(ReadRecord {
        command: common.command,
        settings_blake3: common.settings_blake3,
        inputs: common.inputs,
        outcome: common.outcome,
        is_as_written: is_as_written(&text),
        settings: common.settings,
        files: common.written.map(|written| written.files),
    })
}

/// Names every file of a complete folder in its record, where it has one, except those of parts of a kind of their own: what others
/// put into it later is none of them.
///
/// # Errors
/// [`Error::Io`], [`Error::Full`].
pub(crate) fn name_files(folder: &Path, parts: &[(&str, &FolderKind)]) -> Result<(), Error> {
    let path = folder.join(RUN_NAME);
    let text = match std::fs::read_to_string(&path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        text => text.map_err(Error::io("read", &path))?,
    };
    let above = text.rsplit_once(SUM).map_or(text.as_str(), |(above, _)| above);
    let mut written = Written::default();
    add_files(folder, "", &mut written.files)?;
    let in_part = |file: &str| parts.iter().any(|(part, _)| Path::new(file).starts_with(part));
    written.files.retain(|file| file != RUN_NAME && !in_part(file));
    let table = BTreeMap::from([("written", written)]);
    let list =
        toml::to_string_pretty(&table).map_err(|source| Error::Record { path: path.clone(), source })?;
    write(&path, with_sum(&format!("{above}\n{list}")))
}

fn add_files(folder: &Path, below: &str, files: &mut BTreeSet<String>) -> Result<(), Error> {
    for entry in std::fs::read_dir(folder).map_err(Error::io("read", folder))? {
        let entry = entry.map_err(Error::io("read", folder))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if is_own_name(&name) {
            continue;
        }
        let below = format!("{below}{name}");
        if entry.file_type().map_err(Error::io("read", folder))?.is_dir() {
            add_files(&entry.path(), &format!("{below}/"), files)?;
        } else {
            files.insert(below);
        }
    }
    Ok(())
}

fn with_sum(text: &str) -> String {
    format!("{text}{SUM}{}\n", checksum::of_bytes(text.as_bytes()))
}

fn is_as_written(text: &str) -> Option<bool> {
    let (above, sum) = text.rsplit_once(SUM)?;
    Some(checksum::of_bytes(above.as_bytes()).to_hex().as_str() == sum.trim_end())
}

/// Whether a folder's `run.toml` is that of a command.
pub fn is_of(folder: &Path, command: &str) -> bool {
    read(&folder.join(RUN_NAME)).is_ok_and(|record| record.command == command)
}

/// Up to version 0.1.0 without a command, each had keys of its own.
fn of_old_release(mut table: Table) -> Option<ReadRecord> {
    let text = |table: &Table, key: &str| table.get(key).and_then(Value::as_str).map(str::to_owned);
    let mut inputs: BTreeMap<String, String> =
        table.remove("inputs").and_then(|inputs| inputs.try_into().ok()).unwrap_or_default();
    let outcome = table.get("result").and_then(Value::as_table).cloned();
    let settings_blake3 = text(&table, "settings_blake3");
    let settings = |table: &mut Table| match table.remove("settings") {
        Some(Value::Table(settings)) => settings,
        _ => Table::new(),
    };
    let (command, settings) = if let Some(dataset) = text(&table, "evaluated") {
        inputs.extend(text(&table, "dataset_blake3").map(|sum| (dataset, sum)));
        ("evaluate", settings(&mut table))
    } else if table.contains_key("campaign_blake3") {
        for (key, name) in [("campaign_blake3", "campaign.toml"), ("plan_blake3", "plan.csv")] {
            inputs.extend(text(&table, key).map(|sum| (name.to_owned(), sum)));
        }
        ("generate", settings(&mut table))
    } else if table.contains_key("imported") {
        ("data import", table)
    } else if table.contains_key("budget_s") || table.contains_key("allow_leak") {
        ("train run", table)
    } else {
        return None;
    };
    Some(ReadRecord {
        command: command.to_owned(),
        settings_blake3,
        inputs,
        outcome,
        is_as_written: None,
        settings,
        files: None,
    })
}
