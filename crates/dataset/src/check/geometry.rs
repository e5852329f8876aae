//! What the geometry of one pair shows, read as it is stored.

use super::numbers::{PairNumbers, moved, pair_numbers};
use super::pose::{self, BestReading, DepthReading, Reading, Stored};
use super::principal_point::{self, Evidence};
use super::report::{Code, Finding, Severity};
use super::reprojection::{DepthView, OUTLIER, symmetric};
use crate::import::triplets as import;
use crate::pair::Trajectory;
use crate::stored::RawView;
use selenograph_geometry::{Body, BodyFixed, Cam, Camera, Geodetic, Rigid3};
use selenograph_raster::codec::exr::SampleType;
use selenograph_raster::{Raster, statistics};

/// Depths that agree worse than this after warping do not belong together; half floats reach 2e-4.
const MAX_MEDIAN_RELATIVE_ERROR: f64 = 1e-3;

/// The principal point is fitted on every this many pixels at least: neighbours share their errors.
const FIT_STEP: usize = 4;

/// Numbers, evidence and findings of a pair.
#[derive(Debug, Default)]
pub struct GeometryCheck {
    /// The pair's numbers.
    pub numbers: Option<PairNumbers>,
    /// What it says about principal points; absent where something worse is wrong.
    pub evidence: Option<Evidence>,
    /// What is wrong.
    pub findings: Vec<Finding>,
}

/// The body, and what a pair is aimed at.
#[derive(Debug, Clone, Copy)]
pub struct Ground<'a> {
    /// The body.
    pub body: &'a Body,
    /// The site that the pair's record tells.
    pub site: Option<Geodetic>,
    /// How it was flown: where no site is told, it follows from that as in an import.
    pub trajectory: Option<Trajectory>,
}

impl Ground<'_> {
    /// The site that is told, or else the one that an import of the same poses would tell.
    pub fn site(&self, views: [&DepthView; 2]) -> Geodetic {
        let derived = || import::site(self.trajectory, views, self.body);
        // Optical axes that never meet have no crossing to aim at.
        let below_a = || Geodetic { height_m: 0.0, ..self.body.place(&views[0].world_from_cam.origin()) };
        self.site.unwrap_or_else(|| derived().unwrap_or_else(|_| below_a()))
    }
}

/// Checks the depth samples of one view. `marks_absent`: the value that the layout uses for absent depth.
pub fn check_depth(raw: &RawView, place: &str, absent_is: f32) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut add = |severity, code, message: String, hint: Option<String>| {
        findings.push(Finding { hint, ..Finding::new(severity, code, place, message) });
    };
    let depths = || raw.depth_z.data.iter().copied();
    let valid = || depths().filter(|z| z.is_finite() && *z > 0.0);
    let Some(median_m) = statistics::median(valid().map(f64::from)) else {
        add(Severity::Error, Code::AbsentDepth, "no pixel has depth".to_owned(), None);
        return findings;
    };
    if is_half(raw) {
        let stored = if raw.depth_stored == SampleType::Half { "stored" } else { "rounded" };
        let step_m = 2f64.powi(median_m.log2().floor() as i32 - 10);
        let message = format!("depth is {stored} as half float: steps of {step_m} m at {median_m:.0} m");
        let hint = "slopes from it are mostly steps; render again, or take slopes from the terrain";
        add(Severity::Warning, Code::HalfFloatDepth, message, Some(hint.to_owned()));
    }
    let same = |z: f32| if absent_is.is_nan() { z.is_nan() } else { z.to_bits() == absent_is.to_bits() };
    let num_wrong = depths().filter(|z| !same(*z) && (!z.is_finite() || *z <= 0.0)).count();
    if num_wrong > 0 {
        let message = format!(
            "{num_wrong} depths are zero, negative or not finite in another way than {absent_is}, which marks absent \
             depth here"
        );
        add(Severity::Error, Code::AbsentDepth, message, None);
    }
    let num_absent = depths().filter(|z| same(*z)).count();
    if num_absent > 0 && !absent_is.is_nan() {
        // Half float ends at 65 504 m.
        let saturated = is_half(raw) && valid().any(|z| z > 60_000.0);
        let hint = if saturated {
            "depth reaches the end of half float: farther ground is lost"
        } else {
            "ground without terrain data, or sky"
        };
        let message = format!("{num_absent} pixels without depth ({absent_is})");
        add(Severity::Info, Code::AbsentDepth, message, Some(hint.to_owned()));
    }
    findings
}

/// Whether every finite depth has 11 significant bits, whatever type stores it.
fn is_half(raw: &RawView) -> bool {
    const BITS_LOST: u32 = 0x1fff;
    let exact = |z: &f32| !z.is_finite() || z.to_bits() & BITS_LOST == 0;
    raw.depth_stored == SampleType::Half || raw.depth_z.data.iter().all(exact)
}

/// Checks cameras, poses and depths of a pair against each other.
pub fn check_pair(name: &str, views: [&RawView; 2], ground: &Ground<'_>, step: usize) -> GeometryCheck {
    let mut check = GeometryCheck::default();
    let mut usable = Vec::new();
    for (raw, letter) in views.iter().zip(["A", "B"]) {
        let place = format!("{name} {letter}");
        if let (Some(camera), Some(pose)) =
            (usable_camera(raw, &place, &mut check.findings), usable_pose(raw, &place, &mut check.findings))
        {
            usable.push((camera, pose, &raw.depth_z));
        }
    }
    if let [(camera_a, pose_a, depth_a), (camera_b, pose_b, depth_b)] = usable.as_slice() {
        let a = Stored { camera: camera_a, pose: pose_a, depth_values: depth_a };
        let b = Stored { camera: camera_b, pose: pose_b, depth_values: depth_b };
        compare(name, &a, &b, ground, step, &mut check);
    }
    check
}

