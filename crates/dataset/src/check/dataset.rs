//! What a dataset says of itself: its run records, its campaign, its plan, and whether every pair of the plan is there.

use super::report::{Code, Finding, Severity};
use crate::Error;
use crate::generate::folder::{CAMPAIGN_NAME, COMMAND, PLAN_NAME, Shard};
use crate::pair::pair_folder;
use crate::plan::{Campaign, Plan, Row};
use selenograph_files::record::{self, RUN_NAME, ReadRecord};
use selenograph_files::{checksum, regular};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The folder that holds `pairs`, and what could be read of it.
#[derive(Debug, Default)]
pub struct Dataset {
    root: PathBuf,
    runs: Vec<(Shard, ReadRecord)>,
    /// Its campaign, unless it has none or it is broken.
    pub campaign: Option<Campaign>,
    plan: Option<Plan>,
    /// What is wrong with these files.
    pub findings: Vec<Finding>,
}

/// Keys of a run's settings that are not the campaign's.
const RUN_KEYS: [&str; 3] = ["shard", "num_shards", "instruction_set"];

const AGAIN: &str = "run the same `generate` again: it makes what is missing, and writes its record anew";
const ANEW: &str = "take the file from a copy of the dataset, or make the dataset anew";

impl Dataset {
    /// Whether a folder says that it is one, whether or not a pair is in it.
    pub fn is_at(folder: &Path) -> bool {
        folder.join(PLAN_NAME).is_file() && folder.join(CAMPAIGN_NAME).is_file()
    }

    /// Reads what there is.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be listed.
    pub fn open(root: &Path) -> Result<Self, Error> {
        let mut dataset = Self { root: root.to_owned(), ..Self::default() };
        dataset.read_runs()?;
        let is_planned = Self::is_planned(&dataset.runs)
            || [CAMPAIGN_NAME, PLAN_NAME].iter().any(|name| root.join(name).exists());
        if is_planned {
            let text = dataset.read(CAMPAIGN_NAME);
            dataset.campaign = dataset.parsed(CAMPAIGN_NAME, text.map(|text| Campaign::from_toml(&text)));
            let text = dataset.read(PLAN_NAME);
            let path = root.join(PLAN_NAME);
            dataset.plan = dataset.parsed(PLAN_NAME, text.map(|text| Plan::from_csv(&text, &path)));
            dataset.compare_settings();
        }
        Ok(dataset)
    }

    fn is_planned(runs: &[(Shard, ReadRecord)]) -> bool {
        runs.iter().any(|(_, run)| run.command == COMMAND)
    }

    fn find(&mut self, code: Code, file: &Path, message: impl Into<String>, hint: &str) {
        let place = file.display().to_string();
        self.findings.push(Finding::new(Severity::Error, code, place, message).hint(hint));
    }

    fn read_runs(&mut self) -> Result<(), Error> {
        let entries = std::fs::read_dir(&self.root).map_err(Error::io("read", &self.root))?;
        let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        let mut runs: Vec<(String, Shard)> =
            names.filter_map(|name| Shard::of_run_name(&name).map(|shard| (name, shard))).collect();
        runs.sort_by_key(|(name, _)| name.clone());
        if runs.is_empty() {
            let path = self.root.join(RUN_NAME);
            self.find(Code::MissingFile, &path, "the record of the run is missing", AGAIN);
        }
        for (name, shard) in runs {
            let path = self.root.join(name);
            match record::read(&path) {
                Err(error) => self.find(Code::BrokenFile, &path, error.to_string(), AGAIN),
                Ok(run) => {
                    if run.is_as_written == Some(false) {
                        let message = "its checksum is not the one in its last line: it was edited";
                        self.find(Code::ChangedFile, &path, message, AGAIN);
                    }
                    self.runs.push((shard, run));
                }
            }
        }
        Ok(())
    }

    /// A file whose checksum the runs hold, if it is there; where it is another one, that is found.
    fn read(&mut self, name: &str) -> Option<String> {
        let path = self.root.join(name);
        let bytes = match regular::read(&path, regular::MAX_TEXT_BYTES) {
            Ok(bytes) => bytes,
            Err(error) => {
                let missing = error.kind() == std::io::ErrorKind::NotFound;
                let code = if missing { Code::MissingFile } else { Code::BrokenFile };
                self.find(code, &path, Error::io("read", &path)(error).to_string(), AGAIN);
                return None;
            }
        };
        let sum = checksum::of_bytes(&bytes).to_string();
        let differs = |(_, run): &(Shard, ReadRecord)| run.inputs.get(name).is_some_and(|told| *told != sum);
        if self.runs.iter().any(differs) {
            let message = format!(
                "its checksum is not the one in the record of the run ({} bytes): changed or truncated",
                bytes.len()
            );
            self.find(Code::ChangedFile, &path, message, ANEW);
        }
        match String::from_utf8(bytes) {
            Ok(text) => Some(text),
            Err(_) => {
                self.find(Code::BrokenFile, &path, "it is no text (UTF-8)", ANEW);
                None
            }
        }
    }

