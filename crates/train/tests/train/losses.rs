//! Every loss of the paper: values and gradients.

use crate::goldens::{Golden, relative_error, root, stated, values, with_tensors};
use burn_tensor::{Device, Int, Tensor};
use selenograph_dataset::rng::rng;
use selenograph_train::batch::{AssemblySettings, HostBatch, Matches, Targets, ViewOutput, ViewTarget};
use selenograph_train::loss::{self, LossSettings, MatchingSettings, term};
use std::path::Path;

/// Losses, relative: the README of the goldens.
const LOSS_TOLERANCE: f32 = 1e-5;
/// Gradients, relative to the largest: the same.
const GRADIENT_TOLERANCE: f32 = 1e-3;
/// Normalised points are quotients of values that the reference knows to 2e-7.
const POINT_TOLERANCE: f32 = 2e-6;

fn host_batch(golden: &Golden, metric: &Golden) -> HostBatch {
    let settings = AssemblySettings { match_block: 8192, epipolar: false };
    HostBatch::assemble(&golden.pairs(metric), &settings, &mut rng(0, "test", 0, "matches")).unwrap()
}

fn assert_close(name: &str, found: f32, expected: f32) {
    let error = (found - expected).abs() / expected.abs();
    assert!(error <= LOSS_TOLERANCE, "{name}: {found} instead of {expected} ({error:.1e})");
}

/// The gradient of `total` with respect to each output, against `case.grad.*`.
fn check_gradients(golden: &Golden, case: &str, total: &Tensor<1>, output: &[ViewOutput; 2]) {
    let gradients = total.backward();
    for (view, output) in output.iter().enumerate() {
        let found = [
            ("pts3d", output.points.grad(&gradients).map(|g| values(&g))),
            ("conf", output.confidence.grad(&gradients).map(|g| values(&g))),
            ("desc", output.descriptors.grad(&gradients).map(|g| values(&g))),
            ("desc_conf", output.descriptor_confidence.grad(&gradients).map(|g| values(&g))),
        ];
        for (what, found) in found {
            let name = format!("{case}.grad.{what}_{}", view + 1);
            if golden.has(&name) {
                let error = relative_error(&found.unwrap(), golden.values(&name));
                println!("{name}: {error:.1e}");
                assert!(error <= GRADIENT_TOLERANCE, "{name}: {error:.1e}");
            }
        }
    }
}

/// The losses of `truth`'s outputs that `golden` holds; they say of themselves which pairs are metric.
fn check_training(truth: &Golden, golden: &Golden) {
    let device = Device::flex();
    let targets = host_batch(truth, golden).targets(&device);
    let tracked = device.autodiff();
    for (case, weight) in [("conf_regr", 0.0), ("total", 0.075)] {
        let output = truth.output(&tracked);
        let settings = LossSettings {
            matching: MatchingSettings { weight, ..MatchingSettings::default() },
            ..LossSettings::default()
        };
        let points = loss::normalise(&output, &targets);
        for (view, (predicted, truth)) in points.views.iter().enumerate() {
            for (name, found) in [("pr", predicted), ("gt", truth)] {
                // Where there is no truth the reference keeps what it was given, and so may we.
                let valid = targets.views[view].valid.clone().unsqueeze_dim::<4>(3).expand(found.dims());
                let expected = golden.tensor::<4>(&format!("regr.{name}_norm{}", view + 1), &Device::flex());
                let [found, expected] = [found.clone().inner(), expected]
                    .map(|t| values(&t.mask_fill(valid.clone().bool_not(), 0.0)));
                let error = relative_error(&found, &expected);
                assert!(error <= POINT_TOLERANCE, "{name} {view}: {error:.1e}");
            }
        }
        let loss = loss::training_loss(&output, &targets, &settings);
        let names = [
            (term::CONFIDENCE_A, "conf_loss_1"),
            (term::CONFIDENCE_B, "conf_loss2"),
            (term::REGRESSION_A, "Regr3D_pts3d_1"),
            (term::REGRESSION_B, "Regr3D_pts3d_2"),
            (term::MATCHING, "MatchingLoss"),
            (term::MATCHING_CONFIDENCE, "matching_conf_loss"),
        ];
        for (name, value) in &loss.terms {
            let theirs = names.iter().find(|(ours, _)| ours == name).unwrap().1;
            assert_close(name, values(value)[0], golden.scalar(&format!("{case}.detail.{theirs}")));
        }
        assert_close(case, values(&loss.total)[0], golden.scalar(&format!("{case}.value")));
        check_gradients(golden, case, &loss.total, &output);
    }
}

#[test]
fn shared_scale_free_and_metric_pairs() {
    let Some(root) = root("golden losses") else { return };
    for truth in with_tensors(&root, &["gt1.img", "pred.pts3d_1"]) {
        let held = ["gt1.is_metric_scale", "total.value"];
        for file in with_tensors(truth.parent().unwrap(), &held) {
            println!("{} of {}", file.display(), truth.display());
            check_training(&Golden::open(&truth), &Golden::open(&file));
        }
    }
}

/// The values of the valid matches, row by row.
fn of_valid(matches: &Matches, found: &Tensor<2>) -> Vec<f32> {
    let valid: Vec<bool> = matches.valid.to_data().try_to_vec().unwrap();
    values(found).into_iter().zip(valid).filter_map(|(value, valid)| valid.then_some(value)).collect()
}

#[test]
fn shared_every_match_of_the_matching_loss_and_several_blocks() {
    let Some(root) = root("golden losses/loss_norm, infonce") else { return };
    for file in with_tensors(&root, &["gt1.img", "infonce.per_match"]) {
        check_every_match_of_the_matching_loss_and_several_blocks(&Golden::open(&file));
    }
}

