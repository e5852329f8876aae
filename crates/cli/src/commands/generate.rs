//! `generate`: planned pairs rendered into a dataset folder.

use super::clock::{instant, now_utc};
use super::planning::{check_carries, make_plan};
use crate::args::campaign::Generate;
use crate::exit::Outcome;
use crate::settings::Layers;
use crate::target::{SAME_COMMAND, say_complete_is_kept};
use crate::ui::Ui;
use selenograph_dataset::generate::{Options, Progress, Report, Shard, generate, planned, take};
use selenograph_dataset::plan::{Campaign, Plan};
use selenograph_files::{Existing, HeldFolder};
use selenograph_render::Tracer;
use selenograph_terrain::{Terrain, store};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Plans, renders and writes; a second run goes on where the first stopped.
///
/// # Errors
/// A campaign, plan or terrain that cannot be read, a terrain that carries no pair, a target of another campaign.
pub fn run(args: &Generate, ui: &Ui) -> anyhow::Result<Outcome> {
    let campaign = Layers::from_choice(&args.choice)?.campaign()?;
    let shard = Shard { index: args.shard, count: args.shards };
    let existing = if args.target.force { Existing::Replace } else { Existing::Resume };
    let folder = if args.dry_run { None } else { Some(take(&args.target.out, existing, shard)?) };
    if folder.is_some() {
        say_complete_is_kept(&args.target.out, SAME_COMMAND);
    }
    ui.detail(&format!("campaign:\n{}", campaign.to_toml()?));
    let terrain = ui.timed("open terrain", || Terrain::open(&args.terrain))?;
    let tracer = Tracer::new(&terrain, campaign.render.surface);
    let inputs = inputs(&args.terrain)?;
    let plan = match &args.plan {
        Some(path) => Plan::read(path)?,
        None if existing == Existing::Resume => match planned(&args.target.out, &campaign, &inputs)? {
            Some(plan) => {
                ui.note("the plan is there: it is read, not made anew");
                plan
            }
            None => make_plan(&campaign, &tracer, ui)?,
        },
        None => make_plan(&campaign, &tracer, ui)?,
    };
    check_carries(&plan)?;
    let Some(folder) = folder else { return dry_run(&campaign, &plan, ui) };
    let options = Options { shard, started: Some(now_utc()), inputs };
    let report = render_all(&campaign, &plan, &tracer, &folder, &options, ui)?;
    if ui.json {
        ui.data_json(&report)?;
    }
    let skipped =
        report.skipped.iter().map(|skip| format!("pair {}: {}", skip.pair_id, skip.reason)).collect();
    ui.note(&format!("dataset: {}", args.target.out.display()));
    Ok(if report.skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(skipped) })
}

/// Renders the pairs of a plan behind a progress bar.
///
/// # Errors
/// Those of the library.
pub fn render_all(
    campaign: &Campaign,
    plan: &Plan,
    tracer: &Tracer<'_>,
    folder: &HeldFolder,
    options: &Options,
    ui: &Ui,
) -> anyhow::Result<Report> {
    let bar = ui.bar(plan.rows.len() as u64, "pairs");
    let start = instant();
    let tell = |progress: Progress| {
        bar.set_length(progress.num_pairs);
        if progress.num_done == 0 {
            // Pairs found complete say nothing about how fast this run is.
            bar.set_position(progress.num_resumed);
            bar.reset_eta();
        }
        bar.set_position(progress.num_resumed + progress.num_done);
        let rate = progress.num_rays as f64 / start.elapsed().as_secs_f64().max(1e-3) / 1e6;
        bar.set_message(format!("{rate:.1} Mrays/s"));
    };
    let report =
        ui.timed("render and write pairs", || generate(campaign, plan, tracer, folder, options, &tell))?;
    bar.finish_and_clear();
    for warning in &report.warnings {
        ui.note(&format!("note: {warning}"));
    }
    let seconds = start.elapsed().as_secs_f64();
    ui.note(&format!(
        "{} pairs made, {} were there, {} left out; {:.1} s, {:.2} pairs/s, {:.1} Mrays/s",
        report.num_done,
        report.num_resumed,
        report.skipped.len(),
        seconds,
        report.num_done as f64 / seconds,
        report.num_rays as f64 / seconds / 1e6
    ));
    Ok(report)
}

/// Checksums of the elevation models that the terrain was made from, by name.
///
/// # Errors
/// If the terrain's description cannot be read.
pub fn inputs(terrain: &Path) -> anyhow::Result<BTreeMap<String, String>> {
    let layers = store::describe(terrain)?.layers;
    Ok(layers
        .into_iter()
        .filter_map(|layer| layer.source.blake3.map(|blake3| (layer.source.name, blake3)))
        .collect())
}

/// What a run would be.
#[derive(Serialize)]
struct DryRun {
    num_pairs: usize,
    num_lights: usize,
    num_skipped: usize,
    num_camera_rays: u64,
}

fn dry_run(campaign: &Campaign, plan: &Plan, ui: &Ui) -> anyhow::Result<Outcome> {
    let placed = plan.rows.iter().filter_map(|row| row.placed.as_ref());
    let rays: u64 = placed
        .map(|pair| {
            let pixels = (pair.camera.width * pair.camera.height) as u64;
            // Both views: one ray for the truth, and those of the pictures, which all lights share.
            2 * pixels * (1 + u64::from(campaign.render.rays_per_pixel))
        })
        .sum();
    let num_skipped = plan.skipped().count();
    if ui.json {
        ui.data_json(&DryRun {
            num_pairs: plan.rows.len() - num_skipped,
            num_lights: campaign.lights.len(),
            num_skipped,
            num_camera_rays: rays,
        })?;
        return Ok(Outcome::Done);
    }
    ui.data(&format!(
        "{} pairs under {} lights, {num_skipped} left out, {:.1} million camera rays; nothing was written",
        plan.rows.len() - num_skipped,
        campaign.lights.len(),
        rays as f64 / 1e6
    ))?;
    Ok(Outcome::Done)
}
