//! Training data against the numbers of the reference.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::print_stdout, reason = "a test on shared data says whether it ran")]

mod goldens;

use goldens::Golden;
use selenograph_dataset::augment::{Augmentation, Fidelity, Turn, UndevelopedView, rescale};
use selenograph_dataset::correspondence::{MatchPool, Sighted};
use selenograph_dataset::loader::{Loader, LoaderOptions, Mixture, Source};
use selenograph_dataset::pair::ViewName;
use selenograph_geometry::PixelConvention;
use selenograph_raster::statistics;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[test]
fn shared_reciprocal_correspondences() {
    let Some(golden) = goldens::open("reciprocal correspondences", "geom.safetensors") else { return };
    let views = ["1", "2"].map(|n| {
        let truth = golden.truth(&format!("corr.depthmap{n}"), &format!("corr.camera_pose{n}"));
        let (width, height) = (truth.depth_z.width, truth.depth_z.height);
        (golden.camera(&format!("corr.camera_intrinsics{n}"), width, height), truth)
    });
    let widths = views.each_ref().map(|(camera, _)| camera.width as f64);
    let [a, b] = views.each_ref().map(|(camera, truth)| Sighted { camera, truth });
    let pool = MatchPool::reciprocal(a, b);
    let flat = |name: &str, width: f64| -> Vec<u32> {
        golden.get(name).chunks(2).map(|xy| (xy[0] + width * xy[1]) as u32).collect()
    };
    let expected: Vec<[u32; 2]> = flat("corr.xy1", widths[0])
        .into_iter()
        .zip(flat("corr.xy2", widths[1]))
        .map(|(a, b)| [a, b])
        .collect();
    assert_eq!(pool.positives, expected);
}

/// The reference's homographies are stored in single precision.
const STORED: f64 = 1e-5;

#[test]
fn shared_windows_become_turned_cameras() {
    let Some(golden) = goldens::open("crop homographies", "geom.safetensors") else { return };
    for n in 0..3 {
        let k = golden.matrix(&format!("crop{n}.K"));
        let size = [2.0 * k[(0, 2)], 2.0 * k[(1, 2)]].map(|side| side as usize);
        let camera = golden.camera(&format!("crop{n}.K"), size[0], size[1]);
        let window: [f64; 4] = golden.get(&format!("crop{n}.crop")).try_into().unwrap();
        let target: Vec<usize> =
            golden.get(&format!("crop{n}.imsize")).iter().map(|side| *side as usize).collect();
        let turn = Turn::onto(&camera, window, [target[0], target[1]], Fidelity::Published).unwrap();
        let (k_new, h) = (turn.camera.k(PixelConvention::Center), turn.source_from_target);
        assert!((k_new - golden.matrix(&format!("crop{n}.K2"))).amax() < STORED);
        assert!((turn.old_from_new - golden.matrix(&format!("crop{n}.R"))).amax() < STORED);
        // Its largest entries are 40.
        assert!((h - golden.matrix(&format!("crop{n}.H"))).amax() < STORED);
    }
}

/// The three channels of a picture as views with the same camera and truth.
fn channels(golden: &Golden) -> [UndevelopedView; 3] {
    std::array::from_fn(|channel| {
        let levels = golden.channel("aug.rgb_u8", channel);
        let camera = golden.camera("aug.K", levels.width, levels.height);
        UndevelopedView { levels, camera, truth: golden.truth("aug.depth", "aug.pose") }
    })
}

/// Grey levels that a picture may differ by.
const LEVELS: f32 = 1.0;
/// Single precision of a depth of 3.
const DEPTH_Z: f32 = 1e-6;

#[test]
fn shared_window_of_one_view() {
    let Some(golden) = goldens::open("aug_crop of one view", "preprocess.safetensors") else { return };
    let window: [f64; 4] = golden.get("aug.crop").try_into().unwrap();
    for (channel, view) in channels(&golden).iter().enumerate() {
        let expected = golden.channel("aug.out_rgb_u8", channel);
        let size = [expected.width, expected.height];
        let turn = Turn::onto(&view.camera, window, size, Fidelity::Published).unwrap();
        let view = turn.apply(view);
        let worst =
            view.levels.data.iter().zip(&expected.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst <= LEVELS, "{worst}");
        let truth = view.truth;
        let expected = golden.truth("aug.out_depth", "aug.out_pose");
        for (z, expected) in truth.depth_z.data.iter().zip(&expected.depth_z.data) {
            assert!(z.is_nan() && expected.is_nan() || (z - expected).abs() < DEPTH_Z, "{z} {expected}");
        }
        assert!((truth.world_from_cam.rotation() - expected.world_from_cam.rotation()).amax() < STORED);
        assert!((truth.world_from_cam.origin() - expected.world_from_cam.origin()).norm() < STORED);
        assert!((view.camera.k(PixelConvention::Center) - golden.matrix("aug.out_K")).amax() < STORED);
    }
}

