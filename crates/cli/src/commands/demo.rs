//! `demo`: a synthetic Moon, stereo pairs on it, terrain from one of them, scores of all of them. The commands of the product, one
//! after the other.

mod pages;

use super::clock::{instant, now_utc};
use super::data_sheet::{self, SHEETS};
use super::generate::{inputs, render_all};
use super::planning::make_plan;
use super::reconstruct::{self, RECONSTRUCTION};
use super::run_record::{NO_OUTCOME, write_record};
use super::{dem_import, dem_synth, evaluate};
use crate::args::Target;
use crate::args::campaign::Demo;
use crate::args::data::{KConvention, Sheet};
use crate::args::dem::{Import, Reading, Synth};
use crate::args::evaluate::Evaluate;
use crate::args::network::NetworkChoice;
use crate::args::reconstruct::{Cameras, Known, LearnedChoice, ProductChoice, Reconstruct};
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use anyhow::Context;
use selenograph_dataset::generate::{DATASET, Options, Shard, take};
use selenograph_dataset::plan::Campaign;
use selenograph_dataset::stored::{self, ReadOptions};
use selenograph_evaluate::run::EVALUATION;
use selenograph_files::record::{self, RUN_NAME};
use selenograph_files::{Error, Existing, FolderKind, HeldFolder, is_occupied};
use selenograph_reconstruct::pipeline::{Method, ShadingUse};
use selenograph_render::Tracer;
use selenograph_terrain::Terrain;
use selenograph_terrain::store::TERRAIN;
use serde::Serialize;
use std::path::Path;

/// How large everything is.
struct Size {
    /// Side of the Moon that is made, cells.
    side: usize,
    /// Side of a cell, metres.
    cell_m: f64,
    /// Side of a picture, pixels; the campaign's own where there is none.
    picture_px: Option<usize>,
}

/// 41 km round the pole.
const SIZE: Size = Size { side: 4096, cell_m: 10.0, picture_px: None };
const CAMPAIGN: &str = include_str!("../demo.toml");
/// What the pairs are judged with: ours, the truth itself, and a plane as the lower anchor.
const METHODS: [&str; 3] = ["stereo", "truth", "plane"];

/// The demo's folder, as one that may be gone on with or replaced by another.
static DEMO: FolderKind = FolderKind {
    command: "demo",
    what: "a demo",
    is_own: |folder| record::is_of(folder, DEMO.command),
    names: &[RUN_NAME, "moon.tif", "report.html", "dataset.html", "terrain.html"],
    parts: &[
        ("terrain", &TERRAIN),
        ("dataset", &DATASET),
        ("sheets", &SHEETS),
        ("reconstruction", &RECONSTRUCTION),
        ("evaluation", &EVALUATION),
    ],
};

#[derive(Serialize)]
struct Settings {
    seed: u64,
}

/// For the record.
#[derive(Serialize)]
struct Made<'a> {
    skipped: &'a [String],
}

/// Makes everything below one folder, step by step; a second run goes on where the first stopped.
///
/// # Errors
/// A target that cannot be written.
pub fn run(args: &Demo, ui: &Ui) -> anyhow::Result<Outcome> {
    make(args, &SIZE, ui)
}

