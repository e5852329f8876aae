//! Every loss against its own finite differences, in double precision.

use super::*;
use crate::batch::{Matches, ViewTarget};
use burn_tensor::{Bool, DType, Device, TensorData};
use selenograph_dataset::rng::{Stream, rng};

const B: usize = 2;
const H: usize = 4;
const W: usize = 5;
const C: usize = 3;
const N: usize = 6;
/// Step of the differences; with f64 their error is some 1e-9 of the third derivative.
const STEP: f64 = 1e-5;
/// Against the largest gradient: what the differences leave.
const TOLERANCE: f64 = 1e-6;

fn floats<const D: usize>(values: Vec<f64>, shape: [usize; D]) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), (&Device::flex(), DType::F64))
}

fn uniform(stream: &mut Stream, len: usize, low: f64, high: f64) -> Vec<f64> {
    (0..len).map(|_| stream.uniform(low, high)).collect()
}

fn masks(stream: &mut Stream) -> (Tensor<3, Bool>, Tensor<3, Bool>) {
    let drawn: Vec<f64> = uniform(stream, B * H * W, 0.0, 1.0);
    let of = |holds: fn(f64) -> bool| {
        let values: Vec<bool> = drawn.iter().map(|value| holds(*value)).collect();
        Tensor::from_data(TensorData::new(values, [B, H, W]), &Device::flex())
    };
    (of(|value| value < 0.8), of(|value| value > 0.9))
}

fn targets(metric: [bool; B]) -> Targets {
    let mut stream = rng(11, "loss", 0, "targets");
    let views = [0, 1].map(|_| {
        let (valid, sky) = masks(&mut stream);
        ViewTarget {
            points: floats(uniform(&mut stream, B * H * W * 3, -3.0, 5.0), [B, H, W, 3]),
            valid,
            sky,
        }
    });
    let pixels = [0, 1].map(|_| {
        let drawn: Vec<i32> = (0..B * N).map(|_| stream.index(H * W) as i32).collect();
        Tensor::from_data(TensorData::new(drawn, [B, N]), &Device::flex())
    });
    let valid: Vec<bool> = (0..B * N).map(|n| n % 3 != 2).collect();
    let normals = [0, 1].map(|_| {
        let drawn = floats(uniform(&mut stream, B * H * W * 3, -1.0, 1.0), [B, H, W, 3]);
        drawn.clone() / reduce::length(drawn)
    });
    Targets {
        views,
        metric: Tensor::from_data(TensorData::new(metric.to_vec(), [B]), &Device::flex()),
        matches: Some(Matches {
            pixels,
            valid: Tensor::from_data(TensorData::new(valid, [B, N]), &Device::flex()),
        }),
        up: floats(vec![0.6, 0.0, -0.8, 0.0, 1.0, 0.0], [B, 3]),
        epipolar_normals: Some(normals),
    }
}

/// The values of both views' points, confidences, descriptors and their confidences.
type Values = [[Vec<f64>; 4]; 2];

fn values() -> Values {
    let mut stream = rng(12, "loss", 0, "outputs");
    [0, 1].map(|_| {
        [
            uniform(&mut stream, B * H * W * 3, -2.0, 2.0),
            uniform(&mut stream, B * H * W, 1.1, 4.0),
            uniform(&mut stream, B * H * W * C, -0.5, 0.5),
            uniform(&mut stream, B * H * W, 0.2, 3.0),
        ]
    })
}

fn outputs(values: &Values) -> [ViewOutput; 2] {
    values.clone().map(|[points, confidence, descriptors, descriptor_confidence]| ViewOutput {
        points: floats(points, [B, H, W, 3]).autodiff().require_grad(),
        confidence: floats(confidence, [B, H, W]).autodiff().require_grad(),
        descriptors: floats(descriptors, [B, H, W, C]).autodiff().require_grad(),
        descriptor_confidence: floats(descriptor_confidence, [B, H, W]).autodiff().require_grad(),
    })
}

fn numbers<const D: usize>(tensor: Option<Tensor<D>>) -> Option<Vec<f64>> {
    Some(tensor?.to_data_as::<f64>().try_to_vec().unwrap())
}

