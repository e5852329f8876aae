//! `plan`: a campaign on a terrain as a table.

use super::planning::{make_plan, without_place};
use crate::args::campaign::Plan;
use crate::exit::Outcome;
use crate::settings::Layers;
use crate::target::{self, Draft};
use crate::ui::Ui;
use selenograph_render::Tracer;
use selenograph_terrain::Terrain;
use serde::Serialize;

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
    // Finds out before the work whether the target can be written.
    drop(Draft::new(&args.target.out, args.target.force)?);
    ui.detail(&format!("campaign:\n{}", campaign.to_toml()?));
    let terrain = Terrain::open(&args.terrain)?;
    let tracer = Tracer::new(&terrain, campaign.render.surface);
    let plan = make_plan(&campaign, &tracer, ui)?;
    target::write_file(&args.target.out, args.target.force, plan.to_csv()?.as_bytes())?;
    let skipped = without_place(&plan);
    let num_placed = plan.rows.len() - skipped.len();
    if ui.json {
        ui.data_json(&Summary { num_pairs: plan.rows.len(), num_placed, skipped: skipped.clone() })?;
    } else {
        ui.note(&format!("{num_placed} of {} pairs placed: {}", plan.rows.len(), args.target.out.display()));
    }
    Ok(if skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(skipped) })
}