fn make(args: &Demo, size: &Size, ui: &Ui) -> anyhow::Result<Outcome> {
    let held = args.target.held(&DEMO)?;
    begin(&held, args)?;
    let folder = held.path();
    let start = instant();
    let quiet = ui.without_notes();
    let at = |name: &str| folder.join(name);
    let target = |name: &str| Target { out: at(name), force: false };
    // Each of these appears when it is complete.
    let is_missing = |name: &str| !at(name).exists();

    if is_missing("moon.tif") {
        ui.note(&format!(
            "a Moon of {} km in cells of {} m, seed {} …",
            size.side as f64 * size.cell_m / 1000.0,
            size.cell_m,
            args.seed
        ));
        let synth = Synth {
            size: size.side,
            cell_m: size.cell_m,
            seed: args.seed,
            relief: 1.0,
            crater_density: None,
            base: None,
            nodata: None,
            target: target("moon.tif"),
        };
        ui.timed("synthesis", || dem_synth::run(&synth, &quiet))?;
    }
    if is_missing("terrain") {
        let import =
            Import { files: vec![at("moon.tif")], reading: Reading::default(), target: target("terrain") };
        ui.timed("import", || dem_import::run(&import, &quiet))?;
    }
    let skipped = make_pairs(folder, args.seed, size, ui)?;
    if is_missing("sheets") {
        let sheet = Sheet { dataset: at("dataset"), pairs: 64, thumbnail_px: 144, target: target("sheets") };
        ui.timed("sheet", || data_sheet::run(&sheet, &quiet))?;
    }
    if is_missing("reconstruction") {
        ui.note("terrain from one of them …");
        ui.timed("reconstruction", || reconstruct_one(folder, args.seed, &quiet))?;
    }
    ui.note(&format!("all of them by {}, against the truth …", METHODS.join(", ")));
    let evaluation = Evaluate {
        dataset: at("dataset"),
        methods: METHODS.map(str::to_owned).to_vec(),
        cross_light: None,
        trajectory: Vec::new(),
        pairs: Vec::new(),
        limit: None,
        k_convention: None,
        no_verify: false,
        set: Vec::new(),
        figures: false,
        network: NetworkChoice::default(),
        target: target("evaluation"),
    };
    let scores = ui.timed("evaluation", || evaluate::score(&evaluation, &quiet))?;
    let overview = scores.map(|scores| scores.overview).unwrap_or_default();
    ui.timed("pages", || pages::write(folder, &overview))?;
    write_record(
        folder,
        DEMO.command,
        &[],
        &Settings { seed: args.seed },
        Some(&Made { skipped: &skipped }),
    )?;
    ui.note(&format!("{:.1} s; open {}", start.elapsed().as_secs_f64(), at("report.html").display()));
    Ok(if skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(skipped) })
}

/// Puts what is begun on record. A demo that is complete is gone on with no more, and one Moon is not made into another.
fn begin(held: &HeldFolder, args: &Demo) -> anyhow::Result<()> {
    held.begin()?;
    if is_occupied(held.path()) {
        let found = record::read(&held.path().join(RUN_NAME))?;
        if found.outcome.is_some() {
            return Err(Error::Exists { path: held.path().to_owned() }.into());
        }
        let seed = found.settings.get("seed").and_then(toml::Value::as_integer);
        if seed.is_none_or(|seed| u64::try_from(seed) != Ok(args.seed)) {
            return Err(refuse(
                format!("`{}` was begun with another seed", held.path().display()),
                "pass the same --seed to go on, --force to begin anew, or another --out",
            ));
        }
    }
    write_record(held.path(), DEMO.command, &[], &Settings { seed: args.seed }, NO_OUTCOME)?;
    Ok(())
}

/// The pairs that could not be made, and why.
fn make_pairs(folder: &Path, seed: u64, size: &Size, ui: &Ui) -> anyhow::Result<Vec<String>> {
    let mut campaign = Campaign { seed, ..Campaign::from_toml(CAMPAIGN)? };
    if let Some(side) = size.picture_px {
        (campaign.camera.width_px, campaign.camera.height_px) = (side, side);
    }
    let terrain = Terrain::open(&folder.join("terrain"))?;
    let tracer = Tracer::new(&terrain, campaign.render.surface);
    ui.note(&format!("{} pairs under {} lights …", campaign.num_pairs(), campaign.lights.len()));
    let plan = make_plan(&campaign, &tracer, ui)?;
    let shard = Shard::default();
    let dataset = take(&folder.join("dataset"), Existing::Resume, shard)?;
    let options = Options { shard, started: Some(now_utc()), inputs: inputs(&folder.join("terrain"))? };
    let report = render_all(&campaign, &plan, &tracer, &dataset, &options, ui)?;
    Ok(report.skipped.iter().map(|skip| format!("pair {}: {}", skip.pair_id, skip.reason)).collect())
}

