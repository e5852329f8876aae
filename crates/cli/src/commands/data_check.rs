//! `data check`: what is wrong with a dataset.

use super::run_record::{NO_OUTCOME, write_record};
use crate::args::Target;
use crate::args::data::{Check, KConvention};
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_dataset::check::{CheckOptions, Severity, check};
use selenograph_dataset::photometric;
use selenograph_files::{FolderDraft, FolderKind, record};
use selenograph_geometry::PixelConvention;
use serde::Serialize;
use std::path::Path;

static BESIDE: FolderKind = FolderKind {
    command: "data check",
    what: "a folder of pictures beside their renderings",
    is_own: |folder| record::is_of(folder, BESIDE.command),
    names: &["run.toml", "*_im_#.png"],
    parts: &[],
};

/// For the record of the pictures.
#[derive(Serialize)]
struct Settings<'a> {
    dataset: &'a Path,
    k_pixel_convention: PixelConvention,
}

/// Checks and reports; ends with exit code 1 where something is wrong (warnings alone do not).
///
/// # Errors
/// A folder that cannot be read, or has no pairs.
pub fn run(args: &Check, ui: &Ui) -> anyhow::Result<Outcome> {
    if args.render {
        return render(args, ui);
    }
    let options = CheckOptions {
        k_convention: convention(args.k_convention),
        step: args.step,
        ..CheckOptions::default()
    };
    let report = check(&args.dataset, &options)?;
    if ui.json {
        ui.data_json(&report)?;
    } else {
        ui.data(&report.to_string())?;
    }
    Ok(if report.count(Severity::Error) == 0 { Outcome::Done } else { Outcome::Faulty })
}

/// Compares the pictures of triplets with renderings of their own depth; exit code 1 where they miss the limits.
fn render(args: &Check, ui: &Ui) -> anyhow::Result<Outcome> {
    let settings = photometric::Settings {
        k_convention: convention(args.k_convention),
        ..photometric::Settings::default()
    };
    let target = args.out.clone().map(|out| Target { out, force: args.force });
    let draft = target.map(|target| target.folder(&BESIDE)).transpose()?;
    let pictures = draft.as_ref().map(FolderDraft::path);
    let bar = ui.bar(0, "pairs");
    let report = photometric::check(&args.dataset, &settings, pictures, &mut |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let mut skipped: Vec<String> =
        report.skipped.iter().map(|skip| format!("{}: {}", skip.path.display(), skip.reason)).collect();
    if report.images.is_empty() {
        let why = skipped.drain(..).next().unwrap_or_else(|| "it has no pictures".into());
        return Err(refuse(
            format!("no picture of `{}` can be compared: {why}", args.dataset.display()),
            "the scripts' Suns belong to folders named `nadir…`, `oblique…` or `pitch…`",
        ));
    }
    if let Some(draft) = draft {
        let settings = Settings { dataset: &args.dataset, k_pixel_convention: settings.k_convention };
        write_record(draft.path(), BESIDE.command, &[], &settings, NO_OUTCOME)?;
        draft.commit()?;
    }
    if ui.json {
        ui.data_json(&report)?;
    } else {
        ui.data(&report.to_string())?;
    }
    Ok(match (report.agrees, skipped.is_empty()) {
        (true, true) => Outcome::Done,
        (true, false) => Outcome::Skipped(skipped),
        (false, _) => {
            for reason in &skipped {
                ui.complain(&format!("skipped: {reason}"));
            }
            Outcome::Faulty
        }
    })
}

/// The option as the libraries name it.
pub fn convention(choice: KConvention) -> PixelConvention {
    match choice {
        KConvention::Center => PixelConvention::Center,
        KConvention::Corner => PixelConvention::Corner,
    }
}
