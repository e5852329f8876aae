//! `reconstruct`: two pictures into terrain.

mod inputs;
mod known;
mod learned;
mod pose_file;
mod report;

use super::clock::now_utc;
use super::network;
use super::run_record::{RunRecord, checksums};
use crate::args::reconstruct::{Method, ProductChoice, Reconstruct};
use crate::exit::{Outcome, refuse};
use crate::target::Draft;
use crate::ui::Ui;
use anyhow::Context;
use inputs::Pictures;
use selenograph_pose::relative::CannotSay as Why;
use selenograph_reconstruct::grid::{Completed, GridOptions};
use selenograph_reconstruct::hazard::HazardOptions;
use selenograph_reconstruct::pipeline::{self, Completion, FocalKnowledge, Options, Reconstruction, Stage};
use selenograph_reconstruct::products::{self, PixelMatch, ProductInput, ProductOptions, Products};
use selenograph_reconstruct::relative_pose::SiftOptions;
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Everything that was decided before the work began.
#[derive(Serialize)]
struct Settings<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    pipeline: Option<&'a Options>,
    #[serde(skip_serializing_if = "Option::is_none")]
    learned: Option<learned::Record>,
    products: &'a ProductOptions,
    known: known::Summary,
    cameras: inputs::CameraSummary,
}

/// `reconstruction.json`, and what goes to stdout with --json.
#[derive(Serialize)]
struct Answer {
    pictures: [String; 2],
    /// Absent where none was asked for.
    pose: Option<pose_file::PoseRecord>,
    warnings: Vec<String>,
}

/// Reconstructs and writes a folder; nothing is left behind where no answer can be given.
///
/// # Errors
/// Pictures, cameras or priors that cannot be read or contradict each other; a pair that cannot tell; a target that cannot be written.
pub fn run(args: &Reconstruct, ui: &Ui) -> anyhow::Result<Outcome> {
    let learned = match args.method {
        Method::Mast3r | Method::Mast3rStereo => Some(learned::Choice::new(args)?),
        Method::Sift | Method::Stereo => network::unused(&args.network).map(|()| None)?,
    };
    let draft = Draft::new(&args.target.out, args.target.force)?;
    let mut pictures = ui.timed("read pictures", || inputs::read(args))?;
    let (priors, known) = ui.timed("read what is known", || known::priors(&args.known, pictures.sizes()))?;
    let options = options(args, &pictures);
    let product_options = product_options(&args.products, options.completion);
    for note in &pictures.notes {
        ui.note(&format!("note: {note}"));
    }
    let (found, learned) = match learned {
        Some(choice) => {
            let checkpoint = choice.open(args, &pictures, ui)?;
            if args.network.dry_run {
                return Ok(Outcome::Done);
            }
            with_stages(ui, |progress| {
                let found = choice.reconstruct(&checkpoint, &mut pictures, &priors, &options, progress, ui);
                found.map(|(found, record)| (found, Some(record)))
            })?
        }
        None => {
            let [a, b] = &pictures.views;
            let found = with_stages(ui, |progress| pipeline::reconstruct(a, b, &priors, &options, progress));
            (found.map_err(with_network_in_mind)?, None)
        }
    };
    for warning in &found.warnings {
        ui.note(&format!("note: {warning}"));
    }
    let folder = draft.path();
    std::fs::create_dir(folder).with_context(|| format!("cannot make the folder `{}`", folder.display()))?;
    let made = ui.timed("products", || write_products(folder, &pictures, &found, &product_options))?;
    let pose = pose_file::PoseRecord::new(&found);
    if pose.is_some() {
        write(folder, "pose.json", &pose_file::transform(&found).to_json()?)?;
    }
    let answer = Answer {
        pictures: pictures.paths.each_ref().map(|path| path.display().to_string()),
        pose: pose.clone(),
        warnings: found.warnings.iter().map(ToString::to_string).collect(),
    };
    write(folder, "reconstruction.json", &(serde_json::to_string_pretty(&answer)? + "\n"))?;
    let settings = Settings {
        pipeline: (args.method != Method::Mast3r).then_some(&options),
        learned,
        products: &product_options,
        known,
        cameras: inputs::CameraSummary::new(&found),
    };
    let record = RunRecord::new("reconstruct", now_utc(), checksums(&args.files())?, &settings);
    let run_toml = record.to_toml()?;
    write(folder, "run.toml", &run_toml)?;
    if !args.products.no_report {
        let page = ui.timed("report", || report::page(&pictures, &found, &made, pose.as_ref(), &run_toml))?;
        write(folder, "report.html", &page)?;
    }
    ui.timed("move into place", || draft.commit())?;
    if ui.json {
        ui.data_json(&answer)?;
    }
    if let Some(pose) = &pose {
        ui.note(&pose.sentence());
    }
    let shown = if args.products.no_report { "products.json" } else { "report.html" };
    ui.note(&format!("{}/{shown}", args.target.out.display()));
    Ok(Outcome::Done)
}

