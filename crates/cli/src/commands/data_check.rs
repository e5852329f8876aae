//! `data check`: what is wrong with a dataset.

use crate::args::data::{Check, KConvention};
use crate::exit::Outcome;
use crate::ui::Ui;
use selenograph_dataset::check::{CheckOptions, Severity, check};
use selenograph_geometry::PixelConvention;

/// Checks and reports; ends with exit code 1 where something is wrong (warnings alone do not).
///
/// # Errors
/// A folder that cannot be read, or has no pairs.
pub fn run(args: &Check, ui: &Ui) -> anyhow::Result<Outcome> {
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

/// The option as the libraries name it.
pub fn convention(choice: KConvention) -> PixelConvention {
    match choice {
        KConvention::Center => PixelConvention::Center,
        KConvention::Corner => PixelConvention::Corner,
    }
}
