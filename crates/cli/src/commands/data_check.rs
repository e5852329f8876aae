//! `data check`: what is wrong with a dataset.

use crate::args::data::{Check, KConvention};
use crate::exit::{Outcome, refuse};
use crate::target::Draft;
use crate::ui::Ui;
use selenograph_dataset::check::{CheckOptions, Severity, check};
use selenograph_dataset::photometric;
use selenograph_geometry::PixelConvention;

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
    let draft = args.out.as_deref().map(|out| Draft::new(out, args.force)).transpose()?;
    let pictures = draft.as_ref().map(Draft::path);
    if let Some(folder) = pictures {
        std::fs::create_dir(folder)?;
    }
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
