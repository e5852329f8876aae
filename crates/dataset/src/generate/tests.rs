use super::*;
use crate::check::{CheckOptions, Code, Severity, check};
use crate::covisibility::tests::warp_errors_px;
use crate::pair::{
    CameraRecord, PairRecord, ViewName, camera_name, image_name, pair_folder, read_json, truth_name,
};
use crate::plan::{Planner, rendering};
use crate::stored::{ReadOptions, StoredPair, own};
use crate::test_terrain::wide;
use selenograph_files::{Error as FilesError, Existing};
use selenograph_raster::codec::{Picture, exr, png};
use selenograph_raster::statistics::quantiles;
use selenograph_render::{Interpolation, Viewpoint};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

fn pairs(root: &Path) -> Vec<StoredPair> {
    own(root, ReadOptions::default()).unwrap()
}

fn campaign() -> Campaign {
    let mut campaign = Campaign::preset("paper-iccv2025").unwrap();
    (campaign.nadir.pairs, campaign.oblique.pairs, campaign.dynamic.pairs) = (1, 2, 1);
    (campaign.camera.width_px, campaign.camera.height_px) = (48, 40);
    campaign.limits.max_coarse_share = 1.0;
    campaign.limits.probe_rays = 8;
    campaign.render.rays_per_pixel = 16;
    campaign.lights.truncate(2);
    campaign
}

fn tracer() -> Tracer<'static> {
    Tracer::new(wide(), Interpolation::Bilinear)
}

fn planned(campaign: &Campaign) -> Plan {
    Planner::new(campaign, &tracer()).unwrap().plan(&|_| ())
}

fn options() -> Options {
    Options {
        started: Some("2026-01-02T03:04:05Z".into()),
        inputs: BTreeMap::from([("terrain".into(), "abc".into())]),
        ..Options::default()
    }
}

fn run_all(campaign: &Campaign, plan: &Plan, target: &Path, existing: Existing) -> Result<Report, Error> {
    run_shard(campaign, plan, target, existing, Shard::default())
}

fn run_shard(
    campaign: &Campaign,
    plan: &Plan,
    target: &Path,
    existing: Existing,
    shard: Shard,
) -> Result<Report, Error> {
    let folder = take(target, existing, shard)?;
    generate(campaign, plan, &tracer(), &folder, &Options { shard, ..options() }, &|_| ())
}

/// Every file below a folder with its bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    found
}

fn stored_view(folder: &Path, name: ViewName) -> (Viewpoint, Vec<f32>, CameraRecord) {
    let record: CameraRecord = read_json(&folder.join(camera_name(name))).unwrap();
    let image = exr::read(&folder.join(truth_name(name))).unwrap();
    let depth_z = image.channel("depth_z").unwrap().samples.clone();
    (Viewpoint { camera: record.camera().unwrap(), world_from_cam: record.world_from_cam() }, depth_z, record)
}

#[test]
fn a_dataset_has_all_its_files_and_they_agree_with_the_terrain() {
    let target = tempfile::tempdir().unwrap();
    let mut campaign = campaign();
    campaign.output = rendering::OutputSection { correspondence: true, angles: true };
    let plan = planned(&campaign);
    let last = AtomicU64::new(0);
    let report = generate(
        &campaign,
        &plan,
        &tracer(),
        &take(target.path(), Existing::Refuse, Shard::default()).unwrap(),
        &options(),
        &|p| {
            last.store(p.num_done, Ordering::Relaxed);
        },
    )
    .unwrap();
    assert_eq!((report.num_done, report.skipped.len()), (4, 0));
    assert_eq!(last.load(Ordering::Relaxed), 4);
    assert!(report.num_rays > 4 * 2 * 48 * 40 * 17);
    let pairs = pairs(target.path());
    assert_eq!(pairs.iter().map(|pair| pair.pair_id).collect::<Vec<_>>(), [0, 1, 2, 3]);
    for StoredPair { pair_id, place, .. } in pairs {
        let folder = place.root();
        let record: PairRecord = read_json(&folder.join("pair.json")).unwrap();
        assert_eq!(record.pair_id, pair_id);
        // Two views of: depth, correspondence, camera, and per light: picture, lit mask, angles.
        assert_eq!(record.files.len(), 2 * (3 + 2 * 3));
        for (name, sum) in &record.files {
            assert_eq!(blake3::hash(&fs::read(folder.join(name)).unwrap()).to_hex().as_str(), sum);
        }
        let (a, depth_z, camera) = stored_view(folder, ViewName::A);
        let (b, ..) = stored_view(folder, ViewName::B);
        assert_eq!(camera.valid_share, 1.0);
        let gsd = camera.gsd_m.unwrap() * 48.0 / (2.0 * 22.5f64.to_radians().tan());
        assert!(gsd / camera.altitude_over_terrain_m.unwrap() > 0.6, "{gsd}");
        let [median, p99] = quantiles(warp_errors_px(&tracer(), &a, &depth_z, &b, 1), [0.5, 0.99]).unwrap();
        assert!(median < 0.002 && p99 < 0.05, "{median} {p99}");
        assert!(record.overlap.a_in_b >= record.overlap.a_seen_by_b && record.overlap.a_seen_by_b > 0.2);
        // One gain for both views of a light.
        for pair in record.exposures.chunks(2) {
            assert_eq!((pair[0].gain, pair[0].light_idx), (pair[1].gain, pair[1].light_idx));
        }
        let Picture::Grey16(picture) = png::read(&folder.join(image_name(ViewName::A, 0))).unwrap() else {
            panic!("16 bits were asked for");
        };
        assert!(picture.data.iter().max() > Some(&30_000));
    }
    let run = fs::read_to_string(target.path().join("run.toml")).unwrap();
    for wanted in
        ["started = \"2026-01-02T03:04:05Z\"", "num_done = 4", "terrain = \"abc\"", "[settings.nadir]"]
    {
        assert!(run.contains(wanted), "{wanted}\n{run}");
    }
    let again =
        Campaign::from_toml(&fs::read_to_string(target.path().join("campaign.toml")).unwrap()).unwrap();
    assert_eq!(again, campaign);
    assert_eq!(Plan::read(&target.path().join("plan.csv")).unwrap(), plan);
}

