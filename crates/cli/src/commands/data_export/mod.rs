//! `data export`: the paper's triplets, a COLMAP model, nerfstudio's `transforms.json`.

mod scene;

use super::data_check::convention;
use super::run_record::{NO_OUTCOME, write_record};
use crate::args::data::{Export, ExportFormat};
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_dataset::export::stereolunar::{ExportOptions, export_dataset};
use selenograph_dataset::pair::read_json;
use selenograph_dataset::split::Split;
use selenograph_files::{FolderKind, record};
use selenograph_geometry::PixelConvention;
use serde::Serialize;
use std::path::{Path, PathBuf};

static TRIPLETS: FolderKind = FolderKind {
    command: "data export",
    what: "a folder of triplets that was exported",
    is_own: |folder| record::is_of(folder, TRIPLETS.command),
    names: &["run.toml", "all.npz", "train.npz", "val.npz", "*/im_#.jpg", "*/im_#.exr", "*/im_#.npz"],
    parts: &[],
};

/// For the record.
#[derive(Serialize)]
struct Settings<'a> {
    dataset: &'a Path,
    k_pixel_convention: PixelConvention,
}

/// Exports.
///
/// # Errors
/// A dataset without pairs, a split that cannot be read or is not for this format, a target that cannot be written.
pub fn run(args: &Export, ui: &Ui) -> anyhow::Result<Outcome> {
    if args.format == ExportFormat::Triplets {
        return triplets(args, ui);
    }
    if args.split.is_some() {
        return Err(refuse("--split is for triplets", "leave it out, or leave out --format"));
    }
    scene::run(args, ui)
}

fn triplets(args: &Export, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = args.target.folder(&TRIPLETS)?;
    let split: Option<Split> = args.split.as_deref().map(read_json).transpose()?;
    let options = ExportOptions {
        k_convention: convention(args.k_convention),
        verify: !args.no_verify,
        ..ExportOptions::default()
    };
    let bar = ui.bar(0, "pairs");
    let summary = export_dataset(&args.dataset, draft.path(), split.as_ref(), &options, |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let settings = Settings { dataset: &args.dataset, k_pixel_convention: options.k_convention };
    let read: Vec<PathBuf> = args.split.iter().cloned().collect();
    write_record(draft.path(), TRIPLETS.command, &read, &settings, NO_OUTCOME)?;
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