/// Features are of light and shade: under another Sun they have nothing in common, and a network's matches may.
fn with_network_in_mind(error: selenograph_reconstruct::Error) -> anyhow::Error {
    use selenograph_reconstruct::Error::CannotSay;
    match &error {
        CannotSay(why @ (Why::TooFewMatches { .. } | Why::NoConsensus { .. })) => refuse(
            error.to_string(),
            format!(
                "{}; if the Sun stood elsewhere in one of them, try `--method mast3r --points-from triangulated`",
                why.hint()
            ),
        ),
        _ => error.into(),
    }
}

fn write(folder: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    std::fs::write(folder.join(name), text).with_context(|| format!("cannot write `{name}`"))
}

fn options(args: &Reconstruct, pictures: &Pictures) -> Options {
    Options {
        method: match args.method {
            Method::Sift => pipeline::Method::Sift,
            Method::Stereo | Method::Mast3r | Method::Mast3rStereo => pipeline::Method::Stereo,
        },
        completion: if args.complete { Completion::Smooth } else { Completion::Absent },
        focal: if pictures.camera_known { FocalKnowledge::Known } else { FocalKnowledge::Guessed },
        sift: SiftOptions { seed: args.seed, ..SiftOptions::default() },
        ..Options::default()
    }
}

fn product_options(choice: &ProductChoice, completion: Completion) -> ProductOptions {
    let defaults = ProductOptions::default();
    let completed = if completion == Completion::Smooth { Completed::Include } else { Completed::Leave };
    ProductOptions {
        grid: GridOptions { cell: choice.cell_m, completed, ..defaults.grid },
        hazard: HazardOptions {
            max_slope_deg: choice.max_slope_deg,
            max_roughness_m: choice.max_roughness_m,
            footprint_m: choice.footprint_m,
            ..defaults.hazard
        },
        ..defaults
    }
}

fn write_products(
    folder: &Path,
    pictures: &Pictures,
    found: &Reconstruction,
    options: &ProductOptions,
) -> anyhow::Result<Products> {
    let matches: Vec<PixelMatch> = found
        .matches
        .iter()
        .map(|m| PixelMatch {
            a: [m.a.x, m.a.y],
            b: [m.b.x, m.b.y],
            score: m.sigma_px.map_or(0.0, |sigma| -sigma),
            inlier: m.inlier,
        })
        .collect();
    let [a, b] = &pictures.views;
    let views = [(a, 0), (b, 1)].map(|(view, k)| selenograph_reconstruct::View {
        image: view.image.clone(),
        camera: found.cameras[k].clone(),
    });
    let input = ProductInput {
        views: [&views[0], &views[1]],
        prediction: &found.prediction,
        placement: &found.placement,
        matches: Some(&matches),
    };
    Ok(products::write(folder, &input, options)?)
}

/// Runs work that tells its stages: shown while they last, timed with --verbose.
fn with_stages<T>(ui: &Ui, work: impl FnOnce(&mut dyn FnMut(Stage)) -> T) -> T {
    let bar = ui.bar(0, "stages");
    let mut running: Option<(Stage, Instant)> = None;
    let mut tell = |stage: Option<Stage>| {
        if let Some((done, start)) = running.take() {
            bar.inc(1);
            ui.detail(&format!("time: {} {:.3} s", done.as_str(), start.elapsed().as_secs_f64()));
        }
        if let Some(stage) = stage {
            bar.set_length(bar.position() + 1);
            bar.set_message(stage.as_str());
            bar.tick();
            running = Some((stage, Instant::now()));
        }
    };
    let done = work(&mut |stage| tell(Some(stage)));
    tell(None);
    bar.finish_and_clear();
    done
}