#[test]
fn a_killed_run_goes_on_and_shards_make_the_same_pairs() {
    let (whole, broken) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let campaign = campaign();
    let plan = planned(&campaign);
    run_all(&campaign, &plan, whole.path(), Existing::Refuse).unwrap();
    // Shard by shard into one folder; between them a kill leaves one pair missing and one half written.
    for index in 0..2 {
        let shard = Shard { index, count: 2 };
        let report = run_shard(&campaign, &plan, broken.path(), Existing::Resume, shard).unwrap();
        assert_eq!(report.num_done, 2);
    }
    fs::remove_dir_all(pair_folder(broken.path(), 2)).unwrap();
    let half = broken.path().join("pairs/000/.000002.partial");
    fs::create_dir_all(&half).unwrap();
    fs::write(half.join("a.l0.png"), b"half").unwrap();
    assert_eq!(pairs(broken.path()).len(), 3);
    let report = run_all(&campaign, &plan, broken.path(), Existing::Resume).unwrap();
    assert_eq!((report.num_done, report.num_resumed), (1, 3));
    assert!(!half.exists());
    let strip = |root: &Path| {
        let all = contents(&root.join("pairs"));
        all.into_iter()
            .map(|(p, b)| (p.strip_prefix(root).unwrap().to_path_buf(), b))
            .collect::<BTreeMap<_, _>>()
    };
    assert!(strip(whole.path()) == strip(broken.path()), "the same bytes, however they were made");
    // Nothing to do is done at once.
    let report = run_all(&campaign, &plan, broken.path(), Existing::Resume).unwrap();
    assert_eq!((report.num_done, report.num_resumed, report.num_rays), (0, 4, 0));
}

#[test]
fn targets_are_refused_before_anything_is_written() {
    let target = tempfile::tempdir().unwrap();
    let mut campaign = campaign();
    (campaign.oblique.pairs, campaign.dynamic.pairs) = (0, 0);
    let plan = planned(&campaign);
    let at = target.path();
    run_all(&campaign, &plan, at, Existing::Refuse).unwrap();
    let before = contents(target.path());
    assert!(matches!(
        run_all(&campaign, &plan, at, Existing::Refuse),
        Err(Error::Files(FilesError::Exists { .. }))
    ));
    let other = Campaign { seed: 1, ..campaign.clone() };
    let refused = run_all(&other, &planned(&other), at, Existing::Resume);
    assert!(matches!(refused, Err(Error::OtherCampaign { what: "campaign", .. })), "{refused:?}");
    let refused = run_all(&campaign, &planned(&other), at, Existing::Resume);
    assert!(matches!(refused, Err(Error::OtherCampaign { what: "plan", .. })), "{refused:?}");
    let refused = run_shard(&campaign, &plan, at, Existing::Resume, Shard { index: 3, count: 3 });
    assert!(matches!(refused, Err(Error::Shard { .. })));
    assert_eq!(contents(target.path()), before);
    // Force replaces a dataset, and nothing but a dataset.
    fs::write(target.path().join("thesis.tex"), b"years of work").unwrap();
    assert!(matches!(
        run_all(&other, &plan, at, Existing::Replace),
        Err(Error::Files(FilesError::Foreign { .. }))
    ));
    assert_eq!(contents(target.path()).len(), before.len() + 1);
    fs::remove_file(target.path().join("thesis.tex")).unwrap();
    run_all(&other, &planned(&other), at, Existing::Replace).unwrap();
    assert_ne!(contents(target.path()), before);
    // A file where the folder should be.
    let file = target.path().join("file");
    fs::write(&file, b"").unwrap();
    let refused = run_all(&campaign, &plan, &file, Existing::Refuse);
    assert!(matches!(refused, Err(Error::Files(FilesError::Exists { .. }))), "{refused:?}");
    // A campaign that someone wrote there is no dataset.
    let own = tempfile::tempdir().unwrap();
    fs::write(own.path().join("campaign.toml"), b"seed = 1").unwrap();
    for existing in [Existing::Resume, Existing::Replace] {
        let refused = run_all(&campaign, &plan, own.path(), existing);
        assert!(matches!(refused, Err(Error::Files(FilesError::OtherKind { .. }))), "{refused:?}");
    }
}