#[test]
fn shared_rescaling() {
    let Some(golden) = goldens::open("rescale_image_depthmap", "preprocess.safetensors") else { return };
    for (channel, view) in channels(&golden).into_iter().enumerate() {
        let expected = golden.channel("rescale.rgb_u8", channel);
        // The size that was asked for is not in the file: the one that it led to leads to itself.
        let view = rescale::cover(view, [expected.width, expected.height], Fidelity::Published).unwrap();
        assert_eq!((view.levels.width, view.levels.height), (expected.width, expected.height));
        let worst =
            view.levels.data.iter().zip(&expected.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst <= LEVELS, "{worst}");
        assert_eq!(view.truth.depth_z.data, golden.raster("rescale.depth").data);
        assert!((view.camera.k(PixelConvention::Center) - golden.matrix("rescale.K")).amax() < STORED);
    }
}

/// Pairs of triplets below a folder: a picture's number is 6 · pair + 2 · light + camera.
fn num_pairs(folder: &Path) -> usize {
    let entries = |path: &Path| std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path());
    let pictures = entries(folder).filter(|path| path.is_dir()).flat_map(|scene| entries(&scene));
    let pairs: BTreeSet<(PathBuf, usize)> = pictures
        .filter(|path| path.extension().is_some_and(|ending| ending == "jpg"))
        .map(|path| {
            let name = path.file_stem().unwrap().to_str().unwrap();
            let number: usize = name.trim_start_matches("im_").parse().unwrap();
            (path.parent().unwrap().to_owned(), number / 6)
        })
        .collect();
    pairs.len()
}

#[test]
fn shared_pairs_of_the_paper_are_learned_from() {
    let Some(folder) = goldens::shared("training pairs of the paper", "data/stereolunar") else { return };
    for (augmentation, convention) in [
        (Augmentation::published(), PixelConvention::Center),
        (Augmentation::physical(), PixelConvention::Corner),
    ] {
        let source = Source::triplets("paper", &folder, None, convention).unwrap();
        let num_pairs = num_pairs(&folder);
        assert_eq!(source.num_pairs(), num_pairs as u64);
        let is_published = augmentation.fidelity == Fidelity::Published;
        let options = LoaderOptions {
            batch_size: num_pairs,
            sizes: vec![[512, 512]],
            num_matches: 8192,
            augmentation,
            ..LoaderOptions::default()
        };
        let mixture = Arc::new(Mixture::new(vec![source], options).unwrap());
        let batch = Loader::start(mixture, 0).unwrap().next_batch().unwrap();
        for pair in &batch.pairs {
            assert_eq!((pair.views[0].rgb.width, pair.matches.valid.len()), (512, 8192));
            let [of_a, of_b] = ViewName::BOTH.map(|view| pair.points(view, ViewName::A));
            let at = |points: &[[f32; 3]], [x, y]: [u32; 2]| points[(x + 512 * y) as usize];
            let gsds = pair.matches.valid.iter().enumerate().filter(|(_, valid)| **valid).map(|(n, _)| {
                let (a, b) = (at(&of_a, pair.matches.a[n]), at(&of_b, pair.matches.b[n]));
                let apart = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
                apart / pair.views[0].camera.gsd_m(f64::from(a[2]))
            });
            // Rounding to a pixel of B, on slanted ground, and the steps of half floats.
            let median = statistics::median(gsds).unwrap();
            assert!(median < 1.5, "{median}");
            // The farthest two percent, and in some windows a rim beyond the picture.
            let truth = &pair.views[0].truth;
            let absent = truth.depth_z.data.iter().filter(|z| z.is_nan()).count() as f64 / 512.0 / 512.0;
            assert!(if is_published { (0.0..0.1).contains(&absent) } else { absent < 0.01 }, "{absent}");
        }
    }
}
