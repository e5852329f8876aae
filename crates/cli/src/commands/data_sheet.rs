//! `data sheet`: contact sheets.

use super::run_record::{NO_OUTCOME, write_record};
use crate::args::data::Sheet;
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_dataset::sheet::{self, SheetOptions};
use selenograph_files::{FolderKind, record};
use serde::Serialize;
use std::path::Path;

/// Smallest thumbnail that shows anything, pixels.
const MIN_THUMBNAIL_PX: usize = 16;

pub(super) static SHEETS: FolderKind = FolderKind {
    command: "data sheet",
    what: "a folder of contact sheets",
    is_own: |folder| record::is_of(folder, SHEETS.command),
    names: &["run.toml", "sheet_#.png"],
    parts: &[],
};

#[derive(Serialize)]
struct Settings<'a> {
    dataset: &'a Path,
    pairs: usize,
    thumbnail_px: usize,
    skipped: &'a [String],
}

/// What was made.
#[derive(Serialize)]
struct Summary<'a> {
    num_pages: usize,
    skipped: &'a [String],
}

/// Writes the pages into a folder.
///
/// # Errors
/// A folder without pairs, a target that cannot be written.
pub fn run(args: &Sheet, ui: &Ui) -> anyhow::Result<Outcome> {
    if args.thumbnail_px < MIN_THUMBNAIL_PX || args.pairs == 0 {
        return Err(refuse(
            format!("{} pairs with thumbnails of {} pixels", args.pairs, args.thumbnail_px),
            format!("--pairs is at least 1, --thumbnail-px at least {MIN_THUMBNAIL_PX}"),
        ));
    }
    let draft = args.target.folder(&SHEETS)?;
    let options =
        SheetOptions { thumbnail_px: args.thumbnail_px, max_pairs: args.pairs, ..SheetOptions::default() };
    let (pages, skipped) = sheet::write(&args.dataset, draft.path(), &options)?;
    if pages.is_empty() {
        let why = skipped.into_iter().next().unwrap_or_default();
        return Err(refuse(
            format!("no pair of `{}` can be shown: {why}", args.dataset.display()),
            "`selenograph data check` explains what is wrong",
        ));
    }
    let num_pages = pages.len();
    let settings = Settings {
        dataset: &args.dataset,
        pairs: args.pairs,
        thumbnail_px: args.thumbnail_px,
        skipped: &skipped,
    };
    write_record(draft.path(), SHEETS.command, &[], &settings, NO_OUTCOME)?;
    draft.commit()?;
    if ui.json {
        ui.data_json(&Summary { num_pages, skipped: &skipped })?;
    }
    ui.note(&format!("{num_pages} page(s): {}", args.target.out.display()));
    Ok(if skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(skipped) })
}