#[test]
fn what_cannot_be_written_is_one_error_and_leaves_whole_pairs() {
    let target = tempfile::tempdir().unwrap();
    let campaign = campaign();
    let plan = planned(&campaign);
    // A file stands where pair 2 belongs, as a full disk would: the rename fails.
    run_all(&campaign, &plan, target.path(), Existing::Refuse).unwrap();
    for id in [2, 3] {
        fs::remove_dir_all(pair_folder(target.path(), id)).unwrap();
    }
    fs::write(pair_folder(target.path(), 2), b"in the way").unwrap();
    let refused = run_all(&campaign, &plan, target.path(), Existing::Resume);
    assert!(matches!(refused, Err(Error::Files(FilesError::Io { .. }))), "{refused:?}");
    let left: Vec<u64> = pairs(target.path()).iter().map(|pair| pair.pair_id).collect();
    assert_eq!(left, [0, 1]);
    assert!(contents(target.path()).keys().all(|p| !p.to_string_lossy().contains(".partial")));
    fs::remove_file(pair_folder(target.path(), 2)).unwrap();
    assert_eq!(run_all(&campaign, &plan, target.path(), Existing::Resume).unwrap().num_done, 2);
}

#[test]
fn skips_and_dark_suns_are_told() {
    let target = tempfile::tempdir().unwrap();
    let mut campaign = campaign();
    (campaign.oblique.pairs, campaign.dynamic.pairs) = (0, 0);
    campaign.lights = vec![crate::plan::Light::fixed(10.0, -5.0)];
    campaign.tone =
        rendering::ToneSection { kind: rendering::ToneKind::MinMax, bits: 8, ..Default::default() };
    let mut plan = planned(&campaign);
    let mut lost = plan.rows[0].clone();
    lost.pair_id = 7;
    lost.placed = None;
    lost.attempts = 50;
    lost.refusals = BTreeMap::from([(crate::plan::Refusal::Sky, 50)]);
    plan.rows.push(lost);
    let report = run_all(&campaign, &plan, target.path(), Existing::Refuse).unwrap();
    assert_eq!(report.num_done, 1);
    assert_eq!(report.skipped[0].reason, "no place in 50 attempts (sky 50)");
    assert!(report.warnings[0].contains("5.00° below the horizon"), "{:?}", report.warnings);
    let folder = pair_folder(target.path(), 0);
    let Picture::Grey8(picture) = png::read(&folder.join(image_name(ViewName::A, 0))).unwrap() else {
        panic!("8 bits were asked for");
    };
    assert!(picture.data.iter().all(|level| *level == 0));
    let record: PairRecord = read_json(&folder.join("pair.json")).unwrap();
    assert_eq!(record.exposures[0].lit_share, 0.0);
}

/// What a check of a dataset finds, as codes and places.
fn found(root: &Path) -> Vec<(Code, String)> {
    let report = check(root, &CheckOptions { step: 1, ..CheckOptions::default() }).unwrap();
    let errors = report.findings.into_iter().filter(|finding| finding.severity == Severity::Error);
    errors.map(|finding| (finding.code, finding.place)).collect()
}

