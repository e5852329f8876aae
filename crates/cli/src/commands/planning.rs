//! Planning, as `plan`, `generate` and `demo` share it.

use crate::exit::refuse;
use crate::ui::Ui;
use selenograph_dataset::plan::{Campaign, Plan, Planner};
use selenograph_render::Tracer;
use std::collections::BTreeMap;

/// Plans a campaign on a terrain.
///
/// # Errors
/// A campaign that contradicts itself, a terrain that carries none of its pairs.
pub fn make_plan(campaign: &Campaign, tracer: &Tracer<'_>, ui: &Ui) -> anyhow::Result<Plan> {
    let planner = ui.timed("look at the terrain", || Planner::new(campaign, tracer))?;
    let bar = ui.bar(planner.num_pairs(), "pairs");
    bar.set_message("planning");
    let plan = ui.timed("plan", || planner.plan(&|done| bar.set_position(done)));
    bar.finish_and_clear();
    check_carries(&plan)?;
    Ok(plan)
}

/// Refuses a plan without a single pair.
///
/// # Errors
/// Says why the places were refused.
pub fn check_carries(plan: &Plan) -> anyhow::Result<()> {
    if plan.rows.iter().any(|row| row.placed.is_some()) {
        return Ok(());
    }
    let mut reasons: BTreeMap<&str, u32> = BTreeMap::new();
    for (refusal, count) in plan.rows.iter().flat_map(|row| &row.refusals) {
        *reasons.entry(refusal.as_str()).or_default() += count;
    }
    let reasons: Vec<String> = reasons.iter().map(|(reason, count)| format!("{reason} {count}×")).collect();
    Err(refuse(
        format!("the terrain carries none of the {} pairs: {}", plan.rows.len(), reasons.join(", ")),
        "take a larger or finer terrain, lower altitudes (`*.altitude_levels_m`), or sites inside it (`sites.lat_deg`)",
    ))
}

/// Pairs without a place, one line each.
pub fn without_place(plan: &Plan) -> Vec<String> {
    plan.skipped()
        .map(|row| {
            let reasons: Vec<String> = row
                .refusals
                .iter()
                .map(|(refusal, count)| format!("{} {count}×", refusal.as_str()))
                .collect();
            format!("pair {}: no place in {} attempts ({})", row.pair_id, row.attempts, reasons.join(", "))
        })
        .collect()
}
