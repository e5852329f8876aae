//! The files of one pair: are they there, whole, and the same under each light?

use super::CheckOptions;
use super::geometry::{self, GeometryCheck};
use super::numbers::PairNumbers;
use super::principal_point::Evidence;
use super::report::{Code, Finding, Severity};
use crate::Error;
use crate::import::stereolunar::{Triplet, TripletPair};
use crate::import::{RawView, selenograph, stereolunar};
use crate::pair::{PAIR_NAME, PairRecord, ViewName, image_name, read_json};
use std::path::Path;

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
    let missing = matches!(error, Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound)
        || matches!(error, Error::Raster(selenograph_raster::Error::Io { source, .. })
            if source.kind() == std::io::ErrorKind::NotFound);
    let code = if missing { Code::MissingFile } else { Code::BrokenFile };
    Finding::new(Severity::Error, code, place.display().to_string(), error.to_string())
        .hint("copy or render the file again; a truncated one reads as corrupt")
}

/// Checks one pair of our own layout.
pub fn check_own(pair_id: u64, folder: &Path, options: &CheckOptions) -> PairCheck {
    let mut check = PairCheck::default();
    let name = format!("{pair_id:06}");
    let record: PairRecord = match read_json(&folder.join(PAIR_NAME)) {
        Ok(record) => record,
        Err(error) => {
            check.findings.push(broken(&folder.join(PAIR_NAME), &error));
            return check;
        }
    };
    check_sums(folder, &record, &mut check);
    for view in ViewName::BOTH {
        for light_idx in 0..record.suns.len() {
            check.num_images += usize::from(folder.join(image_name(view, light_idx)).is_file());
        }
    }
    let mut views: Vec<RawView> = Vec::new();
    for view in ViewName::BOTH {
        match selenograph::read_raw_view(folder, view) {
            Ok((raw, _)) => {
                let place = format!("{name} {}", view.as_str());
                check.findings.extend(geometry::check_depth(&raw, &place, f32::NAN));
                views.push(raw);
            }
            Err(error) => {
                let already_told =
                    check.findings.iter().any(|f| f.severity == Severity::Error && f.place.contains(&name));
                if !already_told {
                    check.findings.push(broken(folder, &error));
                }
            }
        }
    }
    if let [a, b] = views.as_slice() {
        check.add_geometry(geometry::check_pair(&name, [a, b], &record.body, options.step));
    }
    check
}

/// Compares every file with the checksum written beside it.
fn check_sums(folder: &Path, record: &PairRecord, check: &mut PairCheck) {
    for (file, sum) in &record.files {
        let path = folder.join(file);
        let finding = match std::fs::read(&path) {
            Err(source) => broken(&path, &Error::Io { action: "read", path: path.clone(), source }),
            Ok(bytes) if blake3::hash(&bytes).to_hex().as_str() != sum => Finding::new(
                Severity::Error,
                Code::ChangedFile,
                path.display().to_string(),
                format!(
                    "its checksum is not the one in {PAIR_NAME} ({} bytes): changed or truncated",
                    bytes.len()
                ),
            )
            .hint("delete the pair's folder and resume `generate`: it is rendered again"),
            Ok(_) => continue,
        };
        check.findings.push(finding);
    }
}

/// Checks one pair of triplets.
pub fn check_triplets(scene: &Path, pair: &TripletPair, options: &CheckOptions) -> PairCheck {
    let mut check = PairCheck::default();
    let scene_name = scene.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    check_presence(scene, pair, &mut check);
    let mut views = Vec::new();
    let mut first_stem = None;
    for view_idx in 0..2 {
        let triplets: Vec<&Triplet> =
            pair.lights.values().filter_map(|light| light[view_idx].as_ref()).collect();
        first_stem = first_stem.or(triplets.first().map(|triplet| triplet.stem.clone()));
        if let Some(raw) = check_lights(&triplets, options, &mut check) {
            let place = raw.path.display().to_string();
            check.findings.extend(geometry::check_depth(&raw, &place, f32::INFINITY));
            views.push(raw);
        }
    }
    let name = format!("{scene_name}/{}", first_stem.unwrap_or_default());
    if let [a, b] = views.as_slice() {
        check.add_geometry(geometry::check_pair(&name, [a, b], &options.body, options.step));
    }
    check
}

/// Every light needs both views, and every view three files.
fn check_presence(scene: &Path, pair: &TripletPair, check: &mut PairCheck) {
    let pose_donor = |view_idx: usize| {
        let mut views = pair.lights.values().filter_map(|light| light[view_idx].as_ref());
        views.find(|triplet| triplet.npz.is_some()).map(|triplet| triplet.stem.clone())
    };
    for (light_idx, light) in &pair.lights {
        for (view_idx, triplet) in light.iter().enumerate() {
            let Some(triplet) = triplet else {
                let number = 2 * (pair.pair_id * stereolunar::LIGHTS_PER_PAIR + light_idx) + view_idx as u64;
                let place = scene.join(stereolunar::stem(number)).display().to_string();
                let message = "the other view of this light is here, this one is not";
                check.findings.push(Finding::new(Severity::Error, Code::MissingFile, place, message));
                continue;
            };
            check.num_images += usize::from(triplet.jpg.is_some());
            for extension in triplet.missing() {
                let place = scene.join(format!("{}.{extension}", triplet.stem)).display().to_string();
                let finding = Finding::new(Severity::Error, Code::MissingFile, place, "the file is missing");
                let donor = if extension == "jpg" { None } else { pose_donor(view_idx) };
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
fn check_lights(triplets: &[&Triplet], options: &CheckOptions, check: &mut PairCheck) -> Option<RawView> {
    let mut first: Option<RawView> = None;
    for triplet in triplets {
        let (Some(exr), Some(npz)) = (&triplet.exr, &triplet.npz) else { continue };
        match stereolunar::read_raw_view(exr, npz, options.k_convention) {
            Err(error) => check.findings.push(broken(exr, &error)),
            Ok(raw) => match &first {
                None => first = Some(raw),
                Some(first) => check.findings.extend(differing(first, &raw)),
            },
        }
    }
    for triplet in triplets {
        let (Some(jpg), Some(raw)) = (&triplet.jpg, &first) else { continue };
        if let Err(error) = stereolunar::read_image(jpg, raw.depth_z.width, raw.depth_z.height) {
            check.findings.push(broken(jpg, &error));
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