    fn parsed<T>(&mut self, name: &str, parsed: Option<Result<T, Error>>) -> Option<T> {
        match parsed? {
            Ok(parsed) => Some(parsed),
            Err(error) => {
                let path = self.root.join(name);
                self.find(Code::BrokenFile, &path, error.to_string(), ANEW);
                None
            }
        }
    }

    /// A run's settings hold the campaign once more.
    fn compare_settings(&mut self) {
        let Some(campaign) = self.campaign.clone() else { return };
        for n in 0..self.runs.len() {
            let (shard, run) = &self.runs[n];
            let mut settings = run.settings.clone();
            settings.retain(|key, _| !RUN_KEYS.contains(&AsRef::<str>::as_ref(key)));
            if run.command != COMMAND || Campaign::from_table(settings).is_ok_and(|told| told == campaign) {
                continue;
            }
            let path = self.root.join(shard.run_name());
            let message = format!("its settings are not those of {CAMPAIGN_NAME}");
            self.find(
                Code::ChangedFile,
                &path,
                message,
                "one of the two was edited, or is of another dataset",
            );
        }
    }

    /// The plan's row of a pair.
    pub fn row(&self, pair_id: u64) -> Option<&Row> {
        let rows = &self.plan.as_ref()?.rows;
        rows.binary_search_by_key(&pair_id, |row| row.pair_id).ok().map(|idx| &rows[idx])
    }

    /// Pairs that should be there and are not, and the reverse.
    pub fn check_pairs(&self, present: &BTreeSet<u64>) -> Vec<Finding> {
        let mut findings = Vec::new();
        let mut find = |place: &Path, message: String, hint: &str| {
            let place = place.display().to_string();
            findings.push(Finding::new(Severity::Error, Code::MissingPair, place, message).hint(hint));
        };
        if let Some(plan) = &self.plan {
            let left_out: BTreeSet<u64> = self.runs.iter().flat_map(|(_, run)| skipped(run)).collect();
            let is_done = |id: u64| {
                let mut runs = self.runs.iter().filter(|(shard, _)| shard.holds(id));
                self.runs.is_empty() || runs.any(|(_, run)| run.outcome.is_some())
            };
            let placed = plan.rows.iter().filter(|row| row.placed.is_some()).map(|row| row.pair_id);
            let (lost, unmade): (Vec<u64>, Vec<u64>) = placed
                .filter(|id| !present.contains(id) && !left_out.contains(id))
                .partition(|id| is_done(*id));
            for id in lost {
                find(
                    &pair_folder(&self.root, id),
                    "the plan has this pair, and it is not here".into(),
                    AGAIN,
                );
            }
            if let Some(first) = unmade.first() {
                let num = unmade.len();
                let message = format!(
                    "{num} pairs of the plan are not made yet, the first is {first:06}: the run has not come to its end"
                );
                find(&self.root, message, AGAIN);
            }
            for id in present.iter().filter(|id| self.row(**id).is_none_or(|row| row.placed.is_none())) {
                let message = "the plan has no such pair".to_owned();
                find(&pair_folder(&self.root, *id), message, "it is of another dataset");
            }
        }
        for (_, run) in self.runs.iter().filter(|(_, run)| run.command != COMMAND) {
            let told = run.outcome.as_ref().and_then(|outcome| outcome.get("num_pairs")?.as_integer());
            if let Some(told) = told.filter(|told| usize::try_from(*told) != Ok(present.len())) {
                let message = format!("{told} pairs were written, and {} are here", present.len());
                find(&self.root, message, "run the same `data import` again with --force");
            }
        }
        findings
    }
}

/// Pairs that a run left out, by its record.
fn skipped(run: &ReadRecord) -> impl Iterator<Item = u64> + '_ {
    let list = run.outcome.as_ref().and_then(|outcome| outcome.get("skipped")?.as_array());
    let id = |skip: &toml::Value| u64::try_from(skip.get("pair_id")?.as_integer()?).ok();
    list.into_iter().flatten().filter_map(id)
}
