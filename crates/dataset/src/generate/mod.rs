//! Planned pairs rendered into a dataset folder.
//!
//! Pairs follow one another; the threads work together on the rays of one, while the files of the one before are encoded
//! and written. A pair's folder is renamed into place when it is whole, so that a kill or a full disk loses at most
//! the pairs in hand, and a later run goes on from there.

mod encode;
pub(crate) mod folder;
pub(crate) mod scene;

pub use folder::{CAMPAIGN_NAME, DATASET, Shard, planned, take};

use crate::Error;
use crate::plan::{Campaign, PlacedPair, Plan, Row};
use scene::Scene;
use selenograph_files::HeldFolder;
use selenograph_files::checksum;
use selenograph_files::record::RunRecord;
use selenograph_render::{InstructionSet, Tracer};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// What to make, and what to put on record.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Which part of the plan to make.
    pub shard: Shard,
    /// When the run began, as the program that called says it; libraries do not read the clock.
    pub started: Option<String>,
    /// Checksums of what went in (terrain, DEM files), by name, for `run.toml`.
    pub inputs: BTreeMap<String, String>,
}

/// How far a run is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Pairs of this shard that the plan placed.
    pub num_pairs: u64,
    /// Pairs written by this run.
    pub num_done: u64,
    /// Pairs found complete.
    pub num_resumed: u64,
    /// Pairs left out.
    pub num_skipped: u64,
    /// Rays cast by this run.
    pub num_rays: u64,
}

/// A pair that was left out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Skip {
    /// Its number.
    pub pair_id: u64,
    /// Why, and after how many attempts.
    pub reason: String,
}

/// What a run did. A run with skips is done, but not in full.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Report {
    /// Pairs written by this run.
    pub num_done: u64,
    /// Pairs found complete.
    pub num_resumed: u64,
    /// Rays cast by this run.
    pub num_rays: u64,
    /// Pairs left out, in order.
    pub skipped: Vec<Skip>,
    /// What is allowed but worth knowing, such as Suns below the horizon.
    pub warnings: Vec<String>,
}

/// Renders the pairs of a plan (of this shard, and not yet complete) into a dataset folder that was taken with [`take`].
///
/// `progress` is called from a worker after each pair.
///
/// # Errors
/// Anything wrong with the target, the settings or the disk; pairs that were complete by then stay.
pub fn generate(
    campaign: &Campaign,
    plan: &Plan,
    tracer: &Tracer<'_>,
    folder: &HeldFolder,
    options: &Options,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Report, Error> {
    campaign.check()?;
    check_surface(campaign, tracer)?;
    let (campaign_toml, plan_csv) = (campaign.to_toml()?, plan.to_csv()?);
    let settings = SettingsRecord {
        shard: options.shard.index,
        num_shards: options.shard.count,
        instruction_set: format!("{:?}", InstructionSet::best()),
        campaign,
    };
    let mut record = RunRecord::new(folder::COMMAND, &settings);
    record.started = options.started.as_deref();
    record.inputs = options.inputs.clone();
    for (name, text) in [(CAMPAIGN_NAME, &campaign_toml), (folder::PLAN_NAME, &plan_csv)] {
        record.inputs.insert(name.into(), checksum::of_bytes(text.as_bytes()).to_string());
    }
    folder::prepare(folder, options.shard, &record, &campaign_toml, &plan_csv)?;
    let rows: Vec<&Row> = plan.rows.iter().filter(|row| options.shard.holds(row.pair_id)).collect();
    let report = run(campaign, &rows, tracer, folder.path(), progress)?;
    record.outcome = Some(&report);
    record.write(&folder.path().join(options.shard.run_name()))?;
    Ok(report)
}

fn check_surface(campaign: &Campaign, tracer: &Tracer<'_>) -> Result<(), Error> {
    if tracer.interpolation() == campaign.render.surface {
        return Ok(());
    }
    Err(Error::Value {
        key: "render.surface".into(),
        expected: format!("the tracer's, {:?}", tracer.interpolation()),
        found: format!("{:?}", campaign.render.surface),
    })
}

/// A rendered pair on its way to the writer.
struct Rendered<'a> {
    row: &'a Row,
    placed: &'a PlacedPair,
    scene: Box<Scene>,
}

