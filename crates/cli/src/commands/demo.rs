//! `demo`: a synthetic Moon, stereo pairs on it, terrain from one of them, scores of all of them. The commands of the product, one
//! after the other.

use super::clock::{instant, now_utc};
use super::generate::{inputs, render_all};
use super::planning::make_plan;
use super::{data_sheet, dem_import, dem_synth, evaluate, reconstruct};
use crate::args::Target;
use crate::args::campaign::Demo;
use crate::args::data::Sheet;
use crate::args::dem::{Import, Reading, Synth};
use crate::args::evaluate::Evaluate;
use crate::args::network::NetworkChoice;
use crate::args::reconstruct::{Cameras, Known, LearnedChoice, ProductChoice, Reconstruct};
use crate::exit::Outcome;
use crate::target::Draft;
use crate::ui::Ui;
use anyhow::Context;
use selenograph_dataset::generate::{Existing, Options, Shard};
use selenograph_dataset::plan::Campaign;
use selenograph_dataset::stored::{self, ReadOptions};
use selenograph_raster::codec::{Picture as Raw, png};
use selenograph_reconstruct::pipeline::Method;
use selenograph_render::Tracer;
use selenograph_report::{Figure, Page, Picture};
use selenograph_terrain::Terrain;
use std::path::{Path, PathBuf};

/// Side and cell of the Moon that is made: 41 km round the pole.
const SIDE: usize = 4096;
const CELL_M: f64 = 10.0;
const CAMPAIGN: &str = include_str!("../demo.toml");
/// What the pairs are judged with: ours, the truth itself, and a plane as the lower anchor.
const METHODS: [&str; 3] = ["stereo", "truth", "plane"];

/// Endings of files that name other files.
const RECORDS: [&str; 4] = ["toml", "json", "jsonl", "html"];

/// Makes everything below one folder.
///
/// # Errors
/// A target that cannot be written.
pub fn run(args: &Demo, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = Draft::new(&args.target.out, args.target.force)?;
    let folder = draft.path();
    std::fs::create_dir(folder)?;
    let start = instant();
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
    ui.note("terrain from one of them …");
    ui.timed("reconstruction", || reconstruct_one(folder, args.seed, &quiet))?;
    ui.note(&format!("all of them by {}, against the truth …", METHODS.join(", ")));
    let evaluation = Evaluate {
        dataset: at("dataset"),
        methods: METHODS.map(str::to_owned).to_vec(),
        cross_light: None,
        trajectory: Vec::new(),
        pairs: Vec::new(),
        limit: None,
        k_convention: None,
        figures: false,
        network: NetworkChoice::default(),
        target: target(at("evaluation")),
    };
    ui.timed("evaluation", || evaluate::score(&evaluation, &quiet))?;
    std::fs::write(at("report.html"), front_page(folder)?)?;
    name_final_place(folder, [folder, &args.target.out].map(|path| path.display().to_string()).each_ref())?;
    draft.commit()?;
    ui.note(&format!(
        "{:.1} s; open {}",
        start.elapsed().as_secs_f64(),
        args.target.out.join("report.html").display()
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

/// Terrain from the pictures of the first pair under its first light: cameras, the place of A and the distance to B are known, the
/// pose of B is not.
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
        complete: false,
        network: NetworkChoice::default(),
        learned: LearnedChoice::default(),
        products: ProductChoice::default(),
        seed,
        target: Target { out: folder.join("reconstruction"), force: false },
    };
    reconstruct::run(&args, ui)
}

/// Records tell where files are: after the move, not before.
fn name_final_place(folder: &Path, [draft, place]: [&String; 2]) -> anyhow::Result<()> {
    let context = |path: &Path| format!("cannot read `{}`", path.display());
    for entry in std::fs::read_dir(folder).with_context(|| context(folder))? {
        let path = entry?.path();
        if path.is_dir() {
            name_final_place(&path, [draft, place])?;
        } else if path.extension().is_some_and(|ending| RECORDS.iter().any(|record| ending == *record)) {
            let text = std::fs::read_to_string(&path).with_context(|| context(&path))?;
            if text.contains(draft) {
                std::fs::write(&path, text.replace(draft, place))?;
            }
        }
    }
    Ok(())
}

/// One page that leads to everything.
fn front_page(folder: &Path) -> anyhow::Result<String> {
    let mut page = Page::new("A synthetic Moon, and what two pictures of it tell");
    page.lead(
        "Made by `selenograph demo`: terrain, stereo pairs with their truth, a reconstruction, scores.",
    );
    page.section("Where to look").links([
        ("reconstruction/report.html", "terrain from one pair: pose, depth, slope, hazards, points to turn"),
        (
            "evaluation/report.html",
            "every pair against its truth: tables with definitions, plots, the worst pairs",
        ),
        ("dataset/", "the pairs with their truth maps"),
        ("terrain/", "the terrain that was rendered"),
    ]);
    let sheet = png::read(&folder.join("sheets/sheet_000.png"))?;
    let sheet = match sheet {
        Raw::Rgb8(raster) => raster,
        Raw::Grey8(raster) => raster.map(|v| [*v; 3]),
        Raw::Grey16(raster) => raster.map(|v| [(v >> 8) as u8; 3]),
    };
    let picture = Picture::photo(&sheet)?;
    page.section("The pairs").figure(&Figure::picture(
        &picture,
        picture.width,
        "Both views under each light.",
    ));
    Ok(page.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_name_the_place_after_the_move() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("deeper")).unwrap();
        let record = dir.path().join("deeper/run.toml");
        std::fs::write(&record, "[inputs]\n\"out/.demo.partial/a.png\" = \"1f\"\n").unwrap();
        let picture = dir.path().join("a.png");
        std::fs::write(&picture, b"\xff out/.demo.partial").unwrap();
        let [draft, place] = ["out/.demo.partial", "out/demo"].map(str::to_owned);
        name_final_place(dir.path(), [&draft, &place]).unwrap();
        assert_eq!(std::fs::read_to_string(&record).unwrap(), "[inputs]\n\"out/demo/a.png\" = \"1f\"\n");
        assert_eq!(std::fs::read(&picture).unwrap(), b"\xff out/.demo.partial");
    }
}
