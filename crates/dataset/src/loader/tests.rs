use super::*;
use crate::check::reprojection::{DepthView, symmetric};
use crate::check::synthetic::{nadir_pair, oblique_pair, write_own_pair};
use crate::export::stereolunar::{ExportOptions, export_dataset};
use crate::plan::Campaign;
use crate::test_terrain::{cap, hills};
use selenograph_geometry::{Body, PixelConvention};
use selenograph_terrain::Terrain;
use std::path::Path;
use std::sync::{Arc, OnceLock};

fn terrain() -> Arc<Terrain> {
    static TERRAIN: OnceLock<Arc<Terrain>> = OnceLock::new();
    let make = || Arc::new(Terrain::new(Body::moon(), vec![cap(200.0, 750, hills)]).unwrap());
    TERRAIN.get_or_init(make).clone()
}

fn campaign() -> Campaign {
    let mut campaign = Campaign::preset("paper-iccv2025").unwrap();
    (campaign.nadir.pairs, campaign.oblique.pairs, campaign.dynamic.pairs) = (3, 3, 2);
    (campaign.camera.width_px, campaign.camera.height_px) = (48, 40);
    campaign.limits.max_coarse_share = 1.0;
    campaign.limits.probe_rays = 8;
    campaign.render.rays_per_pixel = 4;
    campaign
}

fn flight() -> Source {
    Source::flight("flight", campaign(), terrain()).unwrap()
}

fn options() -> LoaderOptions {
    LoaderOptions {
        seed: 3,
        sizes: vec![[32, 32]],
        num_matches: 128,
        match_rule: MatchRule::Seen,
        augmentation: Augmentation::physical(),
        ..LoaderOptions::default()
    }
}

/// Three pairs of 48 × 48 in a folder.
fn dataset() -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    for pair_id in 0..3 {
        write_own_pair(root.path(), pair_id, &if pair_id == 1 { nadir_pair(48) } else { oblique_pair(48) });
    }
    root
}

fn pairs(root: &Path) -> Source {
    Source::pairs("stored", root, None).unwrap()
}

#[test]
fn batches_are_the_same_for_any_number_of_workers_and_go_on_anywhere() {
    let root = dataset();
    let run = |num_workers: usize, first_batch: u64, count: usize| {
        let options =
            LoaderOptions { num_workers, queue_batches: 2, sizes: vec![[32, 32], [32, 24]], ..options() };
        let mixture = Mixture::new(vec![pairs(root.path()), flight().with_weight(0.5)], options).unwrap();
        assert_eq!((mixture.order().shares(), mixture.batches_per_epoch()), (&[5, 6][..], 5));
        let mut loader = Loader::start(Arc::new(mixture), first_batch).unwrap();
        let batches: Vec<TrainingBatch> = (0..count).map(|_| loader.next_batch().unwrap()).collect();
        assert_eq!(loader.position(), first_batch + count as u64);
        assert!(loader.num_waits() <= count as u64);
        batches
    };
    let one = run(1, 0, 8);
    assert_eq!(one, run(3, 0, 8));
    assert_eq!(one[5..], run(2, 5, 3)[..]);
    let mut sizes = Vec::new();
    for (n, batch) in one.iter().enumerate() {
        assert_eq!((batch.batch_idx, batch.epoch), (n as u64, n as u64 / 5));
        assert_eq!(batch.pairs.len(), 2);
        let size = |pair: &TrainingPair| pair.views.each_ref().map(|v| [v.rgb.width, v.rgb.height]);
        assert!(batch.pairs.iter().all(|pair| size(pair) == [size(&batch.pairs[0])[0]; 2]));
        assert!(batch.pairs.iter().all(|pair| pair.matches.valid.len() == 128));
        sizes.push(size(&batch.pairs[0])[0][1]);
    }
    assert!(sizes.contains(&32) && sizes.contains(&24), "{sizes:?}");
    let sources: Vec<&str> =
        one.iter().flat_map(|b| &b.pairs).map(|pair| pair.provenance.source.as_str()).collect();
    assert!(sources.contains(&"stored") && sources.contains(&"flight"));
}