fn usable_camera(raw: &RawView, place: &str, findings: &mut Vec<Finding>) -> Option<Camera> {
    match raw.camera() {
        Ok(camera) => Some(camera),
        Err(error) => {
            findings.push(Finding::new(Severity::Error, Code::BadCamera, place, error.to_string()));
            None
        }
    }
}

fn usable_pose(raw: &RawView, place: &str, findings: &mut Vec<Finding>) -> Option<Rigid3<BodyFixed, Cam>> {
    let Some(fault) = pose::fault(raw) else { return raw.world_from_cam().ok() };
    let message = format!("the pose is no rigid motion: {fault}");
    findings.push(Finding::new(Severity::Error, Code::NotARotation, place, message).hint(
        "the upper left 3×3 has to be a rotation (camera axes X right, Y down, Z forward), in float64",
    ));
    pose::nearest(raw)
}

fn compare(name: &str, a: &Stored, b: &Stored, ground: &Ground<'_>, step: usize, check: &mut GeometryCheck) {
    let body = ground.body;
    let best = pose::best_reading(a, b, body);
    if let Some(best) = best.filter(BestReading::is_another) {
        check.findings.extend(reading_findings(name, &best));
    } else if best.is_none_or(|best| best.as_told.is_none()) {
        check.findings.extend(lonely_findings(name, a, b, body));
    }
    let view = |stored: &Stored| (stored.camera.clone(), *stored.pose, Raster::clone(stored.depth_values));
    let [(camera_a, pose_a, depth_a), (camera_b, pose_b, depth_b)] = [view(a), view(b)];
    let view_a = DepthView { camera: &camera_a, world_from_cam: &pose_a, depth_z: &depth_a };
    let view_b = DepthView { camera: &camera_b, world_from_cam: &pose_b, depth_z: &depth_b };
    let site = ground.site([&view_a, &view_b]);
    check.numbers = pair_numbers(name, &view_a, &view_b, (body, &site), step);
    if !check.findings.is_empty() {
        return;
    }
    let Some(warp) = check.numbers.as_ref().and_then(|numbers| numbers.reprojection) else {
        let message = "the views share no ground";
        check.findings.push(Finding::new(Severity::Info, Code::NoOverlap, name, message));
        return;
    };
    let evidence = principal_point::evidence(&view_a, &view_b, step.max(FIT_STEP));
    // A shifted principal point alone can exceed the limit where pixels are large; it is judged over the folder.
    let with_offset = evidence.and_then(|evidence| {
        let [du, dv] = evidence.offset_px()?;
        let cameras = [moved(&camera_a, du, dv), moved(&camera_b, du, dv)];
        let [a, b] =
            [(view_a, &cameras[0]), (view_b, &cameras[1])].map(|(v, camera)| DepthView { camera, ..v });
        Some(symmetric(&a, &b, step.max(FIT_STEP))?.median_relative_error)
    });
    let error = with_offset.map_or(warp.median_relative_error, |e| e.min(warp.median_relative_error));
    if error <= MAX_MEDIAN_RELATIVE_ERROR {
        check.evidence = evidence;
        return;
    }
    let message = format!(
        "depths disagree after warping: median {:.1e}, {:.0} % beyond {:.1} %",
        warp.median_relative_error,
        100.0 * warp.outlier_share,
        100.0 * OUTLIER
    );
    check.findings.push(
        Finding::new(Severity::Error, Code::Inconsistent, name, message)
            .hint("camera, pose or depth belongs to another picture"),
    );
}

fn reading_findings(name: &str, best: &BestReading) -> Vec<Finding> {
    let against =
        best.as_told.map_or("no shared ground as told".to_owned(), |error| format!("{error:.1e} as told"));
    let error = format!("median difference {:.1e}, {against}", best.median_relative_error);
    let mut findings = Vec::new();
    for (reading, letter) in best.poses.iter().zip(["A", "B"]) {
        if *reading != Reading::AsTold {
            let message = format!("the pose is {} ({error})", reading.text());
            findings.push(
                Finding::new(Severity::Error, Code::FlippedPose, format!("{name} {letter}"), message)
                    .hint("store camera to world with X right, Y down, Z forward"),
            );
        }
    }
    if best.depth_reading == DepthReading::Range {
        let message = format!("depth is the distance along the ray, not along the optical axis ({error})");
        findings.push(
            Finding::new(Severity::Error, Code::RangeAsDepth, name, message)
                .hint("divide by |((u − cx)/f, (v − cy)/f, 1)| to have z-depth"),
        );
    }
    findings
}

/// Views that do not meet can still be seen to look away from the body.
fn lonely_findings(name: &str, a: &Stored, b: &Stored, body: &Body) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (view, letter) in [(a, "A"), (b, "B")] {
        if let Some(reading) = pose::lonely_reading(view, body) {
            let message = format!(
                "the ground lies far from the sphere of {:.1} km, unless the pose is {}",
                body.radius_m / 1e3,
                reading.text()
            );
            findings.push(Finding::new(
                Severity::Error,
                Code::FlippedPose,
                format!("{name} {letter}"),
                message,
            ));
        }
    }
    findings
}
