//! `plan`: a campaign on a terrain as a table.

use super::planning::{make_plan, without_place};
use crate::args::campaign::Plan;
use crate::exit::Outcome;
use crate::settings::Layers;
use crate::ui::Ui;
use selenograph_files::FileKind;
use selenograph_render::Tracer;
use selenograph_terrain::Terrain;
use serde::Serialize;

const PLAN: FileKind =
    FileKind { command: "plan", what: "a plan", is_own: |head| head.starts_with(b"pair_id,trajectory,") };

#[derive(Serialize)]
struct Summary {
    num_pairs: usize,
    num_placed: usize,
    skipped: Vec<String>,
}

/// Plans and writes the table.
///
/// # Errors
/// A campaign or terrain that cannot be read, a terrain that carries no pair, a target that cannot be written.
pub fn run(args: &Plan, ui: &Ui) -> anyhow::Result<Outcome> {
    let campaign = Layers::from_choice(&args.choice)?.campaign()?;
    let target = args.target.file(&PLAN)?;
    ui.detail(&format!("campaign:\n{}", campaign.to_toml()?));
    let terrain = Terrain::open(&args.terrain)?;
    let tracer = Tracer::new(&terrain, campaign.render.surface);
    let plan = make_plan(&campaign, &tracer, ui)?;
    selenograph_files::write(target.path(), plan.to_csv()?)?;
    let skipped = without_place(&plan);
    let num_placed = plan.rows.len() - skipped.len();
    if ui.json {
        ui.data_json(&Summary { num_pairs: plan.rows.len(), num_placed, skipped: skipped.clone() })?;
    } else {
        ui.note(&format!("{num_placed} of {} pairs placed: {}", plan.rows.len(), args.target.out.display()));
    }
    Ok(if skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(skipped) })
}
