//! What a check found, for programs (serde) and for people (`Display`).

use super::numbers::PairNumbers;
use super::principal_point::{PrincipalPoint, Verdict};
use serde::Serialize;
use std::fmt;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing.
    Info,
    /// Usable, with a loss.
    Warning,
    /// Wrong, or not there.
    Error,
}

/// What kind of finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Code {
    /// A file is not there.
    MissingFile,
    /// A file is there and cannot be read.
    BrokenFile,
    /// A file is not the one its pair was written with.
    ChangedFile,
    /// A pair of the plan is not there, or one is there that it does not have.
    MissingPair,
    /// A number in a record is not what it is derived from.
    Record,
    /// The depth has 11 significant bits.
    HalfFloatDepth,
    /// Depth that is infinite, NaN, zero or negative.
    AbsentDepth,
    /// The files of one view differ between the lights.
    LightsDiffer,
    /// The depth is measured along the ray.
    RangeAsDepth,
    /// The pose is no rigid motion.
    NotARotation,
    /// The pose is another one than its name says (inverse, other axes).
    FlippedPose,
    /// The camera matrix is none.
    BadCamera,
    /// Where the principal point is measured from.
    PrincipalPoint,
    /// Depth, pose and camera do not agree.
    Inconsistent,
    /// The views share no ground.
    NoOverlap,
}

/// One thing found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// What it is.
    pub code: Code,
    /// What was found, with its numbers.
    pub message: String,
    /// What to do about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
    /// File, pair or folder.
    #[serde(rename = "where")]
    pub place: String,
}

impl Finding {
    /// A finding with a hint.
    pub fn new(severity: Severity, code: Code, place: impl Into<String>, message: impl Into<String>) -> Self {
        Self { severity, code, message: message.into(), hint: None, place: place.into() }
    }

    /// With a hint.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }
}

/// Which kind of folder was checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FolderKind {
    /// Our own layout.
    Selenograph,
    /// StereoLunar triplets.
    Stereolunar,
}

/// The result of a check.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The folder.
    pub folder: String,
    /// Its layout.
    pub kind: FolderKind,
    /// Pairs looked at.
    pub num_pairs: usize,
    /// Images among them.
    pub num_images: usize,
    /// Where the principal points are measured from, fitted over all pairs; absent where no pair could be warped.
    pub principal_point: Option<PrincipalPoint>,
    /// The numbers of every pair that could be read.
    pub pairs: Vec<PairNumbers>,
    /// What was found, worst first.
    pub findings: Vec<Finding>,
}

impl Report {
    /// Number of findings of a severity.
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.severity == severity).count()
    }

    /// Whether nothing is wrong: no error and no warning.
    pub fn is_clean(&self) -> bool {
        self.findings.iter().all(|finding| finding.severity == Severity::Info)
    }
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Info => "info",
            Self::Warning => "warning",
            Self::Error => "error",
        })
    }
}

/// Findings of one kind shown in full in the text form; the rest are counted.
const SHOWN_PER_CODE: usize = 5;

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            FolderKind::Selenograph => "dataset",
            FolderKind::Stereolunar => "StereoLunar triplets",
        };
        writeln!(f, "{}: {kind}, {} pairs, {} images", self.folder, self.num_pairs, self.num_images)?;
        if let Some(point) = &self.principal_point {
            writeln!(f, "principal point: {point}")?;
        }
        let half_pixel =
            self.principal_point.as_ref().is_some_and(|point| point.verdict == Verdict::HalfPixelMore);
        write_table(f, &self.pairs, half_pixel)?;
        let mut shown = 0;
        let mut last = None;
        for (idx, finding) in self.findings.iter().enumerate() {
            shown = if last == Some((finding.severity, finding.code)) { shown + 1 } else { 0 };
            last = Some((finding.severity, finding.code));
            if shown < SHOWN_PER_CODE {
                writeln!(f, "{}: {}: {}", finding.severity, finding.place, finding.message)?;
                if let Some(hint) = &finding.hint {
                    writeln!(f, "  hint: {hint}")?;
                }
            }
            let next = self.findings.get(idx + 1).map(|finding| (finding.severity, finding.code));
            if next != last && shown >= SHOWN_PER_CODE {
                writeln!(f, "  … and {} more of this kind", shown + 1 - SHOWN_PER_CODE)?;
            }
        }
        write!(
            f,
            "{} errors, {} warnings, {} notes",
            self.count(Severity::Error),
            self.count(Severity::Warning),
            self.count(Severity::Info)
        )
    }
}

/// One line per pair; `half_pixel`: reprojected with the principal points half a pixel farther, where they really are.
fn write_table(f: &mut fmt::Formatter<'_>, pairs: &[PairNumbers], half_pixel: bool) -> fmt::Result {
    if pairs.is_empty() {
        return Ok(());
    }
    writeln!(
        f,
        "{:<18} {:>15} {:>13} {:>9} {:>6} {:>7} {:>11} {:>11} {:>17} {:>9}",
        "pair", "altitude m", "GSD m", "base m", "B/H", "rot °", "tilt °", "overlap", "rel. error", "px"
    )?;
    for pair in pairs {
        let [a, b] = &pair.views;
        write!(
            f,
            "{:<18} {:>7.0}/{:<7.0} {:>6.2}/{:<6.2} {:>9.0} {:>6.3} {:>7.2} {:>5.1}/{:<5.1} ",
            pair.name,
            a.altitude_above_sphere_m,
            b.altitude_above_sphere_m,
            a.gsd_m,
            b.gsd_m,
            pair.baseline_m,
            pair.baseline_over_height,
            pair.relative_rotation_deg,
            a.tilt_deg,
            b.tilt_deg
        )?;
        match if half_pixel { &pair.reprojection_half_pixel } else { &pair.reprojection } {
            Some(r) => writeln!(
                f,
                "{:>5.2}/{:<5.2} {:>8.1e} ({:>5.2}%) {:>9.4}",
                r.overlap_a_in_b,
                r.overlap_b_in_a,
                r.median_relative_error,
                100.0 * r.outlier_share,
                r.median_px
            )?,
            None => writeln!(f, "{:>11}", "none")?,
        }
    }
    Ok(())
}
