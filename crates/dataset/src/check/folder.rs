//! The files of one pair: are they there, whole, and the same under each light?

use super::dataset::Dataset;
use super::geometry::{self, GeometryCheck, Ground};
use super::numbers::PairNumbers;
use super::principal_point::Evidence;
use super::record::{self, Told};
use super::report::{Code, Finding, Severity};
use crate::Error;
use crate::pair::{PAIR_NAME, ViewName, image_name};
use crate::stored::triplets::{read_geometry, read_picture, trajectory_of};
use crate::stored::{Layout, OpenPair, RawView, StoredPair, Triplet, TripletPair};
use selenograph_geometry::{Body, PixelConvention};
use std::path::Path;

/// How to check.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckOptions {
    /// The body of triplets, whose files do not name one.
    pub body: Body,
    /// What the triplets' camera matrices are taken for; the fit then says whether that is so.
    pub k_convention: PixelConvention,
    /// Every this many pixels across and down are warped.
    pub step: usize,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self { body: Body::moon(), k_convention: PixelConvention::Corner, step: 2 }
    }
}

/// Everything known of one pair.
#[derive(Debug, Default)]
pub struct PairCheck {
    /// Its numbers.
    pub numbers: Option<PairNumbers>,
    /// Its say about principal points.
    pub evidence: Option<Evidence>,
    /// What is wrong with it.
    pub findings: Vec<Finding>,
    /// Pictures found.
    pub num_images: usize,
}

impl PairCheck {
    fn add_geometry(&mut self, geometry: GeometryCheck) {
        self.numbers = geometry.numbers;
        self.evidence = geometry.evidence;
        self.findings.extend(geometry.findings);
    }
}

fn broken(place: &Path, error: &Error) -> Finding {
    let missing = matches!(error, Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound);
    let code = if missing { Code::MissingFile } else { Code::BrokenFile };
    Finding::new(Severity::Error, code, place.display().to_string(), error.to_string())
        .hint("copy or render the file again; a truncated one reads as corrupt")
}

/// Checks one pair.
pub fn check_pair(stored: &StoredPair, dataset: Option<&Dataset>, options: &CheckOptions) -> PairCheck {
    let open = match stored.open() {
        Ok(open) => open,
        Err(error) => {
            let findings = vec![broken(&stored.place.path(PAIR_NAME), &error)];
            return PairCheck { findings, ..PairCheck::default() };
        }
    };
    match &stored.layout {
        Layout::Own => check_own(stored, &open, dataset, options),
        Layout::Triplets(pair) => check_triplets(stored, pair, options),
    }
}

/// Checks one pair of our own layout.
fn check_own(
    stored: &StoredPair,
    open: &OpenPair<'_>,
    dataset: Option<&Dataset>,
    options: &CheckOptions,
) -> PairCheck {
    let mut check = PairCheck::default();
    let name = format!("{:06}", stored.pair_id);
    check_sums(open, &mut check);
    for view in ViewName::BOTH {
        for light in open.lights() {
            check.num_images += usize::from(stored.place.has(&image_name(view, light as usize)));
        }
    }
    let mut views: Vec<RawView> = Vec::new();
    for view in ViewName::BOTH {
        match open.raw_view(view) {
            Ok(raw) => {
                let place = format!("{name} {}", view.as_str());
                check.findings.extend(geometry::check_depth(&raw, &place, f32::NAN));
                views.push(raw);
            }
            Err(error) => {
                let already_told =
                    check.findings.iter().any(|f| f.severity == Severity::Error && f.place.contains(&name));
                if !already_told {
                    check.findings.push(broken(stored.place.root(), &error));
                }
            }
        }
    }
    if let ([a, b], Some(record)) = (views.as_slice(), &open.record) {
        let ground =
            Ground { body: &record.body, site: Some(record.site.place()), trajectory: record.trajectory };
        check.add_geometry(geometry::check_pair(&name, [a, b], &ground, options.step));
        let cameras = ViewName::BOTH.map(|view| open.camera_record(view).ok().flatten());
        if let [Some(camera_a), Some(camera_b)] = cameras {
            let (cameras, views, depths) = ([camera_a, camera_b], [a, b], [&a.depth_z, &b.depth_z]);
            let told = Told { stored, open, record, cameras, views, depths, dataset };
            check.findings.extend(record::check(&told));
        }
    }
    check
}

