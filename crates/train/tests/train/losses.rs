//! Every loss of the paper: values and gradients.

use crate::goldens::{Golden, relative_error, root, values};
use burn_tensor::{Device, Tensor};
use selenograph_dataset::rng::rng;
use selenograph_train::batch::{AssemblySettings, HostBatch, Targets, ViewOutput};
use selenograph_train::loss::{self, LossSettings, MatchingSettings, term};

/// Losses, relative: the README of the goldens.
const LOSS_TOLERANCE: f32 = 1e-5;
/// Gradients, relative to the largest: the same.
const GRADIENT_TOLERANCE: f32 = 1e-3;
/// Normalised points are quotients of values that the reference knows to 2e-7.
const POINT_TOLERANCE: f32 = 2e-6;

fn targets(golden: &Golden, metric: &Golden, device: &Device) -> Targets {
    let settings = AssemblySettings { match_block: 8192, epipolar: false };
    let host =
        HostBatch::assemble(&golden.pairs(metric), &settings, &mut rng(0, "test", 0, "matches")).unwrap();
    host.targets(device)
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

fn check_training(file: &str) {
    let Some(root) = root(&format!("golden losses/{file}")) else { return };
    let truth = Golden::open(&root.join("losses/loss_norm.safetensors"));
    let golden = Golden::open(&root.join(format!("losses/{file}.safetensors")));
    let device = Device::flex();
    let targets = targets(&truth, &golden, &device);
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
        check_gradients(&golden, case, &loss.total, &output);
    }
}

#[test]
fn shared_scale_free_pairs() {
    check_training("loss_norm");
}

#[test]
fn shared_metric_pairs() {
    check_training("loss_metric");
}
