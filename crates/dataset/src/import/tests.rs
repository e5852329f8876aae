use super::*;
use crate::check::synthetic::{oblique_pair, write_own_pair};
use crate::check::{CheckOptions, Code, FolderKind, Severity, check};
use crate::export::stereolunar::{ExportOptions, export_dataset};
use crate::pair::{ImportedSuns, PairRecord, read_json};
use crate::stored::{StereoPair, own};
use selenograph_raster::codec::exr::{self, SampleType};
use std::path::PathBuf;

/// Triplets `oblique/im_00000…im_00009` of two pairs under two lights.
fn triplets(root: &Path) -> PathBuf {
    let views = oblique_pair(32);
    let own = root.join("own");
    for pair_id in 0..2 {
        write_own_pair(&own, pair_id, &views);
    }
    let out = root.join("triplets");
    let options = ExportOptions { k_convention: PixelConvention::Corner, ..ExportOptions::default() };
    export_dataset(&own, &out, None, &options, |_, _| ()).unwrap();
    out
}

fn pairs(root: &Path) -> Vec<StoredPair> {
    own(root, ReadOptions::default()).unwrap()
}

fn read_pair(pair: &StoredPair) -> (StereoPair, PairRecord) {
    let open = pair.open().unwrap();
    (open.stereo().unwrap(), open.record.unwrap())
}

/// Stores a triplet's depth as the public samples do.
fn to_half(path: &Path) {
    let mut image = exr::read(path).unwrap();
    image.channels[0].stored = SampleType::Half;
    std::fs::write(path, exr::encode(&image).unwrap()).unwrap();
}

#[test]
fn triplets_come_in_as_they_went_out() {
    let root = tempfile::tempdir().unwrap();
    let source = triplets(root.path());
    let out = root.path().join("out");
    let summary = import_dataset(&source, &out, &ImportOptions::default(), &|_, _| ()).unwrap();
    assert_eq!((summary.num_pairs, summary.num_images, summary.num_half_float), (2, 8, 0));
    assert!(summary.skipped.is_empty());
    let ids: Vec<u64> = pairs(&out).iter().map(|pair| pair.pair_id).collect();
    assert_eq!(ids, [0, 1]);
    let (pair, record) = read_pair(&pairs(&out)[1]);
    let (before, old) = read_pair(&pairs(&root.path().join("own"))[1]);
    for (a, b) in pair.views.iter().zip(&before.views) {
        assert_eq!(a.depth_z.data, b.depth_z.data);
        assert_eq!(a.camera, b.camera);
        assert!((a.world_from_cam.origin() - b.world_from_cam.origin()).norm() < 1e-9);
        // JPEG loses a little.
        assert!(a.images[1].data.iter().zip(&b.images[1].data).all(|(a, b)| a.abs_diff(*b) < 8));
        assert!(a.slope_rad.is_none() && a.lit.is_empty());
    }
    assert!((record.baseline_m - old.baseline_m).abs() < 1e-6);
    assert_eq!((record.trajectory, record.suns.clone()), (old.trajectory, vec![None, None]));
    assert!((0.3..1.0).contains(&record.overlap.a_in_b), "{:?}", record.overlap);
    let source = record.source.unwrap();
    assert_eq!((source.scene.as_str(), source.pair_id, source.lights), ("oblique", 1, vec![0, 1]));
    assert!(source.files.contains_key("im_00006.npz") && source.depth_stored == "float");
    let report = check(&out, &CheckOptions::default()).unwrap();
    assert_eq!((report.kind, report.num_pairs), (FolderKind::Selenograph, 2));
    assert_eq!(report.count(Severity::Error), 0, "{report}");
}

#[test]
fn half_float_depth_is_noted_and_told_again() {
    let root = tempfile::tempdir().unwrap();
    let source = triplets(root.path());
    for number in [0, 1, 2, 3] {
        to_half(&source.join(format!("oblique/im_{number:05}.exr")));
    }
    let out = root.path().join("out");
    let summary = import_dataset(&source, &out, &ImportOptions::default(), &|_, _| ()).unwrap();
    assert_eq!((summary.num_pairs, summary.num_half_float), (2, 1));
    let first = &pairs(&out)[0];
    let truth = exr::read(&first.place.path("a.depth_z.exr")).unwrap();
    assert_eq!((first.pair_id, truth.channel("depth_z").unwrap().stored), (0, SampleType::Float));
    assert!(truth.attributes.contains_key("note"));
    let report = check(&out, &CheckOptions::default()).unwrap();
    let half = report.findings.iter().filter(|f| f.code == Code::HalfFloatDepth).count();
    assert_eq!((half, report.count(Severity::Error)), (2, 0), "{report}");
}