/// Compares every file with the checksum written beside it.
fn check_sums(open: &OpenPair<'_>, check: &mut PairCheck) {
    let files = open.files_to_verify();
    for file in files.sums.iter().flat_map(|sums| sums.keys()) {
        let Err(error) = files.read(file) else { continue };
        let path = files.place.path(file);
        check.findings.push(match &error {
            Error::Changed { num_bytes, .. } => Finding::new(
                Severity::Error,
                Code::ChangedFile,
                path.display().to_string(),
                format!(
                    "its checksum is not the one in {PAIR_NAME} ({num_bytes} bytes): changed or truncated"
                ),
            )
            .hint("delete the pair's folder and resume `generate`: it is rendered again"),
            _ => broken(&path, &error),
        });
    }
}

/// Checks one pair of triplets.
fn check_triplets(stored: &StoredPair, pair: &TripletPair, options: &CheckOptions) -> PairCheck {
    let mut check = PairCheck::default();
    check_presence(stored, pair, &mut check);
    let mut views = Vec::new();
    let mut first_stem = None;
    for view in ViewName::BOTH {
        first_stem = first_stem.or(pair.triplets(view).next().map(|triplet| triplet.stem.clone()));
        if let Some(raw) = check_lights(stored, pair, view, options, &mut check) {
            let place = raw.path.display().to_string();
            check.findings.extend(geometry::check_depth(&raw, &place, f32::INFINITY));
            views.push(raw);
        }
    }
    let name = format!("{}/{}", stored.place.name(), first_stem.unwrap_or_default());
    if let [a, b] = views.as_slice() {
        let trajectory = trajectory_of(&stored.place.name());
        let ground = Ground { body: &options.body, site: None, trajectory };
        check.add_geometry(geometry::check_pair(&name, [a, b], &ground, options.step));
    }
    check
}

/// Every light needs both views, and every view three files.
fn check_presence(stored: &StoredPair, pair: &TripletPair, check: &mut PairCheck) {
    let pose_donor = |view: ViewName| {
        let donor = pair.triplets(view).find(|triplet| triplet.npz.is_some());
        donor.map(|triplet| triplet.stem.clone())
    };
    let path = |file: &str| stored.place.path(file).display().to_string();
    for (light, views) in &pair.lights {
        for (view, triplet) in ViewName::BOTH.into_iter().zip(views) {
            let Some(triplet) = triplet else {
                let place = path(&pair.stem(*light, view));
                let message = "the other view of this light is here, this one is not";
                check.findings.push(Finding::new(Severity::Error, Code::MissingFile, place, message));
                continue;
            };
            check.num_images += usize::from(triplet.jpg.is_some());
            for extension in triplet.missing() {
                let place = path(&format!("{}.{extension}", triplet.stem));
                let finding = Finding::new(Severity::Error, Code::MissingFile, place, "the file is missing");
                let donor = if extension == "jpg" { None } else { pose_donor(view) };
                check.findings.push(match donor {
                    Some(stem) => finding.hint(format!(
                        "the geometry is the same under every light: copy {stem}.{extension} to it"
                    )),
                    None => finding,
                });
            }
        }
    }
}

/// Reads one view under every light; the first whole one stands for it.
fn check_lights(
    stored: &StoredPair,
    pair: &TripletPair,
    view: ViewName,
    options: &CheckOptions,
    check: &mut PairCheck,
) -> Option<RawView> {
    let place = &stored.place;
    let mut first: Option<RawView> = None;
    for triplet in pair.triplets(view) {
        let (Some(exr), Some(npz)) = (&triplet.exr, &triplet.npz) else { continue };
        match read_geometry(place, [exr, npz], options.k_convention) {
            Err(error) => check.findings.push(broken(&place.path(exr), &error)),
            Ok(raw) => match &first {
                None => first = Some(raw),
                Some(first) => check.findings.extend(differing(first, &raw)),
            },
        }
    }
    for Triplet { jpg, .. } in pair.triplets(view) {
        let (Some(jpg), Some(raw)) = (jpg, &first) else { continue };
        if let Err(error) = read_picture(place, jpg, (raw.depth_z.width, raw.depth_z.height)) {
            check.findings.push(broken(&place.path(jpg), &error));
        }
    }
    first
}

fn differing(first: &RawView, other: &RawView) -> Option<Finding> {
    let bits = |raw: &RawView| raw.depth_z.data.iter().map(|z| z.to_bits()).collect::<Vec<_>>();
    let mut what = Vec::new();
    if bits(first) != bits(other) {
        what.push("depth");
    }
    if first.world_from_cam != other.world_from_cam {
        what.push("pose");
    }
    if first.k != other.k {
        what.push("camera matrix");
    }
    (!what.is_empty()).then(|| {
        let message = format!("{} differs from {}", what.join(" and "), first.path.display());
        Finding::new(Severity::Warning, Code::LightsDiffer, other.path.display().to_string(), message)
            .hint("the lights of a pair share their geometry; the images may be numbered in another way")
    })
}
