//! `data export`: the paper's triplets.

use super::data_check::convention;
use crate::args::data::Export;
use crate::exit::Outcome;
use crate::target::Draft;
use crate::ui::Ui;
use selenograph_dataset::export::stereolunar::{ExportOptions, export_dataset};
use selenograph_dataset::pair::read_json;
use selenograph_dataset::split::Split;

/// Exports.
///
/// # Errors
/// A dataset without pairs, a split that cannot be read, a target that cannot be written.
pub fn run(args: &Export, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = Draft::new(&args.target.out, args.target.force)?;
    let split: Option<Split> = args.split.as_deref().map(read_json).transpose()?;
    let options = ExportOptions { k_convention: convention(args.k_convention), ..ExportOptions::default() };
    let bar = ui.bar(0, "pairs");
    let summary = export_dataset(&args.dataset, draft.path(), split.as_ref(), &options, |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    draft.commit()?;
    if ui.json {
        ui.data_json(&summary)?;
    } else {
        ui.note(&format!(
            "{} pairs, {} images in {}: {}",
            summary.num_pairs,
            summary.num_images,
            summary.scenes.join(", "),
            args.target.out.display()
        ));
    }
    Ok(Outcome::Done)
}