#[test]
fn a_light_that_lacks_a_file_is_left_out_and_listed() {
    let root = tempfile::tempdir().unwrap();
    let source = triplets(root.path());
    let at = |name: &str| source.join("oblique").join(name);
    std::fs::remove_file(at("im_00001.npz")).unwrap();
    // A light with other geometry: depth of A for B.
    std::fs::copy(at("im_00006.exr"), at("im_00009.exr")).unwrap();
    let out = root.path().join("out");
    let options = ImportOptions { suns: ImportedSuns::Scripts, ..ImportOptions::default() };
    let summary = import_dataset(&source, &out, &options, &|_, _| ()).unwrap();
    assert_eq!((summary.num_pairs, summary.num_images), (2, 4));
    let told: Vec<String> = summary.skipped.iter().map(|skip| skip.path.display().to_string()).collect();
    assert_eq!(told.len(), 2);
    assert!(told[0].ends_with("im_00001.npz") && told[1].ends_with("im_00008, im_00009"), "{told:?}");
    let (_, record) = read_pair(&pairs(&out)[0]);
    let sun = record.suns[0].unwrap();
    assert_eq!((record.suns.len(), sun.azimuth_deg, record.source.unwrap().lights), (1, 250.0, vec![1]));
    let norm: f64 = sun.direction.iter().map(|v| v * v).sum();
    assert!((norm - 1.0).abs() < 1e-12);
    // Without a camera under either light nothing is left of the pair.
    std::fs::remove_file(at("im_00003.npz")).unwrap();
    let summary = import_dataset(&source, &root.path().join("one"), &options, &|_, _| ()).unwrap();
    assert_eq!((summary.num_pairs, summary.skipped.len()), (1, 3));
    for name in ["im_00006.npz", "im_00008.npz"] {
        std::fs::remove_file(at(name)).unwrap();
    }
    let none = import_dataset(&source, &root.path().join("none"), &options, &|_, _| ());
    assert!(matches!(none, Err(Error::Format { .. })));
    assert!(!root.path().join("none").exists());
}

#[test]
fn records_written_before_there_were_imports_are_read() {
    let root = tempfile::tempdir().unwrap();
    let folder = write_own_pair(root.path(), 0, &oblique_pair(16));
    let path = folder.join("pair.json");
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(!text.contains("\"source\"") && text.contains("\"trajectory\": \"oblique\""), "{text}");
    let record: PairRecord = read_json(&path).unwrap();
    assert!(record.source.is_none() && record.suns.iter().all(Option::is_some));
}

#[test]
fn shared_samples_are_imported_and_checked() {
    let workspace = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let shared = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(|| "../shared".into(), PathBuf::from);
    let source = workspace.join(shared).join("data/stereolunar");
    if !source.is_dir() {
        eprintln!("SKIP shared-data: no {}", source.display());
        return;
    }
    let root = tempfile::tempdir().unwrap();
    let options = ImportOptions { suns: ImportedSuns::Scripts, ..ImportOptions::default() };
    let summary = import_dataset(&source, root.path(), &options, &|_, _| ()).unwrap();
    for pair in pairs(root.path()) {
        let source = pair.open().unwrap().record.unwrap().source.unwrap();
        assert_eq!(source.suns == ImportedSuns::Scripts, !source.scene.starts_with("dynamic"));
    }
    let report = check(root.path(), &CheckOptions::default()).unwrap();
    assert_eq!((report.num_pairs, report.num_images), (summary.num_pairs, summary.num_images));
    assert_eq!(report.count(Severity::Error), 0, "{report}");
    assert_eq!(
        report.findings.iter().any(|finding| finding.code == Code::HalfFloatDepth),
        summary.num_half_float > 0
    );
    println!("RAN shared-data: shared_samples_are_imported_and_checked ({} pairs)", summary.num_pairs);
}
