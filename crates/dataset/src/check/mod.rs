//! What is right and wrong with a folder of pairs: ours, or StereoLunar triplets.
//!
//! Nothing here trusts a name: depths are warped from view to view, and what agrees is what is stored.

mod dataset;
mod exposure;
mod folder;
mod geometry;
mod nadir;
pub mod numbers;
mod pose;
pub mod principal_point;
mod record;
mod report;
pub mod reprojection;
#[cfg(test)]
pub(crate) mod synthetic;

pub use folder::CheckOptions;
pub use geometry::Ground;
pub use report::{Code, Finding, FolderKind, Report, Severity};

use crate::Error;
use crate::stored::{self, ReadOptions, StoredPair};
use dataset::Dataset;
use folder::PairCheck;
use principal_point::{PrincipalPoint, Verdict};
use rayon::prelude::*;
use selenograph_geometry::PixelConvention;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Checks a dataset of ours, a folder of triplets, or the folders of one kind below a folder.
///
/// # Errors
/// [`Error::Io`] if the folder cannot be read, [`Error::Format`] if there are no pairs in it. What is wrong with the
/// pairs themselves is in the report.
pub fn check(folder: &Path, options: &CheckOptions) -> Result<Report, Error> {
    let options = &CheckOptions { step: options.step.max(1), ..options.clone() };
    // Checksums are compared file by file, each told by itself; what differs is still looked at.
    let reading = ReadOptions { k_convention: options.k_convention, verify: false };
    let found = stored::find(folder, reading)?;
    let datasets = datasets(folder, &found)?;
    let num_own = found.iter().filter(|pair| pair.triplets().is_none()).count();
    let expected = "`pairs/…` of a dataset, or `im_NNNNN.jpg/.exr/.npz` here or in folders below";
    let kind = match num_own {
        _ if found.is_empty() && !datasets.is_empty() => FolderKind::Selenograph,
        _ if found.is_empty() => return Err(Error::unexpected(folder, expected, "neither")),
        0 => FolderKind::Stereolunar,
        all if all == found.len() => FolderKind::Selenograph,
        _ => return Err(Error::unexpected(folder, expected, "both: check one after the other")),
    };
    let checks = found
        .par_iter()
        .map(|pair| folder::check_pair(pair, root_of(pair).and_then(|root| datasets.get(root)), options))
        .collect();
    let mut report = assemble(folder, kind, checks, options);
    for (root, dataset) in datasets {
        let here = found.iter().filter(|pair| root_of(pair) == Some(root.as_path()));
        report.findings.extend(dataset.check_pairs(&here.map(|pair| pair.pair_id).collect()));
        report.findings.extend(dataset.findings);
    }
    // Stable: within a kind, the order of the pairs stays.
    report.findings.sort_by_key(|finding| (std::cmp::Reverse(finding.severity), finding.code));
    Ok(report)
}

/// The datasets that pairs of ours belong to, by their folders; one without a single pair is one, too.
fn datasets(folder: &Path, found: &[StoredPair]) -> Result<BTreeMap<PathBuf, Dataset>, Error> {
    let mut roots: BTreeSet<&Path> = found.iter().filter_map(root_of).collect();
    roots.extend(Some(folder).filter(|folder| Dataset::is_at(folder)));
    roots.into_iter().map(|root| Ok((root.to_owned(), Dataset::open(root)?))).collect()
}

/// The folder of the dataset that a pair of ours lies in: three above its own.
fn root_of(pair: &StoredPair) -> Option<&Path> {
    let own = pair.triplets().is_none().then_some(pair.place.root())?;
    own.ancestors().nth(3)
}

fn assemble(folder: &Path, kind: FolderKind, checks: Vec<PairCheck>, options: &CheckOptions) -> Report {
    let evidence: Vec<_> = checks.iter().filter_map(|check| check.evidence).collect();
    let principal_point = principal_point::combine(&evidence);
    let place = folder.display().to_string();
    let mut report = Report {
        folder: place.clone(),
        kind,
        num_pairs: checks.len(),
        num_images: checks.iter().map(|check| check.num_images).sum(),
        principal_point: None,
        pairs: Vec::new(),
        findings: Vec::new(),
    };
    for check in checks {
        report.pairs.extend(check.numbers);
        report.findings.extend(check.findings);
    }
    if let Some(point) = &principal_point {
        let gsd_m = report.pairs.iter().map(|pair| pair.views[0].gsd_m).fold(0.0, f64::max);
        report.findings.extend(principal_point_finding(point, kind, &place, gsd_m, options));
    }
    report.principal_point = principal_point;
    report
}

fn principal_point_finding(
    point: &PrincipalPoint,
    kind: FolderKind,
    place: &str,
    gsd_m: f64,
    options: &CheckOptions,
) -> Option<Finding> {
    let finding = |severity, message: String| Finding::new(severity, Code::PrincipalPoint, place, message);
    let found = match (point.verdict, options.k_convention) {
        (Verdict::CannotTell, _) => {
            return Some(finding(
                Severity::Info,
                format!(
                    "cannot tell whether principal points are corner-based or centre-based: half a pixel is {:.1} \
                     sigma in this geometry",
                    point.separation_sigma
                ),
            ));
        }
        (Verdict::Other, _) => {
            return Some(
                finding(Severity::Error, format!("principal points are off: {point}"))
                    .hint("the image may have been cropped or resized without its camera matrix"),
            );
        }
        // Our own records say their convention, and have to keep it.
        (Verdict::AsTold, _) if kind == FolderKind::Selenograph => return None,
        (_, _) if kind == FolderKind::Selenograph => {
            return Some(
                finding(Severity::Error, format!("principal points are not as the records say: {point}"))
                    .hint("`k_pixel_convention` in camera.json is wrong, or the matrix was copied from elsewhere"),
            );
        }
        (Verdict::AsTold, told) => told,
        (Verdict::HalfPixelMore, _) => PixelConvention::Center,
        (Verdict::HalfPixelLess, _) => PixelConvention::Corner,
    };
    Some(match found {
        PixelConvention::Center => finding(
            Severity::Info,
            "principal points are centre-based, as OpenCV and the paper's loader take them".to_owned(),
        ),
        PixelConvention::Corner => finding(
            Severity::Warning,
            format!(
                "principal points are corner-based; a loader that back-projects whole pixel numbers is off by half \
                 a pixel, up to {:.0} m here",
                gsd_m / 2.0
            ),
        )
        .hint("take 0.5 from cx and cy for such a loader, or add 0.5 to its pixel numbers"),
    })
}

#[cfg(test)]
mod shared_samples;
#[cfg(test)]
mod tests;
