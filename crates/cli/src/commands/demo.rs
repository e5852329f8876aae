//! `demo`: a synthetic Moon, stereo pairs on it, a contact sheet. The commands of the product, one after the other.

use super::generate::{inputs, render_all};
use super::planning::make_plan;
use super::{clock::now_utc, data_sheet, dem_import, dem_synth};
use crate::args::Target;
use crate::args::campaign::Demo;
use crate::args::data::Sheet;
use crate::args::dem::{Import, Reading, Synth};
use crate::exit::Outcome;
use crate::target::Draft;
use crate::ui::Ui;
use selenograph_dataset::generate::{Existing, Options, Shard};
use selenograph_dataset::plan::Campaign;
use selenograph_render::Tracer;
use selenograph_terrain::Terrain;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Side and cell of the Moon that is made: 41 km round the pole.
const SIDE: usize = 4096;
const CELL_M: f64 = 10.0;
const CAMPAIGN: &str = include_str!("../demo.toml");

/// Makes everything below one folder.
///
/// # Errors
/// A target that cannot be written.
pub fn run(args: &Demo, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = Draft::new(&args.target.out, args.target.force)?;
    let folder = draft.path();
    std::fs::create_dir(folder)?;
    let start = Instant::now();
    let quiet = ui.without_notes();
    let at = |name: &str| folder.join(name);
    let target = |path: PathBuf| Target { out: path, force: false };

    ui.note(&format!(
        "a Moon of {} km in cells of {CELL_M} m, seed {} …",
        SIDE as f64 * CELL_M / 1000.0,
        args.seed
    ));
    let synth = Synth {
        size: SIDE,
        cell_m: CELL_M,
        seed: args.seed,
        relief: 1.0,
        crater_density: None,
        base: None,
        target: target(at("moon.tif")),
    };
    ui.timed("synthesis", || dem_synth::run(&synth, &quiet))?;
    let import =
        Import { files: vec![at("moon.tif")], reading: Reading::default(), target: target(at("terrain")) };
    ui.timed("import", || dem_import::run(&import, &quiet))?;

    let outcome = make_pairs(folder, args.seed, ui)?;

    let sheet = Sheet { dataset: at("dataset"), pairs: 64, thumbnail_px: 144, target: target(at("sheets")) };
    ui.timed("sheet", || data_sheet::run(&sheet, &quiet))?;
    draft.commit()?;
    let out = args.target.out.display();
    ui.note(&format!(
        "{:.1} s; look at {out}/sheets/sheet_000.png, then at {out}/dataset",
        start.elapsed().as_secs_f64()
    ));
    Ok(outcome)
}

fn make_pairs(folder: &Path, seed: u64, ui: &Ui) -> anyhow::Result<Outcome> {
    let campaign = Campaign { seed, ..Campaign::from_toml(CAMPAIGN)? };
    let terrain = Terrain::open(&folder.join("terrain"))?;
    let tracer = Tracer::new(&terrain, campaign.render.surface);
    ui.note(&format!("{} pairs under {} lights …", campaign.num_pairs(), campaign.lights.len()));
    let plan = make_plan(&campaign, &tracer, ui)?;
    let options = Options {
        target: folder.join("dataset"),
        existing: Existing::Refuse,
        shard: Shard::default(),
        started: Some(now_utc()),
        inputs: inputs(&folder.join("terrain"))?,
    };
    let report = render_all(&campaign, &plan, &tracer, &options, ui)?;
    let skipped: Vec<String> =
        report.skipped.iter().map(|skip| format!("pair {}: {}", skip.pair_id, skip.reason)).collect();
    Ok(if skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(skipped) })
}
