//! The folder that a campaign is written to: made, taken up again, or refused; files and pairs renamed into place.

use crate::Error;
use crate::pair::pair_folder;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What to do with a target folder that is not empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Existing {
    /// Refuse it.
    #[default]
    Refuse,
    /// Go on where an earlier run of the same campaign and plan stopped.
    Resume,
    /// Remove the dataset in it and begin anew. A folder that holds anything else is refused.
    Replace,
}

/// One of several runs that share a campaign: it makes the pairs whose number leaves `index` when divided by `count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 0.
    pub index: u64,
    /// How many.
    pub count: u64,
}

impl Default for Shard {
    fn default() -> Self {
        Self { index: 0, count: 1 }
    }
}

impl Shard {
    /// Whether a pair is this shard's.
    pub fn holds(&self, pair_id: u64) -> bool {
        pair_id % self.count == self.index
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        if self.index < self.count {
            return Ok(());
        }
        Err(Error::Shard { shard: self.index, num_shards: self.count })
    }

    /// `run.toml`, or `run-2-of-8.toml` for one of several.
    pub fn run_name(&self) -> String {
        match self.count {
            1 => "run.toml".into(),
            count => format!("run-{}-of-{count}.toml", self.index),
        }
    }
}

/// The resolved campaign in the target.
pub const CAMPAIGN_NAME: &str = "campaign.toml";
/// The plan in the target.
pub const PLAN_NAME: &str = "plan.csv";
/// Beginning of the names of unfinished files and folders.
const UNFINISHED: &str = ".unfinished-";

/// Makes the target ready: `campaign.toml` and `plan.csv` are in it afterwards, and nothing unfinished of this shard.
pub(super) fn prepare(
    target: &Path,
    existing: Existing,
    shard: Shard,
    campaign: &str,
    plan: &str,
) -> Result<(), Error> {
    let entries = entries(target)?;
    // Another shard may have begun the same dataset a moment ago: then its campaign and plan are checked below.
    let begun = entries.iter().any(|name| name == CAMPAIGN_NAME);
    let together = shard.count > 1 && begun;
    if !entries.is_empty() {
        match existing {
            Existing::Refuse if !together => return Err(Error::TargetExists { path: target.into() }),
            Existing::Refuse | Existing::Resume => {}
            Existing::Replace => remove_dataset(target, &entries)?,
        }
    }
    fs::create_dir_all(target.join("pairs")).map_err(Error::io("create", &target.join("pairs")))?;
    for (name, what, text) in [(CAMPAIGN_NAME, "campaign", campaign), (PLAN_NAME, "plan", plan)] {
        let path = target.join(name);
        match fs::read_to_string(&path) {
            Ok(found) if found == text => {}
            Ok(found) => {
                let sum = |text: &str| blake3::hash(text.as_bytes()).to_hex()[..16].to_owned();
                return Err(Error::OtherCampaign { path, what, expected: sum(text), found: sum(&found) });
            }
            Err(error) if error.kind() == ErrorKind::NotFound => write_file(&path, text.as_bytes())?,
            Err(error) => return Err(Error::io("read", &path)(error)),
        }
    }
    remove_unfinished(target, shard)
}

fn entries(target: &Path) -> Result<Vec<String>, Error> {
    match fs::read_dir(target) {
        Ok(entries) => entries
            .map(|entry| {
                Ok(entry.map_err(Error::io("read", target))?.file_name().to_string_lossy().into_owned())
            })
            .collect(),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(Error::io("read", target)(error)),
    }
}

/// Whether a name is one that a dataset's folder has.
fn is_ours(name: &str) -> bool {
    matches!(name, CAMPAIGN_NAME | PLAN_NAME | "pairs")
        || name.starts_with(UNFINISHED)
        || (name.starts_with("run") && name.ends_with(".toml"))
}

fn remove_dataset(target: &Path, entries: &[String]) -> Result<(), Error> {
    // Everything is looked at before anything is removed.
    if let Some(found) = entries.iter().find(|name| !is_ours(name)) {
        return Err(Error::NotADataset { path: target.into(), found: found.clone() });
    }
    for name in entries {
        let path = target.join(name);
        let removed = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        removed.map_err(Error::io("remove", &path))?;
    }
    Ok(())
}

/// Removes what a killed run of this shard left behind.
fn remove_unfinished(target: &Path, shard: Shard) -> Result<(), Error> {
    let top = target.join("pairs");
    for group in entries(&top)? {
        let group = top.join(group);
        if !group.is_dir() {
            continue;
        }
        for name in entries(&group)? {
            let id = name.strip_prefix(UNFINISHED).and_then(|id| id.parse().ok());
            if id.is_some_and(|id| shard.holds(id)) {
                let path = group.join(&name);
                fs::remove_dir_all(&path).map_err(Error::io("remove", &path))?;
            }
        }
    }
    Ok(())
}

/// Writes a file beside its place and renames it, so that it is whole or not there.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    // Two shards may write the same file at once; each has its own unfinished one.
    let unfinished = path.with_file_name(format!("{UNFINISHED}{}-{name}", std::process::id()));
    let written = fs::write(&unfinished, bytes)
        .map_err(Error::io("write", path))
        .and_then(|()| fs::rename(&unfinished, path).map_err(Error::io("write", path)));
    if written.is_err() {
        // What is left of it helps nobody; the error that is told is the first.
        let _ = fs::remove_file(&unfinished);
    }
    written
}

/// Whether a pair is complete: its folder is renamed into place only then.
pub fn is_complete(target: &Path, pair_id: u64) -> bool {
    pair_folder(target, pair_id).join(crate::pair::PAIR_NAME).is_file()
}

/// Writes all files of a pair into an unfinished folder and renames it into place.
pub(crate) fn write_pair(target: &Path, pair_id: u64, files: &[(String, Vec<u8>)]) -> Result<(), Error> {
    let folder = pair_folder(target, pair_id);
    let unfinished = unfinished_folder(&folder, pair_id);
    let written = fill(&unfinished, files)
        .and_then(|()| fs::rename(&unfinished, &folder).map_err(Error::io("write", &folder)));
    if written.is_err() {
        // As above: on a full disk this also gives the room back.
        let _ = fs::remove_dir_all(&unfinished);
    }
    written
}

fn unfinished_folder(folder: &Path, pair_id: u64) -> PathBuf {
    folder.with_file_name(format!("{UNFINISHED}{pair_id}"))
}

fn fill(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<(), Error> {
    fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    for (name, bytes) in files {
        let path = folder.join(name);
        fs::write(&path, bytes).map_err(Error::io("write", &path))?;
    }
    Ok(())
}
