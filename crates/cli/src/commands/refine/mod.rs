//! `refine`: an elevation model sharpened by pictures of it.

mod inputs;
mod products;
mod report;

use super::figures::rms;
use super::reading;
use super::render::law;
use super::run_record::write_record;
use crate::args::refine::Refine;
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use inputs::{Pictures, SunRecord};
use selenograph_files::{FolderKind, record};
use selenograph_reconstruct::refine::{self, Octave, Quality, RefineOptions, Refined};
use selenograph_reconstruct::shading::ShadingOptions;
use serde::Serialize;
use std::path::PathBuf;

static REFINED: FolderKind = FolderKind {
    command: "refine",
    what: "a sharpened elevation model",
    is_own: |folder| record::is_of(folder, REFINED.command),
    names: &[
        "run.toml",
        "report.html",
        "refine.json",
        "dem.tif",
        "dem_sigma.tif",
        "change.tif",
        "albedo.tif",
        "residual_*.tif",
    ],
    parts: &[],
};

/// Everything that was decided before the work began.
#[derive(Serialize)]
struct Settings<'a> {
    refine: &'a RefineOptions,
    suns: Vec<SunRecord>,
}

/// `refine.json`, and what goes to stdout with --json.
#[derive(Debug, Serialize)]
pub struct Answer {
    dem: String,
    /// First column and row of the window in the file, counted in the file's cells.
    first: [usize; 2],
    /// Columns and rows of the result.
    size: [usize; 2],
    /// Side of its cells on the ground, metres.
    cell_m: f64,
    /// Side of the cells that the surface was found on, metres.
    surface_cell_m: f64,
    quality: Quality,
    /// Share of the result's cells that pictures changed.
    changed_share: f64,
    /// Cells in a picture where the surface was not found: they keep their height.
    num_lost: usize,
    /// Root mean square and largest change of what was changed, metres.
    change_rms_m: f64,
    change_max_m: f64,
    pictures: Vec<PictureAnswer>,
    notes: Vec<String>,
}

/// How a picture was explained.
#[derive(Debug, Serialize)]
struct PictureAnswer {
    picture: String,
    /// How like it a rendering of the model as given is, octave by octave, the shortest first.
    octaves: Vec<Octave>,
    /// Correlation with the rendering of the result.
    correlation: f64,
    /// Root mean square of picture less rendering, in the picture's lit mean.
    residual_rms: f64,
    /// Share of the picture's pixels that are lit and not saturated.
    lit_share: f64,
}

/// Sharpens and writes a folder; nothing is left behind where pictures do not belong to the model.
///
/// # Errors
/// Files that cannot be read, cameras without a place, another body, pictures of other ground, a target that cannot be written.
pub fn run(args: &Refine, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = args.target.folder(&REFINED)?;
    let mut reader = reading::open(&args.dem, &args.reading)?;
    let pictures = ui.timed("read pictures", || inputs::read(args, reader.info().body()))?;
    for note in &pictures.notes {
        ui.note(&format!("note: {note}"));
    }
    let options = options(args)?;
    let refined = ui.timed("shading", || refine::refine(&mut reader, &pictures.placed, &options))?;
    reader.refuse_impossible(&refined.given.heights().data)?;
    for note in &refined.notes {
        ui.note(&format!("note: {note}"));
    }
    let folder = draft.path();
    ui.timed("products", || products::write(folder, &refined, args.absent))?;
    let answer = answer(args, &pictures, &refined);
    let text = serde_json::to_string_pretty(&answer)? + "\n";
    selenograph_files::write(&folder.join("refine.json"), &text)?;
    let settings = Settings { refine: &options, suns: pictures.suns.clone() };
    let run_toml = write_record(folder, REFINED.command, &args.files(), &settings, Some(&answer))?;
    if !args.no_report {
        let page = ui.timed("report", || report::page(&pictures, &refined, &answer, &run_toml))?;
        selenograph_files::write(&folder.join("report.html"), &page)?;
    }
    ui.timed("move into place", || draft.commit())?;
    if ui.json {
        ui.data_json(&answer)?;
    }
    ui.note(&answer.sentence());
    let shown = if args.no_report { "dem.tif" } else { "report.html" };
    ui.note(&format!("{}/{shown}", args.target.out.display()));
    Ok(Outcome::Done)
}

impl Refine {
    /// Every file that is named.
    fn files(&self) -> Vec<PathBuf> {
        [&self.dem].into_iter().chain(&self.pictures).chain(&self.cameras).cloned().collect()
    }
}

fn options(args: &Refine) -> anyhow::Result<RefineOptions> {
    let length = |name: &str, given: Option<f64>| match given {
        Some(metres) if !(metres > 0.0 && metres.is_finite()) => {
            Err(refuse(format!("{name} {metres}: no such length"), "it is in metres, above zero"))
        }
        given => Ok(given),
    };
    Ok(RefineOptions {
        shading: ShadingOptions { law: law(args.law), ..ShadingOptions::default() },
        sigma_m: length("--dem-sigma-m", args.trust.dem_sigma_m)?,
        resolution_m: length("--dem-resolution-m", args.trust.dem_resolution_m)?,
        cell_m: length("--cell-m", args.cell_m)?,
        ..RefineOptions::default()
    })
}

fn answer(args: &Refine, pictures: &Pictures, refined: &Refined) -> Answer {
    let heights = &refined.heights;
    let changed: Vec<f64> = (0..heights.data.len())
        .filter(|i| refined.weight.data[*i] > 0.0)
        .map(|i| f64::from(refined.change.data[i]))
        .filter(|change| change.is_finite())
        .collect();
    let shaded = &refined.shaded;
    let of_pictures = shaded.pictures.iter().zip(&refined.octaves).zip(&shaded.compared).zip(&pictures.paths);
    let of_pictures = of_pictures.map(|(((explained, octaves), compared), path)| PictureAnswer {
        picture: path.display().to_string(),
        octaves: octaves.clone(),
        correlation: explained.correlation,
        residual_rms: rms(compared.residual().data.iter().map(|r| f64::from(*r))),
        lit_share: explained.lit_share,
    });
    Answer {
        dem: args.dem.display().to_string(),
        first: refined.first,
        size: [heights.width, heights.height],
        cell_m: refined.given.cell_m(),
        surface_cell_m: shaded.patch.cell,
        quality: refined.quality,
        changed_share: changed.len() as f64 / heights.data.len().max(1) as f64,
        num_lost: refined.num_lost,
        change_rms_m: rms(changed.iter().copied()),
        change_max_m: changed.iter().map(|c| c.abs()).fold(0.0, f64::max),
        pictures: of_pictures.collect(),
        notes: pictures.notes.iter().chain(&refined.notes).cloned().collect(),
    }
}

impl Answer {
    /// What came of it, for people.
    fn sentence(&self) -> String {
        let correlations: Vec<String> =
            self.pictures.iter().map(|p| format!("{:.3}", p.correlation)).collect();
        format!(
            "{}×{} cells of {:.3} m, {:.1} % of them changed, by {:.2} m (rms); correlation with the pictures {}",
            self.size[0],
            self.size[1],
            self.cell_m,
            100.0 * self.changed_share,
            self.change_rms_m,
            correlations.join(", ")
        )
    }
}
