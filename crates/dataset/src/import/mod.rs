//! StereoLunar triplets into our own dataset layout, so that every tool reads them: float32 depth, poses with their words,
//! lossless copies of the pictures, and a note of where each came from.
//!
//! A light that lacks a file, or whose geometry is not that of the others, is left out and listed; nothing is invented
//! that the triplets do not hold (normals, slopes, shadow masks, exposures).

mod options;
pub(crate) mod triplets;

pub use options::ImportOptions;

use crate::Error;
use crate::generate::folder::{PAIRS, write_pair};
use crate::pair::ImportedSuns;
use crate::photometric::Skipped;
use crate::stored::{self, ReadOptions, StoredPair, TripletPair};
use rayon::prelude::*;
use selenograph_files::FolderKind;
use selenograph_files::record::{self, RUN_NAME, RunRecord};
use selenograph_geometry::{Body, PixelConvention};
use serde::Serialize;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What an import has written.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct ImportSummary {
    /// Pairs written.
    pub num_pairs: usize,
    /// Pictures among them.
    pub num_images: usize,
    /// Pairs whose depth was stored as half float.
    pub num_half_float: usize,
    /// What was left out.
    pub skipped: Vec<Skipped>,
}

/// Imports a folder of triplets, or the folders in it, into `out`, which need not exist. Pairs are numbered
/// through all folders in order; a pair that is left out leaves its number free.
///
/// # Errors
/// [`Error::Format`] if there is nothing to import, [`Error::Io`] in writing. What is wrong with a pair is in the summary.
pub fn import_dataset(
    source: &Path,
    out: &Path,
    options: &ImportOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<ImportSummary, Error> {
    let found = stored::find(source, ReadOptions::with_convention(options.k_convention))?;
    let all: Vec<(&StoredPair, &TripletPair)> =
        found.iter().filter_map(|pair| Some((pair, pair.triplets()?))).collect();
    let jobs: Vec<_> = (0..).zip(all).collect();
    let num_done = AtomicUsize::new(0);
    let results: Vec<ImportSummary> = jobs
        .par_iter()
        .map(|&(pair_id, (stored, pair))| {
            let mut summary = ImportSummary::default();
            if let Some(pair) = triplets::read(&stored.place, pair, options, &mut summary.skipped) {
                write_pair(out, pair_id, &pair.encode(pair_id, options)?)?;
                summary.num_pairs = 1;
                summary.num_images = pair.num_images();
                summary.num_half_float = usize::from(pair.is_half());
            }
            progress(num_done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
            Ok(summary)
        })
        .collect::<Result<_, Error>>()?;
    let mut summary = ImportSummary::default();
    for one in results {
        summary.num_pairs += one.num_pairs;
        summary.num_images += one.num_images;
        summary.num_half_float += one.num_half_float;
        summary.skipped.extend(one.skipped);
    }
    if summary.num_pairs == 0 {
        let found = match summary.skipped.first() {
            Some(skip) => format!("none: {}: {}", skip.path.display(), skip.reason),
            None => "none".into(),
        };
        return Err(Error::unexpected(
            source,
            "whole triplets `im_NNNNN.jpg/.exr/.npz` here or in folders below",
            found,
        ));
    }
    let settings = SettingsRecord {
        imported: "stereolunar",
        source: name_of(source),
        k_pixel_convention: options.k_convention,
        suns: options.suns,
        body: &options.body,
    };
    let mut record = RunRecord::new(COMMAND, &settings);
    record.started = options.started.as_deref();
    record.outcome = Some(&summary);
    record.write(&out.join(RUN_NAME))?;
    Ok(summary)
}

/// The folder of an import, as one that may be replaced by another.
pub static IMPORT: FolderKind = FolderKind {
    command: COMMAND,
    what: "an imported dataset",
    is_own: |folder| record::is_of(folder, COMMAND),
    names: &[RUN_NAME],
    parts: &[("pairs", &PAIRS)],
};
const COMMAND: &str = "data import";

/// The settings of an import, for its record.
#[derive(Serialize)]
struct SettingsRecord<'a> {
    imported: &'static str,
    /// The folder's name; where it lay says nothing on another machine.
    source: String,
    k_pixel_convention: PixelConvention,
    suns: ImportedSuns,
    body: &'a Body,
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests;