fn check_every_match_of_the_matching_loss_and_several_blocks(golden: &Golden) {
    let device = Device::flex();
    let output = golden.output(&device.clone().autodiff());
    let matches = host_batch(golden, golden).targets(&device).matches.unwrap();
    let settings = MatchingSettings::default();
    let expected = golden.values("infonce.per_match");
    let found = of_valid(&matches, &loss::info_nce(&output, &matches, &settings));
    let error = relative_error(&found, expected);
    assert!(error <= LOSS_TOLERANCE, "{error:.1e}");

    // Each match three times, in three blocks that know nothing of each other: three times the same.
    let [_, n] = matches.valid.dims();
    let thrice = |pixels: &Tensor<2, Int>| Tensor::cat(vec![pixels.clone(); 3], 1);
    let blocks = Matches {
        pixels: [0, 1].map(|view| thrice(&matches.pixels[view])),
        valid: Tensor::cat(vec![matches.valid.clone(); 3], 1),
    };
    let settings = MatchingSettings { block: n, ..settings };
    let in_blocks = loss::info_nce(&output, &blocks, &settings);
    for block in 0..3 {
        let found = of_valid(&matches, &in_blocks.clone().narrow(1, block * n, n));
        let error = relative_error(&found, expected);
        assert!(error <= LOSS_TOLERANCE, "block {block}: {error:.1e}");
    }
    let whole = loss::matching(&output, &blocks, &settings);
    assert_close("plain", values(&whole.plain)[0], golden.scalar("conf_match.detail.MatchingLoss"));
    assert_close("weighted", values(&whole.weighted)[0], golden.scalar("conf_match.value"));
}

#[test]
fn shared_test_criterion_and_average_precision() {
    let Some(root) = root("golden losses/loss_norm, test criterion") else { return };
    for file in with_tensors(&root, &["gt1.img", "ap.per_match"]) {
        check_test_criterion_and_average_precision(&root, &Golden::open(&file));
    }
}

fn check_test_criterion_and_average_precision(root: &Path, golden: &Golden) {
    let device = Device::flex();
    let output = golden.output(&device.clone().autodiff());
    let batch = host_batch(golden, golden);
    let targets = batch.targets(&device);

    let loss = loss::test_criterion(&output, &targets, None);
    assert_close("unpadded", values(&loss.total)[0], golden.scalar("test_nopad.value"));
    let Some(count) = stated(root, "test_f32.value", "negatives_padding=") else { return };
    let padding = batch.padding(count as usize, &device);
    let loss = loss::test_criterion(&output, &targets, padding.as_ref());
    assert_close("padded", values(&loss.total)[0], golden.scalar("test_f32.value"));
    for (name, theirs) in [
        (term::REGRESSION_A, "Regr3D_pts3d_1"),
        (term::REGRESSION_B, "Regr3D_pts3d_2"),
        (term::PRECISION, "MatchingLoss"),
    ] {
        let found = &loss.terms.iter().find(|(ours, _)| *ours == name).unwrap().1;
        assert_close(name, values(found)[0], golden.scalar(&format!("test_f32.detail.{theirs}")));
    }

    let matches = targets.matches.as_ref().unwrap();
    let found = of_valid(matches, &loss::reciprocal_ranks(&output, matches, padding.as_ref()));
    // Quotients of small whole numbers: the same to the last digit.
    let error = relative_error(&found, golden.values("ap.per_match"));
    assert!(error <= f32::EPSILON, "{error:.1e}");
}

#[test]
fn shared_scale_of_a_pair() {
    let Some(root) = root("golden geom, norm") else { return };
    for file in with_tensors(&root, &["norm.p1", "norm.factor"]) {
        check_scale_of_a_pair(&Golden::open(&file));
    }
}

fn check_scale_of_a_pair(golden: &Golden) {
    let device = Device::flex();
    let [points_a, points_b] = ["norm.p1", "norm.p2"].map(|name| golden.tensor::<4>(name, &device));
    let [b, h, w, _] = points_a.dims();
    let view = |points: &Tensor<4>, mask: &str| {
        let valid = golden.tensor::<3>(mask, &device).greater_elem(0.5);
        ViewTarget { points: points.clone(), sky: valid.clone().bool_not(), valid }
    };
    let targets = Targets {
        views: [view(&points_a, "norm.m1"), view(&points_b, "norm.m2")],
        metric: Tensor::from_data([false; 2], &device),
        matches: None,
        up: Tensor::zeros([b, 3], &device),
        epipolar_normals: None,
    };
    let predicted = |points: Tensor<4>| ViewOutput {
        points,
        confidence: Tensor::ones([b, h, w], &device),
        descriptors: Tensor::ones([b, h, w, 1], &device),
        descriptor_confidence: Tensor::ones([b, h, w], &device),
    };
    // The prediction is half the truth: its own scale takes that out.
    let output = [predicted(points_a.clone() * 0.5), predicted(points_b * 0.5)];
    let found = loss::normalise(&output, &targets);
    let expected = golden.values("norm.factor");
    let error = relative_error(&values(&found.truth_scale_m), expected);
    assert!(error <= POINT_TOLERANCE, "{error:.1e}");
    let theirs = points_a / golden.tensor::<4>("norm.factor", &device);
    let error = relative_error(&values(&found.views[0].0), &values(&theirs));
    assert!(error <= POINT_TOLERANCE, "{error:.1e}");
}