#[test]
fn pairs_flown_while_training_agree_with_themselves_after_every_change() {
    let mixture = Mixture::new(vec![flight()], options()).unwrap();
    for batch_idx in 0..8 {
        let (pair, _) = mixture.sample(batch_idx, 0).unwrap();
        let [a, b] = pair.views.each_ref().map(|view| {
            let truth = &view.truth;
            DepthView { camera: &view.camera, world_from_cam: &truth.world_from_cam, depth_z: &truth.depth_z }
        });
        let Some(statistics) = symmetric(&a, &b, 1) else { continue };
        // Pixels see some 300 m of hills 3 km wide: bilinear depth between them is off by far less.
        assert!(statistics.median_px < 0.05, "{batch_idx}: {statistics:?}");
        let spread = |view: &TrainingView| {
            let levels = view.rgb.data.iter().map(|rgb| rgb[0]);
            levels.clone().max().unwrap_or(0) - levels.min().unwrap_or(0)
        };
        assert!(pair.views.iter().all(|view| spread(view) > 20));
        let known = |view: usize| pair.matches.valid.iter().filter(|v| **v).count() > 0 && view < 2;
        assert!(known(0));
    }
    // A second pass flies other pairs.
    let of = |pass| {
        let draw = Draw { source_idx: 0, pass, item_idx: 0 };
        mixture.make(&draw, 0, [32, 32]).unwrap()
    };
    let (first, second) = (of(0), of(1));
    assert_eq!((first.provenance.pair_id, second.provenance.pair_id), (0, 8));
    assert_ne!(first.views[0].truth, second.views[0].truth);
}

#[test]
fn the_first_pass_is_what_generate_would_write() {
    let plain = LoaderOptions { sizes: vec![[48, 40]], augmentation: Augmentation::default(), ..options() };
    let mixture = Mixture::new(vec![flight()], plain).unwrap();
    let (pair, _) = mixture.sample(0, 0).unwrap();
    let (terrain, campaign) = (terrain(), campaign());
    let tracer = selenograph_render::Tracer::new(&terrain, campaign.render.surface);
    let row = crate::plan::Planner::new(&campaign, &tracer).unwrap().row(pair.provenance.pair_id);
    let placed = row.placed.clone().unwrap();
    let Ok(scene) = crate::generate::scene::render(&campaign, &tracer, &row, &placed).unwrap() else {
        panic!("the plan has placed it");
    };
    for (view, expected) in pair.views.iter().zip(&scene.views) {
        let truth = &view.truth;
        assert_eq!(truth.world_from_cam, expected.view.world_from_cam);
        let same = truth.depth_z.data.iter().zip(&expected.truth.depth_z).all(|(x, y)| *x == *y as f32);
        assert!(same && view.camera == expected.view.camera);
    }
}

#[test]
fn triplets_are_read_with_and_without_a_split_file() {
    let root = dataset();
    let out = root.path().join("triplets");
    export_dataset(root.path(), &out, None, &ExportOptions::default(), |_, _| ()).unwrap();
    let published = LoaderOptions {
        augmentation: Augmentation::published(),
        match_rule: MatchRule::Reciprocal,
        ..options()
    };
    let split = Source::triplets("split", &out, Some(&out.join("all.npz")), PixelConvention::Center).unwrap();
    let whole = Source::triplets("folder", &out, None, PixelConvention::Center).unwrap();
    // Three pairs under two lights.
    assert_eq!((split.num_pairs(), whole.num_pairs()), (6, 3));
    let mixture = Mixture::new(vec![split, whole], published).unwrap();
    for batch_idx in 0..4 {
        let (pair, replaced) = mixture.sample(batch_idx, 1).unwrap();
        assert!(pair.has_truth() && replaced.is_empty() && !pair.is_metric);
    }
    std::fs::remove_file(out.join("oblique/im_00001.npz")).unwrap();
    // The camera of another light serves; a split file asks for its own.
    Source::triplets("folder", &out, None, PixelConvention::Center).unwrap();
    std::fs::remove_file(out.join("oblique/im_00003.npz")).unwrap();
    let refused = Source::triplets("folder", &out, None, PixelConvention::Center);
    assert!(matches!(&refused, Err(Error::Unusable { why, .. }) if why.contains("missing")), "{refused:?}");
}