fn run(
    campaign: &Campaign,
    rows: &[&Row],
    tracer: &Tracer<'_>,
    target: &Path,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Report, Error> {
    let mut report = Report { warnings: warnings(rows), ..Report::default() };
    let mut todo = Vec::new();
    for row in rows {
        match &row.placed {
            None => report.skipped.push(Skip { pair_id: row.pair_id, reason: refusal_text(row) }),
            Some(_) if folder::is_complete(target, row.pair_id) => report.num_resumed += 1,
            Some(placed) => todo.push((*row, placed)),
        }
    }
    let start = Progress {
        num_pairs: todo.len() as u64 + report.num_resumed,
        num_resumed: report.num_resumed,
        num_skipped: report.skipped.len() as u64,
        ..Progress::default()
    };
    progress(start);
    // One rendered pair waits at most: memory stays that of three.
    let (sender, receiver) = sync_channel(1);
    let (rendered, written) = std::thread::scope(|scope| {
        let writer = scope.spawn(|| write_all(campaign, tracer, target, receiver, start, progress));
        let rendered = render_all(campaign, tracer, &todo, sender);
        (rendered, writer.join())
    });
    let written = match written {
        Ok(written) => written?,
        // The writer's own panic, carried on.
        Err(panic) => std::panic::resume_unwind(panic),
    };
    report.skipped.extend(rendered?);
    report.skipped.sort_by_key(|skip| skip.pair_id);
    report.num_done = written.num_done;
    report.num_rays = written.num_rays;
    Ok(report)
}

/// Renders pair after pair until the writer has gone; returns those left out.
fn render_all<'a>(
    campaign: &Campaign,
    tracer: &Tracer<'_>,
    todo: &[(&'a Row, &'a PlacedPair)],
    sender: SyncSender<Rendered<'a>>,
) -> Result<Vec<Skip>, Error> {
    let mut skipped = Vec::new();
    for (row, placed) in todo {
        match scene::render(campaign, tracer, row, placed)? {
            Ok(scene) => {
                // A writer that has gone tells its error itself.
                if sender.send(Rendered { row, placed, scene }).is_err() {
                    break;
                }
            }
            Err(refusal) => {
                let reason = format!("{} (seen at full size only)", refusal.as_str());
                skipped.push(Skip { pair_id: row.pair_id, reason });
            }
        }
    }
    Ok(skipped)
}

fn write_all(
    campaign: &Campaign,
    tracer: &Tracer<'_>,
    target: &Path,
    receiver: Receiver<Rendered<'_>>,
    mut state: Progress,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Progress, Error> {
    for Rendered { row, placed, scene } in receiver {
        let files = encode::encode(campaign, tracer.terrain(), row, placed, &scene)?;
        folder::write_pair(target, row.pair_id, &files)?;
        state.num_done += 1;
        state.num_rays += scene.num_rays;
        progress(state);
    }
    Ok(state)
}

fn refusal_text(row: &Row) -> String {
    let reasons: Vec<String> =
        row.refusals.iter().map(|(refusal, count)| format!("{} {count}", refusal.as_str())).collect();
    format!("no place in {} attempts ({})", row.attempts, reasons.join(", "))
}

fn warnings(rows: &[&Row]) -> Vec<String> {
    let mut warnings = Vec::new();
    for row in rows {
        let suns = row.placed.iter().flat_map(|placed| placed.suns.iter().enumerate());
        for (idx, sun) in suns.filter(|(_, sun)| sun.elevation_deg < 0.0) {
            let below = -sun.elevation_deg;
            warnings.push(format!(
                "pair {}: Sun {idx} stands {below:.2}° below the horizon of the site; its pictures are dark or nearly so",
                row.pair_id
            ));
        }
    }
    warnings
}

/// The settings of a run, for its record.
#[derive(Serialize)]
struct SettingsRecord<'a> {
    shard: u64,
    num_shards: u64,
    instruction_set: String,
    #[serde(flatten)]
    campaign: &'a Campaign,
}

#[cfg(test)]
mod tests;