#[test]
fn what_is_generated_passes_its_check_until_something_is_missing_or_edited() {
    let target = tempfile::tempdir().unwrap();
    let root = target.path();
    let mut campaign = campaign();
    campaign.identical.pairs = 1;
    let plan = planned(&campaign);
    run_all(&campaign, &plan, root, Existing::Refuse).unwrap();
    assert_eq!(found(root), []);
    let expect = |code: Code, place: &str| {
        let found = found(root);
        assert!(found.iter().any(|(c, p)| *c == code && p.ends_with(place)), "{code:?} {place}: {found:?}");
    };
    for name in ["run.toml", "campaign.toml", "plan.csv"] {
        let path = root.join(name);
        let right = fs::read(&path).unwrap();
        fs::remove_file(&path).unwrap();
        expect(Code::MissingFile, name);
        fs::write(&path, &right[..right.len() / 2]).unwrap();
        let garbled = found(root);
        assert!(garbled.iter().any(|(_, place)| place.ends_with(name)), "{name}: {garbled:?}");
        let text = String::from_utf8(right.clone()).unwrap();
        fs::write(&path, text.replacen("2025", "2026", 1)).unwrap();
        let edited = found(root);
        if text.contains("2025") {
            assert!(
                edited.iter().any(|(code, p)| *code == Code::ChangedFile && p.ends_with(name)),
                "{edited:?}"
            );
        }
        fs::write(&path, &right).unwrap();
    }
    assert_eq!(found(root), []);
    // A Sun elsewhere and a motion off by 50 m, told with right checksums: the plan knows better.
    let pair = pair_folder(root, 2);
    let right = fs::read(pair.join("pair.json")).unwrap();
    let mut record: PairRecord = read_json(&pair.join("pair.json")).unwrap();
    let site = record.site.place();
    let sun = record.suns[0].unwrap();
    let moved = crate::plan::SunAngles { azimuth_deg: sun.azimuth_deg - 20.0, ..sun.angles() };
    record.suns[0] = Some(crate::pair::SunRecord::new(&moved, &record.body, &site, sun.angular_radius_deg));
    fs::write(pair.join("pair.json"), crate::pair::json_text(&record, &pair).unwrap()).unwrap();
    expect(Code::Record, "pair.json");
    fs::write(pair.join("pair.json"), &right).unwrap();
    fs::remove_dir_all(pair_folder(root, 1)).unwrap();
    expect(Code::MissingPair, "000001");
    fs::remove_dir_all(root.join("pairs")).unwrap();
    expect(Code::MissingPair, "000004");
}

#[test]
fn an_edited_exposure_is_found_by_the_radiance_of_depth_sun_and_law() {
    for tone in [
        rendering::ToneSection::default(),
        rendering::ToneSection { kind: rendering::ToneKind::MinMax, bits: 8, ..Default::default() },
    ] {
        let target = tempfile::tempdir().unwrap();
        let campaign = Campaign { tone, ..campaign() };
        run_all(&campaign, &planned(&campaign), target.path(), Existing::Refuse).unwrap();
        assert_eq!(found(target.path()), []);
        let folder = pair_folder(target.path(), 1);
        let right: PairRecord = read_json(&folder.join("pair.json")).unwrap();
        let edits: [fn(&mut PairRecord); 5] = [
            |record| record.exposures[0].gain *= 1.3,
            |record| (record.exposures[0].gain, record.exposures[1].gain) = (-1.0, -1.0),
            |record| record.exposures[3].offset += 0.2,
            // Both alike, as one gain has to be.
            |record| record.exposures.iter_mut().for_each(|exposure| exposure.gain *= 1.3),
            |record| record.exposures[2].offset -= 0.2,
        ];
        for edit in edits {
            let mut record = right.clone();
            edit(&mut record);
            let text = crate::pair::json_text(&record, &folder).unwrap();
            fs::write(folder.join("pair.json"), text).unwrap();
            let found = found(target.path());
            let is_told =
                |(code, place): &(Code, String)| *code == Code::Record && place.ends_with("pair.json");
            assert!(found.iter().any(is_told), "{:?}: {:?} {found:?}", campaign.tone.kind, record.exposures);
        }
    }
}

#[test]
fn the_plan_that_is_there_is_read_where_campaign_and_inputs_are_the_same() {
    let target = tempfile::tempdir().unwrap();
    let campaign = campaign();
    let plan = planned(&campaign);
    let inputs = options().inputs;
    let there = |campaign: &Campaign, inputs: &BTreeMap<String, String>| {
        folder::planned(target.path(), campaign, inputs).unwrap()
    };
    assert_eq!(there(&campaign, &inputs), None);
    let shard = Shard { index: 1, count: 4 };
    run_shard(&campaign, &plan, target.path(), Existing::Resume, shard).unwrap();
    assert_eq!(there(&campaign, &inputs), Some(plan));
    assert_eq!(there(&Campaign { seed: 9, ..campaign.clone() }, &inputs), None);
    assert_eq!(there(&campaign, &BTreeMap::from([("terrain".into(), "abd".into())])), None);
    let path = target.path().join("plan.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replacen("nadir", "oblique", 1)).unwrap();
    assert_eq!(there(&campaign, &inputs), None);
}
