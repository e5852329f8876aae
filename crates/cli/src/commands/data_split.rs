//! `data split`: parts that share no ground.

use crate::args::data::Split;
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_dataset::split::{SplitOptions, footprints, split};
use selenograph_files::FileKind;

const SPLIT: FileKind = FileKind {
    command: "data split",
    what: "a split",
    is_own: |head| head.starts_with(b"{\n  \"options\": {\n    \"val_share\""),
};

/// Splits and writes the split as JSON.
///
/// # Errors
/// A dataset without pairs or that cannot be read, a target that cannot be written.
pub fn run(args: &Split, ui: &Ui) -> anyhow::Result<Outcome> {
    let target = args.target.file(&SPLIT)?;
    let footprints = footprints(&args.dataset)?;
    if footprints.is_empty() {
        return Err(refuse(
            format!("`{}` has no pairs", args.dataset.display()),
            "pass a dataset made by `selenograph generate`",
        ));
    }
    let options = SplitOptions { val_share: args.val_share, seed: args.seed, cell_m: args.cell_m };
    let split = split(&footprints, &options)?;
    let text = serde_json::to_string_pretty(&split)? + "\n";
    selenograph_files::write(target.path(), &text)?;
    if ui.json {
        ui.data(text.trim_end())?;
    } else {
        ui.note(&format!(
            "cells of {:.0} m: {} pairs to train on, {} to validate on, {} left out because they touch both: {}",
            split.cell_m,
            split.train.len(),
            split.val.len(),
            split.left_out.len(),
            args.target.out.display()
        ));
    }
    Ok(Outcome::Done)
}
