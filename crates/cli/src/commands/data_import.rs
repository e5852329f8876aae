//! `data import`: the paper's triplets into our layout.

use super::clock::now_utc;
use super::data_check::convention;
use crate::args::data::{Import, Suns};
use crate::exit::Outcome;
use crate::ui::Ui;
use selenograph_dataset::import::{IMPORT, ImportOptions, import_dataset};
use selenograph_dataset::pair::ImportedSuns;

/// Imports; what is left out is listed, with exit code 3.
///
/// # Errors
/// A folder without whole triplets, a target that cannot be written.
pub fn run(args: &Import, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = args.target.folder(&IMPORT)?;
    let options = ImportOptions {
        k_convention: convention(args.k_convention),
        suns: match args.suns {
            Suns::Unknown => ImportedSuns::Unknown,
            Suns::Scripts => ImportedSuns::Scripts,
        },
        started: Some(now_utc()),
        ..ImportOptions::default()
    };
    let bar = ui.bar(0, "pairs");
    let summary = import_dataset(&args.source, draft.path(), &options, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    draft.commit()?;
    if ui.json {
        ui.data_json(&summary)?;
    } else {
        ui.note(&format!(
            "{} pairs, {} images: {}",
            summary.num_pairs,
            summary.num_images,
            args.target.out.display()
        ));
        if summary.num_half_float > 0 {
            ui.note(&format!(
                "note: {} pairs hold half-float depth: slopes from it are mostly steps",
                summary.num_half_float
            ));
        }
    }
    let skipped: Vec<String> =
        summary.skipped.iter().map(|skip| format!("{}: {}", skip.path.display(), skip.reason)).collect();
    Ok(if skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(skipped) })
}
