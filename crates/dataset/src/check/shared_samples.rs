//! The public sample pairs, whose numbers were measured by another program (`protocol.md`, section c).

use super::{CheckOptions, Code, Report, Severity, check};
use crate::check::principal_point::Verdict;
use std::path::{Path, PathBuf};

fn shared() -> PathBuf {
    std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        |root| {
            let root = PathBuf::from(root);
            // Relative to the workspace's root, wherever the test runs.
            if root.is_absolute() {
                root
            } else {
                Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(root)
            }
        },
    )
}

/// The sample folders `<trajectory>_<n>`, each checked.
fn reports() -> Vec<(String, Report)> {
    let root = shared().join("data/stereolunar");
    let Ok(entries) = std::fs::read_dir(&root) else { return Vec::new() };
    let mut found: Vec<_> = entries
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.is_dir())
        .map(|path| {
            let report = check(&path, &CheckOptions { step: 1, ..CheckOptions::default() }).unwrap();
            (path.file_name().unwrap().to_string_lossy().into_owned(), report)
        })
        .collect();
    found.sort_by(|a, b| a.0.cmp(&b.0));
    found
}

/// A row of the table: first image, altitudes, latitude, longitude, centre depths, mean depths, absent pixels, GSDs,
/// baseline, rotation, tilts, overlaps, errors with and without half a pixel.
struct Row {
    first: &'static str,
    altitude_m: [f64; 2],
    place_deg: [f64; 2],
    center_m: [f64; 2],
    mean_m: [f64; 2],
    num_absent: [usize; 2],
    gsd_m: [f64; 2],
    baseline_m: f64,
    rotation_deg: f64,
    tilt_deg: [f64; 2],
    overlap: [f64; 2],
    error: f64,
    error_integer: f64,
}

const TABLE: [Row; 3] = [
    Row {
        first: "im_00594",
        altitude_m: [30_646.0, 30_646.0],
        place_deg: [-88.86, 280.3],
        center_m: [30_640.0, 30_864.0],
        mean_m: [30_617.0, 30_662.0],
        num_absent: [0, 0],
        gsd_m: [49.5, 49.6],
        baseline_m: 2165.0,
        rotation_deg: 2.87,
        tilt_deg: [0.80, 2.94],
        overlap: [0.92, 0.92],
        error: 1.4e-4,
        error_integer: 1.4e-4,
    },
    Row {
        first: "im_00432",
        altitude_m: [24_774.0, 24_577.0],
        place_deg: [-88.19, 105.5],
        center_m: [34_112.0, 27_216.0],
        mean_m: [37_885.0, 28_561.0],
        num_absent: [869, 0],
        gsd_m: [61.3, 46.2],
        baseline_m: 11_337.0,
        rotation_deg: 17.89,
        tilt_deg: [45.25, 29.45],
        overlap: [0.52, 1.00],
        error: 1.8e-4,
        error_integer: 3.6e-4,
    },
    Row {
        first: "im_01194",
        altitude_m: [36_960.0, 27_936.0],
        place_deg: [-87.97, 149.9],
        center_m: [38_560.0, 28_112.0],
        mean_m: [38_238.0, 28_193.0],
        num_absent: [0, 0],
        gsd_m: [61.9, 45.6],
        baseline_m: 12_713.0,
        rotation_deg: 119.13,
        tilt_deg: [13.65, 8.94],
        overlap: [0.54, 0.94],
        error: 1.8e-4,
        error_integer: 2.6e-4,
    },
];

fn near(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found}, expected {expected}");
}

#[test]
fn shared_samples_give_the_published_numbers() {
    let mut num_compared = 0;
    for (folder, report) in reports() {
        for pair in &report.pairs {
            let Some(row) = TABLE.iter().find(|row| pair.name.ends_with(row.first)) else { continue };
            num_compared += 1;
            // Half a unit of the last digit printed.
            for (i, view) in pair.views.iter().enumerate() {
                near(view.altitude_above_sphere_m, row.altitude_m[i], 0.6, "altitude");
                // Which of the four middle pixels was printed is not said: one step of half float.
                let step_m = 2f64.powi(row.center_m[i].log2().floor() as i32 - 10);
                near(view.center_depth_z_m.unwrap(), row.center_m[i], step_m, "centre depth");
                near(view.mean_depth_z_m, row.mean_m[i], 0.6, "mean depth");
                near(view.gsd_m, row.gsd_m[i], 0.06, "GSD");
                near(view.tilt_deg, row.tilt_deg[i], 0.006, "tilt");
                assert_eq!(view.num_absent, row.num_absent[i], "{folder}");
            }
            near(pair.views[0].latitude_deg, row.place_deg[0], 0.006, "latitude");
            near(pair.views[0].longitude_deg, row.place_deg[1], 0.06, "longitude");
            near(pair.baseline_m, row.baseline_m, 0.6, "baseline");
            near(pair.relative_rotation_deg, row.rotation_deg, 0.006, "rotation");
            let warp = pair.reprojection.unwrap();
            near(warp.overlap_a_in_b, row.overlap[0], 0.006, "overlap 1 → 2");
            near(warp.overlap_b_in_a, row.overlap[1], 0.006, "overlap 2 → 1");
            near(warp.median_relative_error, row.error, 1e-5, "error");
            let integer = pair.reprojection_half_pixel.unwrap();
            near(integer.median_relative_error, row.error_integer, 1e-5, "error with integer centres");
        }
    }
    if num_compared == 0 {
        eprintln!("SKIP shared-data: none of the tabled sample pairs is there");
        return;
    }
    println!("RAN shared-data: shared_samples_give_the_published_numbers ({num_compared} pairs)");
}

#[test]
fn shared_samples_are_half_float_and_corner_based_where_geometry_tells() {
    let reports = reports();
    if reports.is_empty() {
        eprintln!("SKIP shared-data: no folder data/stereolunar");
        return;
    }
    for (folder, report) in &reports {
        let point = report.principal_point.as_ref().unwrap();
        let told = point.verdict;
        println!("{folder}: {point}, separation {:.1} sigma", point.separation_sigma);
        let expected: &[Verdict] = if folder.starts_with("nadir") {
            &[Verdict::CannotTell, Verdict::AsTold]
        } else {
            &[Verdict::AsTold]
        };
        assert!(expected.contains(&told), "{folder}: {point:?}");
        assert!(report.findings.iter().any(|finding| finding.code == Code::HalfFloatDepth), "{report}");
        let wrong = [
            Code::RangeAsDepth,
            Code::FlippedPose,
            Code::NotARotation,
            Code::Inconsistent,
            Code::LightsDiffer,
        ];
        assert!(!report.findings.iter().any(|finding| wrong.contains(&finding.code)), "{report}");
        assert!(report.findings.iter().all(|f| f.severity < Severity::Error || f.code == Code::MissingFile));
    }
    println!("RAN shared-data: shared_samples_are_half_float_and_corner_based_where_geometry_tells");
}
