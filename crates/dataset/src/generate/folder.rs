//! The folder that a campaign is written to: made, taken up again, or refused; files and pairs renamed into place.

use crate::Error;
use crate::pair::pair_folder;
use crate::plan::{Campaign, Plan};
use selenograph_files::record::{self, RUN_NAME, RunRecord};
use selenograph_files::{
    Existing, FolderDraft, FolderKind, HeldFolder, Sharing, checksum, clear_drafts, regular,
};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

/// A dataset's folder, as one that may be gone on with or replaced by another.
pub static DATASET: FolderKind = FolderKind {
    command: COMMAND,
    what: "a dataset",
    is_own: |folder| {
        let names = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let is_record = |path: &Path| {
            path.extension().is_some_and(|ending| ending == "toml")
                && record::read(path).is_ok_and(|record| record.command == COMMAND)
        };
        names.into_iter().any(|path| is_record(&path))
    },
    names: &[RUN_NAME, "run-#-of-#.toml", CAMPAIGN_NAME, PLAN_NAME],
    parts: &[("pairs", &PAIRS)],
};
/// The words after `selenograph`.
pub(crate) const COMMAND: &str = "generate";

/// What is below `pairs`.
pub(crate) static PAIRS: FolderKind = FolderKind {
    command: COMMAND,
    what: "pairs",
    // A part of a dataset, never one by itself.
    is_own: |_| false,
    names: &[
        "#/#/pair.json",
        "#/#/a.camera.json",
        "#/#/b.camera.json",
        "#/#/a.depth_z.exr",
        "#/#/b.depth_z.exr",
        "#/#/a.in_b.exr",
        "#/#/b.in_a.exr",
        "#/#/a.l#.png",
        "#/#/b.l#.png",
        "#/#/a.l#.lit.png",
        "#/#/b.l#.lit.png",
        "#/#/a.l#.angles.exr",
        "#/#/b.l#.angles.exr",
        // Of runs of older versions that were killed.
        "#/.unfinished-#/*",
    ],
    parts: &[],
};

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

    /// The shard whose record a file is by its name.
    pub(crate) fn of_run_name(name: &str) -> Option<Self> {
        if name == RUN_NAME {
            return Some(Self::default());
        }
        let (index, count) = name.strip_prefix("run-")?.strip_suffix(".toml")?.split_once("-of-")?;
        let shard = Self { index: index.parse().ok()?, count: count.parse().ok()? };
        shard.check().is_ok().then_some(shard)
    }

    /// `run.toml`, or `run-2-of-8.toml` for one of several.
    pub fn run_name(&self) -> String {
        match self.count {
            1 => RUN_NAME.into(),
            count => format!("run-{}-of-{count}.toml", self.index),
        }
    }
}

/// The resolved campaign in the target.
pub const CAMPAIGN_NAME: &str = "campaign.toml";
/// The plan in the target.
pub const PLAN_NAME: &str = "plan.csv";

/// The plan that an earlier run of the same campaign on the same inputs has written here, unchanged since.
///
/// # Errors
/// [`Error::Io`] and [`Error::Format`] for a plan that cannot be read although its checksum is right.
pub fn planned(
    target: &Path,
    campaign: &Campaign,
    inputs: &BTreeMap<String, String>,
) -> Result<Option<Plan>, Error> {
    let (path, campaign_sum) = (target.join(PLAN_NAME), campaign.checksum()?);
    let Ok(text) = regular::read_to_string(&path) else { return Ok(None) };
    let sum = checksum::of_bytes(text.as_bytes()).to_string();
    let is_of_it = |run: &record::ReadRecord| {
        let told = |name: &str| run.inputs.get(name);
        run.command == COMMAND
            && told(PLAN_NAME) == Some(&sum)
            && told(CAMPAIGN_NAME) == Some(&campaign_sum)
            && inputs.iter().all(|(name, sum)| told(name) == Some(sum))
            && run.inputs.len() == inputs.len() + 2
    };
    let entries = fs::read_dir(target).map_err(Error::io("read", target))?.flatten();
    let mut names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let is_known = names.any(|name| {
        Shard::of_run_name(&name).is_some()
            && record::read(&target.join(name)).is_ok_and(|run| is_of_it(&run))
    });
    if is_known { Plan::from_csv(&text, &path).map(Some) } else { Ok(None) }
}

/// Takes a folder for a dataset, or for one of its shards, before anything is computed.
///
/// # Errors
/// [`Error::Shard`]; [`Error::Files`] for a folder that is in use, or holds what may not be gone on with or replaced.
pub fn take(target: &Path, existing: Existing, shard: Shard) -> Result<HeldFolder, Error> {
    shard.check()?;
    let sharing = if shard.count == 1 { Sharing::Alone } else { Sharing::Part(shard.index) };
    Ok(HeldFolder::take(target, &DATASET, existing, sharing)?)
}

/// Makes the target ready: record, `campaign.toml` and `plan.csv` are in it afterwards, and nothing unfinished of this shard.
pub(super) fn prepare(
    folder: &HeldFolder,
    shard: Shard,
    record: &RunRecord<'_, impl Serialize, impl Serialize>,
    campaign: &str,
    plan: &str,
) -> Result<(), Error> {
    folder.begin()?;
    let target = folder.path();
    fs::create_dir_all(target.join("pairs")).map_err(Error::io("create", &target.join("pairs")))?;
    let mut missing = Vec::new();
    // Another shard may have begun the same dataset a moment ago.
    for (name, what, text) in [(CAMPAIGN_NAME, "campaign", campaign), (PLAN_NAME, "plan", plan)] {
        let path = target.join(name);
        match regular::read_to_string(&path) {
            Ok(found) if found == text => {}
            Ok(found) => {
                let sum = |text: &str| checksum::of_bytes(text.as_bytes()).to_hex()[..16].to_owned();
                return Err(Error::OtherCampaign { path, what, expected: sum(text), found: sum(&found) });
            }
            Err(error) if error.kind() == ErrorKind::NotFound => missing.push((path, text)),
            Err(error) => return Err(Error::io("read", &path)(error)),
        }
    }
    // The record first: by it a later run knows what was begun here.
    record.write(&target.join(shard.run_name()))?;
    for (path, text) in missing {
        selenograph_files::write(&path, text)?;
    }
    remove_unfinished(target, shard)
}

/// Removes what a killed run of this shard left behind.
fn remove_unfinished(target: &Path, shard: Shard) -> Result<(), Error> {
    let pairs = target.join("pairs");
    for group in fs::read_dir(&pairs).map_err(Error::io("read", &pairs))? {
        let group = group.map_err(Error::io("read", &pairs))?.path();
        if group.is_dir() {
            clear_drafts(&group, |name| name.parse().is_ok_and(|id| shard.holds(id)))?;
        }
    }
    Ok(())
}

/// Whether a pair is complete: its folder is renamed into place only then.
pub fn is_complete(target: &Path, pair_id: u64) -> bool {
    pair_folder(target, pair_id).join(crate::pair::PAIR_NAME).is_file()
}

/// Writes all files of a pair into a folder that gets its name when it is whole.
pub(crate) fn write_pair(target: &Path, pair_id: u64, files: &[(String, Vec<u8>)]) -> Result<(), Error> {
    let draft = FolderDraft::beside(&pair_folder(target, pair_id))?;
    for (name, bytes) in files {
        selenograph_files::write(&draft.path().join(name), bytes)?;
    }
    Ok(draft.commit()?)
}
