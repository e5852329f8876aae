//! `reconstruct`: two pictures into terrain.

pub(super) mod inputs;
pub(super) mod known;
mod network_choice;
mod pose_file;
mod reference;
mod report;
mod scene;
mod shading;
mod suns;

use super::clock::instant;
use super::data_check::convention;
use super::network;
use super::run_record::write_record;
use crate::args::reconstruct::{ProductChoice, Reconstruct};
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use inputs::Pictures;
use reference::Reference;
use selenograph_files::{FolderKind, record};
use selenograph_pose::relative::CannotSay as Why;
use selenograph_reconstruct::evidence::FocalKnowledge;
use selenograph_reconstruct::grid::{Completed, GridOptions};
use selenograph_reconstruct::hazard::HazardOptions;
use selenograph_reconstruct::learned::{LearnedInput, LearnedOptions};
use selenograph_reconstruct::matches_file::GivenMatches;
use selenograph_reconstruct::pipeline::{
    self, Input, Options, Reconstruction, ShadingOutcome, ShadingUse, Stage, features_fail,
};
use selenograph_reconstruct::products::{self, ProductInput, ProductOptions, Products};
use selenograph_reconstruct::stereo::{Completion, StereoOptions};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;
use suns::SunRecord;

pub(super) static RECONSTRUCTION: FolderKind = FolderKind {
    command: "reconstruct",
    what: "a reconstruction",
    is_own: |folder| record::is_of(folder, RECONSTRUCTION.command),
    names: &[
        "run.toml",
        "report.html",
        "reconstruction.json",
        "pose.json",
        "products.json",
        "transform.json",
        "cloud.ply",
        "cloud.las",
        "cloud.glb",
        "pointmaps.npz",
        "matches.npz",
        "matches.csv",
        "colmap/*.txt",
        "colmap/*.bin",
        "nerfstudio/transforms.json",
        "dem.tif",
        "dem_sigma.tif",
        "slope.tif",
        "hillshade.tif",
        "hazard.tif",
        "hazard.tif.aux.xml",
        "albedo.tif",
        "albedo_sigma.tif",
        "slope_sigma.tif",
        "model_a.tif",
        "model_b.tif",
        "residual_a.tif",
        "residual_b.tif",
    ],
    parts: &[],
};

/// Everything that was decided before the work began.
#[derive(Serialize)]
struct Settings<'a> {
    pipeline: &'a Options,
    #[serde(skip_serializing_if = "Option::is_none")]
    network: Option<network_choice::Record>,
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
    /// Absent where no elevation model was named, or none of the place.
    #[serde(skip_serializing_if = "Option::is_none")]
    reference: Option<reference::Record>,
    /// Absent where it is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    sun_a: Option<SunRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sun_b: Option<SunRecord>,
    /// Absent where nobody asked for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    shading: Option<shading::Record>,
    warnings: Vec<String>,
}

/// What came of it, in `run.toml`.
#[derive(Serialize)]
struct RunOutcome<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    shading: Option<&'a shading::Record>,
}

