//! `data sheet`: contact sheets.

use crate::args::data::Sheet;
use crate::exit::{Outcome, refuse};
use crate::target::Draft;
use crate::ui::Ui;
use anyhow::Context;
use selenograph_dataset::sheet::{self, SheetOptions};

/// Smallest thumbnail that shows anything, pixels.
const MIN_THUMBNAIL_PX: usize = 16;

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
    let draft = Draft::new(&args.target.out, args.target.force)?;
    let options =
        SheetOptions { thumbnail_px: args.thumbnail_px, max_pairs: args.pairs, ..SheetOptions::default() };
    std::fs::create_dir(draft.path())
        .with_context(|| format!("cannot write `{}`", args.target.out.display()))?;
    let (pages, skipped) = sheet::write(&args.dataset, draft.path(), &options)?;
    if pages.is_empty() {
        let why = skipped.into_iter().next().unwrap_or_default();
        return Err(refuse(
            format!("no pair of `{}` can be shown: {why}", args.dataset.display()),
            "`selenograph data check` explains what is wrong",
        ));
    }
    let num_pages = pages.len();
    draft.commit()?;
    ui.note(&format!("{num_pages} page(s): {}", args.target.out.display()));
    Ok(if skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(skipped) })
}