/// Compares the gradient of `loss` with differences at a few values of every output that it reads.
fn check(name: &str, loss: impl Fn(&[ViewOutput; 2]) -> Tensor<1>) {
    let at = values();
    let output = outputs(&at);
    let gradients = loss(&output).backward();
    let mut num_read = 0;
    for view in 0..2 {
        let found = [
            numbers(output[view].points.grad(&gradients)),
            numbers(output[view].confidence.grad(&gradients)),
            numbers(output[view].descriptors.grad(&gradients)),
            numbers(output[view].descriptor_confidence.grad(&gradients)),
        ];
        for (part, found) in found.into_iter().enumerate() {
            let Some(found) = found else { continue };
            num_read += 1;
            let largest = found.iter().fold(0.0f64, |max, value| max.max(value.abs()));
            assert!(largest > 0.0 && largest.is_finite(), "{name}: view {view} part {part}");
            for idx in (0..found.len()).step_by(7) {
                let value = |step: f64| {
                    let mut moved = at.clone();
                    moved[view][part][idx] += step;
                    loss(&outputs(&moved)).inner().into_scalar::<f64>()
                };
                let expected = (value(STEP) - value(-STEP)) / (2.0 * STEP);
                let error = (found[idx] - expected).abs() / largest;
                assert!(error < TOLERANCE, "{name}: view {view} part {part} value {idx}: {error:.1e}");
            }
        }
    }
    assert!(num_read >= 2, "{name} reads {num_read} outputs");
}

#[test]
fn gradients_agree_with_finite_differences() {
    for metric in [[false, false], [true, false]] {
        let targets = targets(metric);
        let settings = LossSettings::default();
        check("total", |output| training_loss(output, &targets, &settings).total);
        check("regression", |output| {
            let [a, b] = regression(&normalise(output, &targets), &targets, None);
            masked_mean(a.loss, a.mask) + masked_mean(b.loss, b.mask)
        });
        check("slope", |output| slope(&normalise(output, &targets), &targets));
        check("normals", |output| normals(&normalise(output, &targets), &targets));
        check("epipolar", |output| epipolar(output, targets.epipolar_normals.as_ref().unwrap()));
        let matches = targets.matches.as_ref().unwrap();
        for block in [2, 8192] {
            let settings = MatchingSettings { block, ..MatchingSettings::default() };
            check("matching", |output| matching(output, matches, &settings).weighted);
        }
    }
}

#[test]
fn a_perfect_prediction_costs_nothing_in_any_scale() {
    let targets = targets([false, false]);
    let mut output = outputs(&values());
    for (view, target) in output.iter_mut().zip(&targets.views) {
        view.points = target.points.clone() * 0.01;
    }
    let points = normalise(&output, &targets);
    let [a, b] = regression(&points, &targets, None);
    // Rounding in double precision.
    let zero = |name: &str, value: Tensor<1>| {
        let value = value.into_scalar::<f64>();
        assert!(value.abs() < 1e-12, "{name}: {value:.1e}");
    };
    zero("view A", masked_mean(a.loss, a.mask));
    zero("view B", masked_mean(b.loss, b.mask));
    zero("slope", slope(&points, &targets));
    zero("normals", normals(&points, &targets));
}

#[test]
fn a_pair_without_truth_or_vertical_gives_zero_and_no_nan() {
    let mut targets = targets([false, false]);
    for view in &mut targets.views {
        view.valid = view.valid.clone().bool_and(view.valid.clone().bool_not());
        view.sky = view.valid.clone();
    }
    targets.up = targets.up.zeros_like();
    targets.matches = None;
    let settings = LossSettings { slope_weight: 1.0, normals_weight: 1.0, ..LossSettings::default() };
    let output = outputs(&values());
    let loss = training_loss(&output, &targets, &settings);
    assert_eq!(loss.total.clone().inner().into_scalar::<f64>(), 0.0);
    let gradients = loss.total.backward();
    let points = numbers(output[0].points.grad(&gradients)).unwrap();
    assert!(points.iter().all(|value| *value == 0.0));
}