/// Terrain from the pictures of the first pair under its first light: cameras, the place of A and the distance to B are known, the
/// pose of B is not. The Moon that was made is only compared with.
fn reconstruct_one(folder: &Path, seed: u64, ui: &Ui) -> anyhow::Result<Outcome> {
    let pairs = stored::own(&folder.join("dataset"), ReadOptions::default())?;
    let pair = pairs.first().context("the dataset holds no pair")?;
    let at = |name: &str| Some(pair.place.path(name));
    let args = Reconstruct {
        a: pair.place.path("a.l0.png"),
        b: pair.place.path("b.l0.png"),
        cameras: Cameras {
            camera_a: at("a.camera.json"),
            camera_b: at("b.camera.json"),
            ..Cameras::default()
        },
        known: Known {
            world_from_cam_a: at("a.camera.json"),
            baseline_m: pair.open()?.record.map(|record| record.baseline_m),
            ..Known::default()
        },
        method: Method::Stereo,
        shading: ShadingUse::Auto,
        complete: false,
        network: NetworkChoice::default(),
        learned: LearnedChoice::default(),
        products: ProductChoice { reference: Some(folder.join("moon.tif")), ..ProductChoice::default() },
        matches: None,
        matches_convention: KConvention::Corner,
        seed,
        target: Target { out: folder.join("reconstruction"), force: false },
    };
    reconstruct::run(&args, ui)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::fs;

    const SMALL: Size = Size { side: 1024, cell_m: 40.0, picture_px: Some(160) };

    /// Every file below a folder, with its bytes.
    fn contents(folder: &Path) -> BTreeMap<std::path::PathBuf, Vec<u8>> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let files = entries.flat_map(|path| match path.is_dir() {
            true => contents(&path),
            false => BTreeMap::from([(path.clone(), fs::read(&path).unwrap())]),
        });
        files.collect()
    }

    /// Without the times that stand in them, and in the pages that quote them.
    fn timeless(files: &BTreeMap<std::path::PathBuf, Vec<u8>>) -> Vec<(&Path, Option<&[u8]>)> {
        let tells_time = |path: &Path| {
            let name = path.to_string_lossy();
            ["run.toml", ".html", "summary.json"].iter().any(|ending| name.ends_with(ending))
        };
        files
            .iter()
            .map(|(path, bytes)| (path.as_path(), (!tells_time(path)).then_some(&bytes[..])))
            .collect()
    }

    #[test]
    fn a_demo_that_was_stopped_anywhere_goes_on_to_the_same_end() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("demo");
        let demo = Demo { seed: 1, target: Target { out: folder.clone(), force: false } };
        let ui = Ui::plain().without_notes();
        let made = || make(&demo, &SMALL, &ui).map(|outcome| matches!(outcome, Outcome::Done));
        assert!(made().unwrap());
        let whole = contents(&folder);
        assert!(whole.contains_key(&folder.join("report.html")));
        // The Moon took no part in the terrain, and is what it is held against.
        let found = fs::read_to_string(folder.join("reconstruction/reconstruction.json")).unwrap();
        let found: serde_json::Value = serde_json::from_str(&found).unwrap();
        assert_eq!(found["reference"]["placed_by_it"], false);
        assert!(found["reference"]["num_cells"].as_u64().unwrap() > 1000, "{found}");
        // Complete, it is left alone.
        assert!(made().unwrap_err().to_string().contains("exists"));
        // What was not there yet when it was stopped: at the pages, at the evaluation, among the pairs.
        let stops: [&[&str]; 3] = [
            &["report.html", "dataset.html", "terrain.html"],
            &["evaluation", "reconstruction"],
            &["sheets", "dataset/pairs/000/000002"],
        ];
        let mut lost: Vec<&str> = Vec::new();
        for stop in stops {
            lost.extend(stop);
            for name in &lost {
                let path = folder.join(name);
                if path.is_dir() { fs::remove_dir_all(path).unwrap() } else { fs::remove_file(path).unwrap() }
            }
            write_record(&folder, DEMO.command, &[], &Settings { seed: 1 }, NO_OUTCOME).unwrap();
            assert!(made().unwrap(), "{lost:?}");
            assert_eq!(timeless(&contents(&folder)), timeless(&whole), "{lost:?}");
            assert!(record::read(&folder.join(RUN_NAME)).unwrap().outcome.is_some());
        }
    }
}