#[test]
fn faulty_pairs_are_one_error_or_counted() {
    let root = dataset();
    let folder = |id: u64| crate::pair::pair_folder(root.path(), id);
    // Pair 0 has no depth in one view, pair 1 nothing but holes, pair 2 is whole.
    std::fs::remove_file(folder(0).join("b.depth_z.exr")).unwrap();
    let [mut a, b] = nadir_pair(48);
    a.depth_z.data.fill(f32::NAN);
    write_own_pair(root.path(), 1, &[a, b]);
    let load = |faults| {
        let options = LoaderOptions { faults, batch_size: 3, ..options() };
        let mixture = Arc::new(Mixture::new(vec![pairs(root.path())], options).unwrap());
        Loader::start(mixture, 0).unwrap().next_batch()
    };
    let refused = load(Faults::Refuse);
    assert!(matches!(refused, Err(Error::Unusable { .. })), "{refused:?}");
    let batch = load(Faults::Replace).unwrap();
    assert!(batch.pairs.iter().all(|pair| pair.provenance.pair_id == 2));
    assert!(batch.replaced.len() >= 2, "{:?}", batch.replaced);
    let told = |what: &str| batch.replaced.iter().any(|r| r.reason.contains(what));
    assert!(told("one view has depth") && told("no pixel with depth"), "{:?}", batch.replaced);
    // A pair without any truth feeds what needs none.
    std::fs::remove_file(folder(0).join("a.depth_z.exr")).unwrap();
    let only = Source::pairs("blind", root.path(), Some(&[0])).unwrap();
    let mixture = Mixture::new(vec![only], LoaderOptions { batch_size: 1, ..options() }).unwrap();
    let (pair, _) = mixture.sample(0, 0).unwrap();
    assert!(!pair.has_truth() && pair.matches.valid.is_empty());
    // Its poses are known all the same.
    let pose = |view: usize| pair.views[view].truth.world_from_cam;
    assert!((pose(0).origin() - pose(1).origin()).norm() > 1.0);
    assert!(Source::pairs("none", root.path(), Some(&[77])).is_err());
}

#[test]
fn shared_ground_is_found_and_flights_keep_off() {
    let root = dataset();
    let (train, val) = ([pairs(root.path())], [Source::pairs("val", root.path(), Some(&[0])).unwrap()]);
    let found = shared_ground(&train, &val).unwrap();
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].val, ("val".to_owned(), 0));
    let elsewhere = [Source { world: "mars".into(), ..pairs(root.path()) }];
    assert!(shared_ground(&elsewhere, &val).unwrap().is_empty());
    // The campaign covers the cap, and so the stored pair's ground; kept off it, none of its pairs sees that ground.
    let mut campaign = campaign();
    (campaign.nadir.pairs, campaign.oblique.pairs, campaign.dynamic.pairs) = (40, 0, 0);
    campaign.sites.lat_deg = Interval::new(-88.5, -87.0);
    let mut flying = Source::flight("flight", campaign, terrain()).unwrap();
    assert!(!shared_ground(std::slice::from_ref(&flying), &val).unwrap().is_empty());
    flying.keep_off(&val).unwrap();
    let options = LoaderOptions { batch_size: 1, augmentation: Augmentation::default(), ..options() };
    let mixture = Mixture::new(vec![flying], options).unwrap();
    let replaced = (0..40).map(|n| mixture.sample(n, 0).unwrap().1).collect::<Vec<_>>().concat();
    assert!(replaced.iter().any(|r| r.reason.contains("held out")), "{replaced:?}");
}

#[test]
fn options_outside_their_range_are_refused() {
    let refused = |options| Mixture::new(vec![flight()], options).is_err();
    assert!(refused(LoaderOptions { batch_size: 0, ..options() }));
    assert!(refused(LoaderOptions { batch_size: 9, ..options() }));
    assert!(refused(LoaderOptions { sizes: vec![], ..options() }));
    assert!(refused(LoaderOptions { num_matches: 32 * 32 + 1, ..options() }));
    assert!(Mixture::new(vec![], options()).is_err());
}

#[test]
fn a_camera_that_was_moved_and_pictures_that_were_swapped_are_refused() {
    let load = |root: &Path, verify: bool| {
        let source = if verify { pairs(root) } else { pairs(root).unverified() };
        let mixture = Mixture::new(vec![source], LoaderOptions { batch_size: 3, ..options() }).unwrap();
        (0..3).try_for_each(|position| mixture.sample(0, position).map(|_| ()))
    };
    let root = dataset();
    assert!(load(root.path(), true).is_ok());
    let folder = crate::pair::pair_folder(root.path(), 1);
    std::fs::copy(folder.join("b.l0.png"), folder.join("a.l1.png")).unwrap();
    std::fs::copy(folder.join("b.l0.png"), folder.join("a.l0.png")).unwrap();
    let camera = folder.join("b.camera.json");
    let text = std::fs::read_to_string(&camera).unwrap();
    std::fs::write(&camera, text.replacen("\"view\": \"b\"", "\"view\":  \"b\"", 1)).unwrap();
    let refused = load(root.path(), true);
    assert!(refused.as_ref().is_err_and(|error| error.to_string().contains("checksum")), "{refused:?}");
    assert!(load(root.path(), false).is_ok());
}