/// Reconstructs and writes a folder; nothing is left behind where no answer can be given.
///
/// # Errors
/// Pictures, cameras or priors that cannot be read or contradict each other; a pair that cannot tell; a target that cannot be written.
pub fn run(args: &Reconstruct, ui: &Ui) -> anyhow::Result<Outcome> {
    let asked = shading::asked(args)?;
    // With shading it is decided when the Suns are known.
    let is_settled = args.method.needs_network() || asked == ShadingUse::Off;
    let network = if is_settled { network_choice(args, args.method.needs_network())? } else { None };
    if args.matches.is_some() && !args.method.takes_matches() {
        return Err(refuse(
            format!("--matches is for the methods `stereo` and `sift`, not `{}`", args.method.as_str()),
            "leave out --method, or --matches",
        ));
    }
    let draft = args.target.folder(&RECONSTRUCTION)?;
    let mut pictures = ui.timed("read pictures", || inputs::read(args))?;
    let (priors, known, mut suns) =
        ui.timed("read what is known", || known::priors(&args.known, asked != ShadingUse::Off, &pictures))?;
    let why_not = shading::settle(args, asked, &mut suns, ui)?;
    let options = options(args, asked, &pictures);
    // Features have little in common under two Suns; a network's matches may.
    let two_suns = options.shading_use(&priors) != ShadingUse::Off && priors.may_be_two_suns();
    let standby = match is_settled {
        true => None,
        false => network_choice(args, two_suns && args.matches.is_none())?,
    };
    let reference = Reference::read(args, &priors)?;
    let product_options = product_options(&args.products, args.complete);
    for note in &pictures.notes {
        ui.note(&format!("note: {note}"));
    }
    let matches = matches(args, &pictures, ui)?;
    if let (true, Some(choice)) = (args.network.dry_run, network.as_ref().or(standby.as_ref())) {
        choice.open(args, &pictures, ui)?;
        return Ok(Outcome::Done);
    }
    let ask = |choice: network_choice::Choice, pictures: &mut Pictures| {
        let checkpoint = choice.open(args, pictures, ui)?;
        choice.ask(&checkpoint, pictures, ui)
    };
    let solve = |pictures: &Pictures, said: Option<&LearnedInput>, options: &Options| {
        let input = Input { views: pictures.views.each_ref(), learned: said, matches: matches.as_ref() };
        with_stages(ui, |progress| pipeline::reconstruct(&input, &priors, options, progress))
    };
    let (said, mut network) = network.map(|choice| ask(choice, &mut pictures)).transpose()?.unzip();
    let mut found = solve(&pictures, said.as_ref(), &options);
    let open = features_fail(found.as_ref().map(|found| &found.shading));
    if let Some(choice) = standby.filter(|_| open) {
        ui.note(&format!("note: features tell too little ({}): the network is asked", why_open(&found)));
        let (said, record) = ask(choice, &mut pictures)?;
        let second = solve(&pictures, Some(&said), &shading::by_network(&options, asked));
        if found.is_err() || second.as_ref().is_ok_and(|second| second.shading.used().is_some()) {
            found = second;
        }
        network = Some(record);
    }
    let mut found = found.map_err(|error| with_network_in_mind(error, network.is_some()))?;
    if let Some(told) = pictures.told {
        found.focal = told;
        found.warnings.extend(told.warning());
    }
    for warning in &found.warnings {
        ui.note(&format!("note: {warning}"));
    }
    let folder = draft.path();
    let made = ui.timed("products", || write_products(folder, &pictures, &found, &product_options))?;
    let pose = pose_file::PoseRecord::new(&found);
    if pose.is_some() {
        write(folder, "pose.json", &pose_file::transform(&found).to_json()?)?;
    }
    ui.timed("scene", || scene::write(folder, &args.target.out, &pictures, &found))?;
    let answer = Answer {
        pictures: pictures.paths.each_ref().map(|path| path.display().to_string()),
        pose: pose.clone(),
        reference: match &reference {
            Some(reference) => reference.compared(&found, &made, ui)?,
            None => None,
        },
        sun_a: known.sun_a.clone(),
        sun_b: known.sun_b.clone(),
        shading: shading::Record::new(asked, why_not, &found, &priors),
        warnings: found.warnings.iter().map(ToString::to_string).chain(suns.notes).collect(),
    };
    write(folder, "reconstruction.json", &(serde_json::to_string_pretty(&answer)? + "\n"))?;
    let settings = Settings {
        pipeline: &options,
        network,
        products: &product_options,
        known,
        cameras: inputs::CameraSummary::new(&found),
    };
    let read: Vec<PathBuf> = args.files().into_iter().chain(suns.files).collect();
    let outcome = RunOutcome { shading: answer.shading.as_ref() };
    let outcome = answer.shading.as_ref().map(|_| &outcome);
    let run_toml = write_record(folder, RECONSTRUCTION.command, &read, &settings, outcome)?;
    if !args.products.no_report {
        let page = ui.timed("report", || {
            report::page(&report::Contents {
                pictures: &pictures,
                found: &found,
                made: &made,
                pose: pose.as_ref(),
                reference: answer.reference.as_ref(),
                shading: answer.shading.as_ref(),
                options: &product_options,
                run_toml: &run_toml,
            })
        })?;
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

/// How the network runs, where it is asked; settings of one that is not asked are refused.
fn network_choice(args: &Reconstruct, is_asked: bool) -> anyhow::Result<Option<network_choice::Choice>> {
    if is_asked {
        return network_choice::Choice::new(args).map(Some);
    }
    network::unused(&args.network)?;
    Ok(None)
}

/// The matches of a file, in place of features.
fn matches(args: &Reconstruct, pictures: &Pictures, ui: &Ui) -> anyhow::Result<Option<GivenMatches>> {
    let Some(path) = &args.matches else { return Ok(None) };
    let given = GivenMatches::read(path, pictures.sizes(), convention(args.matches_convention))?;
    ui.note(&format!("note: `{}`: {}", path.display(), given.sentence()));
    Ok(Some(given))
}

/// What features left open.
fn why_open(found: &Result<Reconstruction, selenograph_reconstruct::Error>) -> String {
    match found {
        Err(error) => error.to_string(),
        Ok(found) => match &found.shading {
            ShadingOutcome::LeftOut(why) => why.to_string(),
            ShadingOutcome::Used(_) | ShadingOutcome::NotAsked => String::new(),
        },
    }
}

/// Features are of light and shade: under another Sun they have nothing in common, and a network's matches may.
fn with_network_in_mind(error: selenograph_reconstruct::Error, is_asked: bool) -> anyhow::Error {
    use selenograph_reconstruct::Error::CannotSay;
    match &error {
        CannotSay(why @ (Why::TooFewMatches { .. } | Why::NoConsensus { .. })) if !is_asked => refuse(
            error.to_string(),
            format!(
                "{}; if the Sun stood elsewhere in one of them, give both Suns (--sun-a, --sun-b), or try `--method mast3r --points-from triangulated`",
                why.hint()
            ),
        ),
        _ => error.into(),
    }
}

fn write(folder: &Path, name: &str, text: &str) -> Result<(), selenograph_files::Error> {
    selenograph_files::write(&folder.join(name), text)
}

fn options(args: &Reconstruct, shading_use: ShadingUse, pictures: &Pictures) -> Options {
    let usual = Options::default();
    Options {
        method: args.method,
        shading_use,
        focal: if pictures.camera_known { FocalKnowledge::Known } else { FocalKnowledge::Guessed },
        stereo: StereoOptions { completion: completion(args), ..usual.stereo },
        learned: LearnedOptions {
            pose: args.learned.pose_from,
            points: args.learned.points_from,
            ..LearnedOptions::default()
        },
        ..usual
    }
    .seeded(args.seed)
}

/// What is given where nothing was measured.
fn completion(args: &Reconstruct) -> Completion {
    if args.complete { Completion::Everywhere } else { Completion::None }
}

fn product_options(choice: &ProductChoice, complete: bool) -> ProductOptions {
    let defaults = ProductOptions::default();
    let completed = if complete { Completed::Include } else { Completed::Leave };
    ProductOptions {
        grid: GridOptions { cell: choice.cell_m, completed, ..defaults.grid },
        hazard: HazardOptions {
            max_slope_deg: choice.max_slope_deg,
            max_roughness_m: choice.max_roughness_m,
            footprint_m: choice.footprint_m,
            ..defaults.hazard
        },
        nodata: choice.nodata,
        ..defaults
    }
}

fn write_products(
    folder: &Path,
    pictures: &Pictures,
    found: &Reconstruction,
    options: &ProductOptions,
) -> anyhow::Result<Products> {
    let [a, b] = &pictures.views;
    let views = [(a, 0), (b, 1)].map(|(view, k)| selenograph_reconstruct::View {
        image: view.image.clone(),
        camera: found.cameras[k].clone(),
    });
    let input = ProductInput {
        views: [&views[0], &views[1]],
        prediction: &found.prediction,
        placement: &found.placement,
        matches: Some(&found.matches),
        shaded: found.shading.used().map(|used| &used.shaded),
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
            running = Some((stage, instant()));
        }
    };
    let done = work(&mut |stage| tell(Some(stage)));
    tell(None);
    bar.finish_and_clear();
    done
}
